"""Friction of a joint with motor and harmonic drive, seen at the joint."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin_gait.core.hyperbolic import hyperbolic_tangent

_SQRT_2E = math.sqrt(2.0 * math.e)


@dataclass(slots=True)
class Friction:
    """Parameters of :func:`rotational_friction_torque`.

    Attributes:
        breakaway_torque: a in [N m].
        coulomb_friction: b in [N m].
        breakaway_velocity: c in [rad] / [s].
        viscous_friction: d in [N m s] / [rad].
    """

    breakaway_torque: float
    coulomb_friction: float
    breakaway_velocity: float
    viscous_friction: float


def rotational_friction_torque(
    velocity: float,
    breakaway_torque: float,
    coulomb_friction: float,
    breakaway_velocity: float,
    viscous_friction: float,
) -> float:
    r"""Magnitude of the rotational friction torque, with the sign of the velocity.

    Equation (3.1) of the thesis, with breakaway torque :math:`a`, Coulomb friction :math:`b`,
    breakaway velocity :math:`c` and viscous coefficient :math:`d`:

    .. math::

        T_{fr}(\omega) = \sqrt{2e}\,(a-b)\,e^{-(\omega/c)^2}\frac{\omega}{c}
                         + b \tanh\frac{\omega}{c/10} + d\,\omega

    The torque on the plant is :math:`-T_{fr}`; a compensator adds :math:`+G\,T_{fr}`. With :math:`a < b`, as
    in table 3.1, the first term is a dip near 0.13 rad/s instead of a Stribeck peak.

    Args:
        velocity: Joint velocity in [rad] / [s].
        breakaway_torque: :math:`a` in [N m].
        coulomb_friction: :math:`b` in [N m].
        breakaway_velocity: :math:`c` in [rad] / [s], not zero.
        viscous_friction: :math:`d` in [N m s] / [rad].

    Returns:
        Friction torque in [N m]; odd in the velocity.
    """
    x = velocity / breakaway_velocity
    stribeck = _SQRT_2E * (breakaway_torque - coulomb_friction) * math.exp(-(x * x)) * x
    return stribeck + coulomb_friction * hyperbolic_tangent(10.0 * x) + viscous_friction * velocity


def load_friction_torque(
    velocity: float, load: float, coefficient: float, breakaway_velocity: float
) -> float:
    r"""Magnitude of the friction that the gear adds under load, with the sign of the velocity.

    .. math::

        T_l(\omega) = K_l\,|\tau|\,\tanh\frac{\omega}{c/10}

    Friction of the gear grows with its load (model M3 of Duclusaud et al. 2025, who found
    :math:`K_l = 0.148` for a geared servo, with the difference of motor and outer torque as load; here it is
    the motor's torque at the joint, which the gear passes on but for the share that turns the rotor). It
    turns over at the same velocity as the Coulomb term of (3.1).

    Args:
        velocity: Joint velocity :math:`\omega` in [rad] / [s].
        load: Torque :math:`\tau` that the gear passes on in [N m], either sign.
        coefficient: :math:`K_l`, no unit.
        breakaway_velocity: :math:`c` in [rad] / [s], not zero.

    Returns:
        Friction torque in [N m]; odd in the velocity.
    """
    return coefficient * abs(load) * hyperbolic_tangent(10.0 * velocity / breakaway_velocity)
