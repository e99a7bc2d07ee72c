"""Curves with as few points as show them truly: corners of a recorded one, extremes of a live one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FAITHFUL = 0.002  # of its range that a drawn curve may be off the log, at any tick
EXTREMES_TICKS = 5  # in which a live curve has its smallest and its largest value: 200 spans a second


class Curve(NamedTuple):
    """Straight lines between points."""

    times: np.ndarray  # in [s], not falling, shape ``(n,)``
    values: np.ndarray  # shape ``(n,)``; not a number where there is no line


def corners(values: np.ndarray, kept: np.ndarray, tolerance: float) -> np.ndarray:
    """Rows between which straight lines stay close to every value.

    The row that is farthest from its line becomes a corner, until none is too far: the algorithm of Ramer
    (1972), Douglas and Peucker (1973) on all lines at once, with distances along the value's axis.
    ``values``: shape ``(n,)``; lines end where they are not numbers; ``kept``: rows that are corners in any
    case, sorted, with the first and the last one; ``tolerance``: largest distance of a value from its line,
    in the unit of the values. Returns rows, sorted, shape ``(m,)``.
    """
    ends = np.flatnonzero(np.diff(np.isfinite(values)))
    rows, kept = np.arange(len(values)), np.union1d(kept, np.concatenate((ends, ends + 1)))
    while True:
        off = np.nan_to_num(np.abs(values - np.interp(rows, kept, values[kept])))[:-1]
        worst = np.repeat(np.maximum.reduceat(off, kept[:-1]), np.diff(kept)) if len(off) else off
        found = np.flatnonzero((off == worst) & (off > tolerance))
        if not len(found):
            return kept
        kept = np.union1d(kept, found)


def faithful_curve(times: np.ndarray, values: np.ndarray, kept: np.ndarray) -> Curve:
    """A curve that is nowhere off by more than 0.2 % of the range of its values.

    ``times`` in [s], shape ``(n,)``; ``values``: shape ``(n,)``; ``kept``: rows that stay as they are,
    sorted, with the first and the last one.
    """
    finite = values[np.isfinite(values)]
    rows = corners(values, kept, FAITHFUL * float(np.ptp(finite)) if len(finite) else 0.0)
    return Curve(times[rows], values[rows])


def extremes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the largest value of every few ticks, in the order in which they came.

    ``values``: one row per tick, shape ``(n, m)``. Returns rows and their values, shape ``(k, m)`` each.
    """
    rows = []
    for start in range(0, len(values), EXTREMES_TICKS):
        span = values[start : start + EXTREMES_TICKS]
        rows.append(start + np.sort([span.argmin(axis=0), span.argmax(axis=0)], axis=0))
    found = np.concatenate(rows) if rows else np.zeros((0, values.shape[1]), dtype=int)
    return found, np.take_along_axis(values, found, axis=0)
