"""Friction of a joint with motor and harmonic drive, seen at the joint."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import exponential, hyperbolic_tangent
from twin_gait.core.friction_models import (
    asymmetric_torque,
    bristle_rate,
    bristle_step,
    directional_viscous_torque,
    lugre_torque,
    sign_of,
    stribeck_level,
)

_SQRT_2E = math.sqrt(2.0 * math.e)

# Laws of a :class:`PlantFriction`.
FRICTIONLESS, ROTATIONAL, ASYMMETRIC, BRISTLE = range(4)
# Whether there may be others than the first two; a loop whose plant has none is bound to False.
WITH_OTHER_FRICTION_LAWS = True


@dataclass(slots=True)
class PlantFriction:
    """Friction of a coordinate of the plant: which law, and the parameters of all of them.

    A law leaves alone what it does not know; :func:`friction_torque` says who reads what.
    """

    law: int = FRICTIONLESS  # ``FRICTIONLESS``, ``ROTATIONAL``, ``ASYMMETRIC`` or ``BRISTLE``.
    breakaway_torque: float = 0.0  # T_b, a of (3.1), in [N m].
    coulomb_friction: float = 0.0  # T_c, b of (3.1), in [N m].
    stribeck_velocity: float = 1.0  # ω_c, c of (3.1), of the others ω_st, in [rad] / [s], not zero.
    # d of (3.1) in [N m s] / [rad]; d+ of the others, in [N m] at 1 rad/s.
    viscous_friction_forward: float = 0.0
    viscous_friction_backward: float = 0.0  # d- in [N m] at 1 rad/s.
    gear_efficiency: float = 1.0  # η under load, beside all that; 1 for a gear without such losses.
    offset: float = 0.0  # T_0 in [N m].
    transition_velocity: float = 1.0  # ω_t in [rad] / [s], above 0.
    stribeck_exponent: float = 2.0  # δ.
    viscous_exponent: float = 1.0  # α.
    bristle_stiffness: float = 0.0  # σ0 in [N m] / [rad]; 0 for laws without bristles.
    bristle_damping: float = 0.0  # σ1 in [N m s] / [rad].


def rotational_friction_torque(
    velocity: float, breakaway: float, coulomb: float, breakaway_velocity: float, viscous: float
) -> float:
    r"""Magnitude of the rotational friction torque in [N m], with the sign of the velocity; odd in it.

    Equation (3.1) of the thesis, with breakaway torque a and Coulomb friction b in [N m], breakaway velocity
    c in [rad] / [s], not zero, and viscous coefficient d in [N m s] / [rad]:

    .. math::

        T_{fr}(\omega) = \sqrt{2e}\,(a-b)\,e^{-(\omega/c)^2}\frac{\omega}{c}
                         + b \tanh\frac{\omega}{c/10} + d\,\omega

    The torque on the plant is :math:`-T_{fr}`; a compensator adds :math:`+G\,T_{fr}`. With :math:`a < b`, as
    in table 3.1, the first term is a dip near 0.13 rad/s instead of a Stribeck peak.
    """
    x = velocity / breakaway_velocity
    stribeck = _SQRT_2E * (breakaway - coulomb) * exponential(-(x * x)) * x
    return stribeck + coulomb * hyperbolic_tangent(10.0 * x) + viscous * velocity


def gear_loss_torque(velocity: float, load: float, efficiency: float, transition_velocity: float) -> float:
    r"""Torque in [N m] that the gear loses under load, with the sign of the velocity.

    Driving, the joint receives :math:`\eta\tau` of what the motor puts into the gear; driven backwards, it
    takes :math:`\tau/\eta` to overcome the motor:

    .. math::

        T_l = \begin{cases} (1 - \eta)\,\tau & \tau\omega > 0 \\
              (1 - 1/\eta)\,\tau & \tau\omega < 0 \end{cases}

    Between them it follows the parabola in :math:`t = \tanh(\omega/\omega_t)` that joins both and is smooth
    through rest, where the gear loses nothing:

    .. math::

        T_l = t\,(A\,|\tau| - B\,t\,\tau), \qquad
        A = \tfrac12\left(\tfrac1\eta - \eta\right), \quad B = \tfrac12\left(\tfrac1\eta + \eta\right) - 1

    As :math:`B < A`, it never gives energy. In other words: friction of the gear that grows with its load
    (model M3 of Duclusaud et al. 2025), :math:`K_l\,|\tau|` with :math:`K_l = 1 - \eta` driving and
    :math:`1/\eta - 1` driven. The load τ is that of the motor less what turns the rotor, η in (0, 1].
    """
    return _gear_loss(hyperbolic_tangent(velocity / transition_velocity), load, efficiency)


def _gear_loss(turning: float, load: float, efficiency: float) -> float:
    """Loss of the gear by how surely it turns, from -1 to 1."""
    inverse = 1.0 / efficiency
    steepness, bend = 0.5 * (inverse - efficiency), 0.5 * (inverse + efficiency) - 1.0
    return turning * (steepness * abs(load) - bend * turning * load)


def geared_friction_torque(
    velocity: float,
    breakaway: float,
    coulomb: float,
    breakaway_velocity: float,
    viscous: float,
    load: float,
    efficiency: float,
) -> float:
    """:func:`rotational_friction_torque` and what the gear loses under load, which turn over together.

    They share their hyperbolic tangent, and a compiler finds it. Load in [N m], efficiency in (0, 1].
    """
    friction = rotational_friction_torque(velocity, breakaway, coulomb, breakaway_velocity, viscous)
    turning = hyperbolic_tangent(10.0 * (velocity / breakaway_velocity))
    return friction + _gear_loss(turning, load, efficiency)


def friction_torque(friction: PlantFriction, velocity: float, deflection: float, load: float) -> float:
    r"""Friction of a coordinate of the plant in [N m] by whichever law it has, with the sign of the velocity.

    ``ROTATIONAL`` is (3.1) with the losses of the gear, :func:`geared_friction_torque`. ``ASYMMETRIC`` is
    :func:`twin_gait.core.friction_models.asymmetric_torque`, ``BRISTLE`` LuGre's model with directions
    (Dahl's with :math:`T_b = T_c`, :math:`\sigma_1 = 0`) and the deflection z in [rad]:

    .. math::

        T_0 + \left\{\begin{array}{l} h(\omega)\,\tanh(\omega/\omega_t) \\
        \sigma_0 z + \sigma_1 \dot z \end{array}\right\} + d_\pm|\omega|^\alpha\,\mathrm{sgn}\,\omega

    with the Stribeck curve h. All lose :func:`gear_loss_torque` beside it, whose :math:`\omega_t` is that of
    ``ASYMMETRIC``, of the others a tenth of ``stribeck_velocity``.
    """
    rotational = rotational_torque(friction, velocity, load)
    return total_friction_torque(friction, rotational, velocity, deflection, load)


def rotational_torque(friction: PlantFriction, velocity: float, load: float) -> float:
    """:func:`geared_friction_torque` of a coordinate that has that law, 0 of any other."""
    if friction.law != ROTATIONAL:
        return 0.0
    return geared_friction_torque(
        velocity,
        friction.breakaway_torque,
        friction.coulomb_friction,
        friction.stribeck_velocity,
        friction.viscous_friction_forward,
        load,
        friction.gear_efficiency,
    )


def total_friction_torque(
    friction: PlantFriction, rotational: float, velocity: float, deflection: float, load: float
) -> float:
    """As :func:`friction_torque`, with the torque of :func:`rotational_torque` given, 0 without friction."""
    if WITH_OTHER_FRICTION_LAWS:
        if friction.law > ROTATIONAL:
            return _directional_torque(friction, velocity, deflection, load)
    return rotational


def _directional_torque(law: PlantFriction, velocity: float, deflection: float, load: float) -> float:
    """Friction by the laws with directions of their own, with or without bristles."""
    level = _level(law, velocity)
    viscous = directional_viscous_torque(
        velocity, law.viscous_friction_forward, law.viscous_friction_backward, law.viscous_exponent
    )
    if law.law == ASYMMETRIC:
        loss = gear_loss_torque(velocity, load, law.gear_efficiency, law.transition_velocity)
        return loss + asymmetric_torque(velocity, law.offset, level, law.transition_velocity, viscous)
    rate = bristle_rate(velocity, deflection, level, law.bristle_stiffness)
    bristles = lugre_torque(velocity, deflection, rate, law.bristle_stiffness, law.bristle_damping, 0.0)
    # Beside the bristles, not in their level: their damper would multiply a load that comes a little late.
    loss = gear_loss_torque(velocity, load, law.gear_efficiency, 0.1 * law.stribeck_velocity)
    return loss + bristles + law.offset + viscous


def advance_deflection(
    friction: PlantFriction, displacement: float, velocity: float, deflection: float
) -> float:
    """Deflection in [rad] of the bristles after a small displacement of the joint in [rad].

    Bristles follow the way, not the time; only their level h depends on the speed, that at the end. For a
    level that stays this is exact (:func:`twin_gait.core.friction_models.bristle_step`), however long the
    way: a step may be longer than bristles take to slide. Laws without bristles leave the deflection as it
    is.
    """
    if friction.law != BRISTLE:
        return deflection
    return bristle_step(displacement, deflection, _level(friction, velocity), friction.bristle_stiffness, 1.0)


def steady_deflection(friction: PlantFriction, velocity: float) -> float:
    """Deflection in [rad] of bristles that slide at a constant velocity: h sgn ω / σ0, or 0."""
    if friction.law != BRISTLE:
        return 0.0
    return sign_of(velocity) * _level(friction, velocity) / friction.bristle_stiffness


def _level(law: PlantFriction, velocity: float) -> float:
    """Torque that sliding bristles hold: the Stribeck curve."""
    return stribeck_level(
        velocity, law.coulomb_friction, law.breakaway_torque, law.stribeck_velocity, law.stribeck_exponent
    )
