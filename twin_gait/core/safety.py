"""The safety monitor between controller and motor, and the hold after a trip.

The monitor uses only signals that a firmware measures: encoder angles with their velocity estimate, currents
and voltages of the drives, commands, phases and the bus voltage. A trip is permanent.

The drive applies a known voltage to the winding and measures the current; with the model of the motor this
gives a speed that needs no encoder (from the back-EMF). The monitor compares the encoder with this speed, and
the hold brakes with it, so that a broken encoder cannot drive the leg.
"""

import math
from dataclasses import dataclass

from twin_gait.core.control_tick import Encoder

# Causes of a trip, as numbered in the log and in the engines.
NO_TRIP, MISSING_TRIP, JUMP_TRIP, FROZEN_TRIP, MODEL_TRIP, SPEED_TRIP, RANGE_TRIP, COMMAND_TRIP = range(8)
TORQUE_TRIP, CURRENT_TRIP, HEAT_TRIP, DRIVE_TRIP, PHASE_TRIP, LOAD_TRIP = range(8, 14)
SUPPLY_TRIP, OPERATOR_TRIP, BUS_TRIP, SETPOINT_TRIP = range(14, 18)


@dataclass(slots=True)
class Bounds:
    """Limits of the monitor for the measurements of a joint."""

    lower: float  # Lowest angle in [rad].
    upper: float  # Highest angle in [rad].
    highest_speed: float  # Largest speed in [rad/s].
    stop_distance_factor: float  # Half the inverse of the braking deceleration in [s²/rad].
    angle_step: float  # Largest change of the angle in a tick in [rad].
    frozen_speed: float  # Motor speed above which a constant encoder reading is a fault in [rad/s].
    frozen_ticks: int  # Number of such ticks that leads to a trip.
    model_gain: float  # Period over the time constant with which the residual decays.
    model_deviation: float  # Largest residual in [rad].
    highest_torque: float  # Command in [N·m] that may be exceeded for a limited time.
    torque_ticks: int  # Number of ticks above it that leads to a trip.
    highest_command: float  # Largest plausible command in [N·m].
    command_deviation: float  # Largest deviation of the command from its setpoint in [N·m].
    command_gain: float  # Gain of the filter of that deviation: period over its time constant.
    highest_current: float  # Largest current in [A].
    heating: float  # Period over winding time constant and squared continuous current in 1 / [A²].
    cooling: float  # Period over winding time constant.
    drive_deviation: float  # Largest difference between measured and target current in [A].
    drive_ticks: int  # Number of ticks with a larger difference that leads to a trip.
    emf_constant: float  # Back-EMF at the joint in [V·s/rad].
    model_resistance: float  # Resistance of winding and inverter that the monitor assumes in [Ω].


@dataclass(slots=True)
class MonitorState:
    """State of the monitor for a joint and its drive."""

    motor_speed: float = 0.0  # Joint speed that the drive infers in [rad/s].
    residual: float = 0.0  # Residual of the encoder in [rad]; see :func:`model_residual`.
    heat: float = 0.0  # Heat of the winding; see :func:`winding_heat`.
    motor_current: float = 0.0  # Measured current in [A].
    current_deviation: float = 0.0  # Measured minus expected current of the drive in [A].
    last_command: float = 0.0  # Command of the last tick in [N·m].
    command_deviation: float = 0.0  # Filtered deviation of the commands from their setpoints in [N·m].
    frozen_streak: int = 0  # Consecutive ticks with a constant encoder reading while the motor turned.
    torque_streak: int = 0  # Consecutive ticks with a command above the limit.
    drive_streak: int = 0  # Consecutive ticks with a current that deviates.


def motor_speed(voltage: float, current: float, emf_constant: float, model_resistance: float) -> float:
    r"""Estimate the joint speed in [rad/s] from voltage U and current I of the drive's winding.

    :math:`\hat\omega = \frac{U - \hat R I}{K_e\,\tau}`

    The true voltage drop of the winding (:func:`twin_gait.core.actuator.winding_voltage`) differs from the
    model's when copper is warm: R rises by 39 % in 100 K.
    """
    return (voltage - model_resistance * current) / emf_constant


def model_residual(residual: float, change: float, speed: float, period: float, gain: float) -> float:
    r"""Update the angle in [rad] by which the encoder deviates from the motor's model; it decays slowly.

    :math:`r_k = (1 - \alpha)\,r_{k-1} + \Delta\theta_k - \hat\omega_{k-1} T` with the change of the encoder
    in this tick and the speed that the drive estimated in the tick before.
    """
    return residual + (change - speed * period) - gain * residual


def stopping_angle(angle: float, velocity: float, distance_factor: float) -> float:
    r"""Compute the angle in [rad] at which a joint comes to rest if it is braked from now on.

    The stop distance at present speed is :math:`\omega^2 / (2 a)`, in the direction of motion; the factor is
    :math:`1 / (2 a)` with the braking deceleration a, in [s²/rad].
    """
    return angle + distance_factor * velocity * abs(velocity)


def winding_heat(heat: float, current: float, heating: float, cooling: float) -> float:
    r"""Update the heat of the winding by one tick of the RMS thermal model of a motor, I²t.

    :math:`h_k = h_{k-1} + \frac{T}{\tau_w}\left(\frac{I^2}{I_N^2} - h_{k-1}\right)`

    At the continuous current :math:`I_N` the heat tends to 1. ``heating``: :math:`T / (\tau_w I_N^2)` in 1 /
    [A²]. ``cooling``: :math:`T / \tau_w`.
    """
    return heat + (heating * current * current - cooling * heat)


def monitor_joint(bounds: Bounds, monitor: MonitorState, encoder: Encoder, period: float) -> int:
    """Compare the measurements of one joint with its bounds; return the cause of a trip or ``NO_TRIP``.

    The commands, currents and speeds in ``monitor`` are those of the tick before. NaN is outside every bound.
    Residual, heat and streaks in ``monitor`` are changed in place.
    """
    angle, velocity = encoder.angle, encoder.velocity_fast
    speed, current = monitor.motor_speed, monitor.motor_current
    change = angle - encoder.last_angle
    residual = model_residual(monitor.residual, change, speed, period, bounds.model_gain)
    heat = winding_heat(monitor.heat, current, bounds.heating, bounds.cooling)
    stop = stopping_angle(angle, velocity, bounds.stop_distance_factor)
    monitor.residual = residual
    monitor.heat = heat
    frozen = change == 0.0 and abs(speed) > bounds.frozen_speed
    monitor.frozen_streak = monitor.frozen_streak + 1 if frozen else 0
    high = abs(monitor.last_command) > bounds.highest_torque
    monitor.torque_streak = monitor.torque_streak + 1 if high else 0
    deviates = abs(monitor.current_deviation) > bounds.drive_deviation
    monitor.drive_streak = monitor.drive_streak + 1 if deviates else 0
    cause = NO_TRIP
    if not abs(change) <= bounds.angle_step:
        cause = JUMP_TRIP if math.isfinite(angle) else MISSING_TRIP
    elif monitor.frozen_streak >= bounds.frozen_ticks:
        cause = FROZEN_TRIP
    elif not abs(residual) <= bounds.model_deviation:
        cause = MODEL_TRIP
    elif abs(velocity) > bounds.highest_speed:
        cause = SPEED_TRIP
    elif stop < bounds.lower or stop > bounds.upper:
        cause = RANGE_TRIP
    elif monitor.torque_streak >= bounds.torque_ticks:
        cause = TORQUE_TRIP
    elif abs(current) > bounds.highest_current:
        cause = CURRENT_TRIP
    elif heat > 1.0:
        cause = HEAT_TRIP
    elif not abs(monitor.command_deviation) <= bounds.command_deviation:
        cause = SETPOINT_TRIP
    elif monitor.drive_streak >= bounds.drive_ticks:
        cause = DRIVE_TRIP
    return cause


def command_is_plausible(command: float, highest: float) -> bool:
    """Check whether a command in [N·m] is small enough to be sent to the drive; NaN is not."""
    return abs(command) <= highest


def hold_torque(speed: float, damping: float) -> float:
    r"""Compute the torque in [N·m] that brakes a joint at the estimated speed, :math:`-b_h \hat\omega`."""
    return -damping * speed


def hold_weight_share(ticks: int, lowering_ticks: int) -> float:
    """Compute the share of the leg's weight that the hold carries, a number of ticks after the trip.

    The share decreases linearly from 1 to 0 over ``lowering_ticks``.
    """
    if ticks >= lowering_ticks:
        return 0.0
    return 1.0 - ticks / lowering_ticks
