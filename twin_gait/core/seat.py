r"""A seat under the buttocks and the backs of the thighs.

The buttocks are a round pad about the axis of the hips, so that it meets the seat straight below them
whatever the pitch. Of each thigh one point of the back touches: ℓ from the hip along it and t behind its
axis. With the thigh's elevation α from the vertical (hip flexion less pitch), forwards positive, it stands at

.. math::

    x = \ell \sin\alpha - t \cos\alpha, \qquad z = -\ell \cos\alpha - t \sin\alpha

from the hips, and a force on it turns the thigh upwards with :math:`F_z x - F_x z`.
"""

from dataclasses import dataclass

from twin_gait.core.contact import contact_friction_force, mechanical_stop_torque


@dataclass(slots=True)
class Pad:
    """What of the body meets the seat."""

    stiffness: float  # In [N] / [m].
    dissipation: float  # In [s] / [m].
    thickness: float  # From the axis of hip or thigh to the skin, uncompressed, in [m].
    along: float = 0.0  # Way of it down the thigh in [m]; 0 for the buttocks.


@dataclass(slots=True)
class Seat:
    """A level seat without a back."""

    height: float  # Over the ground in [m].
    forward: float  # Place of its front edge in [m].
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
    behind: float = 0.0


def bearing_share(seat: Seat, forward: float) -> float:
    """Share of its stiffness that the seat has at a place in [m]: 0 beyond its edges, then a ramp to 1."""
    inside = min(seat.forward - forward, forward - (seat.forward - seat.depth))
    return min(max(inside / seat.rounding, 0.0), 1.0)


def seat_force(
    seat: Seat, pad: Pad, forward: float, height: float, speed: float, rise: float
) -> tuple[float, float]:
    r"""Forward and upward force in [N] of the seat on a pad, of which nothing jumps.

    :math:`N = s(x)\,k\,\delta\,\max(0, 1 + c\,\dot\delta), \qquad F = -\mu N \tanh(v / v_t)`

    Force and power are added to the sums of the seat. Place and height are those of the pad's skin,
    uncompressed, in [m]; ``speed`` forwards and ``rise`` in [m] / [s].
    """
    share = bearing_share(seat, forward)
    normal = share * mechanical_stop_torque(height, rise, seat.height, height, pad.stiffness, pad.dissipation)
    friction = contact_friction_force(speed, normal, seat.friction_coefficient, seat.transition_velocity)
    seat.normal += normal
    seat.friction += friction
    seat.power += normal * rise + friction * speed
    return friction, normal


def seat_the_hips(
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


def seat_the_thigh(
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
