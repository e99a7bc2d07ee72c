"""What the firmware does in one tick of 1 ms, joint by joint.

Memory (last angles, rings) is handed in and changed in place; nothing is kept between calls.
"""

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
from twin_gait.core.impedance import impedance_torque

# Columns of the parameters of a phase as a gait table is resolved: four per joint, then the share of gravity
# compensation.
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN = range(4)
COLUMNS_PER_JOINT = 4
_ROOM = 16  # windows of any length up to the next multiple share one compiled loop


@dataclass(slots=True)
class Encoder:
    """Encoder of a joint with its two velocity estimates."""

    resolution: float  # Angle of a count in [rad]; 0 for an ideal sensor.
    angle: float  # Measured in [rad].
    velocity_fast: float  # First-order estimate in [rad] / [s].
    velocity_slow: float  # Decimated and averaged estimate in [rad] / [s].
    last_angle: float  # Of the tick before.
    last_fast: float  # Fast velocity of the tick before.
    decimated_angle: float  # Angle at the last slow sample.
    window: int  # Slow samples that are averaged.
    ring: list[float]  # Last slow samples in [rad] / [s], with room for more than the window.


def new_encoder(resolution: float, angle: float, window: int) -> Encoder:
    """An encoder that is referenced at an angle, at rest.

    ``resolution``: angle of a count in [rad]; 0 for an ideal sensor. ``angle``: in [rad]. ``window``: slow
    samples that are averaged.
    """
    room = -(-window // _ROOM) * _ROOM
    return Encoder(resolution, angle, 0.0, 0.0, 0.0, 0.0, 0.0, window, [0.0] * room)


def measure_joint(
    encoder: Encoder, tick: int, reading: float, period: float, fast_gain: float, decimation: int
) -> None:
    r"""Encoder and the two velocity estimates of one tick.

    ``velocity_fast`` is the 1 kHz encoder difference through a first-order filter. ``velocity_slow``
    is the thesis's: the difference over ``decimation`` ticks, averaged over the last samples in the
    ring (thesis 2.3.1; about 50 ms late).

    ``encoder``: changed in place. ``tick``: present tick; in tick 0 only the angle is read. ``reading``: what
    the sensor reads, noise included, in [rad]. ``period``: length of a tick in [s]. ``fast_gain``: from
    :func:`~twin_gait.core.estimation.first_order_gain`. ``decimation``: ticks between two samples of the slow
    estimate.
    """
    measure_angle(encoder, tick == 0, reading, period, fast_gain)
    if tick > 0 and tick % decimation == 0:
        sample_slowly(encoder, tick // decimation, decimation * period)


def measure_angle(encoder: Encoder, first: bool, reading: float, period: float, fast_gain: float) -> None:
    """Encoder and fast velocity estimate of one tick; see :func:`measure_joint`.

    ``encoder``: changed in place. ``first``: whether only the angle is read, for want of one before.
    ``reading``: what the sensor reads, noise included, in [rad]. ``period``: length of a tick in [s].
    ``fast_gain``: of the filter.
    """
    angle = quantise(reading, encoder.resolution)
    fast = first_order_step(encoder.velocity_fast, (angle - encoder.angle) / period, fast_gain)
    encoder.last_angle = encoder.angle
    encoder.last_fast = encoder.velocity_fast
    if first:
        encoder.decimated_angle = angle
    else:
        encoder.velocity_fast = fast
    encoder.angle = angle


def sample_slowly(encoder: Encoder, number: int, interval: float) -> None:
    """Take a sample of the slow velocity estimate, and the mean over the window.

    ``encoder``: changed in place. ``number``: of the sample. ``interval``: between two samples in [s].
    """
    sample = (encoder.angle - encoder.decimated_angle) / interval
    encoder.decimated_angle = encoder.angle
    window = encoder.window
    encoder.ring[number % window] = sample
    total = 0.0
    for position in range(window):
        total += encoder.ring[position]
    encoder.velocity_slow = total / window


@dataclass(slots=True)
class Setpoint:
    """What a gait table asks of a joint."""

    stiffness: float  # k in [N m] / [rad].
    damping: float  # b in [N m s] / [rad].
    equilibrium: float  # θ0 in [rad].
    gain: float  # G, of the friction compensation.


def blend_setpoint(start: Setpoint, target: Setpoint, share: float, blended: Setpoint) -> None:
    """Fade the setpoint of a joint from where it was at the switch to that of the phase.

    ``start``: values at the switch. ``target``: values of the phase. ``share``: from
    :func:`~twin_gait.core.blending.blend_share`. ``blended``: present values; changed in place.
    """
    blended.stiffness = blend(start.stiffness, target.stiffness, share)
    blended.damping = blend(start.damping, target.damping, share)
    blended.equilibrium = blend(start.equilibrium, target.equilibrium, share)
    blended.gain = blend(start.gain, target.gain, share)


def copy_setpoint(source: Setpoint, target: Setpoint) -> None:
    """Give a setpoint the values of another.

    ``target``: changed in place.
    """
    target.stiffness = source.stiffness
    target.damping = source.damping
    target.equilibrium = source.equilibrium
    target.gain = source.gain


def controller_torques(
    angle: float,
    velocity_fast: float,
    velocity_slow: float,
    stiffness: float,
    damping: float,
    equilibrium_angle: float,
    friction_compensation_gain: float,
    model_friction_torque: float,
) -> tuple[float, float]:
    r"""Impedance on friction compensation, equations (2.17) and (2.18) of the thesis.

    .. math::

        \tau_{imp} = -[k(\theta-\theta_0) + b\,\hat\omega_{fast}], \qquad
        \tau_{fc} = G\,T_{fr}(\hat\omega_{slow})

    ``angle``: measured angle in [rad]. ``velocity_fast``: fast velocity estimate in [rad] / [s], for the
    damper. ``velocity_slow``: slow estimate in [rad] / [s]; this law needs it only through the friction
    model. ``stiffness``: k in [N m] / [rad]. ``damping``: b in [N m s] / [rad]. ``equilibrium_angle``: θ0 in
    [rad]. ``friction_compensation_gain``: G. ``model_friction_torque``: T_fr of the compensator's friction
    model at the slow velocity in [N m]. Returns the impedance torque and friction-compensation torque in [N
    m].
    """
    impedance = impedance_torque(angle, velocity_fast, stiffness, damping, equilibrium_angle)
    return impedance, friction_compensation_gain * model_friction_torque


def target_current(motor: Motor, command: float, torque_limit: float, current_limit: float) -> float:
    """Current that the firmware asks the drive for: torque limit, conversion, current limit.

    ``motor``: motor and gear. ``command``: sum of the controller's torques in [N m]. ``torque_limit``: in [N
    m]. ``current_limit``: in [A]. Returns the current in [A].
    """
    limited = saturate(command, torque_limit)
    wanted = torque_to_current(limited, motor.torque_constant, motor.gear_ratio)
    return saturate(wanted, current_limit)


def driven_motor(
    motor: Motor, current: float, joint_velocity: float, bus_voltage: float
) -> tuple[float, float]:
    """What a motor gives when its drive is asked for a current: what the bus voltage allows at this speed.

    The current loop (20 kHz) is ideal within the tick.

    ``motor``: motor and gear. ``current``: asked for, from :func:`target_current`, in [A].
    ``joint_velocity``: true joint velocity in [rad] / [s], for the back-EMF. ``bus_voltage``: in [V]. Returns
    the measured current in [A], motor torque at the joint before the losses of the gear in [N m].
    """
    measured = voltage_limited_current(
        current, joint_velocity, bus_voltage, motor.resistance, motor.torque_constant, motor.gear_ratio
    )
    return measured, current_to_torque(measured, motor.torque_constant, motor.gear_ratio)
