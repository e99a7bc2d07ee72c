"""Encoder and the two velocity estimates of the firmware, and samples that come late."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import settled_share

_ROOM = 16  # delays up to the next multiple share one compiled loop


def quantise(angle: float, resolution: float) -> float:
    """Angle in [rad] as an encoder reports it, whose count is ``resolution``; 0 or less is an ideal one.

    A whole number of counts; NaN, a reading that is missing, passes through.
    """
    if resolution <= 0.0 or angle != angle:
        return angle
    return math.floor(angle / resolution + 0.5) * resolution


def first_order_gain(period: float, time_constant: float) -> float:
    r"""Gain :math:`\alpha = 1 - e^{-T/\tau}` in (0, 1] of the discrete first-order low-pass filter.

    Times in [s]; a time constant of zero means no filter.
    """
    if time_constant <= 0.0:
        return 1.0
    return settled_share(period / time_constant)


def first_order_step(estimate: float, sample: float, gain: float) -> float:
    """Output of the first-order low-pass filter after one more sample."""
    return estimate + gain * (sample - estimate)


@dataclass(slots=True)
class DelayLine:
    """Samples that are under way."""

    delay: int  # How many samples later one is used.
    samples: list[float]  # Taken in turn, with room for more than the delay.


def new_delay_line(delay: int, first: float = 0.0) -> DelayLine:
    """A delay line of so many samples, 0 or more, that is full of one sample."""
    return DelayLine(delay, [first] * ((delay // _ROOM + 1) * _ROOM))


def delayed_sample(line: DelayLine, number: int, sample: float) -> float:
    """Put a sample in at one end and take the one that is due out at the other.

    ``number``: of the sample, from 0 on. Returns the sample whose number is smaller by the delay; what the
    line was full of if there was none yet.
    """
    size = line.delay + 1
    line.samples[number % size] = sample
    return line.samples[(number + 1) % size]
