"""Foot and ground, and the mechanical stops of the joints."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from twin_gait.core.elementary import hyperbolic_tangent

LEAST_FORCE = 1e-6  # [N]; a lighter contact has no centre of pressure
Pair = tuple[float, float]  # parts forwards and upwards


def contact_normal_force(
    penetration: float, penetration_rate: float, stiffness: float, dissipation: float
) -> float:
    r"""Normal force of a contact point: Hunt and Crossley (1975), Hertz exponent.

    .. math::

        F_n = k\,\delta^{3/2}\,\max(0,\ 1 + \tfrac{3}{2} c\,\dot\delta)

    It is smooth at touch-down and never pulls. With the factor 3/2, as in Simbody's ``HuntCrossleyForce``, a
    slow fall at v has the coefficient of restitution :math:`e = 1 - c v`; at any speed, whatever mass and
    stiffness, the energy of the way in and of the way out gives

    .. math::

        x\,(1 + e) = \ln\frac{1 + x}{1 - e\,x}, \qquad x = \tfrac{3}{2} c v

    A mass m that stands on the point with W, :math:`\delta_0` deep, bounces about its place with

    .. math::

        \omega^2 = \frac{3 W}{2\,m\,\delta_0}, \qquad \zeta = \frac{3\,c\,W}{4\,m\,\omega}

    Args:
        penetration: :math:`\delta` in [m]; zero or less is no contact.
        penetration_rate: :math:`\dot\delta` in [m] / [s].
        stiffness: :math:`k` in [N] / [m]^1.5.
        dissipation: :math:`c` in [s] / [m].

    Returns:
        Force in [N], zero or positive.
    """
    if penetration <= 0.0:
        return 0.0
    damping = 1.0 + 1.5 * dissipation * penetration_rate
    if damping <= 0.0:
        return 0.0
    return stiffness * penetration * math.sqrt(penetration) * damping


def contact_friction_force(
    slip_velocity: float, normal_force: float, friction_coefficient: float, transition_velocity: float
) -> float:
    r"""Regularised Coulomb friction of a contact point.

    :math:`F_t = -\mu F_n \tanh(v / v_t)`: sliding is opposed, sticking is a slow creep.

    Args:
        slip_velocity: Velocity of the point relative to the ground (belt) in [m] / [s].
        normal_force: In [N].
        friction_coefficient: :math:`\mu`.
        transition_velocity: :math:`v_t` in [m] / [s], positive.

    Returns:
        Force along the direction of the velocity in [N].
    """
    if normal_force <= 0.0:
        return 0.0
    return -friction_coefficient * normal_force * hyperbolic_tangent(slip_velocity / transition_velocity)


def mechanical_stop_torque(
    angle: float, velocity: float, lower: float, upper: float, stiffness: float, dissipation: float
) -> float:
    r"""Torque of the mechanical stops of a joint.

    A one-sided spring with the same dissipation as the ground contact, so that the torque is
    continuous at touch-down and never pulls the joint back to the stop:
    :math:`\tau = k\,\delta\,\max(0, 1 + c\,\dot\delta)` towards the inside.

    Args:
        angle: Joint angle in [rad].
        velocity: Joint velocity in [rad] / [s].
        lower: Lower stop in [rad].
        upper: Upper stop in [rad].
        stiffness: :math:`k` in [N m] / [rad].
        dissipation: :math:`c` in [s] / [rad].

    Returns:
        Torque on the joint in [N m]: positive at the lower stop, negative at the upper one.
    """
    if angle < lower:
        damping = 1.0 - dissipation * velocity
        return stiffness * (lower - angle) * damping if damping > 0.0 else 0.0
    if angle > upper:
        damping = 1.0 + dissipation * velocity
        return -stiffness * (angle - upper) * damping if damping > 0.0 else 0.0
    return 0.0


@dataclass(slots=True)
class Ground:
    """The ground under the feet, or the belt.

    Attributes:
        belt_speed: Present one, backwards positive, in [m] / [s].
        stiffness: In [N] / [m]^1.5.
        dissipation: In [s] / [m].
        friction_coefficient: Coulomb coefficient.
        transition_velocity: Of the regularised friction in [m] / [s].
        slope_sine: Of the angle by which the plane rises forwards; it contains the origin.
        slope_cosine: Likewise.
    """

    belt_speed: float = 0.0
    stiffness: float = 0.0
    dissipation: float = 0.0
    friction_coefficient: float = 0.0
    transition_velocity: float = 0.0
    slope_sine: float = 0.0
    slope_cosine: float = 1.0


@dataclass(slots=True)
class Point:
    """A point of a sole.

    Attributes:
        forward: Force on it in [N], level.
        upward: Likewise, vertical.
        height: Above the ground, at right angles to it, in [m].
    """

    forward: float = 0.0
    upward: float = 0.0
    height: float = 0.0


def ground_contact_force(
    ground: Ground, height: float, forward_velocity: float, vertical_velocity: float
) -> tuple[float, float]:
    """Force of level ground, or a belt, on a point of the sole.

    Args:
        ground: Its parameters and the speed of the belt.
        height: Of the point above it in [m]; negative is penetration.
        forward_velocity: Of the point in the world in [m] / [s].
        vertical_velocity: Of the point in [m] / [s], up positive.

    Returns:
        Forward and upward force on the point in [N].
    """
    # Read before the branch: in vectors of points it would not be known whether it may be read at all.
    stiffness, dissipation = ground.stiffness, ground.dissipation
    coefficient, transition_velocity = ground.friction_coefficient, ground.transition_velocity
    slip_velocity = forward_velocity + ground.belt_speed
    if height >= 0.0:
        return 0.0, 0.0
    normal = contact_normal_force(-height, -vertical_velocity, stiffness, dissipation)
    friction = contact_friction_force(slip_velocity, normal, coefficient, transition_velocity)
    return friction, normal


def along_slope(sine: float, cosine: float, forward: float, upward: float) -> tuple[float, float]:
    r"""Parts of a vector along a plane that rises forwards by α, and at right angles to it.

    .. math::

        x' = x \cos\alpha + z \sin\alpha, \qquad z' = z \cos\alpha - x \sin\alpha

    Args:
        sine: Of α; with its sign changed this is the way back.
        cosine: Likewise.
        forward: Level part x.
        upward: Vertical part z.

    Returns:
        Part along the plane, forwards positive, and part away from it, in the unit of the vector.
    """
    return forward * cosine + upward * sine, upward * cosine - forward * sine


def sloped_contact_force(
    sine: float, cosine: float, place: Pair, velocity: Pair, press: Callable[[float, float, float], Pair]
) -> tuple[float, float, float]:
    """Force of a plane through the origin, or a belt along it, on a point of the sole.

    In the axes of the plane the law is that of level ground. Numbers or symbols of a kernel.

    Args:
        sine: Of the angle by which the plane rises forwards.
        cosine: Likewise.
        place: Of the point in the world, forwards and upwards, in [m].
        velocity: Likewise in [m] / [s].
        press: Law of level ground: :func:`ground_contact_force` from height and velocities on.

    Returns:
        Forward and upward force on the point in [N], and its height above the plane in [m].
    """
    _, height = along_slope(sine, cosine, *place)
    friction, normal = press(height, *along_slope(sine, cosine, *velocity))
    return (*along_slope(-sine, cosine, friction, normal), height)
