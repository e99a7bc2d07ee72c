"""Encoder, low-pass filter of the velocity estimate, and samples that arrive late."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import settled_share

_CAPACITY_STEP = 16
PERCEPTION_CAPACITY = 64  # Capacity step of the delays of a person, so that 0.13 to 0.19 s share a loop.


def quantise(angle: float, resolution: float) -> float:
    """Round an angle in [rad] to a whole number of encoder counts of ``resolution``.

    A resolution of 0 or less is an ideal encoder. NaN, a missing reading, passes through.
    """
    if resolution <= 0.0 or angle != angle:
        return angle
    return math.floor(angle / resolution + 0.5) * resolution


def first_order_gain(period: float, time_constant: float) -> float:
    r"""Compute the gain of the discrete first-order low-pass filter.

    :math:`\alpha = 1 - e^{-T/\tau}` in (0, 1]. Times are in [s]; a time constant of zero means no filter.
    """
    if time_constant <= 0.0:
        return 1.0
    return settled_share(period / time_constant)


def first_order_step(estimate: float, sample: float, gain: float) -> float:
    """Update the output of the first-order low-pass filter with one more sample."""
    return estimate + gain * (sample - estimate)


@dataclass(slots=True)
class DelayLine:
    """Samples that arrive after a fixed delay."""

    delay: int  # Delay in samples.
    samples: list[float]  # Ring buffer of the samples; longer than the delay.


def new_delay_line(delay: int, first: float = 0.0, capacity_step: int = _CAPACITY_STEP) -> DelayLine:
    """Create a delay line of the given delay in samples, 0 or more, filled with one value.

    Its buffer is a multiple of ``capacity_step``; delays below the next multiple share a compiled loop.
    """
    return DelayLine(delay, [first] * ((delay // capacity_step + 1) * capacity_step))


def delayed_sample(line: DelayLine, number: int, sample: float) -> float:
    """Write a sample into the delay line and return the sample that is due.

    ``number``: number of the sample, from 0 on. Returns the sample whose number is smaller by the delay, or
    the initial value if there was no such sample yet.
    """
    size = line.delay + 1
    line.samples[number % size] = sample
    return line.samples[(number + 1) % size]
