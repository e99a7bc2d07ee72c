"""Encoder and the two velocity estimates of the firmware."""

from __future__ import annotations

import math


def quantise(angle: float, resolution: float) -> float:
    """Angle as an encoder of a given resolution reports it.

    Args:
        angle: True angle in [rad].
        resolution: Angle of one count in [rad]; zero or less means an ideal sensor.

    Returns:
        Angle in [rad], a whole number of counts; NaN, a reading that is missing, passes through.
    """
    if resolution <= 0.0 or angle != angle:
        return angle
    return math.floor(angle / resolution + 0.5) * resolution


def first_order_gain(period: float, time_constant: float) -> float:
    r"""Gain :math:`\alpha = 1 - e^{-T/\tau}` of the discrete first-order low-pass filter.

    Args:
        period: Sampling period :math:`T` in [s].
        time_constant: :math:`\tau` in [s]; zero means no filter.

    Returns:
        Gain in (0, 1].
    """
    if time_constant <= 0.0:
        return 1.0
    return 1.0 - math.exp(-period / time_constant)


def first_order_step(estimate: float, sample: float, gain: float) -> float:
    """One step of the first-order low-pass filter.

    Args:
        estimate: Filter output before.
        sample: New input, same unit.
        gain: From :func:`first_order_gain`.

    Returns:
        Filter output after.
    """
    return estimate + gain * (sample - estimate)
