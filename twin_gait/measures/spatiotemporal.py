"""Steps and strides in time and space, by foot contact.

Terms as in D. A. Winter: The biomechanics and motor control of human gait, 2nd edition, University of
Waterloo Press, 1991: a stride goes from a heel strike to the next of the same foot, a step from a heel
strike of the other foot to one of this foot.
"""

from __future__ import annotations

import numpy as np

SECONDS_PER_MINUTE = 60.0


def cadence(stride_times: np.ndarray) -> float:
    """Steps in a minute, two a stride.

    Args:
        stride_times: In [s], shape ``(n,)``.

    Returns:
        Cadence in steps a minute; NaN without strides.
    """
    if len(stride_times) == 0:
        return float("nan")
    return float(2.0 * SECONDS_PER_MINUTE / np.mean(stride_times))


def stride_lengths(stride_times: np.ndarray, speed: float) -> np.ndarray:
    """Way that the belt goes in each stride, which is the stride's length at a steady place on it.

    Args:
        stride_times: In [s], shape ``(n,)``.
        speed: Of the belt in [m] / [s].

    Returns:
        Lengths in [m], shape ``(n,)``.
    """
    return np.asarray(speed * stride_times)


def step_times(strikes: np.ndarray, other_strikes: np.ndarray, tick: float) -> np.ndarray:
    """Duration of the steps that end with a heel strike of one foot.

    A step begins with the other foot's last strike before it; if this foot struck since, the other foot has
    made no step in between and there is none to count.

    Args:
        strikes: Heel strikes of the foot, ticks in ascending order, shape ``(n,)``.
        other_strikes: Of the other foot, shape ``(m,)``.
        tick: Sampling period in [s].

    Returns:
        Durations in [s], shape ``(k,)`` with k at most n.
    """
    durations = []
    for number, strike in enumerate(strikes):
        before = other_strikes[other_strikes < strike]
        last = strikes[number - 1] if number > 0 else -1
        if len(before) and before[-1] > last:
            durations.append((strike - before[-1]) * tick)
    return np.array(durations)


def double_support_share(
    normal_force: np.ndarray, other_force: np.ndarray, strides: np.ndarray, threshold: float
) -> float:
    """Share of the time in which both feet carry.

    Args:
        normal_force: Of one foot in [N], one value a tick, shape ``(n_ticks,)``.
        other_force: Of the other foot, same shape.
        strides: First tick of each stride and of the next one, shape ``(n, 2)``.
        threshold: Force in [N] above which a foot carries.

    Returns:
        Share in [0, 1]; NaN without strides.
    """
    if len(strides) == 0:
        return float("nan")
    both = (normal_force > threshold) & (other_force > threshold)
    inside = np.concatenate([both[start:end] for start, end in strides])
    return float(np.mean(inside))
