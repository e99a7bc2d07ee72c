"""Strides and steps: their beginnings and ends, their durations, and the curves of joints within them.

A stride is a pair of ticks, from one event of a leg to the next of the same kind: two heel strikes,
or two entries into the first phase. The first strides of a run still settle, so they are skipped
unless a caller says otherwise. Terms as in D. A. Winter: The biomechanics and motor control of human gait,
2nd edition, University of Waterloo Press, 1991: a stride goes from a heel strike to the next of the same
foot, a step from a heel strike of the other foot to one of this foot.
"""

import math

import numpy as np

from twin_gait.measures.effort import root_mean_square

SKIPPED_STRIDES = 2  # number of strides at the start of a walk in which it settles

PERCENT = np.arange(101.0)  # [%] of the stride; the last sample is the first of the next stride
PERCENT.setflags(write=False)
# Samples of a cycle that is shifted by 0 to 99 %, a row each.
_SHIFTED = np.add.outer(np.arange(100), np.arange(100)) % 100


def stride_bounds(events: np.ndarray) -> np.ndarray:
    """Pair consecutive events into strides.

    ``events``: ticks in ascending order, shape ``(n,)``. Returns first tick of each stride and of the next
    one, shape ``(n_strides, 2)``, integers.
    """
    ticks = np.asarray(events, dtype=int)
    return np.column_stack((ticks[:-1], ticks[1:]))


def describe_stride_count(counted: int, found: int) -> str:
    """Describe how many strides a mean is taken over, and why others are left out.

    Returns a text such as ``6 strides (the first 2 of 8 settle)``.
    """
    text = f"{counted} stride" + ("" if counted == 1 else "s")
    return text if counted == found else f"{text} (the first {found - counted} of {found} settle)"


def last_event_before(events: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """Return the last of ascending ``events`` before each tick, in the shape of ``ticks``; -1 if none is."""
    return np.append(-1, events)[events.searchsorted(ticks)]


def join_strides(bounds: np.ndarray) -> np.ndarray:
    """Join strides that follow each other into walks: legs at rest between two walks make no stride.

    ``bounds``: strides in ascending order, shape ``(n_strides, 2)``. Returns first tick of each walk and
    first tick after it, shape ``(m, 2)``, integers.
    """
    walks: list[list[int]] = []
    for start, end in bounds.tolist():
        if walks and walks[-1][1] == start:
            walks[-1][1] = end
        else:
            walks.append([start, end])
    return np.array(walks, dtype=int).reshape(-1, 2)


def is_in_stride(ticks: np.ndarray, bounds: np.ndarray, *, last: bool = False) -> np.ndarray:
    """Determine which ticks are in a stride, or at the end of one with ``last``; booleans."""
    begun = bounds[:, 0].searchsorted(ticks, side="right")
    ended = bounds[:, 1].searchsorted(ticks, side="left" if last else "right")
    return np.asarray(begun > ended)


def values_in_strides(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return the values of a signal of one value a tick in all strides, one after the other."""
    walks = join_strides(bounds).tolist()
    if len(walks) == 1:
        return signal[slice(*walks[0])]
    return np.concatenate([signal[:0], *(signal[start:end] for start, end in walks)])


def normalise_strides(signal: np.ndarray, bounds: np.ndarray, percent: np.ndarray = PERCENT) -> np.ndarray:
    """Bring every stride to the same length by linear interpolation.

    ``signal``: one value a tick, any unit, shape ``(n_ticks,)``; ``bounds`` from :func:`stride_bounds`;
    ``percent``: instants in [%] of the stride, from 0 to 100, shape ``(m,)``. Returns the signal at these
    instants of every stride, shape ``(n_strides, m)``.
    """
    if len(bounds) == 0:
        return np.zeros((0, len(percent)))
    start, end = bounds[:, :1], bounds[:, 1:]
    positions = start + percent / percent[-1] * (end - start)
    before = positions.astype(int)
    # The result is that of ``np.interp``, which reads the whole signal and takes three times as long.
    values, after = signal[before], signal[before + (positions > before)]
    return np.asarray((after - values) * (positions - before) + values)


def stride_times(bounds: np.ndarray, tick: float) -> np.ndarray:
    """Compute the duration of every stride in [s], shape ``(n_strides,)``."""
    return np.asarray((bounds[:, 1] - bounds[:, 0]) * tick)


def stride_sums(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Sum a signal over each stride, or over other spans of ticks.

    ``signal``: one value a tick, shape ``(n_ticks,)``; ``bounds``: first tick of each span and first tick
    after it, shape ``(n_strides, 2)``. Returns the sums, shape ``(n_strides,)``.
    """
    return np.array([signal[start:end].sum() for start, end in bounds.tolist()])


def stride_means(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Compute the mean of a signal over each stride, in the unit of the signal, shape ``(n_strides,)``."""
    return np.asarray(stride_sums(signal, bounds) / (bounds[:, 1] - bounds[:, 0]))


def mean(values: np.ndarray) -> float:
    """Compute the mean of values, in their unit; NaN without values.

    The result is that of ``values.mean()``, which takes four times as long for few values.
    """
    return float(np.add.reduce(values) / len(values)) if len(values) else math.nan


def finite_mean(values: np.ndarray) -> float:
    """Compute the mean of the values that are defined, in their unit; NaN without any."""
    return mean(values[np.isfinite(values)])


def coefficient_of_variation(values: np.ndarray) -> float:
    """Divide the sample standard deviation by the mean.

    ``values``: positive numbers, shape ``(n,)``. Returns the ratio; NaN for fewer than 2 values, or zeros.
    """
    if len(values) < 2 or not values.any():
        return math.nan
    return float(np.std(values, ddof=1) / np.mean(values))


def swing_shares(bounds: np.ndarray, toe_offs: np.ndarray) -> np.ndarray:
    """Compute the share of each stride in which the leg swings: from the last toe-off in it to its end.

    ``bounds``: strides from heel strike to heel strike; ``toe_offs``: ticks, shape ``(m,)``. Returns shares
    in [0, 1], shape ``(n_strides,)``; NaN for a stride without a toe-off.
    """
    start, end = bounds.T
    last = last_event_before(toe_offs, end)
    return np.where(last > start, (end - last) / (end - start), np.nan)


def stride_extremes(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Find the lowest and highest value in every stride.

    ``signal``: one value a tick, shape ``(n_ticks,)``; ``bounds`` from :func:`stride_bounds`. Returns an
    array of shape ``(n_strides, 2)``, in the unit of the signal.
    """
    # Every other span is a stride, from its first tick to the tick behind its last.
    edges = np.array([bounds[:, 0], bounds[:, 1] + 1]).T.ravel()
    if len(edges) and edges[-1] >= len(signal):
        edges = edges[:-1]
    return np.array([np.minimum.reduceat(signal, edges)[::2], np.maximum.reduceat(signal, edges)[::2]]).T


def root_mean_square_error(cycles: np.ndarray, reference: np.ndarray) -> float:
    """Compute the root mean square difference from a reference curve, over all strides and samples.

    ``cycles`` from :func:`normalise_strides`, shape ``(n_strides, 101)``; ``reference``: curve at
    ``PERCENT``, shape ``(101,)``, same unit. Returns the error in the unit of the curves; NaN without
    strides.
    """
    return root_mean_square((cycles - reference)[:, :-1])  # the sample at 100 % belongs to the next stride


# Names in a summary of the parts of the distance of strides from a reference; see error_parts.
ERROR_PARTS = ("total_deg", "offset_deg", "timing_deg", "shape_deg", "shift_percent")


def error_parts(cycles: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    r"""Split the root mean square distance of strides from a reference curve into offset, timing and shape.

    With strides :math:`x_i`, reference :math:`r`, their means over strides and samples taken away, and
    :math:`\langle\cdot\rangle` the mean over strides and samples,

    .. math::

        offset = \langle x - r\rangle, \qquad
        shape^2 = \min_s \langle (\tilde x(p + s) - \tilde r(p))^2\rangle, \qquad
        timing^2 = \langle (\tilde x - \tilde r)^2\rangle - shape^2, \qquad
        total^2 = offset^2 + timing^2 + shape^2 .

    The offset is positive above the reference; the shift is the delay of the strides relative to the
    reference as a share of the cycle from -50 to 50 %, in steps of 1 %.

    ``cycles`` from :func:`normalise_strides` in [rad], shape ``(n_strides, 101)``; ``reference``: curve at
    ``PERCENT`` in [rad], shape ``(101,)``. Returns the parts by ``ERROR_PARTS``; NaN without strides.
    """
    if len(cycles) == 0:
        return dict.fromkeys(ERROR_PARTS, math.nan)
    # The sample at 100 % belongs to the next stride.
    strides, healthy = cycles[:, :-1], reference[:-1]
    offset = float(np.mean(strides - healthy))
    difference = strides - healthy - offset
    unshifted = float(np.mean(difference * difference))
    # The squares of both curves do not change with the shift, so only their product depends on it.
    mean_stride, count = strides.mean(axis=0), len(healthy)
    products = np.mean(mean_stride[_SHIFTED] * healthy, axis=1)
    best = int(np.argmax(products))
    # Zero shift is among the candidates, so the difference is below zero by rounding only.
    timing = max(2.0 * float(products[best] - products[0]), 0.0)
    shift = best - count if best > count // 2 else best
    total = math.sqrt(offset * offset + unshifted)
    shape = math.sqrt(max(unshifted - timing, 0.0))
    angles = map(math.degrees, (total, offset, math.sqrt(timing), shape))
    return dict(zip(ERROR_PARTS, (*angles, 100.0 * shift / count), strict=True))


def symmetry_index(left: float, right: float) -> float:
    """Divide the difference of the sides by their mean: 0 if symmetric, positive if the left is larger.

    Returns the index; NaN if the mean is 0 or a side is NaN.
    """
    mean = 0.5 * (left + right)
    return (left - right) / mean if mean != 0.0 else math.nan


SECONDS_PER_MINUTE = 60.0


def cadences(stride_times: np.ndarray) -> np.ndarray:
    """Compute the number of steps in a minute of each stride, two a stride.

    ``stride_times`` in [s], shape ``(n,)``. Returns the cadences in steps a minute, in the same shape.
    """
    return np.asarray(2.0 * SECONDS_PER_MINUTE / stride_times)


def cadence(stride_times: np.ndarray) -> float:
    """Compute the cadence of strides from their mean duration in [s]; NaN without strides or if it is 0."""
    return float(cadences(np.array(finite_mean(stride_times) or math.nan)))


def step_times(bounds: np.ndarray, other_strikes: np.ndarray, tick: float) -> np.ndarray:
    """Compute the duration of the step that ends with each stride.

    The step begins with the last strike of the other foot in the stride. ``bounds``: strides from heel strike
    to heel strike; ``other_strikes``: heel strikes of the other foot, ticks in ascending order, shape
    ``(m,)``; ``tick``: sampling period in [s]. Returns durations in [s], shape ``(n_strides,)``; NaN for a
    stride without a strike of the other foot.
    """
    start, end = bounds.T
    begin = last_event_before(other_strikes, end)
    return np.where(begin > start, (end - begin) * tick, np.nan)


def double_support_shares(loaded: np.ndarray, other_loaded: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Compute the share of each stride in which both feet carry load.

    ``loaded``: whether one foot carries load, one value a tick, shape ``(n_ticks,)``; ``other_loaded``: the
    same for the other foot; ``bounds``: strides. Returns shares in [0, 1], shape ``(n_strides,)``.
    """
    return stride_means(loaded & other_loaded, bounds)
