"""Invariants of every run with a fault, checked on the log alone.

The monitor steps through the laws of :mod:`twin_gait.core.safety` tick by tick; here the same bounds are
applied to whole columns of the log, as a cross-check of the time at which a bound was exceeded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from injected_faults.deviation import deviations, filtered

from twin_gait import JointName, Run, Side
from twin_gait.control.safety import Trip, TripCause
from twin_gait.parameters.drives import ActuatorParameters, LimitParameters, SafetyParameters
from twin_gait.studies.fault_campaign import fault_row

TICK = 1e-3  # [s]
SETTLING = 0.5  # [s] after a trip, from which on joints are looked at for the speed of lowering
ROUNDING = 1e-9
Values = np.ndarray


class Audit(NamedTuple):
    """Findings in the log of a run with a monitor, in addition to :func:`twin_gait.studies.fault_row`.

    Attributes:
        hold_kept: Whether the hold acts on every joint in every tick from its start on, and its damper
            never drives; true without a trip.
        reaction_s: Time from the first tick in which the bound was broken to the hold on every joint; NaN
            without a trip, or if the log shows no breach.
        in_time: Whether that is within the stated time; true without a trip.
        speed_after_rad_per_s: Fastest joint from half a second after the trip on; NaN without one.
        sinking_m_per_s: Largest downward speed of the pelvis from the trip on; NaN without one, or on the
            bench.
    """

    hold_kept: bool
    reaction_s: float
    in_time: bool
    speed_after_rad_per_s: float
    sinking_m_per_s: float


def stated_reaction(cause: TripCause, settings: SafetyParameters) -> float:
    """Return the longest time from the first tick outside a bound to the hold on every joint, in [s].

    Args:
        cause: Of the trip.
        settings: Of the monitor.

    Returns:
        The time for which the bound must be broken, if it has one, and a tick to act.
    """
    lasting = {
        TripCause.ENCODER_FROZEN: settings.frozen_time,
        TripCause.TORQUE: settings.torque_time,
        TripCause.DRIVE: settings.drive_time,
        TripCause.PHASE_TIMEOUT: settings.phase_timeout,
        TripCause.FOOT_LOAD_FROZEN: settings.frozen_load_time,
        TripCause.SUPPLY: settings.voltage_time,
    }
    return lasting.get(cause, 0.0) + TICK


def audit(run: Run) -> Audit:
    """Check a run by its log."""
    trip = run.trip
    if trip is None:
        return Audit(True, np.nan, True, np.nan, np.nan)
    start = hold_start(run)
    breach = breach_tick(run, trip)
    reaction = np.nan if breach is None or start is None else (start - breach) * TICK
    stated = stated_reaction(trip.cause, run.experiment.control.safety)
    later = run.log.iloc[trip.tick + round(SETTLING / TICK) :]
    speeds = [later[f"{side}_{joint}_velocity_rad_per_s"].abs().max() for side, joint in _joints(run)]
    return Audit(
        hold_kept=start is not None and _hold_kept(run, start),
        reaction_s=reaction,
        in_time=bool(reaction <= stated + ROUNDING),
        speed_after_rad_per_s=float(np.max(speeds)),
        sinking_m_per_s=_sinking(run, trip.tick),
    )


def _sinking(run: Run, start: int) -> float:
    if "pelvis_velocity_m_per_s" not in run.log:
        return np.nan
    return float(-run.log["pelvis_velocity_m_per_s"].iloc[start:].min())


def _joints(run: Run) -> list[tuple[Side, JointName]]:
    """Return the driven joints of a run."""
    return [(side, JointName(name)) for side in run.sides for name in run.table.joints]


def _column(run: Run, side: Side, joint: JointName, column: str) -> Values:
    values: Values = run.log[f"{side}_{joint}_{column}"].to_numpy()
    return values


def _in_hold(run: Run) -> Values:
    """Return the ticks in which all joints have the hold: no spring, its damper, no compensation."""
    damping = run.experiment.control.safety.hold_damping
    holds = [
        (_column(run, *joint, "stiffness_Nm_per_rad") == 0.0)
        & (_column(run, *joint, "damping_Nms_per_rad") == damping)
        & (_column(run, *joint, "friction_compensation_torque_Nm") == 0.0)
        for joint in _joints(run)
    ]
    together: Values = np.all(holds, axis=0)
    return together


def hold_start(run: Run) -> int | None:
    """Return the first tick in which the hold acts on every joint, or None."""
    ticks = np.flatnonzero(_in_hold(run))
    return int(ticks[0]) if len(ticks) else None


def _hold_kept(run: Run, start: int) -> bool:
    state = run.log["safety_state"].to_numpy()
    never_back = bool(_in_hold(run)[start:].all() and (state[start:] == 1.0).all())
    # The damper acts on the speed of the tick before.
    power = [
        _column(run, *joint, "impedance_torque_Nm")[start + 1 :]
        * _column(run, *joint, "velocity_rad_per_s")[start:-1]
        for joint in _joints(run)
    ]
    ratio = run.experiment.control.safety.model_resistance_ratio
    return never_back and (ratio != 1.0 or all((item <= ROUNDING).all() for item in power))


def breach_tick(run: Run, trip: Trip) -> int | None:
    """Return the first tick of the breach that led to a trip, from the log.

    Args:
        run: The run.
        trip: Its trip.

    Returns:
        The tick, or None if the log shows no breach that lasts up to the trip.
    """
    if trip.cause is TripCause.COMMAND:
        return trip.tick  # the log has the hold's command in its place
    if trip.cause is TripCause.PHASE_TIMEOUT:
        entries = [item.tick for item in run.switches if item.side is trip.side]
        return max(entries, default=0)
    mask = _BREACHES[trip.cause](run, trip)
    # What the drives did is looked at in the tick after.
    for last in (trip.tick, trip.tick - 1):
        if last >= 0 and mask[last]:
            before = np.flatnonzero(~mask[:last])
            return int(before[-1]) + 1 if len(before) else 0
    return None


def _of_joint(column: str, outside: Callable[[Values, Run, Trip], Values]) -> Callable[[Run, Trip], Values]:
    def breach(run: Run, trip: Trip) -> Values:
        assert trip.side is not None and trip.joint is not None  # such a trip is a joint's
        return outside(_column(run, trip.side, trip.joint, column), run, trip)

    return breach


def _settings(run: Run) -> SafetyParameters:
    return run.experiment.control.safety


def _steps(angles: Values) -> Values:
    return np.diff(angles, prepend=angles[0])


def _jumps(angles: Values, run: Run, trip: Trip) -> Values:
    mask: Values = ~(np.abs(_steps(angles)) <= _settings(run).angle_step)
    # The reference of the first tick is the start of the world, which the log does not have.
    mask[0] = trip.tick == 0
    return mask


def _frozen(angles: Values, run: Run, trip: Trip) -> Values:
    mask: Values = (_steps(angles) == 0.0) & (
        np.abs(_inferred_speed(run, trip)) > _settings(run).frozen_speed
    )
    return mask


def _inferred_speed(run: Run, trip: Trip) -> Values:
    """Return the speed that the drive inferred in the previous tick in [rad/s]."""
    assert trip.side is not None
    joint = trip.joint or JointName.HIP
    motor = run.experiment.plant.actuators[joint]
    current = _column(run, trip.side, joint, "measured_current_A")
    wrong = _resistance(run, motor) * (1.0 - _settings(run).model_resistance_ratio) * current
    speed = _column(run, trip.side, joint, "velocity_rad_per_s")
    inferred = speed + wrong / (motor.torque_constant * motor.gear_ratio)
    return np.concatenate([[0.0], inferred[:-1]])


def _runs_away(angles: Values, run: Run, trip: Trip) -> Values:
    settings = _settings(run)
    step = _steps(angles) - _inferred_speed(run, trip) * TICK
    keep = 1.0 - TICK / settings.model_time_constant
    residual, outside = 0.0, np.zeros(len(angles), dtype=bool)
    for tick, value in enumerate(step.tolist()):
        residual = keep * residual + value
        outside[tick] = not abs(residual) <= settings.model_deviation
    return outside


def _leaves_range(angles: Values, run: Run, trip: Trip) -> Values:
    assert trip.side is not None and trip.joint is not None
    velocity = _column(run, trip.side, trip.joint, "velocity_fast_rad_per_s")
    distance = velocity**2 / (2.0 * _settings(run).stopping_deceleration)
    stop = angles + np.sign(velocity) * distance
    experiment = run.experiment
    model = experiment.build_control_model()
    lower, upper = experiment.control.joint_range(model, trip.side, trip.joint)
    mask: Values = (stop < lower) | (stop > upper)
    return mask


def _limits(run: Run, trip: Trip) -> LimitParameters:
    """Return the limits of the joint that tripped."""
    assert trip.joint is not None
    return run.experiment.control.limits[trip.joint]


def _resistance(run: Run, motor: ActuatorParameters) -> float:
    """Return the resistance of winding and inverter in [Ω]."""
    return motor.resistance + run.experiment.plant.electronics.inverter_resistance


def _too_fast(velocity: Values, run: Run, trip: Trip) -> Values:
    assert trip.side is not None and trip.joint is not None
    experiment = run.experiment
    limit = experiment.control.highest_speed(experiment.build_control_model(), trip.side, trip.joint)
    mask: Values = np.abs(velocity) > _settings(run).speed_share * limit
    return mask


def _too_hot(current: Values, run: Run, trip: Trip) -> Values:
    assert trip.joint is not None
    motor, settings = run.experiment.plant.actuators[trip.joint], _settings(run)
    nominal = motor.continuous_torque / (motor.torque_constant * motor.gear_ratio)
    heat, outside = 0.0, np.zeros(len(current), dtype=bool)
    for tick, value in enumerate(((current / nominal) ** 2).tolist()):
        heat += TICK / settings.thermal_time_constant * (value - heat)
        outside[tick] = heat > 1.0
    return outside


def _ignores_command(current: Values, run: Run, trip: Trip) -> Values:
    """Return the ticks in which the current deviates from that of target, bus voltage and speed."""
    assert trip.side is not None and trip.joint is not None
    motor = run.experiment.plant.actuators[trip.joint]
    bus = run.log["bus_voltage_V"].to_numpy()
    back_emf = (
        motor.torque_constant * motor.gear_ratio * _column(run, trip.side, trip.joint, "velocity_rad_per_s")
    )
    target = _column(run, trip.side, trip.joint, "target_current_A")
    resistance = _resistance(run, motor)
    expected = np.clip(target, (-bus - back_emf) / resistance, (bus - back_emf) / resistance)
    mask: Values = np.abs(current - expected) > _settings(run).drive_deviation
    return mask


def _load_freezes(run: Run, trip: Trip) -> Values:
    """Return the ticks of motion from the fault on, with a frozen sensor; the log has the true load."""
    injected = [round(item.time / TICK) for item in run.experiment.faults if item.side is trip.side]
    moving = np.abs(_inferred_speed(run, trip)) > _settings(run).frozen_speed
    mask: Values = moving & (np.arange(len(moving)) >= min(injected, default=len(moving)))
    return mask


def _deviates(run: Run, trip: Trip) -> Values:
    """Return the ticks in which the filtered deviation of the command from its setpoint is too large."""
    assert trip.side is not None and trip.joint is not None
    settings = _settings(run)
    found = filtered(deviations(run, trip.side, trip.joint), settings.command_time_constant)
    mask: Values = np.abs(found) > settings.command_deviation
    return mask


def _supply_low(run: Run, trip: Trip) -> Values:
    least = _settings(run).min_voltage_share * run.experiment.plant.battery.voltage
    mask: Values = run.log["bus_voltage_V"].to_numpy() < least
    return mask


_BREACHES: dict[TripCause, Callable[[Run, Trip], Values]] = {
    TripCause.ENCODER_MISSING: _of_joint(
        "measured_angle_rad", lambda angles, run, trip: ~np.isfinite(angles)
    ),
    TripCause.ENCODER_JUMP: _of_joint("measured_angle_rad", _jumps),
    TripCause.ENCODER_FROZEN: _of_joint("measured_angle_rad", _frozen),
    TripCause.ENCODER_MODEL: _of_joint("measured_angle_rad", _runs_away),
    TripCause.JOINT_SPEED: _of_joint("velocity_fast_rad_per_s", _too_fast),
    TripCause.JOINT_RANGE: _of_joint("measured_angle_rad", _leaves_range),
    TripCause.TORQUE: _of_joint(
        "motor_command_torque_Nm",
        lambda command, run, trip: np.abs(command) > _limits(run, trip).torque,
    ),
    TripCause.CURRENT: _of_joint(
        "measured_current_A",
        lambda current, run, trip: (
            np.abs(current) > _settings(run).current_share * _limits(run, trip).current
        ),
    ),
    TripCause.WINDING_HEAT: _of_joint("measured_current_A", _too_hot),
    TripCause.DRIVE: _of_joint("measured_current_A", _ignores_command),
    TripCause.FOOT_LOAD_FROZEN: _load_freezes,
    TripCause.SUPPLY: _supply_low,
    TripCause.SETPOINT: _deviates,
}


def audited_row(run: Run) -> dict[str, Any]:
    """Return the outcome of a run with one fault, and the findings in its log."""
    return {**fault_row(run), **audit(run)._asdict()}
