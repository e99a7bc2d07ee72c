"""What the firmware does in one tick of 1 ms, on plain arrays.

Joints are numbered leg by leg (left hip, left knee, right hip, …). Memory (last angles, rings) is
handed in and changed in place; nothing is kept between calls.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_gait.core.actuator import (
    current_to_torque,
    saturate,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.estimation import first_order_step, quantise
from twin_gait.core.impedance import impedance_torque

Array = np.ndarray[Any, np.dtype[Any]]

# Columns of a measurement.
ANGLE, VELOCITY_FAST, VELOCITY_SLOW = range(3)

# Columns of the parameters of a phase: four per joint, then the share of gravity compensation.
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN = range(4)
COLUMNS_PER_JOINT = 4


def measure_joints(
    tick: int,
    angles: Array,
    resolution: Array,
    period: float,
    fast_gain: float,
    decimation: int,
    measured: Array,
    decimated_angle: Array,
    ring: Array,
) -> None:
    r"""Encoders and the two velocity estimates of one tick.

    ``velocity_fast`` is the 1 kHz encoder difference through a first-order filter. ``velocity_slow``
    is the thesis's: the difference over ``decimation`` ticks, averaged over the last samples in the
    ring (thesis 2.3.1; about 50 ms late).

    Args:
        tick: Present tick; in tick 0 only the angles are read.
        angles: What the sensors read, noise included, in [rad], shape ``(n_joints,)``.
        resolution: Encoder resolution in [rad], shape ``(n_joints,)``; 0 for ideal sensors.
        period: Length of a tick in [s].
        fast_gain: From :func:`~twin_gait.core.estimation.first_order_gain`.
        decimation: Ticks between two samples of the slow estimate.
        measured: Columns angle, fast and slow velocity, shape ``(n_joints, 3)``; changed in place.
        decimated_angle: Angle at the last slow sample, shape ``(n_joints,)``; changed in place.
        ring: Last slow samples, shape ``(window, n_joints)``; changed in place.
    """
    window = ring.shape[0]
    for joint in range(angles.shape[0]):
        angle = quantise(angles[joint], resolution[joint])
        if tick == 0:
            measured[joint, ANGLE] = angle
            decimated_angle[joint] = angle
            continue
        difference = (angle - measured[joint, ANGLE]) / period
        measured[joint, VELOCITY_FAST] = first_order_step(
            measured[joint, VELOCITY_FAST], difference, fast_gain
        )
        measured[joint, ANGLE] = angle
        if tick % decimation == 0:
            sample = (angle - decimated_angle[joint]) / (decimation * period)
            decimated_angle[joint] = angle
            ring[(tick // decimation) % window, joint] = sample
            total = 0.0
            for position in range(window):
                total += ring[position, joint]
            measured[joint, VELOCITY_SLOW] = total / window


def leg_signals(
    leg: int,
    joints_per_leg: int,
    measured: Array,
    foot_load: Array,
    ticks_in_phase: Array,
    period: float,
    signals: Array,
    offset: int,
) -> None:
    """Write the measured signals of one leg in the order in which guards read them.

    Args:
        leg: Index of the leg.
        joints_per_leg: Actuated joints of a leg.
        measured: Shape ``(n_joints, 3)``.
        foot_load: Foot load over body weight, shape ``(n_legs,)``.
        ticks_in_phase: Shape ``(n_legs,)``.
        period: Length of a tick in [s].
        signals: Signal array; changed in place.
        offset: Where this leg's signals begin.
    """
    position = offset
    for index in range(joints_per_leg):
        joint = leg * joints_per_leg + index
        signals[position] = measured[joint, ANGLE]
        signals[position + 1] = measured[joint, VELOCITY_FAST]
        position += 2
    signals[position] = foot_load[leg]
    signals[position + 1] = ticks_in_phase[leg] * period


def blend_phase(
    leg: int,
    ticks_since_switch: int,
    duration_ticks: int,
    law: int,
    start: Array,
    target: Array,
    blended: Array,
) -> None:
    """Fade the parameters of a leg from where they were at the switch to those of the phase.

    Args:
        leg: Index of the leg.
        ticks_since_switch: Ticks since the phase was entered.
        duration_ticks: Length of the fade.
        law: Code of the blending law.
        start: Values at the switch, shape ``(n_legs, n_columns)``.
        target: Values of the phase, shape ``(n_columns,)``.
        blended: Present values, shape ``(n_legs, n_columns)``; changed in place.
    """
    progress = 1.0 if duration_ticks <= 0 else ticks_since_switch / duration_ticks
    share = blend_share(progress, law)
    for column in range(target.shape[0]):
        blended[leg, column] = blend(start[leg, column], target[column], share)


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

    Args:
        angle: Measured angle in [rad].
        velocity_fast: Fast velocity estimate in [rad] / [s], for the damper.
        velocity_slow: Slow estimate in [rad] / [s]; this law needs it only through the friction model.
        stiffness: k in [N m] / [rad].
        damping: b in [N m s] / [rad].
        equilibrium_angle: θ0 in [rad].
        friction_compensation_gain: G.
        model_friction_torque: T_fr of the compensator's friction model at the slow velocity in [N m].

    Returns:
        Impedance torque and friction-compensation torque in [N m].
    """
    impedance = impedance_torque(angle, velocity_fast, stiffness, damping, equilibrium_angle)
    return impedance, friction_compensation_gain * model_friction_torque


def drive_motor(
    command: float,
    joint_velocity: float,
    bus_voltage: float,
    torque_limit: float,
    current_limit: float,
    torque_constant: float,
    gear_ratio: float,
    gear_efficiency: float,
    resistance: float,
) -> tuple[float, float, float]:
    """From the commanded torque to the torque that the motor gives.

    Torque limit, conversion to current, current limit, then what the bus voltage allows at the
    present speed. The current loop (20 kHz) is ideal within the tick.

    Args:
        command: Sum of the controller's torques in [N m].
        joint_velocity: True joint velocity in [rad] / [s], for the back-EMF.
        bus_voltage: In [V].
        torque_limit: In [N m].
        current_limit: In [A].
        torque_constant: In [N m] / [A].
        gear_ratio: Motor turns per joint turn.
        gear_efficiency: In (0, 1].
        resistance: In [Ω].

    Returns:
        Target current in [A], measured current in [A], motor torque at the joint in [N m].
    """
    limited = saturate(command, torque_limit)
    target = saturate(torque_to_current(limited, torque_constant, gear_ratio, gear_efficiency), current_limit)
    current = voltage_limited_current(
        target, joint_velocity, bus_voltage, resistance, torque_constant, gear_ratio
    )
    return target, current, current_to_torque(current, torque_constant, gear_ratio, gear_efficiency)
