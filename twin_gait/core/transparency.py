"""Duty-based transparency control, equation (2.1) of the thesis: the motor follows the moved joint."""

import math
from dataclasses import dataclass

from twin_gait.core.actuator import saturate
from twin_gait.core.elementary import sine_cosine


@dataclass(slots=True)
class Transparency:
    """Parameters of :func:`transparency_duty`; each of its two laws reads those of its letters."""

    amplitude: float = 0.0  # A in counts.
    frequency: float = 0.0  # f in [Hz].
    ticks_per_second: float = 1.0  # N, the ``steps`` of the thesis.
    lowest_velocity: float = 0.0  # ω_min in [rad] / [s], below which (2.1a) holds.
    transparency_gain: float = 0.0  # K.
    static_voltage: float = 0.0  # p0 in [V].
    voltage_per_velocity: float = 0.0  # p1 in [V s] / [rad].
    voltage_per_velocity_squared: float = 0.0  # p2 in [V s²] / [rad²].
    duty_limit: float = 0.0  # Safety limit in counts.


def breakaway_duty(law: Transparency, tick: float) -> float:
    r"""Duty in counts that shakes the joint at rest in tick n, equation (2.1a) of the thesis.

    :math:`d = A \sin\frac{2\pi f\,n}{N}`
    """
    sine, _ = sine_cosine(2.0 * math.pi * law.frequency * tick / law.ticks_per_second)
    return law.amplitude * sine


def viscous_duty(law: Transparency, velocity: float, bus_voltage: float, counts: float) -> float:
    r"""Duty in counts that follows the moving joint, equation (2.1b) of the thesis.

    .. math::

        d = \frac{PWM}{V_{bus}} \left\{p_0\,\mathrm{sgn}\,\omega
            + K\,[p_1\,\omega - p_2\,\mathrm{sgn}(\omega)\,\omega^2]\right\}

    ``counts``: PWM, of full duty; the other letters are those of :class:`Transparency`.
    """
    sign = (velocity > 0.0) * 1.0 - (velocity < 0.0) * 1.0
    squared = law.voltage_per_velocity_squared * sign * velocity * velocity
    following = law.voltage_per_velocity * velocity - squared
    return counts / bus_voltage * (law.static_voltage * sign + law.transparency_gain * following)


def transparency_duty(
    law: Transparency, tick: float, velocity: float, bus_voltage: float, counts: float
) -> float:
    """Duty in counts of transparency control, equations (2.1a) and (2.1b) of the thesis."""
    if abs(velocity) < law.lowest_velocity:
        duty = breakaway_duty(law, tick)
    else:
        duty = viscous_duty(law, velocity, bus_voltage, counts)
    return saturate(duty, law.duty_limit)
