"""Forces and torques on a coordinate of the plant: passive torques, braces, imposed motion, harness and seat.

A coordinate without friction has the law ``FRICTIONLESS``; a coordinate without stops has a stop stiffness of
0. One class describes joints with a drive (friction, stops), ankles (the orthosis is a spring) and the
vertical guide of the pelvis (support force, damping).
"""

import math
from dataclasses import dataclass, field

from twin_gait.core.contact import contact_friction_force, mechanical_stop_torque
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.friction import (
    ROTATIONAL,
    WITH_OTHER_FRICTION_LAWS,
    PlantFriction,
    advance_deflection,
    directional_torque,
    gear_direction,
    loss_share,
)

# Load of a gear in [N·m] below which either sign of the load is accepted.
LEAST_LOAD = 1e-9


@dataclass(slots=True)
class MechanicalStop:
    """Mechanical stops of a coordinate."""

    lower: float = 0.0  # Lower stop in [rad] or [m].
    upper: float = 0.0  # Upper stop.
    stiffness: float = 0.0  # In [N·m/rad] or [N/m]; 0 for none.
    dissipation: float = 0.0  # In [s/rad] or [s/m].


@dataclass(slots=True)
class Spring:
    """Spring about zero with a damper and a constant force; with the force K r it is a spring about r."""

    stiffness: float = 0.0  # In [N·m/rad] or [N/m].
    damping: float = 0.0  # In [N·m·s/rad] or [N·s/m].
    force: float = 0.0  # Constant torque in [N·m] or force in [N] on the coordinate.


@dataclass(slots=True)
class Plant:
    """Passive torques on a coordinate: their parameters, none by default, and their last values."""

    friction: PlantFriction = field(default_factory=PlantFriction)  # Of motor and gear.
    stop: MechanicalStop = field(default_factory=MechanicalStop)  # Mechanical stops.
    spring: Spring = field(default_factory=Spring)  # Orthosis, or support of the pelvis.
    armature: float = 0.0  # Inertia of rotor and wave generator seen at the joint in [kg·m²].
    # Deflection in [rad] at the start of the step of the bristles that some laws of friction have.
    deflection: float = 0.0
    load_sign: float = 1.0  # Sign of the load of the gear, 1 or -1.
    loss_share: float = 0.0  # Share of its load that the gear loses.
    friction_torque: float = 0.0  # On the coordinate, with the loss of the gear, in [N·m] or [N].
    stop_torque: float = 0.0  # On the coordinate in [N·m] or [N].
    spring_torque: float = 0.0  # On the coordinate with the constant force, in [N·m] or [N].


def share_loss(plant: Plant, velocity: float) -> None:
    r"""Compute the share c of its load that the gear of a joint loses.

    The load is the motor torque minus the torque that turns the rotor, :math:`\tau = \tau_m - J \ddot q`. The
    loss :math:`c\,\tau` depends on the acceleration of the same instant, and linearly if the sign of the load
    is given. The equation :math:`M \ddot q = \dots + \tau_m - c\,\tau` is therefore solved with a motor
    torque of :math:`(1 - c)\,\tau_m`, and with a rotor inertia of :math:`(1 - c)\,J` instead of J.
    """
    law = plant.friction
    plant.loss_share = loss_share(gear_direction(law, velocity), plant.load_sign, law.gear_efficiency)


def passed_torque(plant: Plant, motor: float, acceleration: float) -> float:
    r"""Compute the load of a gear in [N·m], :math:`\tau = \tau_m - J\,\ddot q`, see :func:`share_loss`."""
    return motor - plant.armature * acceleration


def is_sign_wrong(plant: Plant, motor: float, acceleration: float) -> bool:
    """Return whether the load of a gear has the other sign than its loss was computed for."""
    load = plant.load_sign * passed_torque(plant, motor, acceleration)
    return load < -LEAST_LOAD and plant.loss_share != 0.0


def plant_torque(plant: Plant, rotational: float, q: float, v: float, displacement: float) -> float:
    """Compute and store friction, stop and spring torque of a coordinate; return their sum in [N·m] or [N].

    The loss of the gear is not included. Its share is stored, except for equation (3.1), whose friction and
    share are computed before. ``rotational``: friction by equation (3.1), not read with another law.
    ``displacement``: displacement of the coordinate since the start of the step.
    """
    law, limits, spring = plant.friction, plant.stop, plant.spring
    friction, stop = -rotational if law.law == ROTATIONAL else 0.0, 0.0
    if WITH_OTHER_FRICTION_LAWS:
        if law.law > ROTATIONAL:
            deflection = advance_deflection(law, displacement, v, plant.deflection)
            friction = -directional_torque(law, v, deflection)
            share_loss(plant, v)
    if limits.stiffness != 0.0:
        stop = mechanical_stop_torque(q, v, limits.lower, limits.upper, limits.stiffness, limits.dissipation)
    plant.friction_torque = friction
    plant.stop_torque = stop
    plant.spring_torque = spring.force - spring.stiffness * q - spring.damping * v
    return friction + stop + plant.spring_torque


@dataclass(slots=True)
class Brace:
    """Spring and damper between a coordinate of the device and the same coordinate of the wearer."""

    stiffness: float  # K in [N·m/rad] or [N/m].
    damping: float  # B in [N·m·s/rad] or [N·s/m].
    torque: float = 0.0  # Last torque of the device on the wearer in [N·m] or [N].
    # Share of the pitch of the pelvis that is subtracted from the coordinate: 1 for a cuff on the thigh,
    # because the elevation of the thigh is hip flexion minus pitch.
    pitch_share: float = 0.0


def brace_torque(brace: Brace, apart: float, speed: float) -> float:
    r"""Compute the torque or force of a brace on the wearer.

    :math:`\tau = K\,(q_d - q_w) + B\,(\dot q_d - \dot q_w)` in [N·m] or [N]; the opposite acts on the device.
    """
    return brace.stiffness * apart + brace.damping * speed


@dataclass(slots=True)
class ImposedMotion:
    """Spring and damper that move a coordinate along a cosine path until the release time."""

    index: int = -1  # Index of the coordinate; -1 for none.
    start_angle: float = 0.0  # Start of the path in [rad].
    amplitude: float = 0.0  # Difference between the ends of the path in [rad].
    frequency: float = 0.0  # Frequency in [Hz].
    stiffness: float = 0.0  # Stiffness of the grip in [N·m/rad].
    damping: float = 0.0  # Damping of the grip in [N·m·s/rad].
    release_time: float = 0.0  # Time in [s].
    torque: float = 0.0  # Last torque on the coordinate in [N·m].


def imposed_motion_torque(motion: ImposedMotion, time: float, angle: float, velocity: float) -> float:
    r"""Compute the torque in [N·m] of an imposed motion on its joint, 0 after the release time.

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
    r"""Rope from a rail to the trunk; a trolley on the rail follows, so that the rope stays vertical.

    The rope may carry a level bar with two vertical straps, in front of and behind the trunk. They are fixed
    at :math:`(\pm a, h)` in the axes of the trunk, relative to the hips. Each has the stiffness k and the
    damping b and only pulls. Their lengths are set so that each carries half of the force F of the rope at
    the pitch θ₀. With the pitch θ the attachments differ in height by :math:`2 a \sin\theta`, and the
    tensions by

    .. math::

        D = \max(-F, \min(F, 2 a\,[k (\sin\theta - \sin\theta_0) + b\,\dot\theta \cos\theta]))

    At :math:`|D| = F` one strap is slack. Rope and straps have the pitching moment

    .. math::

        M = -F h \sin\theta - D a \cos\theta

    about the hips. For a constant F and b = 0 it is the negative derivative of the potential
    :math:`-F h \cos\theta + W`, where :math:`W = k a^2 (\sin\theta - \sin\theta_0)^2` while both straps
    are taut, and :math:`W = F a |\sin\theta - \sin\theta_0| - F^2 / 4 k` otherwise. The rope moves with the
    mean height of the attachments; the common stretch of the straps is neglected.
    """

    height: float  # Height of the attachment above the hips, along the trunk, in [m].
    force: float  # Force of the body-weight support in [N].
    damping: float  # Damping of the winch of the rope in [N·s/m].
    stop: MechanicalStop = field(default_factory=MechanicalStop)  # Lower stop that locks at a trip.
    pull: float = 0.0  # Last upward force on the trunk in [N].
    lever: float = 0.0  # Distance a of each strap from the axis of the trunk in [m]; 0 without straps.
    strap_stiffness: float = 0.0  # Stiffness k of a strap in [N/m].
    strap_damping: float = 0.0  # Damping b of a strap in [N·s/m].
    strap_sine: float = 0.0  # Sine of the pitch θ₀ at which both straps have the same tension.


@dataclass(slots=True)
class Trunk:
    r"""Trunk of a wearer with a free pelvis; both turn together about the axis of the hips.

    A point of the trunk at the height h above the hips is at :math:`h (\sin\theta, \cos\theta)` relative to
    them, where θ is the pitch, forwards positive. A force at the point (x, z) relative to the hips has the
    pitching moment

    .. math::

        M = z F_x - x F_z
    """

    shoulder: float  # Height of the shoulders above the hips, along the trunk, in [m].
    harness: Harness  # Harness that holds the trunk.


def pitching_moment(ahead: float, up: float, forward: float, upward: float) -> float:
    """Compute the moment in [N·m] about the hips, forwards positive, of a force in [N] at a point."""
    return up * forward - ahead * upward


def harness_pull(harness: Harness, height: float, speed: float) -> float:
    """Compute and store the upward force in [N] of a rope on the trunk.

    ``height``: height of the attachment in the world in [m]. ``speed``: its upward velocity in [m/s].
    """
    stop = harness.stop
    locked = mechanical_stop_torque(height, speed, stop.lower, stop.upper, stop.stiffness, stop.dissipation)
    harness.pull = harness.force - harness.damping * speed + locked
    return harness.pull


def strap_moment(harness: Harness, sine: float, cosine: float, rate: float) -> float:
    """Compute the pitching moment in [N·m] of the unequal tensions of the straps, from the last pull.

    ``sine`` and ``cosine`` of the pitch; ``rate``: its rate in [rad/s].
    """
    stretch, limit = harness.lever * (sine - harness.strap_sine), max(harness.pull, 0.0)
    speed = harness.lever * cosine * rate
    apart = 2.0 * (harness.strap_stiffness * stretch + harness.strap_damping * speed)
    return -harness.lever * cosine * max(-limit, min(limit, apart))


@dataclass(slots=True)
class Pad:
    """Part of the body that touches the seat."""

    stiffness: float  # Stiffness in [N/m].
    dissipation: float  # Dissipation in [s/m].
    thickness: float  # Distance from the axis of hip or thigh to the uncompressed skin in [m].
    along: float = 0.0  # Distance from the hip along the thigh in [m]; 0 for the buttocks.


@dataclass(slots=True)
class Seat:
    r"""Level seat without a back, under the buttocks and the backs of the thighs.

    The buttocks are a round pad about the axis of the hips, which touches the seat vertically below the hips
    at any pitch. The back of each thigh touches at one point, at the distance ℓ from the hip along the thigh
    and t behind its axis. With the elevation α of the thigh from the vertical (hip flexion minus pitch),
    forwards positive, this point is at

    .. math::

        x = \ell \sin\alpha - t \cos\alpha, \qquad z = -\ell \cos\alpha - t \sin\alpha

    relative to the hips, and a force at it has the moment :math:`F_z x - F_x z` that lifts the thigh.
    """

    height: float  # Height over the ground in [m].
    front_edge: float  # Position of the front edge in [m].
    depth: float  # Distance between front and rear edge in [m].
    rounding: float  # Distance from an edge over which the stiffness rises in [m].
    friction_coefficient: float  # Coulomb coefficient.
    transition_velocity: float  # Transition velocity of the regularised friction in [m/s].
    buttocks: Pad  # Both buttocks.
    thigh: Pad  # One thigh.
    hips: list[int]  # Indices of the two hips in the coordinates.
    normal: float = 0.0  # Last sum of the normal forces in [N].
    friction: float = 0.0  # Last sum of the forces along the seat in [N], forwards positive.
    power: float = 0.0  # Last sum of the powers of all forces in [W].
    # Distance in [m] from the hips of a standing wearer back to the front edge, when the chair is placed.
    standing_distance: float = 0.0


def edge_stiffness_share(seat: Seat, forward: float) -> float:
    """Compute the share of the stiffness of the seat at a position in [m], a ramp from 0 at the edges."""
    inside = min(seat.front_edge - forward, forward - (seat.front_edge - seat.depth))
    return min(max(inside / seat.rounding, 0.0), 1.0)


def seat_force(
    seat: Seat, pad: Pad, forward: float, height: float, speed: float, rise: float
) -> tuple[float, float]:
    r"""Compute the forward and upward force in [N] of the seat on a pad; both are continuous.

    :math:`N = s(x)\,k\,\delta\,\max(0, 1 + c\,\dot\delta), \qquad F = -\mu N \tanh(v / v_t)`

    Force and power are added to the sums of the seat. ``forward`` and ``height`` are the position of the
    uncompressed skin of the pad in [m], ``speed`` and ``rise`` its velocity in [m/s].
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
    """Compute the force of the seat on the buttocks, with which the sums of the seat start anew.

    Position and velocity are those of the hips. Returns forward and upward force in [N], and the pitching
    moment about the hips in [N·m].
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
    """Compute the force of the seat on the back of a thigh from sine, cosine and rate of its elevation.

    Position and velocity are those of the hips. Returns forward and upward force in [N], and the moment about
    the hip that lifts the thigh, in [N·m].
    """
    along, behind = seat.thigh.along, seat.thigh.thickness
    ahead, up = along * sine - behind * cosine, -along * cosine - behind * sine
    fx, fz = seat_force(
        seat, seat.thigh, forward + ahead, height + up, speed - turning * up, rise + turning * ahead
    )
    return fx, fz, fz * ahead - fx * up
