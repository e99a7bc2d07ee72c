"""How far the outputs of two builds of a unit are apart."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np


def differing(first: np.ndarray, second: np.ndarray) -> int:
    """Numbers of two arrays of records of one layout that are not the same bits; of NaN any is the same."""
    if first.dtype.names is not None:
        return sum(differing(first[name], second[name]) for name in first.dtype.names)
    ours, theirs = (np.ascontiguousarray(item) for item in (first, second))
    bits = np.dtype(f"u{ours.itemsize}")
    same = (ours.view(bits) == theirs.view(bits)) | ((ours != ours) & (theirs != theirs))
    return int(same.size - same.sum())


def size_of(rows: np.ndarray) -> int:
    """Numbers in an array of records."""
    if rows.dtype.names is None:
        return rows.size
    return sum(size_of(rows[name]) for name in rows.dtype.names)


class Events(NamedTuple):
    """Switches of the legs, and the trip of the monitor, leg by leg in the order of time."""

    ticks: np.ndarray  # of each
    kinds: list[tuple[int, ...]]  # leg, phases before and after; of a trip its cause


def events_of(outputs: np.ndarray) -> Events:
    """What a unit decided over time."""
    found = list(_events(outputs["decision"]))
    return Events(np.array([tick for tick, _ in found], int), [kind for _, kind in found])


def _events(decision: np.ndarray) -> Iterator[tuple[int, tuple[int, ...]]]:
    for leg, phases in enumerate(decision["phases"].T):
        for tick in (np.flatnonzero(np.diff(phases)) + 1).tolist():
            yield tick, (leg, int(phases[tick - 1]), int(phases[tick]))
    causes = decision["trip_cause"]
    if causes.any():
        first = int(np.flatnonzero(causes)[0])
        yield first, (int(causes[first]),)


def largest_shift(first: Events, second: Events) -> int | None:
    """Ticks between switches and trips that belong together; None if others come, or in another order."""
    if first.kinds != second.kinds:
        return None
    return int(np.abs(first.ticks - second.ticks).max(initial=0))


def current_errors(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Root mean square of the differences of the target currents in [A], shape ``(n_joints,)``."""
    currents = [outputs["commands"]["target_current"].astype(float) for outputs in (first, second)]
    return np.asarray(np.sqrt(np.mean((currents[0] - currents[1]) ** 2, axis=0)))
