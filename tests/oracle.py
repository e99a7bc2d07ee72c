"""Independent second implementation of the loop: numpy laws, ``transitions`` and ``pin.aba``.

It shares data with the package (URDF, gait table, parameters) but none of its steps, records of an episode
or laws, so that the engines can be compared with it. It has ideal sensors, the controller of the thesis and
no safety monitor; the contact law is the formula of the package, written for arrays.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from oracle_arms import UpperBody
from transitions import Machine

from twin_gait.experiment.experiment import IntegrationMethod
from twin_gait.gait.guards import AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import OTHER, signal_scale
from twin_gait.gait.table import TICK, BlendingLaw, GaitTable
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.simulation_setup import SimulationSetup

# Parameters a, b, c, d of equation (3.1) of the thesis.
LAW = ("breakaway_torque", "coulomb_friction", "breakaway_velocity", "viscous_friction")


def _columns(rows: Sequence[Any], names: Sequence[str]) -> np.ndarray:
    """Return attributes of all joints, shape ``(len(names), n)``."""
    return np.array([[getattr(row, name) for row in rows] for name in names])


def friction_torque(velocity: np.ndarray, law: np.ndarray) -> np.ndarray:
    """Compute the friction torques of all joints by equation (3.1) of the thesis.

    Args:
        velocity: Velocities in [rad/s], shape ``(n,)``.
        law: Rows of the parameters a, b, c and d, shape ``(4, n)``.

    Returns:
        Torques with the sign of the velocity in [N·m], shape ``(n,)``.
    """
    a, b, c, d = law
    bump = np.sqrt(2.0 * np.e) * (a - b) * np.exp(-((velocity / c) ** 2)) * (velocity / c)
    return np.asarray(bump + b * np.tanh(velocity / (c / 10.0)) + d * velocity)


class PhaseMachine:
    """Phase of one leg by the library ``transitions``, with Python functions as conditions."""

    def __init__(self, table: GaitTable, initial: str | None) -> None:
        """Add every transition of a gait table under one trigger.

        Args:
            table: Gait table of the device or of the wearer.
            initial: Phase at the start; the first phase if the table does not have it.
        """
        self.signals: dict[str, float] = {}
        self.other_phase: str | None = None
        self.tick = self.entry = 0
        self._debounce = [0] * len(table.transitions)
        machine = Machine(
            model=self,
            states=list(table.phase_names),
            initial=initial if initial in table.phases else table.phase_names[0],
            model_attribute="phase",
            auto_transitions=False,
        )
        for number, item in enumerate(table.transitions):
            ticks = max(item.timeout_ticks or 0, table.phases[item.source].minimum_ticks)
            condition = self._condition(number, self._guard(item.guard), ticks, item.debounce_ticks)
            machine.add_transition("advance", item.source, item.target, conditions=condition, after="enter")
        # From here on the machine updates the attribute.
        self.phase: str

    def enter(self) -> None:
        """Begin a phase."""
        self.entry = self.tick
        self._debounce = [0] * len(self._debounce)

    def _condition(
        self, number: int, guard: Callable[[], bool], ticks: int, debounce: int
    ) -> Callable[[], bool]:
        def due() -> bool:
            self._debounce[number] = self._debounce[number] + 1 if guard() else 0
            return self._debounce[number] >= debounce and self.tick - self.entry >= ticks

        return due

    def _guard(self, guard: Guard) -> Callable[[], bool]:
        if isinstance(guard, PhaseMembership):
            members = guard.phases
            return lambda: self.other_phase in members
        if isinstance(guard, Comparison):
            return self._comparison(guard)
        parts = [self._guard(part) for part in guard.guards]
        if isinstance(guard, AnyOf):
            return lambda: any(part() for part in parts)
        return lambda: all(part() for part in parts)

    def _comparison(self, guard: Comparison) -> Callable[[], bool]:
        name, minus = guard.signal, guard.minus
        threshold = guard.threshold * signal_scale(name)
        above = guard.operator == ">"

        def holds() -> bool:
            value = self.signals[name] - (0.0 if minus is None else self.signals[minus])
            return value > threshold if above else value < threshold

        return holds


class Controller:
    """Measurement, state machines and control law of one run."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Read the parameters for ideal sensors, which may have an offset."""
        experiment = problem.experiment
        self._problem = problem
        self._sensors, self._gain = experiment.sensors, problem.fast_gain
        offsets = experiment.sensors.offset
        self._offset = np.array([offsets.get(item.side, {}).get(item.joint, 0.0) for item in problem.joints])
        limits = [experiment.control.limits[joint.joint] for joint in problem.joints]
        self._torque_limit = np.array([item.torque for item in limits])
        self._current_limit = np.array([item.current for item in limits])
        self._battery = experiment.plant.battery
        self._index = np.array([joint.coordinate for joint in problem.joints])
        self._control_index = np.array([joint.control_coordinate for joint in problem.joints])
        models = [experiment.control.friction_model[joint.joint] for joint in problem.joints]
        self._law = _columns(models, LAW)
        self._target = np.array(
            [experiment.control.target_torque.get(joint.joint, 0.0) for joint in problem.joints]
        )
        actuators = [problem.actuator(joint) for joint in problem.joints]
        self._constant = np.array([item.torque_constant * item.gear_ratio for item in actuators])
        self._resistance = np.array([item.resistance for item in actuators])
        self._electronics = experiment.plant.electronics
        self._resistance += self._electronics.inverter_resistance
        count = len(problem.joints)
        self._angle = self._sampled = np.zeros(count)
        self._fast = self._slow = np.zeros(count)
        window = self._sensors.window
        self._samples: deque[np.ndarray] = deque([np.zeros(count)] * window, maxlen=window)
        self._voltage = self._battery.voltage
        starts = problem.world.initial_phases
        self.machines = {side: PhaseMachine(problem.table, starts[side]) for side in problem.sides}
        feet = problem.world.model.sides
        self._feet = [feet.index(side) for side in problem.sides]  # the other leg may have no device
        self.may_step = True  # the step command of the person with crutches
        self._blended = problem.phase_rows[np.arange(len(self.machines)), self.phases()]
        self._start = self._blended.copy()

    def phases(self) -> list[int]:
        """Return the phase of every leg as its index in the table."""
        return [self._problem.table.phase_index(machine.phase) for machine in self.machines.values()]

    def torque(self, tick: int, q: np.ndarray, v: np.ndarray, loads: list[float]) -> np.ndarray:
        """Compute the motor torques of a tick on all coordinates in [N·m], shape ``(nv,)``.

        Args:
            loads: Foot loads over body weight.
        """
        self._loads = loads
        self._measure(tick, q[self._index] + self._offset)
        pitch = self._problem.world.model.pitch_index
        self._device = {
            "trunk.pitch_deg": 0.0 if pitch is None else float(q[pitch]),
            "walk": 1.0,
            "step": float(self.may_step),
        }
        self._decide(tick)
        stiffness, damping, equilibrium, gain = self._parameters()
        command = -(stiffness * (self._angle - equilibrium) + damping * self._fast)
        command = command + gain * friction_torque(self._slow, self._law) + self._gravity() + self._target
        torque = np.zeros(len(q))
        torque[self._index] = self._drive(command, v[self._index])
        return torque

    def _measure(self, tick: int, angle: np.ndarray) -> None:
        if tick == 0:
            self._angle = self._sampled = angle
            return
        self._fast = self._fast + self._gain * ((angle - self._angle) / TICK - self._fast)
        self._angle = angle
        decimation = self._sensors.decimation
        if tick % decimation == 0:
            self._samples.append((angle - self._sampled) / (decimation * TICK))
            self._sampled = angle
            self._slow = np.mean(self._samples, axis=0)

    def _signals(self, leg: int, prefix: str) -> dict[str, float]:
        joints = self._problem.table.joints
        signals = {f"{prefix}foot.load_bw": self._loads[self._feet[leg]]}
        for position, joint in enumerate(joints):
            number = leg * len(joints) + position
            signals[f"{prefix}{joint}.angle_deg"] = float(self._angle[number])
            signals[f"{prefix}{joint}.velocity_deg_per_s"] = float(self._fast[number])
        return signals

    def _decide(self, tick: int) -> None:
        machines = list(self.machines.values())
        before = [machine.phase for machine in machines]
        entries = [machine.entry for machine in machines]
        for leg, machine in enumerate(machines):
            machine.tick = tick
            machine.signals = {
                **self._device,
                **self._signals(leg, ""),
                "time_in_phase_s": (tick - entries[leg]) * TICK,
            }
            if len(machines) == 2:
                other = 1 - leg
                machine.signals |= self._signals(other, OTHER)
                machine.signals[f"{OTHER}time_in_phase_s"] = (tick - entries[other]) * TICK
                machine.other_phase = before[other]
            if machine.advance():
                self._start[leg] = self._blended[leg]
        self._blend(tick)

    def _blend(self, tick: int) -> None:
        table = self._problem.table
        for leg, machine in enumerate(self.machines.values()):
            share = 1.0
            if table.blending.duration_ticks > 0 and table.blending.law is not BlendingLaw.NONE:
                share = min((tick - machine.entry) / table.blending.duration_ticks, 1.0)
            if table.blending.law is BlendingLaw.MINIMUM_JERK:
                share = 10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5
            target = self._problem.phase_rows[leg, table.phase_index(machine.phase)]
            self._blended[leg] = self._start[leg] + share * (target - self._start[leg])

    def _parameters(self) -> np.ndarray:
        """Return k, b, θ0 and G of all joints, shape ``(4, n_joints)``."""
        return self._blended[:, :-1].reshape(-1, 4).T

    def _gravity(self) -> np.ndarray:
        model = self._problem.control_model
        q = np.zeros(model.nv)
        q[self._control_index] = self._angle
        torque = pin.computeGeneralizedGravity(model.model, model.data, q)[self._control_index]
        return np.asarray(np.repeat(self._blended[:, -1], self._problem.joints_per_leg) * torque)

    def _drive(self, command: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        limited = np.clip(command, -self._torque_limit, self._torque_limit)
        current = np.clip(limited / self._constant, -self._current_limit, self._current_limit)
        back_emf = self._constant * velocity
        current = np.clip(
            current,
            (-self._voltage - back_emf) / self._resistance,
            (self._voltage - back_emf) / self._resistance,
        )
        power = float(np.sum(self._resistance * current**2 + back_emf * current))
        power += self._electronics.constant_power + len(current) * self._electronics.inverter_power
        power = max(power, 0.0) + self._electronics.regeneration * min(power, 0.0)
        self._voltage = self._battery.voltage - self._battery.internal_resistance * power / self._voltage
        return np.asarray(self._constant * current)


class LegPlant:
    """Passive torques, contact and forward dynamics."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Read the parameters."""
        world = problem.world
        self.world, self.model, self.data = world, world.model.model, world.model.data
        n = world.model.nv
        self._law, self._efficiency = np.zeros((4, n)), np.ones(n)
        self._law[2] = 1.0  # for coordinates without friction and motor
        self._armature = self.model.armature
        given = problem.experiment.plant
        for item in problem.joints:
            self._law[:, item.coordinate] = _columns([given.true_friction()[item.joint]], LAW)[:, 0]
            self._efficiency[item.coordinate] = given.actuators[item.joint].gear_efficiency
        self._stops = _columns(
            [row.stop for row in world.plant[:n]], ("lower", "upper", "stiffness", "dissipation")
        )
        self._springs = _columns([row.spring for row in world.plant[:n]], ("stiffness", "damping", "force"))
        frames = [name for names in world.contact_frames.values() for name in names]
        self._frames = [self.model.getFrameId(name) for name in frames]
        self._normal = dict.fromkeys(self._frames, 0.0)
        self._heels = {self.model.getFrameId(names[0]) for names in world.contact_frames.values() if names}
        self.upper_body = UpperBody(problem, self._normal_force) if world.arms else None
        self.muscles: OwnGait | None = None
        self._straps = None if world.trunk is None or world.arms else Straps(problem)

    def passive_torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Compute friction without load, stops, springs and support on the coordinates, shape ``(nv,)``."""
        lower, upper, hardness, dissipation = self._stops
        below = hardness * np.maximum(lower - q, 0.0) * np.maximum(1.0 - dissipation * v, 0.0)
        above = hardness * np.maximum(q - upper, 0.0) * np.maximum(1.0 + dissipation * v, 0.0)
        stiffness, damping, force = self._springs
        lost = friction_torque(v, self._law)
        own = np.zeros(len(q)) if self.muscles is None else self.muscles.torque(q, v)
        if self._straps is not None:
            own += self._straps.torque(q, v)
        return np.asarray(force - stiffness * q - damping * v + below - above - lost + own)

    def _lost_share(self, v: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Compute the lost share of a gear's load: output over load is η driving, 1 at rest, 1/η driven."""
        drives, eta = signs * np.tanh(v / np.abs(self._law[2] / 10.0)), self._efficiency
        ends = 0.5 * drives * ((drives - 1.0) / eta + (drives + 1.0) * eta)
        return np.asarray(drives**2 - ends)

    def _geared_acceleration(
        self, q: np.ndarray, v: np.ndarray, motor: np.ndarray, passive: np.ndarray, forces: Any
    ) -> np.ndarray:
        """Solve for every combination of signs of the loads, and return the consistent accelerations."""
        upper = np.triu(pin.crba(self.model, self.data, q))
        mass = upper + np.triu(upper, 1).T
        right = motor + passive - pin.rnea(self.model, self.data, q, v, np.zeros(len(q)), *forces)
        lossy, found, best = np.flatnonzero(self._efficiency < 1.0), np.zeros(len(q)), -np.inf
        for signs in product((-1.0, 1.0), repeat=len(lossy)):
            of_all = np.ones(len(q))
            of_all[lossy] = signs
            share = self._lost_share(v, of_all)
            a = np.linalg.solve(mass - np.diag(share * self._armature), right - share * motor)
            agreement = np.min((of_all * (motor - self._armature * a))[lossy], initial=0.0)
            if agreement > best:
                found, best = a, agreement
        return found

    def acceleration(self, q: np.ndarray, v: np.ndarray, motor: np.ndarray) -> np.ndarray:
        """Compute the accelerations under motors, passive torques and contact, shape ``(nv,)``."""
        n = self.model.nv
        torque = np.zeros(len(q)) if self.upper_body is None else self.upper_body.torque(q, v)
        body = torque[:n] + self.passive_torque(q[:n], v[:n])
        if self.upper_body is not None:
            body += self.upper_body.react(q, v, torque)
        forces = (self._contact_forces(q[:n], v[:n]),) if self._frames else ()
        legs = self._geared_acceleration(q[:n], v[:n], motor[:n], body, forces)
        tips = [] if self.upper_body is None else self.upper_body.accelerate(q, v, torque, legs)
        return np.array([*legs, *tips])

    def loads(self, q: np.ndarray, v: np.ndarray) -> list[float]:
        """Return the normal force of the ground on each foot over body weight."""
        sides = len(self.world.model.sides)
        if self._frames:
            self._contact_forces(q[: self.model.nv], v[: self.model.nv])
        pressed = np.array(list(self._normal.values())).reshape(sides, -1).sum(axis=1)
        return [float(value) for value in pressed / self.world.body_weight]

    def _pressed(self, height: float, along: float, up: float, heel: bool) -> tuple[float, float]:
        """Compute the friction and normal force of the ground on a point in [N]."""
        law, normal = self.world.contact, self._normal_force(height, up, heel)
        assert law is not None  # there are contact frames
        slip = along + self.world.belt.cruise
        return -law.friction_coefficient * normal * np.tanh(slip / law.transition_velocity), normal

    def _normal_force(self, height: float, up: float, heel: bool = True) -> float:
        """Compute the normal force of the ground on a heel (or the tip of a crutch) or a forefoot in [N]."""
        law = self.world.contact
        assert law is not None
        stiffness, dissipation = law.stiffness, law.dissipation
        if not heel and law.forefoot_stiffness is not None:
            stiffness = law.forefoot_stiffness
        if not heel and law.forefoot_dissipation is not None:
            dissipation = law.forefoot_dissipation
        return stiffness * max(-height, 0.0) ** 1.5 * max(0.0, 1.0 - 1.5 * dissipation * up)

    def _contact_forces(self, q: np.ndarray, v: np.ndarray) -> Any:
        pin.forwardKinematics(self.model, self.data, q, v)
        forces = pin.StdVec_Force()
        forces.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        for number in self._frames:
            frame = self.model.frames[number]
            height = pin.updateFramePlacement(self.model, self.data, number).translation[2]
            velocity = pin.getFrameVelocity(
                self.model, self.data, number, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            ).linear
            friction, normal = self._pressed(height, velocity[0], velocity[2], number in self._heels)
            self._normal[number] = normal
            placement = self.data.oMf[number]
            local = placement.rotation.T @ np.array([friction, 0.0, normal])
            forces[frame.parentJoint] += frame.placement.act(pin.Force(local, np.zeros(3)))
        return forces

    def step(self, q: np.ndarray, v: np.ndarray, motor: np.ndarray, h: float, rk4: bool) -> Any:
        """Return coordinates and velocities after a step of semi-implicit Euler or Runge-Kutta."""
        if not rk4:
            v = v + h * self.acceleration(q, v, motor)
            return q + h * v, v
        a1 = self.acceleration(q, v, motor)
        v2 = v + 0.5 * h * a1
        a2 = self.acceleration(q + 0.5 * h * v, v2, motor)
        v3 = v + 0.5 * h * a2
        a3 = self.acceleration(q + 0.5 * h * v2, v3, motor)
        v4 = v + h * a3
        a4 = self.acceleration(q + h * v3, v4, motor)
        return q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


class Straps:
    """Level bar on a winch with a strap in front of and one behind the trunk, by forces at two points."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Read the parameters of the harness of a treadmill."""
        support, patient = problem.experiment.scenario.support, problem.experiment.patient  # type: ignore[attr-defined]
        assert patient is not None
        model, reach = problem.world.model, support.strap_lever if support.pitch == "soft" else 0.0
        self._support, self._height, self._pitch = support, model.pelvis_index, model.pitch_index
        self._force = support.share * model.total_mass * problem.experiment.plant.gravity
        # Attachments relative to the hips of an upright trunk, as complex numbers: forwards, upwards.
        self._ends = np.array([reach, -reach]) + 1j * support.height * patient.height
        # The strap in front is longer by this, so that both have the same tension at the set lean.
        self._longer = 2.0 * reach * np.sin(support.strap_lean)

    def torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Compute the torques of both straps on the coordinates, shape ``(nv,)``."""
        ends = self._ends * np.exp(-1j * q[self._pitch])
        speeds = v[self._height] - ends.real * v[self._pitch]
        force = self._force - self._support.damping * speeds.mean()
        stretched = (np.diff(ends.imag)[0] - self._longer) * self._support.strap_stiffness
        stretched += np.diff(speeds)[0] * self._support.strap_damping
        front = np.clip(0.5 * (force + stretched), 0.0, force)
        pulls, found = np.array([front, force - front]), np.zeros(len(q))
        found[self._height], found[self._pitch] = force, -pulls @ ends.real
        return found


class OwnGait:
    """Wearer's own gait: springs and dampers of the phases of a second table, at joints without a drive."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Read the wearer's table after scaling, and the strength of the muscles."""
        rows, own = problem.own_gait, problem.experiment.own_gait
        assert rows is not None and own is not None
        self._table, self._numbers = rows.table, rows.phase_rows
        sides, starts = problem.world.model.sides, problem.world.initial_phases
        self.machines = [PhaseMachine(rows.table, starts[side]) for side in sides]
        self._index = np.array([[problem.world.model.index(s, j) for j in own.joints] for s in sides])
        driven = {(joint.side, joint.joint) for joint in problem.joints}
        self._strength = np.array(
            [[0.0 if (s, j) in driven else own.peak_torque[j] for j in own.joints] for s in sides]
        )
        self._blended = np.array([self._row(leg) for leg in range(len(sides))])
        self._start = self._blended.copy()
        q = problem.world.start_q[self._index]
        rest = (q, np.zeros_like(q), np.zeros(len(sides)))
        self._perceived = deque([rest] * (own.delay_ticks + 1), maxlen=own.delay_ticks + 1)

    def _row(self, leg: int) -> np.ndarray:
        phase = self._table.phase_index(self.machines[leg].phase)
        return np.asarray(self._numbers[leg, phase, :-1].reshape(-1, 4))

    def decide(self, tick: int, q: np.ndarray, v: np.ndarray, loads: list[float]) -> None:
        """Perceive late, change phases, and blend the impedances."""
        self._perceived.append((q[self._index], v[self._index], np.array(loads)))
        angle, speed, load = self._perceived[0]
        before = [machine.phase for machine in self.machines]
        entries = [machine.entry for machine in self.machines]

        def signals(leg: int, prefix: str) -> dict[str, float]:
            found = {f"{prefix}foot.load_bw": float(load[leg])}
            found[f"{prefix}time_in_phase_s"] = (tick - entries[leg]) * TICK
            for number, joint in enumerate(self._table.joints):
                found[f"{prefix}{joint}.angle_deg"] = float(angle[leg, number])
                found[f"{prefix}{joint}.velocity_deg_per_s"] = float(speed[leg, number])
            return found

        for leg, machine in enumerate(self.machines):
            machine.tick, machine.other_phase = tick, before[1 - leg]
            machine.signals = signals(leg, "") | signals(1 - leg, OTHER)
            if machine.advance():
                self._start[leg] = self._blended[leg]
            share = min((tick - machine.entry) / self._table.blending.duration_ticks, 1.0)
            share = 10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5
            self._blended[leg] = self._start[leg] + share * (self._row(leg) - self._start[leg])

    def torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Compute the torques of the muscles on the coordinates in [N·m], shape ``(nv,)``."""
        stiffness, damping, rest, _ = np.moveaxis(self._blended, -1, 0)
        own = -stiffness * (q[self._index] - rest) - damping * v[self._index]
        found = np.zeros(len(q))
        found[self._index] = np.clip(own, -self._strength, self._strength)
        return found


class RecordedMotion(NamedTuple):
    """Trace of the loop with a row for each tick.

    Attributes:
        q: Coordinates, shape ``(n, nv)``.
        motor: Motor torques on the coordinates in [N·m], shape ``(n, nv)``.
        phases: Phase of every leg as its index in the table, shape ``(n, n_legs)``.
    """

    q: np.ndarray
    motor: np.ndarray
    phases: np.ndarray


def motion(problem: SimulationSetup, ticks: int) -> RecordedMotion:
    """Simulate a number of ticks of a problem and return their trace."""
    _require_known(problem)
    stepping, world = problem.experiment.resolved_integration, problem.world
    rk4 = stepping.method is IntegrationMethod.RK4
    controller, leg = Controller(problem), LegPlant(problem)
    q, v = world.start_q.copy(), world.start_v.copy()
    trace = RecordedMotion(*(np.zeros((ticks, count)) for count in (len(q), len(q), len(problem.sides))))
    if problem.own_gait is not None:
        leg.muscles = OwnGait(problem)
    for tick in range(ticks):
        loads = leg.loads(q, v)
        motor = controller.torque(tick, q, v, loads)
        if leg.muscles is not None:
            leg.muscles.decide(tick, q, v, loads)
        if leg.upper_body is not None:
            swings = [problem.table.is_swing(machine.phase) for machine in controller.machines.values()]
            leg.upper_body.decide(q, v, swings)
            controller.may_step = leg.upper_body.announces
        trace.q[tick], trace.motor[tick], trace.phases[tick] = q, motor, controller.phases()
        for _ in range(stepping.substeps):
            q, v = leg.step(q, v, motor, stepping.step, rk4)
            if leg.upper_body is not None:
                leg.upper_body.settle(q)
    return trace


def _require_known(problem: SimulationSetup) -> None:
    """Fail if a problem has properties that the loop does not model."""
    experiment, world, control = problem.experiment, problem.world, problem.experiment.control
    assert experiment.sensors.ideal
    assert control.delay == 0.0
    assert control.mode == "impedance"
    assert control.assistance.is_full
    assert control.inertia_compensation == 0.0
    assert not experiment.faults
    assert all(isinstance(law, FrictionParameters) for law in experiment.plant.friction.values())
    assert all(limb.condition.is_torque_free for limb in problem.limbs)
    assert world.braces is None
    assert world.slope == 0.0
    assert world.imposed_motion is None
    assert world.belt.ramp == 0.0
