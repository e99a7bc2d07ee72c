"""Encoder and the two velocity estimates of the firmware, and samples that come late."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import settled_share

_ROOM = 16  # delays up to the next multiple share one compiled loop


def quantise(angle: float, resolution: float) -> float:
    """Angle as an encoder of a given resolution reports it.

    ``angle``: true angle in [rad]. ``resolution``: angle of one count in [rad]; zero or less means an ideal
    sensor. Returns the angle in [rad], a whole number of counts; NaN, a reading that is missing, passes
    through.
    """
    if resolution <= 0.0 or angle != angle:
        return angle
    return math.floor(angle / resolution + 0.5) * resolution


def first_order_gain(period: float, time_constant: float) -> float:
    r"""Gain :math:`\alpha = 1 - e^{-T/\tau}` of the discrete first-order low-pass filter.

    ``period``: sampling period :math:`T` in [s]. ``time_constant``: :math:`\tau` in [s]; zero means no
    filter. Returns the gain in (0, 1].
    """
    if time_constant <= 0.0:
        return 1.0
    return settled_share(period / time_constant)


def first_order_step(estimate: float, sample: float, gain: float) -> float:
    """One step of the first-order low-pass filter.

    ``estimate``: filter output before. ``sample``: new input, same unit. ``gain``: from
    :func:`first_order_gain`.
    """
    return estimate + gain * (sample - estimate)


@dataclass(slots=True)
class DelayLine:
    """Samples that are under way."""

    delay: int  # How many samples later one is used.
    samples: list[float]  # Taken in turn, with room for more than the delay.


def new_delay_line(delay: int, first: float = 0.0) -> DelayLine:
    """A delay line that is full of one sample.

    ``delay``: in samples, 0 or more.
    """
    return DelayLine(delay, [first] * ((delay // _ROOM + 1) * _ROOM))


def delayed_sample(line: DelayLine, number: int, sample: float) -> float:
    """Put a sample in at one end and take the one that is due out at the other.

    ``line``: changed in place. ``number``: of the sample, from 0 on. ``sample``: the new one. Returns the
    sample whose number is smaller by the delay; what the line was full of if there was none yet.
    """
    size = line.delay + 1
    line.samples[number % size] = sample
    return line.samples[(number + 1) % size]
