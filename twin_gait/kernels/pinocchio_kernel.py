"""Rigid-body dynamics by Pinocchio with the interface of the generated kernels.

It shares the laws of :mod:`twin_gait.core` and the steps of a tick with the compiled engine, but not the
dynamics; therefore the compiled engine is checked against it.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from twin_gait.core.contact import ContactState, Ground, ground_contact_force, sloped_contact_force
from twin_gait.leg_model.bodies import contact_points
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.vocabulary import Side
from twin_gait.worlds.world import World

Row: TypeAlias = list[float]
Points: TypeAlias = list[ContactState]


class _Foot(NamedTuple):
    """Foot: Pinocchio's index of its joint, index of its first point, positions of its points in [m]."""

    joint: int
    first: int
    points: list[list[float]]


class GroundContacts:
    """Forces of the ground on the feet of a model, by the law of :mod:`twin_gait.core.contact`.

    Attributes:
        forces: External forces on the bodies in the form of Pinocchio, from the last evaluation.
    """

    def __init__(self, world: World) -> None:
        """Find the feet of the device, or those of the wearer if there are braces."""
        self.model, self.data = world.chains[-1].model, world.chains[-1].data
        self.forces = zero_forces(self.model)
        self.feet: dict[Side, _Foot] = {}
        first = 0
        for side in world.model.sides:
            points = contact_points(self.model, world.contact_frames.get(side, ()))
            if points:
                self.feet[side] = _Foot(points[0].body + 1, first, [point.position for point in points])
            first += len(points)

    def update(self, q: np.ndarray, v: np.ndarray, ground: Ground, points: Points) -> float:
        """Write the forces in a state to the points of the soles, and return their power in [W]."""
        pin.forwardKinematics(self.model, self.data, q, v)
        return sum(self._apply_foot_forces(foot, ground, points) for foot in self.feet.values())

    def _apply_foot_forces(self, foot: _Foot, ground: Ground, points: Points) -> float:
        """Compute the forces on the points of a foot and their sum at its joint; return the power in [W]."""
        placement = self.data.oMi[foot.joint]
        # Python numbers are several times faster here than numpy's scalars.
        (r00, r01, r02), _, (r20, r21, r22) = placement.rotation.tolist()
        ahead, _, height = placement.translation.tolist()
        lx, ly, lz, wx, wy, wz = self.data.v[foot.joint].vector.tolist()
        heel = ground.stiffness, ground.dissipation
        forefoot = ground.forefoot_stiffness, ground.forefoot_dissipation
        power = fx = fy = fz = mx = my = mz = 0.0
        for number, (x, y, z) in enumerate(foot.points, start=foot.first):
            point = points[number]
            press = partial(ground_contact_force, ground, *(heel if number == foot.first else forefoot))
            position = ahead + r00 * x + r01 * y + r02 * z, height + r20 * x + r21 * y + r22 * z
            ux, uy, uz = lx + wy * z - wz * y, ly + wz * x - wx * z, lz + wx * y - wy * x
            forward = r00 * ux + r01 * uy + r02 * uz
            upward = r20 * ux + r21 * uy + r22 * uz
            along, up, point.height = sloped_contact_force(
                ground.slope_sine, ground.slope_cosine, position, (forward, upward), press
            )
            point.forward, point.upward = along, up
            power += along * forward + up * upward
            px, py, pz = r00 * along + r20 * up, r01 * along + r21 * up, r02 * along + r22 * up
            fx, fy, fz = fx + px, fy + py, fz + pz
            mx, my, mz = mx + y * pz - z * py, my + z * px - x * pz, mz + x * py - y * px
        self.forces[foot.joint] = pin.Force(np.array([fx, fy, fz, mx, my, mz]))
        return power

    def wrench(self, side: Side) -> np.ndarray:
        """Return force [N] and moment about the world origin [N·m] on a foot, shape ``(6,)``."""
        joint = self.feet[side].joint
        return np.array(self.data.oMi[joint].act(self.forces[joint]).vector)


class PinocchioKernel:
    """Functions of a kernel; see :mod:`twin_gait.simulation.backend`."""

    def __init__(self, world: World, control_model: LegModel) -> None:
        """Store the models of a world and of its controller."""
        width, self._control = world.model.nv, control_model
        self._contacts = GroundContacts(world)
        airborne = [zero_forces(chain.model) for chain in world.chains[:-1]]
        parts = [slice(width * number, width * (number + 1)) for number in range(len(world.chains))]
        self._chains = list(zip(world.chains, parts, [*airborne, self._contacts.forces], strict=True))
        self._moved = [chain.model.copy() for chain in world.chains]  # The inertias of their rotors change.
        self._guided = world.model.pelvis_index is not None

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        """Functions of the kernel by name, for the specialisation of the engine."""
        found = (self.dynamics, self.contact_forces, self.observe, self.control_gravity, self.control_inertia)
        return {function.__name__: function for function in found}

    def dynamics(
        self,
        q: Row,
        v: Row,
        torque: Row,
        rotors: Row,
        bodies: Row,
        gravity: float,
        ground: Ground,
        a: Row,
        points: Points,
    ) -> float:
        """Write accelerations (articulated-body algorithm) to ``a``; return the contact power in [W]."""
        power = self.contact_forces(q, v, bodies, ground, points)
        whole_q, whole_v, whole_torque, whole_rotors = map(np.array, (q, v, torque, rotors))
        for model, (chain, part, forces) in zip(self._moved, self._chains, strict=True):
            model.armature = whole_rotors[part]
            found = pin.aba(model, chain.data, whole_q[part], whole_v[part], whole_torque[part], forces)
            a[part] = found.tolist()
        return power

    def contact_forces(self, q: Row, v: Row, bodies: Row, ground: Ground, points: Points) -> float:
        """Write the contact forces of a state to ``points``; return their power in [W]."""
        if not self._contacts.feet:
            return 0.0
        _, part, _ = self._chains[-1]
        return self._contacts.update(np.array(q[part]), np.array(v[part]), ground, points)

    def observe(
        self, q: Row, v: Row, a: Row, bodies: Row, gravity: float, points: object
    ) -> tuple[float, float, float, float]:
        """Return kinetic and potential energy [J], forward force [N] and pitch moment [N·m] of the guides.

        Force and moment come from inverse dynamics, each about its own pelvis, summed over the chains.
        """
        kinetic = potential = force = moment = 0.0
        whole_q, whole_v, whole_a = np.array(q), np.array(v), np.array(a)
        for chain, part, forces in self._chains:
            kinetic += chain.kinetic_energy(whole_q[part], whole_v[part])
            potential += chain.potential_energy(whole_q[part])
            if self._guided:
                pin.rnea(chain.model, chain.data, whole_q[part], whole_v[part], whole_a[part], forces)
                wrench = chain.data.f[int(chain.model.getJointId(PELVIS_JOINT))]
                force, moment = force + float(wrench.linear[0]), moment + float(wrench.angular[1])
        return kinetic, potential, force, moment

    def control_gravity(self, q: Row, bodies: Row, gravity: float, torque: Row) -> None:
        """Write the gravity torques of the controller's model in [N·m] to ``torque``."""
        torque[:] = self._control.gravity_torque(np.array(q)).tolist()

    def control_inertia(self, q: Row, a: Row, bodies: Row, torque: Row) -> None:
        """Write the inertia torques of the controller's model in [N·m] to ``torque``."""
        torque[:] = self._control.inertia_torque(np.array(q), np.array(a)).tolist()


def zero_forces(model: pin.Model) -> pin.StdVec_Force:
    """Return zero external forces on the bodies of a model."""
    return pin.StdVec_Force([pin.Force.Zero()] * model.njoints)
