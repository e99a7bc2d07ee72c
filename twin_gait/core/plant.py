"""Passive torques of the plant, one row of parameters per coordinate.

Columns of a row: friction a, b, c, d; stop lower, upper, stiffness, dissipation; spring stiffness
and damping about zero; constant force. A coordinate without friction has a = b = d = 0 and c = 1; one
without stops has a stop stiffness of 0. The same row serves hip and knee (friction, stops), the
ankle orthosis (spring, stops) and the vertical pelvis guide (support force, damping).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.friction import rotational_friction_torque

Array = np.ndarray[Any, np.dtype[Any]]

(
    FRICTION_A,
    FRICTION_B,
    FRICTION_C,
    FRICTION_D,
    STOP_LOWER,
    STOP_UPPER,
    STOP_STIFFNESS,
    STOP_DISSIPATION,
    SPRING_STIFFNESS,
    SPRING_DAMPING,
    CONSTANT_FORCE,
) = range(11)
PLANT_COLUMNS = 11

# Columns of the torques written by :func:`passive_torques`.
FRICTION, STOP, SPRING = range(3)
PASSIVE_COLUMNS = 3


def passive_torques(q: Array, v: Array, rows: Array, out: Array) -> None:
    """Friction, stop and spring torques on every coordinate.

    Args:
        q: Coordinates in [rad] or [m], shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        rows: Parameters, shape ``(n, PLANT_COLUMNS)``.
        out: Torques in [N m] or [N] as they act on the coordinate: friction, stop, spring with
            constant force; shape ``(n, PASSIVE_COLUMNS)``, changed in place.
    """
    for i in range(q.shape[0]):
        if rows[i, FRICTION_A] != 0.0 or rows[i, FRICTION_B] != 0.0 or rows[i, FRICTION_D] != 0.0:
            out[i, FRICTION] = -rotational_friction_torque(
                v[i], rows[i, FRICTION_A], rows[i, FRICTION_B], rows[i, FRICTION_C], rows[i, FRICTION_D]
            )
        else:
            out[i, FRICTION] = 0.0
        if rows[i, STOP_STIFFNESS] != 0.0:
            out[i, STOP] = mechanical_stop_torque(
                q[i],
                v[i],
                rows[i, STOP_LOWER],
                rows[i, STOP_UPPER],
                rows[i, STOP_STIFFNESS],
                rows[i, STOP_DISSIPATION],
            )
        else:
            out[i, STOP] = 0.0
        out[i, SPRING] = (
            rows[i, CONSTANT_FORCE] - rows[i, SPRING_STIFFNESS] * q[i] - rows[i, SPRING_DAMPING] * v[i]
        )


# Sources of work on the leg.
MOTOR_WORK, FRICTION_WORK, STOP_WORK, SPRING_WORK, CONTACT_WORK, PATIENT_WORK = range(6)
WORK_SOURCE_COUNT = 6


def add_work(
    duration: float,
    motor: Array,
    passive: Array,
    hand_index: int,
    hand: float,
    contact_power: float,
    v: Array,
    works: Array,
) -> None:
    """Add the work that every source does on the leg in a short time.

    Args:
        duration: In [s].
        motor: Motor torques, shape ``(n,)``.
        passive: From :func:`passive_torques`, shape ``(n, PASSIVE_COLUMNS)``.
        hand_index: Coordinate that a hand moves, or a negative number.
        hand: Torque of the hand in [N m].
        contact_power: Of all contact forces in [W].
        v: Velocities, shape ``(n,)``.
        works: Work by source in [J], shape ``(WORK_SOURCE_COUNT,)``; changed in place.
    """
    by_motor, by_friction, by_stop, by_spring = 0.0, 0.0, 0.0, 0.0
    for i in range(v.shape[0]):
        by_motor += motor[i] * v[i]
        by_friction += passive[i, FRICTION] * v[i]
        by_stop += passive[i, STOP] * v[i]
        by_spring += passive[i, SPRING] * v[i]
    works[MOTOR_WORK] += duration * by_motor
    works[FRICTION_WORK] += duration * by_friction
    works[STOP_WORK] += duration * by_stop
    works[SPRING_WORK] += duration * by_spring
    works[CONTACT_WORK] += duration * contact_power
    if hand_index >= 0:
        works[PATIENT_WORK] += duration * hand * v[hand_index]


def hand_torque(
    time: float,
    angle: float,
    velocity: float,
    start_angle: float,
    amplitude: float,
    frequency: float,
    stiffness: float,
    damping: float,
    release_time: float,
) -> float:
    r"""Torque of a hand that leads a joint along a cosine path.

    .. math::

        \theta_h = \theta_s + \tfrac{A}{2}\,(1 - \cos 2\pi f t), \qquad
        \tau_h = k_h(\theta_h - \theta) + b_h(\dot\theta_h - \omega)

    After the release time the hand lets go.

    Args:
        time: In [s].
        angle: Joint angle in [rad].
        velocity: Joint velocity in [rad] / [s].
        start_angle: Where the path begins in [rad].
        amplitude: From end to end of the path in [rad].
        frequency: In [Hz].
        stiffness: Of the grip in [N m] / [rad].
        damping: Of the grip in [N m s] / [rad].
        release_time: In [s].

    Returns:
        Torque on the joint in [N m].
    """
    if time >= release_time:
        return 0.0
    phase = 2.0 * math.pi * frequency * time
    path = start_angle + 0.5 * amplitude * (1.0 - math.cos(phase))
    path_velocity = 0.5 * amplitude * 2.0 * math.pi * frequency * math.sin(phase)
    return stiffness * (path - angle) + damping * (path_velocity - velocity)
