"""The plant of the Pinocchio engine: forward dynamics with everything that acts on the leg."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from twin_gait.core.contact import ground_contact_force
from twin_gait.core.integrators import rk4_step, semi_implicit_euler_step
from twin_gait.core.plant import (
    BRACE_WORK,
    CONTACT_WORK,
    FRICTION_WORK,
    MOTOR_WORK,
    PASSIVE_COLUMNS,
    PATIENT_WORK,
    SPRING_WORK,
    STOP_DISSIPATION,
    STOP_LOWER,
    STOP_STIFFNESS,
    STOP_UPPER,
    STOP_WORK,
    brace_torque,
    imposed_motion_torque,
    passive_torque,
)
from twin_gait.experiment import IntegrationMethod
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.scenario.world import World
from twin_gait.simulation.columns import BRACED_WORK_SOURCES, WORK_SOURCES
from twin_gait.vocabulary import Side


class _FootPoints(NamedTuple):
    """Contact points of one foot, in the frame of its joint.

    Attributes:
        joint: Pinocchio's index of the joint that carries the foot.
        points: Positions in [m].
    """

    joint: int
    points: tuple[tuple[float, float, float], ...]


class PinocchioPlant:
    """Forward dynamics with everything that acts on the leg.

    The results of the last evaluation stay readable: passive torques, contact forces, powers.
    """

    def __init__(self, world: World) -> None:
        """Set the plant to the start of the world."""
        self.world = world
        self._chains = [(chain.model, chain.data) for chain in world.chains]
        self.model, self.data = self._chains[-1]  # that stands on the ground
        n, own = len(world.start_q), world.model.nv
        self._parts = [slice(first, first + own) for first in range(0, n, own)]
        self._airborne = _no_forces(self.model.njoints)
        self.q, self.v, self.a = world.start_q.copy(), world.start_v.copy(), np.zeros(n)
        self.motor = np.zeros(n)
        self.wearer = np.zeros(n)
        self.brace = np.zeros(own)
        self.passive = np.zeros((n, PASSIVE_COLUMNS))
        self._rows = [tuple(row) for row in world.plant_rows.tolist()]
        self.imposed_motion = 0.0
        self.time = 0.0
        self.belt_speed = world.belt_speed
        self.contact_power = 0.0
        self.works = np.zeros(len(WORK_SOURCES if world.braces is None else BRACED_WORK_SOURCES))
        self.feet = {side: self._foot(names) for side, names in world.contact_frames.items() if names}
        self.normal_force = dict.fromkeys(self.feet, 0.0)
        self.friction_force = dict.fromkeys(self.feet, 0.0)
        self.clearance = dict.fromkeys(self.feet, 0.0)
        self.external = _no_forces(self.model.njoints)
        self._work = np.zeros((5, n))
        self._work_step = 0.0
        self._last_contact_power = 0.0
        self._contacts_known = False
        self._evaluated = False
        self._recorded_a = np.zeros(n)

    def look(self) -> None:
        """Evaluate the contacts at the present state, for the sensors of this tick."""
        self.update_contacts(self.q, self.v)
        self._contacts_known = True

    def evaluate(self) -> None:
        """Evaluate the present state with the motor torques of this tick, for record and first step."""
        self.acceleration(self.q, self.v, self._recorded_a)
        self._evaluated = True

    def catch(self) -> None:
        """Let the harness lock at the present height of the wearer's pelvis, a stop from below."""
        world, pelvis = self.world, self.world.model.pelvis_index
        if pelvis is None:
            return
        row = list(self._rows[pelvis + world.wearer_shift])
        row[STOP_LOWER], row[STOP_UPPER] = float(self.q[pelvis + world.wearer_shift]), np.inf
        row[STOP_STIFFNESS], row[STOP_DISSIPATION] = world.catch_stiffness, world.catch_dissipation
        self._rows[pelvis + world.wearer_shift] = tuple(row)

    def _foot(self, names: tuple[str, ...]) -> _FootPoints:
        frames = [self.model.frames[self.model.getFrameId(name)] for name in names]
        points = tuple(tuple(float(x) for x in frame.placement.translation) for frame in frames)
        return _FootPoints(int(frames[0].parentJoint), points)  # type: ignore[arg-type]

    def update_contacts(self, q: np.ndarray, v: np.ndarray) -> None:
        """Contact forces at a state, per foot and as external forces on the joints."""
        if not self.feet or self.world.contact is None:
            return
        contact, part = self.world.contact, self._parts[-1]
        pin.forwardKinematics(self.model, self.data, q[part], v[part])
        power = 0.0
        for side, foot in self.feet.items():
            placement = self.data.oMi[foot.joint]
            (r00, r01, r02), _, (r20, r21, r22) = placement.rotation.tolist()
            height = placement.translation.tolist()[2]
            heights = [height + r20 * x + r21 * y + r22 * z for x, y, z in foot.points]
            self.clearance[side] = min(heights)
            loaded = self.normal_force[side] > 0.0
            if self.clearance[side] >= 0.0:
                self.normal_force[side] = self.friction_force[side] = 0.0
                if loaded:
                    self.external[foot.joint] = pin.Force.Zero()
                continue
            lx, ly, lz, wx, wy, wz = self.data.v[foot.joint].vector.tolist()
            normal = friction = fx = fy = fz = mx = my = mz = 0.0
            for (x, y, z), point_height in zip(foot.points, heights, strict=True):
                if point_height >= 0.0:
                    continue
                ux, uy, uz = lx + wy * z - wz * y, ly + wz * x - wx * z, lz + wx * y - wy * x
                forward = r00 * ux + r01 * uy + r02 * uz
                upward = r20 * ux + r21 * uy + r22 * uz
                along, up = ground_contact_force(
                    point_height,
                    forward,
                    upward,
                    self.belt_speed,
                    contact.stiffness,
                    contact.dissipation,
                    contact.friction_coefficient,
                    contact.transition_velocity,
                )
                normal += up
                friction += along
                power += along * forward + up * upward
                px, py, pz = r00 * along + r20 * up, r01 * along + r21 * up, r02 * along + r22 * up
                fx, fy, fz = fx + px, fy + py, fz + pz
                mx, my, mz = mx + y * pz - z * py, my + z * px - x * pz, mz + x * py - y * px
            self.normal_force[side], self.friction_force[side] = normal, friction
            if normal > 0.0 or loaded:
                self.external[foot.joint] = pin.Force(np.array([fx, fy, fz, mx, my, mz]))
        self.contact_power = power

    def ground_wrench(self, side: Side) -> np.ndarray:
        """What the ground does on a foot at the last evaluation of the contacts.

        Returns:
            Force in [N] and moment about the origin of the world in [N m], shape ``(6,)``.
        """
        joint = self.feet[side].joint
        return np.array(self.data.oMi[joint].act(self.external[joint]).vector)

    def acceleration(self, q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        """Accelerations of a state; keeps the torques and forces of this evaluation."""
        if self._evaluated:
            # The first evaluation of a tick is that of the record: same state, same motor torque.
            self._evaluated = False
            out[:] = self._recorded_a
            return
        # Python numbers are several times faster here than numpy's scalars.
        parts = [
            passive_torque(angle, velocity, load, *row)
            for angle, velocity, load, row in zip(
                q.tolist(), v.tolist(), self.motor.tolist(), self._rows, strict=True
            )
        ]
        self.passive[:] = parts
        torque = self.motor + self.wearer + [friction + stop + spring for friction, stop, spring in parts]
        imposed_motion = self.world.imposed_motion
        if imposed_motion is not None:
            self.imposed_motion = imposed_motion_torque(
                self.time,
                q[imposed_motion.index],
                v[imposed_motion.index],
                imposed_motion.start_angle,
                imposed_motion.amplitude,
                imposed_motion.frequency,
                imposed_motion.stiffness,
                imposed_motion.damping,
                imposed_motion.release_time,
            )
            torque[imposed_motion.index] += self.imposed_motion
        if self.world.braces is not None:
            self._bind(q, v, torque)
        if self._contacts_known:
            self._contacts_known = False
        else:
            self.update_contacts(q, v)
        for (model, data), part, forces in zip(self._chains, self._parts, self._forces(), strict=True):
            out[part] = pin.aba(model, data, q[part], v[part], torque[part], forces)

    def _forces(self) -> list[pin.StdVec_Force]:
        """Forces from outside on the bodies of each chain: the ground pushes on the last."""
        return [self._airborne] * (len(self._chains) - 1) + [self.external]

    def _bind(self, q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> None:
        """Torques of the braces, equal and opposite on device and wearer."""
        assert self.world.braces is not None  # the caller has looked
        device, wearer = self._parts
        for index, (stiffness, damping) in enumerate(self.world.braces.rows.tolist()):
            self.brace[index] = brace_torque(
                q[device][index], v[device][index], q[wearer][index], v[wearer][index], stiffness, damping
            )
        torque[device] -= self.brace
        torque[wearer] += self.brace

    def step(self, step: float, method: IntegrationMethod) -> None:
        """One integration step, with the work that every source does in it."""
        if method is IntegrationMethod.RK4:
            self._work_step = step
            rk4_step(self._staged, None, self.q, self.v, step, self._work)
            return
        before = self.v.copy()
        semi_implicit_euler_step(self._single, None, self.q, self.v, step, self.a)
        # Torques work on the mean of old and new velocity, which closes the balance of this method.
        # The contact is only known at its evaluations: trapezoid between this one and the last.
        contact = 0.5 * (self.contact_power + self._last_contact_power)
        self._last_contact_power = self.contact_power
        self._add_work(step, contact, 0.5 * (before + self.v))

    def _single(
        self, context: None, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray
    ) -> None:
        self.acceleration(q, v, out)

    def _staged(
        self, context: None, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray
    ) -> None:
        start = self.time
        self.time = start + offset * self._work_step
        self.acceleration(q, v, out)
        self.time = start
        self._add_work(weight * self._work_step, self.contact_power, v)

    def _add_work(self, duration: float, contact_power: float, v: np.ndarray) -> None:
        """Add the work that every source does on the leg in a short time."""
        friction, stop, spring = v @ self.passive
        self.works[MOTOR_WORK] += duration * (self.motor @ v)
        self.works[FRICTION_WORK] += duration * friction
        self.works[STOP_WORK] += duration * stop
        self.works[SPRING_WORK] += duration * spring
        self.works[CONTACT_WORK] += duration * contact_power
        self.works[PATIENT_WORK] += duration * (self.wearer @ v)
        if self.world.braces is not None:
            device, wearer = self._parts
            self.works[BRACE_WORK] += duration * (self.brace @ (v[wearer] - v[device]))
        if self.world.imposed_motion is not None:
            self.works[PATIENT_WORK] += duration * self.imposed_motion * v[self.world.imposed_motion.index]

    def guide_wrench(self) -> tuple[float, float]:
        """Horizontal force [N] and pitching moment [N m] of the pelvis guide at the present state.

        With braces, those of both guides, each moment about its own pelvis.
        """
        force = moment = 0.0
        for (model, data), part, forces in zip(self._chains, self._parts, self._forces(), strict=True):
            pin.rnea(model, data, self.q[part], self.v[part], self._recorded_a[part], forces)
            wrench = data.f[int(model.getJointId(PELVIS_JOINT))]
            force, moment = force + float(wrench.linear[0]), moment + float(wrench.angular[1])
        return force, moment

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy of the bodies in [J]."""
        kinetic = potential = 0.0
        for chain, part in zip(self.world.chains, self._parts, strict=True):
            kinetic += chain.kinetic_energy(self.q[part], self.v[part])
            potential += chain.potential_energy(self.q[part])
        return kinetic, potential


def _no_forces(joints: int) -> pin.StdVec_Force:
    forces = pin.StdVec_Force()
    for _ in range(joints):
        forces.append(pin.Force.Zero())
    return forces
