r"""Loading peak, midstance trough and push-off peak of the vertical force under a foot.

In healthy walking the force rises to a loading peak, sinks in midstance and rises again as the foot pushes
off (D. A. Winter: The biomechanics and motor control of human gait, 2nd edition, 1991). Other gaits have
other shapes, so the three numbers exist only where the mean stride has them as extrema:

- The loading peak is the highest peak in the first half of stance.
- The push-off peak is the highest peak in the second half of stance.
- The trough is the minimum between them in the middle third of stance.

Neither peak may lie in the middle tenth of stance: a peak there belongs to neither half, and a small
difference between two legs would decide between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin_gait.measures.phases import phase_spells

TWO_PEAKS = "two peaks"
# The following three numbers are assumptions.
SWING_LOAD = 0.05  # share of the carried weight below which the foot counts as unloaded in the mean stride
MIN_PROMINENCE = 0.02  # share of the carried weight by which a peak rises above the lower of its two sides
MIDDLE_TENTH, MIDDLE_THIRD = (0.45, 0.55), (1.0 / 3.0, 2.0 / 3.0)  # intervals of stance, as shares of it


class LoadShape(NamedTuple):
    """The two peaks and the trough of a mean stride as shares of the carried weight; NaN if undefined."""

    loading_peak: float  # highest peak in the first half of stance
    trough: float  # minimum in midstance
    push_off_peak: float  # highest peak in the second half of stance
    pattern: str = TWO_PEAKS  # or the reason why the three numbers are not defined


def load_shape(cycle: np.ndarray) -> LoadShape:
    """Find the two peaks and the trough of a mean stride.

    ``cycle``: vertical force divided by the carried weight at every percent of the stride from heel strike,
    shape ``(101,)``; NaN without strides.
    """
    if not np.isfinite(cycle).all():
        return _undefined("no stride counts")
    stance = cycle[: _stance_end(cycle)]
    # The foot is unloaded before and after stance, so that its first and last sample can be peaks, too.
    peaks = prominent_peaks(np.concatenate(([0.0], stance, [0.0])), MIN_PROMINENCE) - 1
    halves = peaks[peaks < 0.5 * len(stance)], peaks[peaks >= 0.5 * len(stance)]
    highest = [int(half[np.argmax(stance[half])]) for half in halves if len(half)]
    for peak in highest:
        if MIDDLE_TENTH[0] <= peak / len(stance) <= MIDDLE_TENTH[1]:
            return _undefined(f"a peak in midstance, at {peak} % of the stride")
    for half, name in zip(halves, ("first", "second"), strict=True):
        if not len(half):
            return _undefined(f"no peak in the {name} half of stance")
    loading, push_off = highest
    first = max(loading, math.ceil(MIDDLE_THIRD[0] * len(stance)))
    last = min(push_off, math.floor(MIDDLE_THIRD[1] * len(stance)))
    trough = first + int(np.argmin(stance[first : last + 1]))
    if trough in (first, last):
        return _undefined("no minimum in the middle third of stance")
    return LoadShape(float(stance[loading]), float(stance[trough]), float(stance[push_off]))


def prominent_peaks(curve: np.ndarray, prominence: float) -> np.ndarray:
    """Find the local maxima that rise far enough above their surroundings.

    The prominence of a maximum is its height above the higher of the two minima that lie between it and the
    next higher values to its left and right, or the ends of the curve. This is the definition of
    ``scipy.signal.find_peaks``, whose import takes longer than the simulation of a walk.

    Returns the indices in ascending order.
    """
    maxima = 1 + np.flatnonzero((curve[1:-1] > curve[:-2]) & (curve[1:-1] >= curve[2:]))
    found = []
    for peak in maxima.tolist():
        higher = np.flatnonzero(curve > curve[peak])
        before, after = higher[higher < peak], higher[higher > peak]
        left = curve[before[-1] if len(before) else 0 : peak].min()
        right = curve[peak : after[0] + 1 if len(after) else None].min()
        if curve[peak] - max(left, right) >= prominence:
            found.append(peak)
    return np.array(found, dtype=int)


def _undefined(reason: str) -> LoadShape:
    """Return a shape without peaks and trough, with the reason."""
    return LoadShape(math.nan, math.nan, math.nan, reason)


def _stance_end(cycle: np.ndarray) -> int:
    """Return the percent at which the longest interval without load, which is the swing, begins."""
    spells = [spell for spell in phase_spells(cycle[:-1] < SWING_LOAD) if spell.phase]
    longest = max(spells, key=lambda spell: spell.end - spell.start, default=None)
    return len(cycle) - 1 if longest is None else longest.start
