"""What acts on a coordinate of the plant by itself, what binds or leads it, and what holds a wearer.

A coordinate without friction has no law of it; one without stops has a stop stiffness of 0. The same record
serves joints with a drive (friction, stops), the ankle (that of its orthosis is a spring) and the vertical
pelvis guide (support force, damping).
"""

import math
from dataclasses import dataclass, field

from twin_gait.core.contact import contact_friction_force, mechanical_stop_torque
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.friction import (
    FRICTIONLESS,
    WITH_OTHER_FRICTION_LAWS,
    PlantFriction,
    advance_deflection,
    total_friction_torque,
)


@dataclass(slots=True)
class MechanicalStop:
    """Mechanical stops of a coordinate."""

    lower: float = 0.0  # Lower stop in [rad] or [m].
    upper: float = 0.0  # Upper stop.
    stiffness: float = 0.0  # In [N m] / [rad] or [N] / [m]; 0 for none.
    dissipation: float = 0.0  # In [s] / [rad] or [s] / [m].


@dataclass(slots=True)
class Spring:
    """A spring about zero with a damper and a constant force; K r as the force makes it one about r."""

    stiffness: float = 0.0  # In [N m] / [rad] or [N] / [m].
    damping: float = 0.0  # In [N m s] / [rad] or [N s] / [m].
    force: float = 0.0  # Constant torque in [N m] or force in [N] on the coordinate.


@dataclass(slots=True)
class Plant:
    """Passive torques on a coordinate: their parameters, none by default, and what they came to last."""

    friction: PlantFriction = field(default_factory=PlantFriction)  # Of motor and gear.
    stop: MechanicalStop = field(default_factory=MechanicalStop)  # Mechanical stops.
    spring: Spring = field(default_factory=Spring)  # Orthosis, or support of the pelvis.
    armature: float = 0.0  # Inertia of rotor and wave generator seen at the joint in [kg m²].
    # Of the bristles that some laws of friction have, at the start of the step, in [rad].
    deflection: float = 0.0
    friction_torque: float = 0.0  # On the coordinate in [N m] or [N].
    stop_torque: float = 0.0  # Likewise.
    spring_torque: float = 0.0  # Likewise, with the constant force.


def gear_load(plant: Plant, motor: float, acceleration: float) -> float:
    r"""Torque in [N m] that the gear of a joint passes on, :math:`\tau - J\,\ddot q`.

    What turns the rotor never reaches the teeth; in a walk that is half of the knee's torque. The
    acceleration is as it was found last: one evaluation late, since the losses of the gear move the joint
    themselves. With an efficiency above 0.5 that settles, by a factor of :math:`1/\eta - 1` at least in each
    evaluation, for no joint has less inertia than J.
    """
    return motor - plant.armature * acceleration


def plant_torque(
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
        if WITH_OTHER_FRICTION_LAWS:
            deflection = advance_deflection(law, displacement, v, deflection)
        friction = -total_friction_torque(law, rotational, v, deflection, load)
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

    index: int = -1  # The coordinate; -1 for none.
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


@dataclass(slots=True)
class Harness:
    """A rope from a rail to the trunk; the trolley on the rail follows, so that the rope stays vertical."""

    height: float  # Of the attachment above the hips, along the trunk, in [m].
    force: float  # Of body-weight support in [N].
    damping: float  # Of the rope's winch in [N s] / [m].
    stop: MechanicalStop = field(default_factory=MechanicalStop)  # What locks at a trip, from below.
    pull: float = 0.0  # On the trunk in [N], upwards, as it was last.


@dataclass(slots=True)
class Trunk:
    r"""The trunk of a wearer whose pelvis is free, which turns with it about the axis of the hips.

    A point of the trunk h above the hips stands at :math:`h (\sin\theta, \cos\theta)` from them, where θ is
    the pitch, forwards positive. A force in a point (x, z) from the hips pitches the trunk with

    .. math::

        M = z F_x - x F_z
    """

    shoulder: float  # Height of the shoulders above the hips, along the trunk, in [m].
    harness: Harness  # That holds it.


def pitching_moment(ahead: float, up: float, forward: float, upward: float) -> float:
    """Moment in [N m] about the hips, forwards positive, of a force in [N] in a point seen from them."""
    return up * forward - ahead * upward


def harness_pull(harness: Harness, height: float, speed: float) -> float:
    """Upward force in [N] of a rope on the trunk, which the harness keeps.

    ``height``: of the attachment in the world in [m]. ``speed``: of it, upwards.
    """
    stop = harness.stop
    locked = mechanical_stop_torque(height, speed, stop.lower, stop.upper, stop.stiffness, stop.dissipation)
    harness.pull = harness.force - harness.damping * speed + locked
    return harness.pull


@dataclass(slots=True)
class Pad:
    """What of the body meets the seat."""

    stiffness: float  # In [N] / [m].
    dissipation: float  # In [s] / [m].
    thickness: float  # From the axis of hip or thigh to the skin, uncompressed, in [m].
    along: float = 0.0  # Way of it down the thigh in [m]; 0 for the buttocks.


@dataclass(slots=True)
class Seat:
    r"""A level seat without a back, under the buttocks and the backs of the thighs.

    The buttocks are a round pad about the axis of the hips, so that it meets the seat straight below them
    whatever the pitch. Of each thigh one point of the back touches: ℓ from the hip along it and t behind its
    axis. With the thigh's elevation α from the vertical (hip flexion less pitch), forwards positive, it is at

    .. math::

        x = \ell \sin\alpha - t \cos\alpha, \qquad z = -\ell \cos\alpha - t \sin\alpha

    from the hips, and a force on it turns the thigh upwards with :math:`F_z x - F_x z`.
    """

    height: float  # Over the ground in [m].
    front_edge: float  # Place of its front edge in [m].
    depth: float  # From there to its rear edge in [m].
    rounding: float  # Way behind an edge over which the seat comes to bear, in [m].
    friction_coefficient: float  # Coulomb coefficient.
    transition_velocity: float  # Of the regularised friction in [m] / [s].
    buttocks: Pad  # Both.
    thigh: Pad  # One.
    hips: list[int]  # Places of the two hips in the coordinates.
    normal: float = 0.0  # Sum of the normal forces as it was last, in [N].
    friction: float = 0.0  # Of the forces along the seat, forwards positive; likewise.
    power: float = 0.0  # Of all of them in [W]; likewise.
    # Way of its front edge behind the hips where it is put for a standing wearer, in [m].
    standing_distance: float = 0.0


def edge_stiffness_share(seat: Seat, forward: float) -> float:
    """Share of its stiffness that the seat has at a place in [m]: 0 beyond its edges, then a ramp to 1."""
    inside = min(seat.front_edge - forward, forward - (seat.front_edge - seat.depth))
    return min(max(inside / seat.rounding, 0.0), 1.0)


def seat_force(
    seat: Seat, pad: Pad, forward: float, height: float, speed: float, rise: float
) -> tuple[float, float]:
    r"""Forward and upward force in [N] of the seat on a pad, of which nothing jumps.

    :math:`N = s(x)\,k\,\delta\,\max(0, 1 + c\,\dot\delta), \qquad F = -\mu N \tanh(v / v_t)`

    Force and power are added to the sums of the seat. Place and height are those of the pad's skin,
    uncompressed, in [m]; ``speed`` forwards and ``rise`` in [m] / [s].
    """
    share = edge_stiffness_share(seat, forward)
    normal = share * mechanical_stop_torque(height, rise, seat.height, height, pad.stiffness, pad.dissipation)
    friction = contact_friction_force(speed, normal, seat.friction_coefficient, seat.transition_velocity)
    seat.normal += normal
    seat.friction += friction
    seat.power += normal * rise + friction * speed
    return friction, normal


def seat_force_on_buttocks(
    seat: Seat, forward: float, height: float, speed: float, rise: float, pitching: float
) -> tuple[float, float, float]:
    """Force of the seat on the buttocks; the sums of the seat begin with it.

    Place and velocity are those of the hips. Returns forward and upward force in [N], and the pitching moment
    about the hips in [N m].
    """
    seat.normal = seat.friction = seat.power = 0.0
    below = seat.buttocks.thickness
    fx, fz = seat_force(seat, seat.buttocks, forward, height - below, speed - below * pitching, rise)
    return fx, fz, -below * fx


def seat_force_on_thigh(
    seat: Seat,
    sine: float,
    cosine: float,
    forward: float,
    height: float,
    speed: float,
    rise: float,
    turning: float,
) -> tuple[float, float, float]:
    """Force of the seat on the back of a thigh, by sine and cosine of its elevation and their rate.

    Place and velocity are those of the hips. Returns forward and upward force in [N], and the moment about
    the hip that lifts the thigh, in [N m].
    """
    along, behind = seat.thigh.along, seat.thigh.thickness
    ahead, up = along * sine - behind * cosine, -along * cosine - behind * sine
    fx, fz = seat_force(
        seat, seat.thigh, forward + ahead, height + up, speed - turning * up, rise + turning * ahead
    )
    return fx, fz, fz * ahead - fx * up
