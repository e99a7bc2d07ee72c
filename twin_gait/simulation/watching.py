"""Arrays of the safety monitor and of the faults, which both engines step through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.control import Trip, TripCause
from twin_gait.core import safety
from twin_gait.experiment import ControlMode
from twin_gait.gait.table import TICK
from twin_gait.scenario.faults import Fault, FaultKind
from twin_gait.simulation.problem import ActuatedJoint, Problem

NEVER = np.iinfo(np.int64).max


class FaultArrays(NamedTuple):
    """Faults as :mod:`twin_gait.core.faults` reads them.

    Attributes:
        faults: Kind, place and first tick, shape ``(n, 3)``, integers.
        magnitudes: In SI units, shape ``(n,)``.
        first_tick: Of the earliest fault, or ``NEVER``.
    """

    faults: np.ndarray
    magnitudes: np.ndarray
    first_tick: int


def fault_arrays(problem: Problem) -> FaultArrays:
    """Lay the faults of an experiment out."""
    faults = problem.experiment.faults
    rows = [[fault.kind.code, _place(problem, fault), ticks(fault.time)] for fault in faults]
    return FaultArrays(
        np.array(rows, dtype=np.int64).reshape(len(rows), 3),
        np.array([fault.strength for fault in faults], dtype=float),
        min((row[2] for row in rows), default=NEVER),
    )


def _place(problem: Problem, fault: Fault) -> int:
    if fault.side is None:
        return -1
    if fault.kind is FaultKind.FOOT_LOAD_STUCK:
        return problem.sides.index(fault.side)
    places = [(joint.side, joint.joint) for joint in problem.joints]
    return places.index((fault.side, fault.joint))  # type: ignore[arg-type]  # checked by the fault


def ticks(time: float) -> int:
    """Whole ticks of a time in [s], one at least but for 0."""
    return 0 if time == 0.0 else max(1, round(time / TICK))


def phase_time_out_ticks(problem: Problem) -> int:
    """Longest time in a phase; no limit where the table drives nothing, or has no way out of a phase."""
    control = problem.experiment.control
    if control.mode is not ControlMode.IMPEDANCE or not problem.table.transitions:
        return NEVER
    return ticks(control.safety.phase_time_out)


def start_angles(problem: Problem) -> np.ndarray:
    """Joint angles at time 0 in [rad], shape ``(n_joints,)``; the encoders are referenced there."""
    return problem.world.start_q[[joint.coordinate for joint in problem.joints]].copy()


def watch_bounds(problem: Problem) -> np.ndarray:
    """Bounds of the monitor, shape ``(n_joints, BOUND_COUNT)``."""
    return np.array([_bounds_of(problem, joint) for joint in problem.joints])


def _bounds_of(problem: Problem, joint: ActuatedJoint) -> np.ndarray:
    control, model = problem.experiment.control, problem.control_model
    settings, motor = control.safety, problem.actuator(joint)
    row = np.zeros(safety.BOUND_COUNT)
    row[safety.LOWER], row[safety.UPPER] = model.position_limits(joint.side, joint.joint)
    row[safety.HIGHEST_SPEED] = settings.speed_share * _speed_limit(problem, joint)
    row[safety.STOP_DISTANCE_FACTOR] = 0.5 / settings.stopping_deceleration
    row[safety.ANGLE_STEP] = settings.angle_step
    row[safety.FROZEN_SPEED] = settings.frozen_speed
    row[safety.FROZEN_TICKS] = ticks(settings.frozen_time)
    row[safety.MODEL_GAIN] = min(1.0, TICK / settings.model_time_constant)
    row[safety.MODEL_DEVIATION] = settings.model_deviation
    row[safety.HIGHEST_TORQUE] = control.limits.torque
    row[safety.TORQUE_TICKS] = ticks(settings.torque_time)
    row[safety.HIGHEST_COMMAND] = settings.highest_command
    row[safety.HIGHEST_CURRENT] = settings.current_share * control.limits.current
    continuous = motor.continuous_torque / (motor.torque_constant * motor.gear_ratio * motor.gear_efficiency)
    row[safety.COOLING] = min(1.0, TICK / settings.thermal_time_constant)
    row[safety.HEATING] = row[safety.COOLING] / (continuous * continuous)
    row[safety.DRIVE_DEVIATION] = settings.drive_deviation
    row[safety.DRIVE_TICKS] = ticks(settings.drive_time)
    row[safety.EMF_CONSTANT] = motor.torque_constant * motor.gear_ratio
    row[safety.MODEL_RESISTANCE] = settings.model_resistance_ratio * motor.resistance
    return row


def _speed_limit(problem: Problem, joint: ActuatedJoint) -> float:
    """Highest speed of a joint from the URDF in [rad] / [s]; a URDF that leaves it open sets none."""
    limit = float(problem.control_model.model.velocityLimit[joint.control_coordinate])
    return limit if limit > 0.0 else np.inf


def trip_of(problem: Problem, tick: int, cause: int, place: int) -> Trip | None:
    """What the engine's numbers say of a trip.

    Args:
        tick: Of the trip, or a negative number.
        place: A joint, or the number of joints plus a leg, or a negative number for the supply.

    Returns:
        The trip, or None if there was none.
    """
    if tick < 0:
        return None
    name, joints = list(TripCause)[cause], problem.joints
    if place < 0:
        return Trip(tick, name, None, None)
    if place >= len(joints):
        return Trip(tick, name, problem.sides[place - len(joints)], None)
    return Trip(tick, name, joints[place].side, joints[place].joint)
