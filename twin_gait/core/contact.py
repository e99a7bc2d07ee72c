"""Contact of foot and ground, and the mechanical stops of the joints."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from twin_gait.core.elementary import hyperbolic_tangent

MIN_NORMAL_FORCE = 1e-6  # Normal force in [N] below which a contact has no centre of pressure.
Pair = tuple[float, float]  # Forward and upward components.


def contact_normal_force(
    penetration: float, penetration_rate: float, stiffness: float, dissipation: float
) -> float:
    r"""Compute the normal force of a contact point: Hunt and Crossley (1975), Hertz exponent.

    .. math::

        F_n = k\,\delta^{3/2}\,\max(0,\ 1 + \tfrac{3}{2} c\,\dot\delta)

    The force is continuous at touch-down and never pulls. With the factor 3/2, as in Simbody's
    ``HuntCrossleyForce``, a slow impact at velocity v has the coefficient of restitution :math:`e = 1 - c v`;
    at any velocity, for any mass and stiffness, the energy balance of compression and restitution gives

    .. math::

        x\,(1 + e) = \ln\frac{1 + x}{1 - e\,x}, \qquad x = \tfrac{3}{2} c v

    A mass m that rests on the point with the weight W at a penetration :math:`\delta_0` oscillates about its
    equilibrium with

    .. math::

        \omega^2 = \frac{3 W}{2\,m\,\delta_0}, \qquad \zeta = \frac{3\,c\,W}{4\,m\,\omega}

    Args:
        penetration: :math:`\delta` in [m]; zero or less is no contact.
        penetration_rate: :math:`\dot\delta` in [m/s].
        stiffness: :math:`k` in [N/m^1.5].
        dissipation: :math:`c` in [s/m].

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
    r"""Compute the regularised Coulomb friction of a contact point.

    :math:`F_t = -\mu F_n \tanh(v / v_t)`: friction opposes sliding; sticking is approximated by slow creep.

    Args:
        slip_velocity: Velocity v of the point relative to the ground (belt) in [m/s].
        normal_force: Normal force in [N].
        friction_coefficient: :math:`\mu`.
        transition_velocity: :math:`v_t` in [m/s], positive.

    Returns:
        Force along the direction of the velocity in [N].
    """
    if normal_force <= 0.0:
        return 0.0
    return -friction_coefficient * normal_force * hyperbolic_tangent(slip_velocity / transition_velocity)


def mechanical_stop_torque(
    angle: float, velocity: float, lower: float, upper: float, stiffness: float, dissipation: float
) -> float:
    r"""Compute the torque of the mechanical stops of a joint.

    Each stop is a one-sided spring with the same dissipation as the ground contact, so that the torque is
    continuous at touch-down and never pulls the joint towards the stop: :math:`\tau = k\,\delta\,\max(0, 1 +
    c\,\dot\delta)` towards the inside.

    Args:
        angle: Joint angle in [rad].
        velocity: Joint velocity in [rad/s].
        lower: Lower stop in [rad].
        upper: Upper stop in [rad].
        stiffness: :math:`k` in [N·m/rad].
        dissipation: :math:`c` in [s/rad].

    Returns:
        Torque on the joint in [N·m]: positive at the lower stop, negative at the upper one.
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
    """The ground under the feet, or the belt of a treadmill.

    Attributes:
        belt_speed: Present speed of the belt, backwards positive, in [m/s].
        stiffness: Contact stiffness of the heels in [N/m^1.5].
        dissipation: Contact dissipation of the heels in [s/m].
        friction_coefficient: Coulomb coefficient.
        transition_velocity: Transition velocity of the regularised friction in [m/s].
        slope_sine: Sine of the angle by which the plane rises forwards; it contains the origin.
        slope_cosine: Cosine of that angle.
        forefoot_stiffness: Contact stiffness of all other points of the soles in [N/m^1.5].
        forefoot_dissipation: Contact dissipation of these points in [s/m].
    """

    belt_speed: float = 0.0
    stiffness: float = 0.0
    dissipation: float = 0.0
    friction_coefficient: float = 0.0
    transition_velocity: float = 0.0
    slope_sine: float = 0.0
    slope_cosine: float = 1.0
    forefoot_stiffness: float = 0.0
    forefoot_dissipation: float = 0.0


@dataclass(slots=True)
class ContactState:
    """A contact point of a sole.

    Attributes:
        forward: Force on the point in [N], horizontal component.
        upward: Force on the point in [N], vertical component.
        height: Height above the ground, perpendicular to it, in [m].
    """

    forward: float = 0.0
    upward: float = 0.0
    height: float = 0.0


def ground_contact_force(
    ground: Ground,
    stiffness: float,
    dissipation: float,
    height: float,
    forward_velocity: float,
    vertical_velocity: float,
) -> tuple[float, float]:
    """Compute the force of level ground, or a belt, on a point of the sole.

    Args:
        ground: Friction of the ground and the speed of the belt.
        stiffness: Stiffness of the point in [N/m^1.5], that of the heel or of the forefoot.
        dissipation: Dissipation of the point in [s/m].
        height: Height of the point above the ground in [m]; negative is penetration.
        forward_velocity: Forward velocity of the point in the world in [m/s].
        vertical_velocity: Vertical velocity of the point in [m/s], up positive.

    Returns:
        Forward and upward force on the point in [N].
    """
    # Read before the branch: the compiler does not vectorize a read that is conditional.
    coefficient, transition_velocity = ground.friction_coefficient, ground.transition_velocity
    slip_velocity = forward_velocity + ground.belt_speed
    if height >= 0.0:
        return 0.0, 0.0
    normal = contact_normal_force(-height, -vertical_velocity, stiffness, dissipation)
    friction = contact_friction_force(slip_velocity, normal, coefficient, transition_velocity)
    return friction, normal


def resolve_along_slope(sine: float, cosine: float, forward: float, upward: float) -> tuple[float, float]:
    r"""Resolve a vector into components along a plane that rises forwards by α, and perpendicular to it.

    .. math::

        x' = x \cos\alpha + z \sin\alpha, \qquad z' = z \cos\alpha - x \sin\alpha

    Args:
        sine: Sine of α; with the opposite sign the function computes the inverse.
        cosine: Cosine of α.
        forward: Horizontal component x.
        upward: Vertical component z.

    Returns:
        Component along the plane, forwards positive, and component away from it, in the unit of the vector.
    """
    return forward * cosine + upward * sine, upward * cosine - forward * sine


def sloped_contact_force(
    sine: float,
    cosine: float,
    position: Pair,
    velocity: Pair,
    contact_law: Callable[[float, float, float], Pair],
) -> tuple[float, float, float]:
    """Compute the force of a plane through the origin, or a belt along it, on a point of the sole.

    In the axes of the plane the law is that of level ground. Arguments are numbers or symbols of a kernel.

    Args:
        sine: Sine of the angle by which the plane rises forwards.
        cosine: Cosine of that angle.
        position: Position of the point in the world, forwards and upwards, in [m].
        velocity: Velocity of the point, forwards and upwards, in [m/s].
        contact_law: Law of level ground: :func:`ground_contact_force` as a function of height and velocities.

    Returns:
        Forward and upward force on the point in [N], and its height above the plane in [m].
    """
    _, height = resolve_along_slope(sine, cosine, *position)
    friction, normal = contact_law(height, *resolve_along_slope(sine, cosine, *velocity))
    return (*resolve_along_slope(-sine, cosine, friction, normal), height)
