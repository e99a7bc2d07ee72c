"""Winding, current loop, inverter and gear of one joint, with a shorter period than the tick of the firmware.

Currents and voltages are those of the DC equivalent of the block-commutated motor, as in
:mod:`twin_gait.core.actuator`; torques are at the joint.
"""

import math
from collections.abc import Sequence

from twin_gait.core.actuator import saturate
from twin_gait.core.elementary import settled_share, sine_cosine

# Number of switching states of six-step commutation in an electrical turn.
_SIX_STEPS = 6.0
LOWEST_EFFICIENCY = 0.05


def winding_current_step(
    current: float, voltage: float, back_emf: float, resistance: float, inductance: float, period: float
) -> tuple[float, float]:
    r"""Solve the winding exactly over a period of constant voltage and back-EMF: final and mean current.

    .. math::

        L \frac{dI}{dt} = U - R I - E, \qquad
        I(T) = I_\infty + (I - I_\infty)\,e^{-RT/L}, \quad I_\infty = \frac{U - E}{R}

    The mean over the period, which gives the mean torque, is :math:`I_\infty + (I - I_\infty)\,(1 -
    e^{-RT/L})\,L/(RT)`. R in [Ω] and L in [H] are line to line; L and T in [s] are above 0. Currents are in
    [A].
    """
    steady = (voltage - back_emf) / resistance
    exponent = resistance * period / inductance
    settled = settled_share(exponent)
    away = current - steady
    return current - away * settled, steady + away * settled / exponent


def current_loop_gains(resistance: float, inductance: float, bandwidth: float) -> tuple[float, float]:
    r"""Compute the gains of the current loop that cancel the pole of the winding.

    With :math:`K_p = \omega_b L` in [V/A] and :math:`K_i = \omega_b R` in [V/(A·s)] the step response
    of the loop, closed over an ideal measurement, is :math:`1 - e^{-\omega_b t}`.
    """
    return bandwidth * inductance, bandwidth * resistance


def current_loop_step(
    error: float, integral: float, proportional_gain: float, integral_gain: float, period: float, limit: float
) -> tuple[float, float]:
    r"""Update the PI current loop of figure 2.13 of the thesis by one period, with anti-windup.

    :math:`U = K_p\,(I_t - I_m) + K_i \int (I_t - I_m)\,dt`, limited to the voltage ``limit`` of the bus in
    [V]. The integral is held while the voltage is at the limit and the error would drive it further into
    saturation. Returns voltage and integral part in [V].
    """
    grown = integral + integral_gain * period * error
    requested = proportional_gain * error + grown
    voltage = saturate(requested, limit)
    if (requested - voltage) * error > 0.0:
        return voltage, integral
    return voltage, grown


def six_step_current(
    current: float, motor_angle: float, pole_pairs: float, ripple: float, noise: float
) -> float:
    r"""Compute the current in [A] that the shunts of a six-step inverter measure.

    :math:`I_m = I\,[1 + r \cos(6\,p\,\theta_m)] + n` with p pole pairs, rotor angle θ_m and noise n: the
    first harmonic of the ripple that repeats with every commutation, six in an electrical turn, 6p in a turn
    of the motor.
    """
    _, cosine = sine_cosine(_SIX_STEPS * pole_pairs * motor_angle)
    return current * (1.0 + ripple * cosine) + noise


def inverter_voltage(duty: float, counts: float, bus_voltage: float) -> float:
    """Compute the mean voltage in [V] of the pulse-width modulation; the duty is a whole number of counts.

    ``counts``: number of counts at full duty; 0 or less for an inverter without steps, whose duty is a share.
    """
    if counts <= 0.0:
        return saturate(duty, 1.0) * bus_voltage
    return saturate(math.floor(duty + 0.5), counts) / counts * bus_voltage


def drive_efficiency(temperature: float, input_speed: float, fit: Sequence[float]) -> float:
    r"""Compute the efficiency of a harmonic drive at rated torque by a quadratic fit, limited to 0.05 to 1.

    :math:`c_0 + \vartheta\,(c_1 + c_2\vartheta + c_4|\omega|) + |\omega|\,(c_3 + c_5|\omega|)` with the six
    numbers of the ``fit``, the temperature ϑ of the grease in [°C] and the speed ω of the wave generator in
    [rad/s], either sign.
    """
    speed = abs(input_speed)
    heated = temperature * (fit[1] + fit[2] * temperature + fit[4] * speed)
    efficiency = fit[0] + heated + speed * (fit[3] + fit[5] * speed)
    return min(max(efficiency, LOWEST_EFFICIENCY), 1.0)


def torsion_torque(twist: float, twist_rate: float, stiffness: float, damping: float) -> float:
    r"""Compute the torque of the flexspline on the link in [N·m]: :math:`K\,\Delta + D\,\dot\Delta`.

    Δ is the angle of the motor at the joint minus the angle of the link; the negative torque acts on the
    motor side.
    """
    return stiffness * twist + damping * twist_rate


def link_load_torque(angle: float, moment: float, gravity: float, horizontal_angle: float) -> float:
    r"""Compute the torque of gravity on a link in [N·m], equation (2.8) of the thesis.

    :math:`g\,m b \cos(\theta - \theta_h)`, positive along the fall, with the ``moment`` m b of weight and
    link in [kg·m] and the angle θ_h at which the link is level: π/2 if the fall begins level, 0 in the form
    that the thesis prints.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return gravity * moment * cosine
