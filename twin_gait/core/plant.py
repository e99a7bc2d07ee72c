"""Passive torques of the plant, one row of parameters per coordinate.

Columns of a row: friction a, b, c, d; stop lower, upper, stiffness, dissipation; spring stiffness
and damping about zero; constant force; coefficient of the load-dependent friction. A coordinate without
friction has a = b = d = 0 and c = 1; one without stops has a stop stiffness of 0. The same row serves hip
and knee (friction, stops), the ankle orthosis (spring, stops) and the vertical pelvis guide (support force,
damping).
"""

from __future__ import annotations

import math

from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.friction import load_friction_torque, rotational_friction_torque

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
    LOAD_FRICTION,
) = range(12)
PLANT_COLUMNS = 12

# Columns of the torques of :func:`passive_torque`.
FRICTION, STOP, SPRING = range(3)
PASSIVE_COLUMNS = 3


def passive_torque(
    q: float,
    v: float,
    load: float,
    friction_a: float,
    friction_b: float,
    friction_c: float,
    friction_d: float,
    stop_lower: float,
    stop_upper: float,
    stop_stiffness: float,
    stop_dissipation: float,
    spring_stiffness: float,
    spring_damping: float,
    constant_force: float,
    load_friction: float,
) -> tuple[float, float, float]:
    """Friction, stop and spring torque on one coordinate; the arguments after the load are one row.

    Args:
        q: Coordinate in [rad] or [m].
        v: Its velocity.
        load: Torque of its motor in [N m], which presses the teeth of the gear.
        friction_a: Break-away torque.
        friction_b: Coulomb friction.
        friction_c: Break-away velocity.
        friction_d: Viscous friction.
        stop_lower: Lower stop.
        stop_upper: Upper stop.
        stop_stiffness: Of the stops; 0 for none.
        stop_dissipation: Of the stops.
        spring_stiffness: Of a spring about zero.
        spring_damping: Of a damper.
        constant_force: On the coordinate.
        load_friction: Share of the load's magnitude that becomes friction; 0 for none.

    Returns:
        Torques in [N m] or [N] as they act on the coordinate: friction, stop, spring with constant force.
    """
    friction, stop = 0.0, 0.0
    if friction_a != 0.0 or friction_b != 0.0 or friction_d != 0.0:
        friction = -rotational_friction_torque(v, friction_a, friction_b, friction_c, friction_d)
    if load_friction != 0.0:
        friction -= load_friction_torque(v, load, load_friction, friction_c)
    if stop_stiffness != 0.0:
        stop = mechanical_stop_torque(q, v, stop_lower, stop_upper, stop_stiffness, stop_dissipation)
    return friction, stop, constant_force - spring_stiffness * q - spring_damping * v


# Sources of work on the leg; the last one only where the wearer is bound to the device by braces.
MOTOR_WORK, FRICTION_WORK, STOP_WORK, SPRING_WORK, CONTACT_WORK, PATIENT_WORK, BRACE_WORK = range(7)


def brace_torque(
    device: float,
    device_velocity: float,
    wearer: float,
    wearer_velocity: float,
    stiffness: float,
    damping: float,
) -> float:
    r"""Torque of a brace between a coordinate of the device and the same one of the wearer.

    .. math::

        \tau = K\,(q_d - q_w) + B\,(\dot q_d - \dot q_w)

    Args:
        device: q_d in [rad] or [m].
        device_velocity: Its velocity.
        wearer: q_w in [rad] or [m].
        wearer_velocity: Its velocity.
        stiffness: K in [N m] / [rad] or [N] / [m].
        damping: B in [N m s] / [rad] or [N s] / [m].

    Returns:
        What the device does on the wearer in [N m] or [N]; the wearer does the opposite on the device.
    """
    return stiffness * (device - wearer) + damping * (device_velocity - wearer_velocity)


def imposed_motion_torque(
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
    r"""Torque of an imposed motion: a spring and damper that lead a joint along a cosine path.

    .. math::

        \theta_h = \theta_s + \tfrac{A}{2}\,(1 - \cos 2\pi f t), \qquad
        \tau_h = k_h(\theta_h - \theta) + b_h(\dot\theta_h - \omega)

    After the release time there is none.

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
