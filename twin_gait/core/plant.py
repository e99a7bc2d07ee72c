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
    r"""Torque that the gear of a joint passes on, :math:`\tau - J\,\ddot q`.

    What turns the rotor never reaches the teeth; in a walk that is half of the knee's torque.

    ``plant``: of the coordinate. ``motor``: torque :math:`\tau` of its motor at the joint in [N m].
    ``acceleration``: :math:`\ddot q` in [rad] / [s²] as it was found last: one evaluation late, since the
    losses of the gear move the joint themselves. With an efficiency above 0.5 that settles, by a factor of
    :math:`1/\eta - 1` at least in each evaluation, for no joint has less inertia than J. Returns the torque
    in [N m].
    """
    return motor - plant.armature * acceleration


def passive_torque(
    plant: Plant, rotational: float, q: float, v: float, load: float, displacement: float
) -> float:
    """Friction, stop and spring torque on one coordinate.

    ``plant``: of the coordinate; its torques are changed in place. ``rotational``: from
    :func:`~twin_gait.core.friction.rotational_torque`. ``q``: coordinate in [rad] or [m]. ``v``: its
    velocity. ``load``: from :func:`gear_load`. ``displacement``: of the coordinate since the start of the
    step, in [rad] or [m]. Returns their sum in [N m] or [N], as it acts on the coordinate.
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
    r"""Torque of a brace between a coordinate of the device and the same one of the wearer.

    .. math::

        \tau = K\,(q_d - q_w) + B\,(\dot q_d - \dot q_w)

    ``brace``: K and B. ``device``: q_d in [rad] or [m]. ``device_velocity``: its velocity. ``wearer``: q_w in
    [rad] or [m]. ``wearer_velocity``: its velocity. Returns what the device does on the wearer in [N m] or
    [N]; the wearer does the opposite on the device.
    """
    return brace.stiffness * (device - wearer) + brace.damping * (device_velocity - wearer_velocity)


@dataclass(slots=True)
class ImposedMotion:
    """A spring and damper that lead a coordinate along a cosine path until they let go."""

    place: int  # The coordinate; -1 for none.
    start_angle: float  # Where the path begins in [rad].
    amplitude: float  # From end to end of the path in [rad].
    frequency: float  # In [Hz].
    stiffness: float  # Of the grip in [N m] / [rad].
    damping: float  # Of the grip in [N m s] / [rad].
    release_time: float  # In [s].
    torque: float = 0.0  # On the coordinate in [N m], as it was last.


def imposed_motion_torque(motion: ImposedMotion, time: float, angle: float, velocity: float) -> float:
    r"""Torque of an imposed motion on its joint.

    .. math::

        \theta_h = \theta_s + \tfrac{A}{2}\,(1 - \cos 2\pi f t), \qquad
        \tau_h = k_h(\theta_h - \theta) + b_h(\dot\theta_h - \omega)

    After the release time there is none.

    ``motion``: path and grip. ``time``: in [s]. ``angle``: joint angle in [rad]. ``velocity``: joint velocity
    in [rad] / [s]. Returns the torque on the joint in [N m].
    """
    if time >= motion.release_time:
        return 0.0
    sine, cosine = sine_cosine(2.0 * math.pi * motion.frequency * time)
    path = motion.start_angle + 0.5 * motion.amplitude * (1.0 - cosine)
    path_velocity = 0.5 * motion.amplitude * 2.0 * math.pi * motion.frequency * sine
    return motion.stiffness * (path - angle) + motion.damping * (path_velocity - velocity)
