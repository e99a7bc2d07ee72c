"""What acts on a coordinate of the plant by itself, and what binds or leads it.

A coordinate without friction has no law of it; one without stops has a stop stiffness of 0. The same record
serves joints with a drive (friction, stops), the ankle (that of its orthosis is a spring) and the vertical
pelvis guide (support force, damping).
"""

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
    """Mechanical stops of a coordinate."""

    lower: float  # Lower stop in [rad] or [m].
    upper: float  # Upper stop.
    stiffness: float  # In [N m] / [rad] or [N] / [m]; 0 for none.
    dissipation: float  # In [s] / [rad] or [s] / [m].


@dataclass(slots=True)
class Spring:
    """A spring about zero with a damper and a constant force; K r as the force makes it one about r."""

    stiffness: float  # In [N m] / [rad] or [N] / [m].
    damping: float  # In [N m s] / [rad] or [N s] / [m].
    force: float  # Constant torque in [N m] or force in [N] on the coordinate.


@dataclass(slots=True)
class Plant:
    """Passive torques on a coordinate: their parameters, and what they came to last."""

    friction: PlantFriction  # Of motor and gear.
    stop: Stop  # Mechanical stops.
    spring: Spring  # Orthosis, or support of the pelvis.
    armature: float = 0.0  # Inertia of rotor and wave generator seen at the joint in [kg m²].
    # Of the bristles that some laws of friction have, at the start of the step, in [rad].
    deflection: float = 0.0
    friction_torque: float = 0.0  # On the coordinate in [N m] or [N].
    stop_torque: float = 0.0  # Likewise.
    spring_torque: float = 0.0  # Likewise, with the constant force.


def free_coordinate() -> Plant:
    """A coordinate on which nothing acts."""
    return Plant(PlantFriction(), Stop(0.0, 0.0, 0.0, 0.0), Spring(0.0, 0.0, 0.0))


def gear_load(plant: Plant, motor: float, acceleration: float) -> float:
    r"""Torque in [N m] that the gear of a joint passes on, :math:`\tau - J\,\ddot q`.

    What turns the rotor never reaches the teeth; in a walk that is half of the knee's torque. The
    acceleration is as it was found last: one evaluation late, since the losses of the gear move the joint
    themselves. With an efficiency above 0.5 that settles, by a factor of :math:`1/\eta - 1` at least in each
    evaluation, for no joint has less inertia than J.
    """
    return motor - plant.armature * acceleration


def passive_torque(
    plant: Plant, rotational: float, q: float, v: float, load: float, displacement: float
) -> float:
    """Friction, stop and spring torque on one coordinate, in [N m] or [N]; the plant keeps each of them.

    ``rotational``: from :func:`~twin_gait.core.friction.rotational_torque`. ``load``: from :func:`gear_load`.
    ``displacement``: of the coordinate since the start of the step.
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
    """What binds a coordinate of the device to the same one of the wearer."""

    stiffness: float  # K in [N m] / [rad] or [N] / [m].
    damping: float  # B in [N m s] / [rad] or [N s] / [m].
    torque: float = 0.0  # Of the device on the wearer in [N m] or [N], as it was last.


def brace_torque(
    brace: Brace, device: float, device_velocity: float, wearer: float, wearer_velocity: float
) -> float:
    r"""What a brace between a coordinate of the device and that of the wearer does on the wearer.

    :math:`\tau = K\,(q_d - q_w) + B\,(\dot q_d - \dot q_w)` in [N m] or [N]; the wearer does the opposite on
    the device.
    """
    return brace.stiffness * (device - wearer) + brace.damping * (device_velocity - wearer_velocity)


@dataclass(slots=True)
class ImposedMotion:
    """A spring and damper that lead a coordinate along a cosine path until they let go."""

    place: int = -1  # The coordinate; -1 for none.
    start_angle: float = 0.0  # Where the path begins in [rad].
    amplitude: float = 0.0  # From end to end of the path in [rad].
    frequency: float = 0.0  # In [Hz].
    stiffness: float = 0.0  # Of the grip in [N m] / [rad].
    damping: float = 0.0  # Of the grip in [N m s] / [rad].
    release_time: float = 0.0  # In [s].
    torque: float = 0.0  # On the coordinate in [N m], as it was last.


def imposed_motion_torque(motion: ImposedMotion, time: float, angle: float, velocity: float) -> float:
    r"""Torque in [N m] of an imposed motion on its joint, 0 after the release time.

    .. math::

        \theta_h = \theta_s + \tfrac{A}{2}\,(1 - \cos 2\pi f t), \qquad
        \tau_h = k_h(\theta_h - \theta) + b_h(\dot\theta_h - \omega)
    """
    if time >= motion.release_time:
        return 0.0
    sine, cosine = sine_cosine(2.0 * math.pi * motion.frequency * time)
    path = motion.start_angle + 0.5 * motion.amplitude * (1.0 - cosine)
    path_velocity = 0.5 * motion.amplitude * 2.0 * math.pi * motion.frequency * sine
    return motion.stiffness * (path - angle) + motion.damping * (path_velocity - velocity)
