"""Winding, current loop, inverter and gear of one joint, faster than the tick of the firmware.

Currents and voltages are those of the DC equivalent of the block-commutated motor, as in
:mod:`twin_gait.core.actuator`; torques are at the joint.
"""

import math

from twin_gait.core.actuator import saturate
from twin_gait.core.elementary import settled_share, sine_cosine

# Switching states of six-step commutation in an electrical turn.
_SIX_STEPS = 6.0
LOWEST_EFFICIENCY = 0.05


def winding_current_step(
    current: float, voltage: float, back_emf: float, resistance: float, inductance: float, period: float
) -> tuple[float, float]:
    r"""Current of the winding after a period of constant voltage and back-EMF, solved exactly.

    .. math::

        L \frac{dI}{dt} = U - R I - E, \qquad
        I(T) = I_\infty + (I - I_\infty)\,e^{-RT/L}, \quad I_\infty = \frac{U - E}{R}

    The mean over the period, which gives the mean torque, is
    :math:`I_\infty + (I - I_\infty)\,(1 - e^{-RT/L})\,L/(RT)`.

    ``current``: :math:`I` at the start in [A]. ``voltage``: :math:`U` in [V]. ``back_emf``: :math:`E` in [V].
    ``resistance``: :math:`R`, line to line, in [Ω]. ``inductance``: :math:`L`, line to line, in [H], above 0.
    ``period``: :math:`T` in [s], above 0. Returns the current at the end of the period and its mean over the
    period in [A].
    """
    steady = (voltage - back_emf) / resistance
    exponent = resistance * period / inductance
    settled = settled_share(exponent)
    away = current - steady
    return current - away * settled, steady + away * settled / exponent


def current_loop_gains(resistance: float, inductance: float, bandwidth: float) -> tuple[float, float]:
    r"""Gains of the current loop that cancel the pole of the winding.

    With :math:`K_p = \omega_b L` and :math:`K_i = \omega_b R` the loop closed over an ideal measurement
    answers a step as :math:`1 - e^{-\omega_b t}`.

    ``resistance``: :math:`R` in [Ω]. ``inductance``: :math:`L` in [H]. ``bandwidth``: :math:`\omega_b` in
    [rad] / [s]. Returns :math:`K_p` in [V] / [A] and :math:`K_i` in [V] / [A s].
    """
    return bandwidth * inductance, bandwidth * resistance


def current_loop_step(
    error: float,
    integral: float,
    proportional_gain: float,
    integral_gain: float,
    period: float,
    voltage_limit: float,
) -> tuple[float, float]:
    r"""One step of the PI current loop of figure 2.13 of the thesis, with anti-windup.

    :math:`U = K_p\,(I_t - I_m) + K_i \int (I_t - I_m)\,dt`, limited to what the bus gives. The integral
    stands still while the limit holds and the error would drive it further in.

    ``error``: target less measured current in [A]. ``integral``: voltage of the integral part before in [V].
    ``proportional_gain``: :math:`K_p` in [V] / [A]. ``integral_gain``: :math:`K_i` in [V] / [A s].
    ``period``: in [s]. ``voltage_limit``: in [V]. Returns the voltage in [V] and integral part in [V] after.
    """
    grown = integral + integral_gain * period * error
    wanted = proportional_gain * error + grown
    voltage = saturate(wanted, voltage_limit)
    if (wanted - voltage) * error > 0.0:
        return voltage, integral
    return voltage, grown


def six_step_current(
    current: float, motor_angle: float, pole_pairs: float, ripple: float, noise: float
) -> float:
    r"""Current that the shunts of a six-step inverter show.

    .. math::

        I_m = I\,[1 + r \cos(6\,p\,\theta_m)] + n

    the first harmonic of what repeats with every commutation: six in an electrical turn, :math:`6p` in a
    turn of the motor.

    ``current``: true current :math:`I` in [A]. ``motor_angle``: :math:`\theta_m` of the rotor in [rad].
    ``pole_pairs``: :math:`p`. ``ripple``: :math:`r`, relative. ``noise``: :math:`n` of this sample in [A].
    Returns the current in [A].
    """
    _, cosine = sine_cosine(_SIX_STEPS * pole_pairs * motor_angle)
    return current * (1.0 + ripple * cosine) + noise


def inverter_voltage(duty: float, counts: float, bus_voltage: float) -> float:
    """Mean voltage of the pulse-width modulation; the duty is a whole number of counts.

    ``duty``: in counts. ``counts``: of full duty; 0 or less for an inverter without steps, whose duty is a
    share. ``bus_voltage``: in [V]. Returns the voltage on the winding in [V], within the bus voltage.
    """
    if counts <= 0.0:
        return saturate(duty, 1.0) * bus_voltage
    return saturate(math.floor(duty + 0.5), counts) / counts * bus_voltage


def drive_efficiency(
    temperature: float,
    input_speed: float,
    constant: float,
    per_degree: float,
    per_degree_squared: float,
    per_speed: float,
    per_degree_speed: float,
    per_speed_squared: float,
) -> float:
    r"""Efficiency of a harmonic drive at rated torque, a quadratic fit in temperature and speed.

    ``temperature``: :math:`\vartheta` of the grease in [°C]. ``input_speed``: :math:`\omega_{in}` of the wave
    generator in [rad] / [s], either sign. ``constant``: term without either. ``per_degree``: of
    :math:`\vartheta`. ``per_degree_squared``: of :math:`\vartheta^2`. ``per_speed``: of
    :math:`|\omega_{in}|`. ``per_degree_speed``: of :math:`\vartheta\,|\omega_{in}|`. ``per_speed_squared``:
    of :math:`\omega_{in}^2`. Returns the efficiency, kept between 0.05 and 1.
    """
    speed = abs(input_speed)
    efficiency = (
        constant
        + temperature * (per_degree + per_degree_squared * temperature + per_degree_speed * speed)
        + speed * (per_speed + per_speed_squared * speed)
    )
    return min(max(efficiency, LOWEST_EFFICIENCY), 1.0)


def torsion_torque(twist: float, twist_rate: float, stiffness: float, damping: float) -> float:
    r"""Torque of the flexspline on the link: :math:`K\,\Delta + D\,\dot\Delta`.

    ``twist``: :math:`\Delta`, angle of the motor at the joint less that of the link, in [rad].
    ``twist_rate``: its rate in [rad] / [s]. ``stiffness``: :math:`K` in [N m] / [rad]. ``damping``: :math:`D`
    in [N m s] / [rad]. Returns the torque on the link in [N m]; its negative acts on the motor side.
    """
    return stiffness * twist + damping * twist_rate


def link_load_torque(angle: float, moment: float, gravity: float, horizontal_angle: float) -> float:
    r"""Torque of gravity on a link, equation (2.8) of the thesis: :math:`g\,m b \cos(\theta - \theta_h)`.

    ``angle``: :math:`\theta` in [rad]. ``moment``: :math:`m b` of weight and link in [kg m]. ``gravity``:
    :math:`g` in [m] / [s²]. ``horizontal_angle``: :math:`\theta_h` at which the link is level: π/2 where the
    fall begins level, 0 in the form that the thesis prints. Returns the torque on the joint in [N m],
    positive along the fall.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return gravity * moment * cosine


def cosine_path(
    time: float, start_angle: float, amplitude: float, frequency: float
) -> tuple[float, float, float]:
    r"""Path :math:`\theta_s + \tfrac{A}{2}(1 - \cos 2\pi f t)` with its velocity and acceleration.

    ``time``: :math:`t` in [s]. ``start_angle``: :math:`\theta_s` in [rad]. ``amplitude``: :math:`A`, end to
    end, in [rad]. ``frequency``: :math:`f` in [Hz]. Returns the angle in [rad], velocity in [rad] / [s],
    acceleration in [rad] / [s²].
    """
    pulsation = 2.0 * math.pi * frequency
    half = 0.5 * amplitude
    sine, cosine = sine_cosine(pulsation * time)
    return (
        start_angle + half * (1.0 - cosine),
        half * pulsation * sine,
        half * pulsation * pulsation * cosine,
    )
