"""Friction laws of the literature, from which an identification chooses.

They complement the law of the thesis and return the friction torque in [N·m] with the sign of the velocity;
the torque on the plant is its negative. Each law is linear in all of its torques and coefficients, which the
identification exploits; velocities and exponents enter non-linearly. The laws have no branches on numbers but
use :func:`where`, so that the identification runs these same functions over arrays
(:mod:`twin_gait.identification.laws`).

Symbols of all laws: velocity ω in [rad/s]; ``coulomb`` T_c and ``breakaway`` T_b in [N·m]; ``viscous`` d
in [N·m·s/rad]; ``stribeck_velocity`` ω_st and ``transition_velocity`` ω_t in [rad/s], above 0;
``deflection`` z of the bristles in [rad], their ``stiffness`` σ0 in [N·m/rad], and their ``level`` h in
[N·m], above 0.
"""

import math

from twin_gait.core.elementary import exponential, hyperbolic_tangent, settled_share, sine_cosine

_SQRT_2E = math.sqrt(2.0 * math.e)
REFERENCE_TEMPERATURE = 25.0  # Temperature in [°C] for which motor data sheets state their values.


def where(condition: bool, one: float, other: float) -> float:
    """Return one number if a condition is true, else the other; over arrays it is :func:`numpy.where`."""
    return one if condition else other


def sign_of(velocity: float) -> float:
    """Return the sign of a velocity: 1, -1, or 0 at rest."""
    return where(velocity > 0.0, 1.0, where(velocity < 0.0, -1.0, 0.0))


def coulomb_viscous_torque(velocity: float, coulomb: float, viscous: float) -> float:
    r"""Compute Coulomb and viscous friction, thesis (1.1): :math:`T_c\,\mathrm{sgn}\,\omega + d\,\omega`."""
    return coulomb * sign_of(velocity) + viscous * velocity


def coulomb_viscous_tanh_torque(velocity: float, coulomb: float, viscous: float, steepness: float) -> float:
    r"""Compute the friction of TWIN's old model, equation (2.5) of the thesis.

    :math:`d\,\omega + T_c \tanh(\kappa\,\omega)`; T_c (F_s in the thesis) is ``coulomb``, and κ the
    ``steepness`` in [s/rad], 40 in the firmware.
    """
    return coulomb * hyperbolic_tangent(steepness * velocity) + viscous * velocity


def stribeck_level(
    velocity: float, coulomb: float, breakaway: float, stribeck_velocity: float, exponent: float
) -> float:
    r"""Compute the magnitude of the friction without its viscous part: Coulomb friction and Stribeck effect.

    :math:`h(\omega) = T_c + (T_b - T_c)\,e^{-|\omega/\omega_{st}|^\delta}` with an ``exponent`` δ that is
    often 2. In place of T_c in :func:`coulomb_viscous_torque` it gives the Stribeck friction of the thesis,
    equation (1.2).
    """
    return coulomb + (breakaway - coulomb) * exponential(-(abs(velocity / stribeck_velocity) ** exponent))


def two_velocity_torque(
    velocity: float, breakaway: float, coulomb: float, viscous: float, velocity_1: float, velocity_2: float
) -> float:
    r"""Compute rotational friction with a separate velocity threshold for each term, thesis (2.13).

    .. math::

        \sqrt{2e}\,(T_b-T_c)\,e^{-(\omega/\omega_1)^2}\frac{\omega}{\omega_1}
        + T_c \tanh\frac{\omega}{\omega_2} + d\,\omega

    With :math:`\omega_1 = \omega_c` and :math:`\omega_2 = \omega_c/10` it is equation (3.1),
    :func:`twin_gait.core.friction.rotational_friction_torque`; with :math:`\omega_1 = \sqrt2\,\omega_b` and
    :math:`\omega_2 = \omega_b/10` it is the Rotational Friction block of Simscape. Neither velocity may be 0.
    """
    x = velocity / velocity_1
    bump = _SQRT_2E * (breakaway - coulomb) * x * exponential(-(x * x))
    return bump + coulomb * hyperbolic_tangent(velocity / velocity_2) + viscous * velocity


def load_and_temperature_torque(
    velocity: float,
    load: float,
    temperature: float,
    coulomb: float,
    coulomb_per_load: float,
    coulomb_per_kelvin: float,
    viscous: float,
    viscous_per_kelvin: float,
    transition_velocity: float,
) -> float:
    r"""Compute Coulomb and viscous friction that depend on load and temperature.

    .. math::

        [T_c + c_l |T_L| + c_\vartheta (\vartheta - \vartheta_0)] \tanh\frac{\omega}{\omega_t}
        + [d + d_\vartheta (\vartheta - \vartheta_0)]\,\omega

    to first order about :math:`\vartheta_0 = 25` °C; ``load`` is T_L in [N·m], either sign. The load term is
    taken from Duclusaud et al. (2025).
    """
    warmer = temperature - REFERENCE_TEMPERATURE
    level = coulomb + coulomb_per_load * abs(load) + coulomb_per_kelvin * warmer
    drag = (viscous + viscous_per_kelvin * warmer) * velocity
    return level * hyperbolic_tangent(velocity / transition_velocity) + drag


def directional_viscous_torque(velocity: float, forward: float, backward: float, exponent: float) -> float:
    r"""Compute viscous friction with a coefficient for each direction and a power of the speed.

    :math:`d_\pm\,|\omega|^\alpha\,\mathrm{sgn}\,\omega` with ``forward`` and ``backward`` in [N·m] at 1 rad/s
    and the ``exponent`` α: grease thins as it is sheared, and measured exponents of harmonic drives are often
    below 1.
    """
    power = abs(velocity) ** exponent
    return where(velocity > 0.0, forward * power, -backward * power)


def asymmetric_torque(
    velocity: float, offset: float, level: float, transition_velocity: float, viscous: float
) -> float:
    r"""Compute Stribeck friction with an offset and a separate viscous friction in each direction.

    :math:`T_0 + h(\omega)\tanh(\omega/\omega_t) + d_\pm|\omega|^\alpha\,\mathrm{sgn}\,\omega`, with the
    ``level`` :math:`h` of :func:`stribeck_level` and the ``viscous`` friction of
    :func:`directional_viscous_torque`. The Coulomb friction is :math:`T_c + T_0` forwards and :math:`T_c -
    T_0` backwards: a difference of the Coulomb friction between the directions is the same as an offset.
    """
    return offset + level * hyperbolic_tangent(velocity / transition_velocity) + viscous


def ripple_torque(angle: float, cosine: float, sine: float, order: float) -> float:
    r"""Compute the torque that repeats with the joint angle: :math:`C\cos n\theta + S\sin n\theta`.

    ``angle``: θ in [rad]. ``cosine`` and ``sine``: C and S in [N·m]. ``order``: n, periods in a turn of the
    joint.
    """
    sine_of, cosine_of = sine_cosine(order * angle)
    return cosine * cosine_of + sine * sine_of


def bristle_rate(velocity: float, deflection: float, level: float, stiffness: float) -> float:
    r"""Compute the rate in [rad/s] of the bristle deflection of the Dahl and LuGre models.

    :math:`\dot z = \omega - \sigma_0 \frac{|\omega|}{h(\omega)}\,z` with the Coulomb friction as h in Dahl's
    model (1968, exponent 1) and :func:`stribeck_level` in the LuGre model (Canudas de Wit et al. 1995).
    """
    return velocity - stiffness * abs(velocity) / level * deflection


def bristle_step(velocity: float, deflection: float, level: float, stiffness: float, period: float) -> float:
    r"""Solve :func:`bristle_rate` exactly for the deflection after a period in [s] of constant velocity.

    The law is linear in z and very stiff; the exact solution is stable for any period: :math:`z(T) = z_{ss} +
    (z - z_{ss})\,e^{-\sigma_0|\omega|T/h}` with :math:`z_{ss} = h\,\mathrm{sgn}\,\omega/\sigma_0`.
    """
    travelled = stiffness * abs(velocity) * period / level
    grown = settled_share(travelled)
    if velocity > 0.0:
        return deflection + (level / stiffness - deflection) * grown
    if velocity < 0.0:
        return deflection - (level / stiffness + deflection) * grown
    return deflection


def lugre_torque(
    velocity: float, deflection: float, rate: float, stiffness: float, damping: float, viscous: float
) -> float:
    r"""Compute the friction torque of the LuGre model.

    :math:`\sigma_0 z + \sigma_1 \dot z + \sigma_2\,\omega` with the ``rate`` :math:`\dot z` of
    :func:`bristle_rate`. ``damping`` is σ1 and ``viscous`` σ2 in [N·m·s/rad]; Dahl's model is the same
    with σ1 = 0.
    """
    return stiffness * deflection + damping * rate + viscous * velocity
