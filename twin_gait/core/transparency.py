"""Duty-based transparency control, equation (2.1) of the thesis: the motor follows the moved joint."""

import math
from dataclasses import dataclass

from twin_gait.core.actuator import saturate
from twin_gait.core.elementary import sine_cosine


@dataclass(slots=True)
class Transparency:
    """Parameters of :func:`transparency_duty`."""

    amplitude: float  # A in counts.
    frequency: float  # f in [Hz].
    ticks_per_second: float  # N, the ``steps`` of the thesis.
    lowest_velocity: float  # ω_min in [rad] / [s], below which (2.1a) holds.
    transparency_gain: float  # K.
    static_voltage: float  # p0 in [V].
    voltage_per_velocity: float  # p1 in [V s] / [rad].
    voltage_per_velocity_squared: float  # p2 in [V s²] / [rad²].
    duty_limit: float  # Safety limit in counts.


def breakaway_duty(tick: float, amplitude: float, frequency: float, ticks_per_second: float) -> float:
    r"""Duty in counts that shakes the joint at rest in tick n, equation (2.1a) of the thesis.

    :math:`d = A \sin\frac{2\pi f\,n}{N}`
    """
    sine, _ = sine_cosine(2.0 * math.pi * frequency * tick / ticks_per_second)
    return amplitude * sine


def viscous_duty(
    velocity: float,
    transparency_gain: float,
    static_voltage: float,
    voltage_per_velocity: float,
    voltage_per_velocity_squared: float,
    bus_voltage: float,
    counts: float,
) -> float:
    r"""Duty in counts that follows the moving joint, equation (2.1b) of the thesis.

    .. math::

        d = \frac{PWM}{V_{bus}} \left\{p_0\,\mathrm{sgn}\,\omega
            + K\,[p_1\,\omega - p_2\,\mathrm{sgn}(\omega)\,\omega^2]\right\}

    ``counts``: PWM, of full duty; the other letters are those of :class:`Transparency`.
    """
    sign = (velocity > 0.0) * 1.0 - (velocity < 0.0) * 1.0
    following = voltage_per_velocity * velocity - voltage_per_velocity_squared * sign * velocity * velocity
    return counts / bus_voltage * (static_voltage * sign + transparency_gain * following)


def transparency_duty(
    law: Transparency, tick: float, velocity: float, bus_voltage: float, counts: float
) -> float:
    """Duty in counts of transparency control, equations (2.1a) and (2.1b) of the thesis."""
    if abs(velocity) < law.lowest_velocity:
        duty = breakaway_duty(tick, law.amplitude, law.frequency, law.ticks_per_second)
    else:
        duty = viscous_duty(
            velocity,
            law.transparency_gain,
            law.static_voltage,
            law.voltage_per_velocity,
            law.voltage_per_velocity_squared,
            bus_voltage,
            counts,
        )
    return saturate(duty, law.duty_limit)
