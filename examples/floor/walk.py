"""Best walk that motors, body and belt allow: optimal control of half a symmetric stride.

States are the coordinates of the plant and their velocities, the torques of the motors are linear between the
ends of the intervals; Radau collocation of three points (order 5) on intervals of equal length. The function
that is integrated is the engine's own over casadi's symbols (:mod:`floor.plant`). Friction, contact and stops
are smooth or smoothed by :data:`SMOOTH`, so that ipopt has second derivatives.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from floor.plant import equations_of_motion

from twin_gait import JointName, Run, Side
from twin_gait.control.controller import Controller, Plan
from twin_gait.core.actuator import (
    Motor,
    current_to_torque,
    motor_electrical_power,
    sagged_bus_voltage,
    torque_to_current,
)
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.reference import reference_curve, reference_cycle_time
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.simulator import create_engine

try:
    import casadi as ca
except ImportError:
    ca = None

DEGREES = 180.0 / np.pi
POINTS = 3  # of an interval
STRIDES = 6  # of a half stride laid end to end
OPTIMALITY = 1e-6  # of ipopt: largest error of the scaled optimality conditions
SMOOTH = 1e-4  # [m], [rad]; half of it is how deep an unloaded sole or joint already feels ground or stop
LOAD = 0.3  # [N·m], over which the losses of the gear under load are rounded
# Of its cycle the foot is off the belt at the latest from here on, in [%]; stance at 1.5 km/h lasts 67 to 70.
SWING = 70.0


def require_casadi() -> None:
    """Raise an error without the optional dependency."""
    if ca is None:
        print("attainable_floor: needs casadi: pip install 'twin-gait[floor]'", file=sys.stderr)
        raise SystemExit(2)


class Goals(NamedTuple):
    """Required properties of the walk apart from its angles; forces in carried weights.

    Attributes:
        peak: Largest vertical force of a foot.
        trough: Smallest vertical force from 18 to 45 % of the cycle.
        loading: Smallest vertical force from 6 to 20 %.
        forward_N: Largest mean fore-aft force of both feet together in either direction.
        contact_deg: Largest knee flexion at contact.
        yield_deg: Smallest knee flexion after contact, at 15 %.
        clearance_mm: Smallest height of the sole over the middle half of swing.
    """

    peak: float = np.inf
    trough: float = -np.inf
    loading: float = -np.inf
    forward_N: float = np.inf
    contact_deg: float = np.inf
    yield_deg: float = -np.inf
    clearance_mm: float = -np.inf


NOTHING = Goals()


def positive(x: Any, width: float) -> Any:
    """Return the positive part of a symbol, smoothed over a width."""
    return 0.5 * (x + ca.sqrt(x * x + width * width))


def smooth_ground(ground: Any, height: Any, forward: Any, upward: Any) -> tuple[Any, Any]:
    """Compute ``ground_contact_force`` of core without branches."""
    depth = positive(-height, SMOOTH)
    damping = positive(1.0 - 1.5 * ground.dissipation * upward, 1e-3)
    normal = ground.stiffness * depth * ca.sqrt(depth) * damping
    slip = (forward + ground.belt_speed) / ground.transition_velocity
    return -ground.friction_coefficient * normal * ca.tanh(slip), normal


def smooth_stop(q: Any, v: Any, lower: float, upper: float, stiffness: float, dissipation: float) -> Any:
    """Compute ``mechanical_stop_torque`` of core without branches."""
    below = positive(lower - q, SMOOTH) * positive(1.0 - dissipation * v, 1e-3)
    above = positive(q - upper, SMOOTH) * positive(1.0 + dissipation * v, 1e-3)
    return stiffness * (below - above)


@dataclass(slots=True)
class Torques:
    """Torque of every joint in every tick, in [N·m]."""

    rows: list[list[float]]


class Replay(Controller):
    """Controller that applies given torques only."""

    def __init__(self, torques: np.ndarray) -> None:
        """Take the torques in [N·m], shape ``(n_ticks, n_joints)``."""
        self.torques = torques

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Set no springs and no compensation."""
        return np.zeros_like(rows)

    def initial_memory(self, plan: Plan) -> Torques:
        """Return the torques."""
        return Torques(self.torques.tolist())

    @staticmethod
    def tick(memory: Torques, device: Any, tick: int, period: float) -> None:
        """Set the torques of this tick."""
        for number in range(len(device.joints)):
            device.joints[number].setpoint.target = memory.rows[tick][number]


@dataclass(frozen=True)
class Walk:
    """A periodic walk, half a stride of it from heel contact of the first leg.

    Attributes:
        problem: Of the plant.
        times: Of the states in [s], shape ``(m,)``, the first 0.
        states: Coordinates and velocities, shape ``(2 n, m)``.
        torques: Of the motors at the ends of the intervals in [N·m], shape ``(joints, intervals + 1)``.
        weight: Of the mean square torque in [N·m]² beside the mean square error in [deg]².
        optimality: Largest error of the scaled conditions of optimality.
        succeeded: Whether ipopt came to its tolerance.
        unknowns: All of them, to start another search from.
    """

    problem: SimulationSetup
    times: np.ndarray
    states: np.ndarray
    torques: np.ndarray
    weight: float
    optimality: float
    succeeded: bool
    unknowns: np.ndarray

    def replayed(self) -> Run:
        """Simulate the half stride in the engine with the torques of the solution, without feedback."""
        ticks = round(self.times[-1] / TICK)
        experiment = replace(self.problem.experiment, duration=ticks * TICK)
        ends = np.linspace(0.0, self.times[-1], self.torques.shape[1])
        middles = (np.arange(ticks) + 0.5) * TICK
        wanted = np.array([np.interp(middles, ends, row) for row in self.torques]).T
        problem = build_setup(experiment, Replay(wanted))
        n = len(problem.world.start_q)
        state = self.states[:, 0]
        world = replace(problem.world, start_q=state[:n], start_v=state[n:])
        return create_engine(replace(problem, world=world)).run()

    def drift(self, run: Run) -> float:
        """Return the largest difference of a motor-driven angle of the replay from the solution in [deg]."""
        states = self.states_at(np.arange(len(run.log)) * TICK)
        joints = self.problem.joints
        angles = np.array([run.log[f"{item.side}_{item.joint}_angle_rad"] for item in joints])
        return float(np.abs(DEGREES * (angles - states[[item.coordinate for item in joints]])).max())

    def walked(self, run: Run) -> Run:
        """Return a half stride and its mirror image in turn, so that all measures of runs apply."""
        one, other = (f"{side}_" for side in self.problem.sides)

        def exchanged(name: str) -> str:
            turned = name.replace(one, "@").replace(other, one)
            return turned.replace("@", other)

        mirrored = run.log.rename(columns=exchanged)[run.log.columns]
        log = pd.concat([run.log, mirrored] * STRIDES, ignore_index=True)
        log["time_s"] = np.arange(len(log)) * TICK
        experiment = replace(run.experiment, duration=len(log) * TICK)
        return replace(run, log=log, switches=(), experiment=experiment)

    def states_at(self, times: np.ndarray) -> np.ndarray:
        """Return the states at any times of the half stride by the collocation polynomials."""
        length = self.times[POINTS]
        k = np.clip((times / length).astype(int), 0, self.torques.shape[1] - 2)
        share = times / length - k
        nodes = np.array([0.0, *ca.collocation_points(POINTS, "radau")])
        found = 0.0
        for i in range(POINTS + 1):
            others = np.delete(nodes, i)
            basis = np.prod([(share - other) / (nodes[i] - other) for other in others], axis=0)
            found = found + basis * self.states[:, POINTS * k + i]
        return found


class Search:
    """Nonlinear programme of one experiment; goals and weight of the effort are parameters.

    Attributes:
        problem: Of the plant.
        half: Duration of half a stride in [s].
        times: Of the points of collocation in [s].
    """

    def __init__(self, experiment: Experiment, intervals: int, stride_time: float | None = None) -> None:
        """Formulate the programme.

        Args:
            intervals: Of half a stride.
            stride_time: In [s]; the reference's if None.
        """
        self.problem = build_setup(experiment)
        self.speed, self.height = experiment.scenario.belt_speed, experiment.patient.height
        self.half = 0.5 * (stride_time or reference_cycle_time(self.speed, self.height))
        self.nodes = np.array(ca.collocation_points(POINTS, "radau"))
        self.times = self.half / intervals * np.add.outer(np.arange(intervals), self.nodes).ravel()
        n, joints, m = len(self.problem.world.start_q), len(self.problem.joints), len(self.times)
        start, later = ca.MX.sym("start", 2 * n), ca.MX.sym("later", 2 * n, m)
        ends, weight = ca.MX.sym("torques", joints, intervals + 1), ca.MX.sym("weight")
        torques = ends @ ca.sparsify(ca.DM(_linear(self.nodes, intervals)))
        plant = plant_of(self.problem)
        slopes, _, shares = ca.collocation_coeff(self.nodes.tolist())
        change = ca.horzcat(start, later) @ ca.sparsify(ca.DM(_slopes(np.array(slopes), intervals)))
        found = change[n:, :] * (intervals / self.half)  # accelerations by the polynomials
        first = plant(start[:n], start[n:], ends[:, 0], found[:, 0])
        then = plant.map(m)(later[:n, :], later[n:, :], torques, found)
        gap = change - self.half / intervals * ca.vertcat(later[n:, :], then[0])
        equal = [ca.vec(gap[:n, :]), 0.1 * ca.vec(gap[n:, :])]
        turned, other = _mirror(self.problem)
        equal += [later[turned, m - 1] - start, ends[other, intervals] - ends[:, 0]]
        equal += [first[1][0] / CONTACT_FORCE - 1.0]
        moments = ca.DM(
            np.tile(np.array(shares).ravel(), intervals) / intervals
        )  # weights of a mean over time
        error = DEGREES * (later[[joint.coordinate for joint in self.problem.joints], :] - self._reference())
        square, effort = (ca.sum1((item * item) @ moments) / joints for item in (error, torques))
        self._limited = self._limits(then, start, later, moments)
        self.unknowns = ca.vertcat(start, ca.vec(later), ca.vec(ends))
        most = min(_most_torque(self.problem, k) for k in range(joints))
        self._bound = np.concatenate([np.full(2 * n * (m + 1), np.inf), np.full(ends.numel(), most)])
        self._equal = np.zeros(sum(item.numel() for item in equal))
        constraints = ca.vertcat(*equal, *(ca.vec(item) for item, *_ in self._limited))
        programme = {"x": self.unknowns, "p": weight, "f": square + weight * effort, "g": constraints}
        ipopt = {"tol": OPTIMALITY, "max_iter": 1000, "print_level": 0, "sb": "yes"}
        self._solver = ca.nlpsol(
            "walk", "ipopt", programme, {"ipopt": ipopt, "print_time": False, "expand": True}
        )
        self._parts = ca.Function("parts", [self.unknowns], [ca.horzcat(start, later), ends])

    def _reference(self) -> np.ndarray:
        """Return the reference angles of the joints in [rad]; the second leg is half a stride ahead."""
        first, percent = self.problem.sides[0], 50.0 * self.times / self.half
        return np.array(
            [
                reference_curve(
                    item.joint,
                    percent if item.side is first else percent + 50.0,
                    speed=self.speed,
                    height=self.height,
                )
                for item in self.problem.joints
            ]
        )

    def _limits(
        self, then: Any, start: Any, later: Any, moments: Any
    ) -> list[tuple[Any, float | str, float | str]]:
        """Return the limited quantities with lower and upper limits: numbers, or names of goals."""
        _, upward, forward, heights, voltage = then
        percent = 50.0 * self.times / self.half

        def within(low: float, high: float) -> list[int]:
            return np.flatnonzero((percent > low) & (percent < high)).tolist()

        quarter = 0.25 * (100.0 - SWING)
        middle = within(SWING + quarter - 50.0, 50.0 - quarter)  # of the second leg's swing
        swing = upward[1, within(SWING - 50.0, percent[-POINTS])]
        force = upward / (self.problem.world.body_weight - self.problem.world.support_force)
        knee = next(item.coordinate for item in self.problem.joints if item.joint is JointName.KNEE)
        return [
            (voltage, -1.0, 1.0),
            (swing / CONTACT_FORCE, -np.inf, 0.5),
            (force, -np.inf, "peak"),
            (force[0, within(18.0, 45.0)], "trough", np.inf),
            (force[0, within(6.0, 20.0)], "loading", np.inf),
            (ca.sum1(forward @ moments), "-forward_N", "forward_N"),
            (DEGREES * start[knee], -np.inf, "contact_deg"),
            (DEGREES * (later[knee, within(15.0, 50.0)[0]] - start[knee]), "yield_deg", np.inf),
            (1e3 * heights[heights.shape[0] // 2 :, middle], "clearance_mm", np.inf),
        ]

    def _bounds(self, goals: Goals) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and upper bounds of all constraints."""

        def number(bound: float | str) -> float:
            if not isinstance(bound, str):
                return bound
            return -getattr(goals, bound[1:]) if bound[0] == "-" else getattr(goals, bound)

        sides = ([np.full(item[0].numel(), number(item[end])) for item in self._limited] for end in (1, 2))
        least, most = (np.concatenate([self._equal, *side]) for side in sides)
        return least, most

    def start_from(self, run: Run) -> np.ndarray:
        """Return the last complete half stride of a simulated walk, scaled to the time of this one."""
        first, second = self.problem.sides
        strikes = [
            leg_record(run.log, side, run.table.phase_names, TICK).strides()[:, 0] for side in (first, second)
        ]
        end = strikes[1][-1]
        begin = strikes[0][strikes[0] < end][-1]
        model = self.problem.world.model
        names = [("pelvis_height_m", "pelvis_velocity_m_per_s")] * model.nv
        if model.forward_index is not None:
            names[model.forward_index] = "pelvis_forward_m", "pelvis_forward_velocity_m_per_s"
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                stem = f"{side}_{joint}"
                names[model.index(side, joint)] = f"{stem}_angle_rad", f"{stem}_velocity_rad_per_s"
        motors = [f"{item.side}_{item.joint}_motor_torque_Nm" for item in self.problem.joints]
        ends = np.linspace(0.0, 1.0, len(self.times) // POINTS + 1)
        instants = np.array([0.0, *self.times]) / self.half
        parts = [
            np.array(
                [
                    np.interp(begin + (end - begin) * at, np.arange(len(run.log)), run.log[name])
                    for name in group
                ]
            )
            for group, at in ((itertools.chain(*zip(*names, strict=True)), instants), (motors, ends))
        ]
        return np.concatenate([part.ravel("F") for part in parts])

    def solve(self, guess: np.ndarray, weight: float, goals: Goals = NOTHING) -> Walk:
        """Search from a guess for the walk of minimum error and weighted effort, and return it."""
        least, most = self._bounds(goals)
        found = self._solver(x0=guess, p=weight, lbx=-self._bound, ubx=self._bound, lbg=least, ubg=most)
        states, torques = (np.array(item) for item in self._parts(found["x"]))
        status = self._solver.stats()
        last = {name: values[-1] for name, values in status["iterations"].items() if name.startswith("inf_")}
        return Walk(
            problem=self.problem,
            times=np.array([0.0, *self.times]),
            states=states,
            torques=torques,
            weight=weight,
            optimality=max(last.values()),
            succeeded=bool(status["success"]),
            unknowns=np.array(found["x"]).ravel(),
        )


def _linear(nodes: np.ndarray, intervals: int) -> np.ndarray:
    """Return the matrix from values at the ends of the intervals to values at the collocation points."""
    shares = np.zeros((intervals + 1, len(nodes) * intervals))
    for k, j in itertools.product(range(intervals), range(len(nodes))):
        shares[k : k + 2, len(nodes) * k + j] = 1.0 - nodes[j], nodes[j]
    return shares


def _slopes(slopes: np.ndarray, intervals: int) -> np.ndarray:
    """Return the matrix from all states to the slopes at the collocation points."""
    shares = np.zeros((POINTS * intervals + 1, POINTS * intervals))
    for k in range(0, POINTS * intervals, POINTS):
        shares[k : k + POINTS + 1, k : k + POINTS] = slopes
    return shares


def _mirror(problem: SimulationSetup) -> tuple[list[int], list[int]]:
    """Return the indices of states and joints with left and right exchanged."""
    model, (one, two) = problem.world.model, problem.sides
    order = list(range(model.nv))
    for side, opposite in ((one, two), (two, one)):
        for joint, _ in model.legs[side].items():
            order[model.index(side, joint)] = model.index(opposite, joint)
    joints = [item.coordinate for item in problem.joints]
    return order + [index + model.nv for index in order], [joints.index(order[item]) for item in joints]


def _most_torque(problem: SimulationSetup, number: int) -> float:
    """Return the largest torque of a motor within its limits of torque and current."""
    joint = problem.joints[number]
    motor, limits = problem.actuator(joint), problem.experiment.control.limits[joint.joint]
    return min(limits.torque, current_to_torque(limits.current, motor.torque_constant, motor.gear_ratio))


def plant_of(problem: SimulationSetup) -> Any:
    """Return the plant as a function of casadi.

    Returns:
        From coordinates, velocities, motor torques and accelerations, those that the losses of the gears are
        reckoned with, to accelerations, vertical and forward forces of both feet, heights of all points of
        the soles, and the voltages of the motors over that of the sagging bus.
    """
    n, battery = len(problem.world.start_q), problem.experiment.plant.battery
    q, v, a, torque = (*(ca.SX.sym(name, n) for name in "qva"), ca.SX.sym("torque", len(problem.joints)))
    motor: list[Any] = [0.0] * n
    electronics = problem.experiment.plant.electronics
    voltages, power = [], electronics.constant_power
    for k, joint in enumerate(problem.joints):
        motor[joint.coordinate], speed = torque[k], v[joint.coordinate]
        item = problem.actuator(joint)
        ohms = item.resistance + electronics.inverter_resistance
        current = torque_to_current(torque[k], item.torque_constant, item.gear_ratio)
        voltages.append(ohms * current + item.torque_constant * item.gear_ratio * speed)
        power += motor_electrical_power(Motor(item.torque_constant, item.gear_ratio, ohms), current, speed)
        power += electronics.inverter_power
    bus = sagged_bus_voltage(battery.voltage, battery.internal_resistance, power, battery.voltage)
    laws = {
        "sine_cosine": lambda angle: (ca.sin(angle), ca.cos(angle)),
        "exponential": ca.exp,
        "sign_of": lambda torque: torque / ca.sqrt(torque * torque + LOAD * LOAD),
        "hyperbolic_tangent": ca.tanh,
        "ground_contact_force": smooth_ground,
        "mechanical_stop_torque": smooth_stop,
    }
    motion = equations_of_motion(problem, laws)(ca.vertsplit(q), ca.vertsplit(v), motor, ca.vertsplit(a))
    feet = np.array_split(np.array(motion.points, dtype=object), len(problem.sides))
    upward, forward = (
        ca.vertcat(*(sum(getattr(point, name) for point in foot) for foot in feet))
        for name in ("upward", "forward")
    )
    heights = ca.vertcat(*(point.height for point in motion.points))
    outputs = [ca.vertcat(*motion.acceleration), upward, forward, heights, ca.vertcat(*voltages) / bus]
    return ca.Function("plant", [q, v, torque, a], outputs)
