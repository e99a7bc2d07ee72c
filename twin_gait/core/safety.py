"""The safety monitor between controller and motor, and the hold that a trip leads to.

The monitor sees what a firmware sees: encoder angles with their velocity estimate, currents and voltages of
the drives, commands, phases and the bus voltage. A trip is never taken back.

The drive knows the voltage that it puts on the winding and the current that it measures; with the model of
the motor this gives a speed that needs no encoder (the back-EMF). The encoder is compared with it, and the
hold brakes on it, so that no broken encoder can drive the leg.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_gait.core.control_tick import ANGLE, VELOCITY_FAST

Array = np.ndarray[Any, np.dtype[Any]]

# Causes of a trip, as the log and the engines number them.
(
    NO_TRIP,
    MISSING_TRIP,
    JUMP_TRIP,
    FROZEN_TRIP,
    MODEL_TRIP,
    SPEED_TRIP,
    RANGE_TRIP,
    COMMAND_TRIP,
    TORQUE_TRIP,
    CURRENT_TRIP,
    HEAT_TRIP,
    DRIVE_TRIP,
    PHASE_TIME_OUT_TRIP,
    LOAD_TRIP,
    SUPPLY_TRIP,
    OPERATOR_TRIP,
) = range(16)

# Columns of the bounds of a joint.
(
    LOWER,
    UPPER,
    HIGHEST_SPEED,
    STOP_DISTANCE_FACTOR,
    ANGLE_STEP,
    FROZEN_SPEED,
    FROZEN_TICKS,
    MODEL_GAIN,
    MODEL_DEVIATION,
    HIGHEST_TORQUE,
    TORQUE_TICKS,
    HIGHEST_COMMAND,
    HIGHEST_CURRENT,
    HEATING,
    COOLING,
    DRIVE_DEVIATION,
    DRIVE_TICKS,
    EMF_CONSTANT,
    MODEL_RESISTANCE,
) = range(19)
BOUND_COUNT = 19

# Columns of what the monitor remembers of a joint: numbers, then consecutive ticks.
MOTOR_SPEED, RESIDUAL, HEAT, MOTOR_CURRENT, CURRENT_DEVIATION, COMMANDED = range(6)
MEMORY_COUNT = 6
FROZEN_STREAK, TORQUE_STREAK, DRIVE_STREAK = range(3)
STREAK_COUNT = 3


def motor_speed(
    current: float, velocity: float, resistance: float, emf_constant: float, model_resistance: float
) -> float:
    r"""Joint speed that a drive infers from the voltage and the current of its winding.

    .. math::

        U = R I + K_e\,\tau\,\omega, \qquad \hat\omega = \frac{U - \hat R I}{K_e\,\tau}

    The true voltage drop of the winding differs from the model's when copper is warm: :math:`R` rises by
    39 % in 100 K.

    Args:
        current: :math:`I` in [A].
        velocity: True joint velocity :math:`\omega` in [rad] / [s].
        resistance: True resistance :math:`R` in [Ω].
        emf_constant: :math:`K_e \tau` at the joint in [V s] / [rad].
        model_resistance: :math:`\hat R` that the monitor assumes in [Ω].

    Returns:
        Inferred joint velocity in [rad] / [s].
    """
    voltage = resistance * current + emf_constant * velocity
    return (voltage - model_resistance * current) / emf_constant


def model_residual(residual: float, change: float, speed: float, period: float, gain: float) -> float:
    r"""Angle by which the encoder runs away from the motor's model, slowly forgotten.

    .. math::

        r_k = (1 - \alpha)\,r_{k-1} + \Delta\theta_k - \hat\omega_{k-1} T

    Args:
        residual: :math:`r_{k-1}` in [rad].
        change: Change of the encoder's angle in this tick in [rad].
        speed: Speed that the drive inferred in the tick before in [rad] / [s].
        period: Length :math:`T` of a tick in [s].
        gain: :math:`\alpha`, period over time constant of forgetting.

    Returns:
        :math:`r_k` in [rad].
    """
    return residual + (change - speed * period) - gain * residual


def stopping_angle(angle: float, velocity: float, distance_factor: float) -> float:
    r"""Angle at which a joint stands still if it is braked from now on.

    The stop distance at present speed is :math:`\omega^2 / (2 a)`, in the direction of motion.

    Args:
        angle: In [rad].
        velocity: In [rad] / [s].
        distance_factor: :math:`1 / (2 a)` with the braking deceleration a, in [s²] / [rad].

    Returns:
        Angle in [rad].
    """
    return angle + distance_factor * velocity * abs(velocity)


def winding_heat(heat: float, current: float, heating: float, cooling: float) -> float:
    r"""Warm the winding for one tick: the RMS thermal model of a motor, I²t.

    .. math::

        h_k = h_{k-1} + \frac{T}{\tau_w}\left(\frac{I^2}{I_N^2} - h_{k-1}\right)

    At the continuous current :math:`I_N` the heat tends to 1.

    Args:
        heat: :math:`h_{k-1}`.
        current: :math:`I` in [A].
        heating: :math:`T / (\tau_w I_N^2)` in 1 / [A²].
        cooling: :math:`T / \tau_w`.

    Returns:
        :math:`h_k`.
    """
    return heat + (heating * current * current - cooling * heat)


def watch_joint(
    joint: int,
    period: float,
    bounds: Array,
    measured: Array,
    last_angle: Array,
    memory: Array,
    streaks: Array,
) -> int:
    """Compare what is measured on one joint with its bounds.

    Commands, currents and speeds in the memory are those of the tick before. NaN is outside every bound.

    Args:
        joint: Index of the joint.
        period: Length of a tick in [s].
        bounds: Shape ``(n_joints, BOUND_COUNT)``.
        measured: Columns angle, fast and slow velocity of this tick, shape ``(n_joints, 3)``.
        last_angle: Measured angles of the tick before in [rad], shape ``(n_joints,)``.
        memory: Shape ``(n_joints, MEMORY_COUNT)``; residual and heat are changed in place.
        streaks: Shape ``(n_joints, STREAK_COUNT)``; changed in place.

    Returns:
        Cause of a trip, or ``NO_TRIP``.
    """
    angle = measured[joint, ANGLE]
    velocity = measured[joint, VELOCITY_FAST]
    speed = memory[joint, MOTOR_SPEED]
    current = memory[joint, MOTOR_CURRENT]
    change = angle - last_angle[joint]
    residual = model_residual(memory[joint, RESIDUAL], change, speed, period, bounds[joint, MODEL_GAIN])
    heat = winding_heat(memory[joint, HEAT], current, bounds[joint, HEATING], bounds[joint, COOLING])
    stop = stopping_angle(angle, velocity, bounds[joint, STOP_DISTANCE_FACTOR])
    memory[joint, RESIDUAL] = residual
    memory[joint, HEAT] = heat
    if change == 0.0 and abs(speed) > bounds[joint, FROZEN_SPEED]:
        streaks[joint, FROZEN_STREAK] += 1
    else:
        streaks[joint, FROZEN_STREAK] = 0
    if abs(memory[joint, COMMANDED]) > bounds[joint, HIGHEST_TORQUE]:
        streaks[joint, TORQUE_STREAK] += 1
    else:
        streaks[joint, TORQUE_STREAK] = 0
    if abs(memory[joint, CURRENT_DEVIATION]) > bounds[joint, DRIVE_DEVIATION]:
        streaks[joint, DRIVE_STREAK] += 1
    else:
        streaks[joint, DRIVE_STREAK] = 0
    cause = NO_TRIP
    if not abs(change) <= bounds[joint, ANGLE_STEP]:
        cause = JUMP_TRIP if abs(angle) <= 1e300 else MISSING_TRIP
    elif streaks[joint, FROZEN_STREAK] >= bounds[joint, FROZEN_TICKS]:
        cause = FROZEN_TRIP
    elif not abs(residual) <= bounds[joint, MODEL_DEVIATION]:
        cause = MODEL_TRIP
    elif abs(velocity) > bounds[joint, HIGHEST_SPEED]:
        cause = SPEED_TRIP
    elif stop < bounds[joint, LOWER] or stop > bounds[joint, UPPER]:
        cause = RANGE_TRIP
    elif streaks[joint, TORQUE_STREAK] >= bounds[joint, TORQUE_TICKS]:
        cause = TORQUE_TRIP
    elif abs(current) > bounds[joint, HIGHEST_CURRENT]:
        cause = CURRENT_TRIP
    elif heat > 1.0:
        cause = HEAT_TRIP
    elif streaks[joint, DRIVE_STREAK] >= bounds[joint, DRIVE_TICKS]:
        cause = DRIVE_TRIP
    return cause


def command_is_plausible(command: float, highest: float) -> bool:
    """Whether a command may go to the drive; NaN may not.

    Args:
        command: In [N m].
        highest: Largest plausible magnitude in [N m].

    Returns:
        True if it may.
    """
    return abs(command) <= highest


def hold_torque(speed: float, damping: float) -> float:
    r"""Torque that brakes a held joint, :math:`-b_h \hat\omega`.

    Args:
        speed: Speed that the drive infers in [rad] / [s].
        damping: :math:`b_h` in [N m s] / [rad].

    Returns:
        Torque on the joint in [N m].
    """
    return -damping * speed


def support_share(ticks: int, lowering_ticks: int) -> float:
    """Share of the leg's weight that the hold still carries, fading linearly so that the leg is lowered.

    Args:
        ticks: Since the trip.
        lowering_ticks: Length of the fade.

    Returns:
        From 1 at the trip to 0.
    """
    if ticks >= lowering_ticks:
        return 0.0
    return 1.0 - ticks / lowering_ticks
