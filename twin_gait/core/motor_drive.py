"""Winding, current loop, inverter and gear of one joint, faster than the tick of the firmware.

Currents and voltages are those of the DC equivalent of the block-commutated motor, as in
:mod:`twin_gait.core.actuator`; torques are at the joint.
"""

import math
from collections.abc import Sequence

from twin_gait.core.actuator import saturate
from twin_gait.core.elementary import settled_share, sine_cosine

# Switching states of six-step commutation in an electrical turn.
_SIX_STEPS = 6.0
LOWEST_EFFICIENCY = 0.05


def winding_current_step(
    current: float, voltage: float, back_emf: float, resistance: float, inductance: float, period: float
) -> tuple[float, float]:
    r"""Current of the winding after a period of constant voltage and back-EMF, solved exactly, and its mean.

    .. math::

        L \frac{dI}{dt} = U - R I - E, \qquad
        I(T) = I_\infty + (I - I_\infty)\,e^{-RT/L}, \quad I_\infty = \frac{U - E}{R}

    The mean over the period, which gives the mean torque, is :math:`I_\infty + (I - I_\infty)\,(1 -
    e^{-RT/L})\,L/(RT)`. R in [Ω] and L in [H] are line to line; L and T in [s] are above 0.
    """
    steady = (voltage - back_emf) / resistance
    exponent = resistance * period / inductance
    settled = settled_share(exponent)
    away = current - steady
    return current - away * settled, steady + away * settled / exponent


def current_loop_gains(resistance: float, inductance: float, bandwidth: float) -> tuple[float, float]:
    r"""Gains of the current loop that cancel the pole of the winding, in [V] / [A] and [V] / [A s].

    With :math:`K_p = \omega_b L` and :math:`K_i = \omega_b R` the loop closed over an ideal measurement
    answers a step as :math:`1 - e^{-\omega_b t}`.
    """
    return bandwidth * inductance, bandwidth * resistance


def current_loop_step(
    error: float, integral: float, proportional_gain: float, integral_gain: float, period: float, limit: float
) -> tuple[float, float]:
    r"""One step of the PI current loop of figure 2.13 of the thesis, with anti-windup.

    :math:`U = K_p\,(I_t - I_m) + K_i \int (I_t - I_m)\,dt`, within the ``limit`` of what the bus gives in
    [V]. The integral stands still while the limit holds and the error would drive it further in. Returns
    voltage and integral part in [V].
    """
    grown = integral + integral_gain * period * error
    wanted = proportional_gain * error + grown
    voltage = saturate(wanted, limit)
    if (wanted - voltage) * error > 0.0:
        return voltage, integral
    return voltage, grown


def six_step_current(
    current: float, motor_angle: float, pole_pairs: float, ripple: float, noise: float
) -> float:
    r"""Current in [A] that the shunts of a six-step inverter show.

    :math:`I_m = I\,[1 + r \cos(6\,p\,\theta_m)] + n` with p pole pairs, rotor angle θ_m and noise n: the
    first harmonic of what repeats with every commutation, six in an electrical turn, 6p in a turn of the
    motor.
    """
    _, cosine = sine_cosine(_SIX_STEPS * pole_pairs * motor_angle)
    return current * (1.0 + ripple * cosine) + noise


def inverter_voltage(duty: float, counts: float, bus_voltage: float) -> float:
    """Mean voltage in [V] of the pulse-width modulation; the duty is a whole number of counts.

    ``counts``: of full duty; 0 or less for an inverter without steps, whose duty is a share.
    """
    if counts <= 0.0:
        return saturate(duty, 1.0) * bus_voltage
    return saturate(math.floor(duty + 0.5), counts) / counts * bus_voltage


def drive_efficiency(temperature: float, input_speed: float, fit: Sequence[float]) -> float:
    r"""Efficiency of a harmonic drive at rated torque, a quadratic fit, kept between 0.05 and 1.

    :math:`c_0 + \vartheta\,(c_1 + c_2\vartheta + c_4|\omega|) + |\omega|\,(c_3 + c_5|\omega|)` with the six
    numbers of the ``fit``, the temperature ϑ of the grease in [°C] and the speed ω of the wave generator in
    [rad] / [s], either sign.
    """
    speed = abs(input_speed)
    heated = temperature * (fit[1] + fit[2] * temperature + fit[4] * speed)
    efficiency = fit[0] + heated + speed * (fit[3] + fit[5] * speed)
    return min(max(efficiency, LOWEST_EFFICIENCY), 1.0)


def torsion_torque(twist: float, twist_rate: float, stiffness: float, damping: float) -> float:
    r"""Torque of the flexspline on the link in [N m]: :math:`K\,\Delta + D\,\dot\Delta`.

    Δ is the angle of the motor at the joint less that of the link; the negative acts on the motor side.
    """
    return stiffness * twist + damping * twist_rate


def link_load_torque(angle: float, moment: float, gravity: float, horizontal_angle: float) -> float:
    r"""Torque of gravity on a link, equation (2.8) of the thesis: :math:`g\,m b \cos(\theta - \theta_h)`.

    In [N m], positive along the fall, with the ``moment`` m b of weight and link in [kg m] and the angle θ_h
    at which the link is level: π/2 where the fall begins level, 0 in the form that the thesis prints.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return gravity * moment * cosine
