"""What acts on a coordinate of the plant by itself, and what binds or leads it.

A coordinate without friction has no law of it; one without stops has a stop stiffness of 0. The same record
serves joints with a drive (friction, stops), the ankle (that of its orthosis is a spring) and the vertical
pelvis guide (support force, damping).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.friction import (
    FRICTIONLESS,
    OTHER_LAWS,
    PlantFriction,
    advanced_deflection,
    whole_friction_torque,
)


@dataclass(slots=True)
class Stop:
    """Mechanical stops of a coordinate.

    Attributes:
        lower: Lower stop in [rad] or [m].
        upper: Upper stop.
        stiffness: In [N m] / [rad] or [N] / [m]; 0 for none.
        dissipation: In [s] / [rad] or [s] / [m].
    """

    lower: float
    upper: float
    stiffness: float
    dissipation: float


@dataclass(slots=True)
class Spring:
    """A spring about zero with a damper and a constant force; K r as the force makes it one about r.

    Attributes:
        stiffness: In [N m] / [rad] or [N] / [m].
        damping: In [N m s] / [rad] or [N s] / [m].
        force: Constant torque in [N m] or force in [N] on the coordinate.
    """

    stiffness: float
    damping: float
    force: float


@dataclass(slots=True)
class Plant:
    """Passive torques on a coordinate: their parameters, and what they came to last.

    Attributes:
        friction: Of motor and gear.
        stop: Mechanical stops.
        spring: Orthosis, or support of the pelvis.
        armature: Inertia of rotor and wave generator seen at the joint in [kg m²].
        deflection: Of the bristles that some laws of friction have, at the start of the step, in [rad].
        friction_torque: On the coordinate in [N m] or [N].
        stop_torque: Likewise.
        spring_torque: Likewise, with the constant force.
    """

    friction: PlantFriction
    stop: Stop
    spring: Spring
    armature: float = 0.0
    deflection: float = 0.0
    friction_torque: float = 0.0
    stop_torque: float = 0.0
    spring_torque: float = 0.0


def free_coordinate() -> Plant:
    """A coordinate on which nothing acts."""
    return Plant(PlantFriction(), Stop(0.0, 0.0, 0.0, 0.0), Spring(0.0, 0.0, 0.0))


def gear_load(plant: Plant, motor: float, acceleration: float) -> float:
    r"""Torque that the gear of a joint passes on, :math:`\tau - J\,\ddot q`.

    What turns the rotor never reaches the teeth; in a walk that is half of the knee's torque.

    Args:
        plant: Of the coordinate.
        motor: Torque :math:`\tau` of its motor at the joint in [N m].
        acceleration: :math:`\ddot q` in [rad] / [s²] as it was found last: one evaluation late, since the
            losses of the gear move the joint themselves. With an efficiency above 0.5 that settles, by a
            factor of :math:`1/\eta - 1` at least in each evaluation, for no joint has less inertia than J.

    Returns:
        Torque in [N m].
    """
    return motor - plant.armature * acceleration


def passive_torque(
    plant: Plant, rotational: float, q: float, v: float, load: float, displacement: float
) -> float:
    """Friction, stop and spring torque on one coordinate.

    Args:
        plant: Of the coordinate; its torques are changed in place.
        rotational: From :func:`~twin_gait.core.friction.rotational_torque`.
        q: Coordinate in [rad] or [m].
        v: Its velocity.
        load: From :func:`gear_load`.
        displacement: Of the coordinate since the start of the step, in [rad] or [m].

    Returns:
        Their sum in [N m] or [N], as it acts on the coordinate.
    """
    law, limits, spring = plant.friction, plant.stop, plant.spring
    friction, stop = 0.0, 0.0
    if law.law != FRICTIONLESS:
        deflection = plant.deflection
        if OTHER_LAWS:
            deflection = advanced_deflection(law, displacement, v, deflection)
        friction = -whole_friction_torque(law, rotational, v, deflection, load)
    if limits.stiffness != 0.0:
        stop = mechanical_stop_torque(q, v, limits.lower, limits.upper, limits.stiffness, limits.dissipation)
    plant.friction_torque = friction
    plant.stop_torque = stop
    plant.spring_torque = spring.force - spring.stiffness * q - spring.damping * v
    return friction + stop + plant.spring_torque


@dataclass(slots=True)
class Brace:
    """What binds a coordinate of the device to the same one of the wearer.

    Attributes:
        stiffness: K in [N m] / [rad] or [N] / [m].
        damping: B in [N m s] / [rad] or [N s] / [m].
        torque: Of the device on the wearer in [N m] or [N], as it was last.
    """

    stiffness: float
    damping: float
    torque: float = 0.0


def brace_torque(
    brace: Brace, device: float, device_velocity: float, wearer: float, wearer_velocity: float
) -> float:
    r"""Torque of a brace between a coordinate of the device and the same one of the wearer.

    .. math::

        \tau = K\,(q_d - q_w) + B\,(\dot q_d - \dot q_w)

    Args:
        brace: K and B.
        device: q_d in [rad] or [m].
        device_velocity: Its velocity.
        wearer: q_w in [rad] or [m].
        wearer_velocity: Its velocity.

    Returns:
        What the device does on the wearer in [N m] or [N]; the wearer does the opposite on the device.
    """
    return brace.stiffness * (device - wearer) + brace.damping * (device_velocity - wearer_velocity)


@dataclass(slots=True)
class ImposedMotion:
    """A spring and damper that lead a coordinate along a cosine path until they let go.

    Attributes:
        place: The coordinate; -1 for none.
        start_angle: Where the path begins in [rad].
        amplitude: From end to end of the path in [rad].
        frequency: In [Hz].
        stiffness: Of the grip in [N m] / [rad].
        damping: Of the grip in [N m s] / [rad].
        release_time: In [s].
        torque: On the coordinate in [N m], as it was last.
    """

    place: int
    start_angle: float
    amplitude: float
    frequency: float
    stiffness: float
    damping: float
    release_time: float
    torque: float = 0.0


def imposed_motion_torque(motion: ImposedMotion, time: float, angle: float, velocity: float) -> float:
    r"""Torque of an imposed motion on its joint.

    .. math::

        \theta_h = \theta_s + \tfrac{A}{2}\,(1 - \cos 2\pi f t), \qquad
        \tau_h = k_h(\theta_h - \theta) + b_h(\dot\theta_h - \omega)

    After the release time there is none.

    Args:
        motion: Path and grip.
        time: In [s].
        angle: Joint angle in [rad].
        velocity: Joint velocity in [rad] / [s].

    Returns:
        Torque on the joint in [N m].
    """
    if time >= motion.release_time:
        return 0.0
    sine, cosine = sine_cosine(2.0 * math.pi * motion.frequency * time)
    path = motion.start_angle + 0.5 * motion.amplitude * (1.0 - cosine)
    path_velocity = 0.5 * motion.amplitude * 2.0 * math.pi * motion.frequency * sine
    return motion.stiffness * (path - angle) + motion.damping * (path_velocity - velocity)
