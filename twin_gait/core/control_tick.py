"""Laws of one tick of the firmware of 1 ms, for one joint.

The state (last angles, ring buffers) is passed in and changed in place; nothing is kept between calls. Angles
are in [rad], ``period`` is the length of a tick in [s], and a reading is the output of the sensor, noise
included.
"""

import math
from dataclasses import dataclass

from twin_gait.core.actuator import (
    Motor,
    current_to_torque,
    saturate,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.core.blending import blend
from twin_gait.core.estimation import first_order_step, quantise

# Columns of the resolved parameters of a phase of a gait table: four per joint, then the share of gravity
# compensation.
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN = range(4)
COLUMNS_PER_JOINT = 4
# The ring is a multiple of this, so that windows up to the next multiple share a compiled loop.
_CAPACITY_STEP = 16


@dataclass(slots=True)
class Encoder:
    """State of the encoder of a joint with its two velocity estimates."""

    resolution: float  # Angle of a count in [rad]; 0 for an ideal sensor.
    angle: float  # Measured angle in [rad].
    velocity_fast: float  # First-order estimate in [rad/s].
    velocity_slow: float  # Decimated and averaged estimate in [rad/s].
    last_angle: float  # Angle of the tick before in [rad].
    last_fast: float  # Fast velocity estimate of the tick before in [rad/s].
    decimated_angle: float  # Angle at the last slow sample in [rad].
    window: int  # Number of slow samples that are averaged.
    ring: list[float]  # Ring buffer of the last slow samples in [rad/s]; at least as long as the window.


def new_encoder(resolution: float, angle: float, window: int) -> Encoder:
    """Create an encoder at rest that is referenced at an angle; the resolution of an ideal encoder is 0."""
    room = -(-window // _CAPACITY_STEP) * _CAPACITY_STEP
    return Encoder(resolution, angle, 0.0, 0.0, 0.0, 0.0, 0.0, window, [0.0] * room)


def measure_joint(
    encoder: Encoder, tick: int, reading: float, period: float, fast_gain: float, decimation: int
) -> None:
    """Update encoder angle and the two velocity estimates for one tick; in tick 0 only the angle.

    ``velocity_fast`` is the 1 kHz encoder difference through a first-order filter. ``velocity_slow`` is the
    estimate of the thesis: the difference over ``decimation`` ticks, averaged over the last samples in the
    ring (thesis 2.3.1; about 50 ms late).
    """
    measure_angle(encoder, tick == 0, reading, period, fast_gain)
    if tick > 0 and tick % decimation == 0:
        update_slow_velocity(encoder, tick // decimation, decimation * period)


def measure_angle(encoder: Encoder, first: bool, reading: float, period: float, fast_gain: float) -> None:
    """Update encoder angle and fast velocity estimate for one tick; see :func:`measure_joint`.

    ``first``: whether only the angle is read, because there is no earlier one.
    """
    angle = quantise(reading, encoder.resolution)
    fast = first_order_step(encoder.velocity_fast, (angle - encoder.angle) / period, fast_gain)
    encoder.last_angle = encoder.angle
    encoder.last_fast = encoder.velocity_fast
    if first:
        encoder.decimated_angle = angle
        # The first angle must not count as a jump.
        encoder.last_angle = angle if math.isfinite(angle) else encoder.last_angle
    else:
        encoder.velocity_fast = fast
    encoder.angle = angle


def update_slow_velocity(encoder: Encoder, number: int, interval: float) -> None:
    """Take a sample of the slow velocity estimate and average over the window; ``interval`` in [s]."""
    sample = (encoder.angle - encoder.decimated_angle) / interval
    encoder.decimated_angle = encoder.angle
    window = encoder.window
    encoder.ring[number % window] = sample
    total = 0.0
    for position in range(window):
        total += encoder.ring[position]
    encoder.velocity_slow = total / window


@dataclass(slots=True)
class ImpedanceSetpoint:
    """Setpoint of a joint from a gait table."""

    stiffness: float  # k in [N·m/rad].
    damping: float  # b in [N·m·s/rad].
    equilibrium: float  # θ0 in [rad].
    gain: float  # G, gain of the friction compensation.


def blend_setpoint(
    start: ImpedanceSetpoint, target: ImpedanceSetpoint, share: float, blended: ImpedanceSetpoint
) -> None:
    """Blend the setpoint of a joint from its value at the phase switch to that of the new phase.

    ``share``: from :func:`~twin_gait.core.blending.blend_share`. ``blended`` is changed in place.
    """
    blended.stiffness = blend(start.stiffness, target.stiffness, share)
    blended.damping = blend(start.damping, target.damping, share)
    blended.equilibrium = blend(start.equilibrium, target.equilibrium, share)
    blended.gain = blend(start.gain, target.gain, share)


def copy_setpoint(source: ImpedanceSetpoint, target: ImpedanceSetpoint) -> None:
    """Copy the values of a setpoint to ``target``."""
    target.stiffness = source.stiffness
    target.damping = source.damping
    target.equilibrium = source.equilibrium
    target.gain = source.gain


def target_current(motor: Motor, command: float, torque_limit: float, current_limit: float) -> float:
    """Compute the firmware's target current in [A]: torque limit, conversion, current limit.

    ``command``: sum of the controller's torques in [N·m].
    """
    limited = saturate(command, torque_limit)
    current = torque_to_current(limited, motor.torque_constant, motor.gear_ratio)
    return saturate(current, current_limit)


def drive_motor(
    motor: Motor, current: float, joint_velocity: float, bus_voltage: float
) -> tuple[float, float]:
    """Compute current and torque of a motor for a target current, limited by the bus voltage at this speed.

    The current loop (20 kHz) is ideal within the tick. ``joint_velocity``: the true one, for the back-EMF.
    Returns the measured current in [A] and the motor torque at the joint, before the losses of the gear, in
    [N·m].
    """
    measured = voltage_limited_current(motor, current, joint_velocity, bus_voltage)
    return measured, current_to_torque(measured, motor.torque_constant, motor.gear_ratio)
