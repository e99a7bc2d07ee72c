"""Friction of a joint with motor and harmonic drive, and the loss of its gear under load, at the joint."""

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

# Codes of the laws of a :class:`PlantFriction`.
FRICTIONLESS, ROTATIONAL, ASYMMETRIC, BRISTLE = range(4)
# Whether a coordinate may have one of the last two laws; a loop without them is compiled with False.
WITH_OTHER_FRICTION_LAWS = True


@dataclass(slots=True)
class PlantFriction:
    """Friction of a coordinate of the plant: code of its law, and the parameters of all laws.

    Each law reads some of the parameters; :func:`friction_torque` defines them.
    """

    law: int = FRICTIONLESS  # ``FRICTIONLESS``, ``ROTATIONAL``, ``ASYMMETRIC`` or ``BRISTLE``.
    breakaway_torque: float = 0.0  # T_b, a of (3.1), in [N·m].
    coulomb_friction: float = 0.0  # T_c, b of (3.1), in [N·m].
    # ω_c, c of (3.1); ω_st of the other laws; in [rad/s], not zero.
    stribeck_velocity: float = 1.0
    # d of (3.1) in [N·m·s/rad]; d+ of the other laws in [N·m] at 1 rad/s.
    viscous_friction_forward: float = 0.0
    viscous_friction_backward: float = 0.0  # d- in [N·m] at 1 rad/s.
    gear_efficiency: float = 1.0  # η under load; 1 for a gear that loses nothing under load.
    offset: float = 0.0  # T_0 in [N·m].
    transition_velocity: float = 1.0  # ω_t in [rad/s], above 0.
    stribeck_exponent: float = 2.0  # δ.
    viscous_exponent: float = 1.0  # α.
    bristle_stiffness: float = 0.0  # σ0 in [N·m/rad]; 0 for laws without bristles.
    bristle_damping: float = 0.0  # σ1 in [N·m·s/rad].


def rotational_friction_torque(
    velocity: float, breakaway: float, coulomb: float, breakaway_velocity: float, viscous: float
) -> float:
    r"""Compute the rotational friction torque in [N·m], an odd function with the sign of the velocity.

    It is equation (3.1) of the thesis, with breakaway torque a and Coulomb friction b in [N·m], breakaway
    velocity c in [rad/s], not zero, and viscous coefficient d in [N·m·s/rad]:

    .. math::

        T_{fr}(\omega) = \sqrt{2e}\,(a-b)\,e^{-(\omega/c)^2}\frac{\omega}{c}
                         + b \tanh\frac{\omega}{c/10} + d\,\omega

    The torque on the plant is :math:`-T_{fr}`; a compensator adds :math:`+G\,T_{fr}`. With :math:`a < b`, as
    in table 3.1, the first term is a dip near 0.13 rad/s instead of a Stribeck peak.
    """
    x = velocity / breakaway_velocity
    stribeck = _SQRT_2E * (breakaway - coulomb) * exponential(-(x * x)) * x
    return stribeck + coulomb * hyperbolic_tangent(10.0 * x) + viscous * velocity


def rotational_friction_and_share(
    velocity: float,
    breakaway: float,
    coulomb: float,
    breakaway_velocity: float,
    viscous: float,
    load_sign: float,
    efficiency: float,
) -> tuple[float, float]:
    """Compute :func:`rotational_friction_torque` and :func:`loss_share`; a compiler shares their tanh."""
    friction = rotational_friction_torque(velocity, breakaway, coulomb, breakaway_velocity, viscous)
    direction = hyperbolic_tangent(10.0 * (velocity / breakaway_velocity))
    return friction, loss_share(direction, load_sign, efficiency)


def loss_share(direction: float, load_sign: float, efficiency: float) -> float:
    r"""Compute the share c of its load that a gear loses; it is negative if the joint drives the motor.

    The loss :math:`c\,\tau` has the sign of the velocity. If the motor drives the joint, the joint receives
    :math:`\eta\tau`; if the joint drives the motor, it has to apply :math:`\tau/\eta`:

    .. math::

        c = \begin{cases} 1 - \eta & \tau\omega > 0 \\
            1 - 1/\eta & \tau\omega < 0 \end{cases}

    Between the two cases c is the parabola in the direction :math:`t = \tanh(\omega/\omega_t)` that joins
    them, is smooth through rest and is zero at rest:

    .. math::

        c = t\,(A\,\mathrm{sgn}\,\tau - B\,t), \qquad
        A = \tfrac12\left(\tfrac1\eta - \eta\right), \quad B = \tfrac12\left(\tfrac1\eta + \eta\right) - 1

    As :math:`B < A`, the gear never adds energy. The loss is a friction that grows with the load (model M3 of
    Duclusaud et al. 2025), :math:`K_l\,|\tau|` with :math:`K_l = 1 - \eta` or :math:`1/\eta - 1`.

    Args:
        direction: t, from :func:`gear_direction`.
        load_sign: Sign of the load τ, the torque of the motor minus the torque that turns the rotor.
        efficiency: η in (0, 1].
    """
    inverse = 1.0 / efficiency
    steepness, bend = 0.5 * (inverse - efficiency), 0.5 * (inverse + efficiency) - 1.0
    return direction * (steepness * load_sign - bend * direction)


def gear_loss_torque(velocity: float, load: float, efficiency: float, transition_velocity: float) -> float:
    """Compute the torque in [N·m] that a gear loses under a load in [N·m], with the sign of the velocity.

    It is the load times :func:`loss_share`.
    """
    direction = hyperbolic_tangent(velocity / transition_velocity)
    return loss_share(direction, sign_of(load), efficiency) * load


def friction_torque(friction: PlantFriction, velocity: float, deflection: float) -> float:
    r"""Compute the friction of a coordinate in [N·m] without load, with the sign of the velocity.

    ``ROTATIONAL`` is (3.1). ``ASYMMETRIC`` is :func:`twin_gait.core.friction_models.asymmetric_torque`,
    ``BRISTLE`` is the LuGre model with directions (the Dahl model if :math:`T_b = T_c` and
    :math:`\sigma_1 = 0`) with the deflection z in [rad]:

    .. math::

        T_0 + \left\{\begin{array}{l} h(\omega)\,\tanh(\omega/\omega_t) \\
        \sigma_0 z + \sigma_1 \dot z \end{array}\right\} + d_\pm|\omega|^\alpha\,\mathrm{sgn}\,\omega

    with the Stribeck curve h. The gear adds its loss under load, :func:`loss_share`.
    """
    if WITH_OTHER_FRICTION_LAWS:
        if friction.law > ROTATIONAL:
            return directional_torque(friction, velocity, deflection)
    if friction.law == FRICTIONLESS:
        return 0.0
    return rotational_friction_torque(
        velocity,
        friction.breakaway_torque,
        friction.coulomb_friction,
        friction.stribeck_velocity,
        friction.viscous_friction_forward,
    )


def gear_direction(friction: PlantFriction, velocity: float) -> float:
    r"""Compute the direction of a gear, :math:`\tanh(\omega/\omega_t)`; 0 for a coordinate without friction.

    :math:`\omega_t` is the transition velocity of ``ASYMMETRIC``, and a tenth of ``stribeck_velocity`` for
    the other laws.
    """
    if friction.law == FRICTIONLESS:
        return 0.0
    if friction.law == ASYMMETRIC:
        return hyperbolic_tangent(velocity / friction.transition_velocity)
    return hyperbolic_tangent(10.0 * (velocity / friction.stribeck_velocity))


def directional_torque(law: PlantFriction, velocity: float, deflection: float) -> float:
    """Compute the friction of the laws with separate directions, with or without bristles."""
    level = _level(law, velocity)
    viscous = directional_viscous_torque(
        velocity, law.viscous_friction_forward, law.viscous_friction_backward, law.viscous_exponent
    )
    if law.law == ASYMMETRIC:
        return asymmetric_torque(velocity, law.offset, level, law.transition_velocity, viscous)
    rate = bristle_rate(velocity, deflection, level, law.bristle_stiffness)
    bristles = lugre_torque(velocity, deflection, rate, law.bristle_stiffness, law.bristle_damping, 0.0)
    return bristles + law.offset + viscous


def advance_deflection(
    friction: PlantFriction, displacement: float, velocity: float, deflection: float
) -> float:
    """Compute the deflection in [rad] of the bristles after a small displacement of the joint in [rad].

    The deflection depends on the displacement, not on the time; only its level h depends on the velocity at
    the end. For a constant level the result is exact (:func:`twin_gait.core.friction_models.bristle_step`)
    for any displacement, so a step may be longer than the bristles take to slide. Without bristles the
    deflection does not change.
    """
    if friction.law != BRISTLE:
        return deflection
    return bristle_step(displacement, deflection, _level(friction, velocity), friction.bristle_stiffness, 1.0)


def steady_deflection(friction: PlantFriction, velocity: float) -> float:
    """Compute the deflection in [rad] of bristles that slide at a constant velocity: h sgn ω / σ0, or 0."""
    if friction.law != BRISTLE:
        return 0.0
    return sign_of(velocity) * _level(friction, velocity) / friction.bristle_stiffness


def _level(law: PlantFriction, velocity: float) -> float:
    """Compute the torque of sliding bristles, which is the Stribeck curve."""
    return stribeck_level(
        velocity, law.coulomb_friction, law.breakaway_torque, law.stribeck_velocity, law.stribeck_exponent
    )
