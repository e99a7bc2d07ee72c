"""Phases over a run: their durations, their order and their timing relative to the contacts of the foot.

Phases are the indices of a gait table, one a tick.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twin_gait.measures.strides import normalise_strides


class PhaseSpell(NamedTuple):
    """An uninterrupted stay in one phase."""

    phase: int  # index of the phase
    start: int  # first tick
    end: int  # first tick after it


def phase_spells(phases: np.ndarray) -> list[PhaseSpell]:
    """Split a run into uninterrupted stays in one phase.

    ``phases``: phase of each tick, shape ``(n,)``. Returns the stays in order; the first and the last are cut
    off by the record.
    """
    edges = [*phase_beginnings(phases).tolist(), len(phases)]
    return [PhaseSpell(int(phases[start]), start, end) for start, end in pairwise(edges)]


def phase_beginnings(phases: np.ndarray) -> np.ndarray:
    """Return the first ticks of all stays in one phase, integers; ``phases``: phase of each tick."""
    changed = np.ones(len(phases), dtype=bool)
    changed[1:] = phases[1:] != phases[:-1]
    return changed.nonzero()[0]


def phase_entries(phases: np.ndarray, phase: int, beginnings: np.ndarray | None = None) -> np.ndarray:
    """Find the ticks at which a phase begins; a leg that starts in the phase enters it at tick 0.

    ``phases``: phase of each tick, shape ``(n,)``; ``beginnings``: result of :func:`phase_beginnings`,
    computed by default. Returns ticks, shape ``(m,)``, integers.
    """
    if beginnings is None:
        beginnings = phase_beginnings(phases)
    return np.asarray(beginnings[phases[beginnings] == phase])


def phase_onsets(entries: np.ndarray, bounds: np.ndarray, *, first: bool = False) -> np.ndarray:
    """Compute the share of each stride at which a phase begins.

    ``entries``: ticks of the entries into the phase, ascending, shape ``(m,)``; ``bounds``: strides, shape
    ``(n_strides, 2)``; ``first``: whether the phase begins the cycle. The onset is the first entry in the
    stride. For the phase that begins the cycle it is the entry nearest to the start of the stride, negative
    if it lies before the start. Returns shares in [%], shape ``(n_strides,)``; NaN for a stride without such
    an entry, and for the first phase if the nearest entry is half a stride away or more.
    """
    start, end = bounds.T
    if len(entries) == 0 or len(bounds) == 0:
        return np.full(len(bounds), np.nan)
    if first:
        entry = _nearest(entries, start)
        inside = 2 * np.abs(entry - start) < end - start
    else:
        entry = entries[entries.searchsorted(start).clip(max=len(entries) - 1)]
        inside = (entry >= start) & (entry < end)
    return np.where(inside, 100.0 * (entry - start) / (end - start), np.nan)


def phase_durations(phases: np.ndarray, tick: float, *, since: int = 0) -> dict[int, np.ndarray]:
    """Compute the durations of the stays that lie completely within the record.

    ``phases``: phase of each tick, shape ``(n,)``; ``tick``: sampling period in [s]; ``since``: stays that
    begin before this tick do not count. Returns the durations in [s] for each phase that occurs.
    """
    durations: dict[int, list[float]] = {}
    for spell in phase_spells(phases)[1:-1]:
        if spell.start >= since:
            durations.setdefault(spell.phase, []).append((spell.end - spell.start) * tick)
    return {phase: np.array(values) for phase, values in durations.items()}


def phases_in_order(phases: np.ndarray, n_phases: int) -> bool:
    """Check whether each phase was followed by the next one of the cycle, from start to end.

    ``phases``: phase of each tick, shape ``(n,)``. Returns true also if the phase never changed.
    """
    order = phases[phase_beginnings(phases)]
    return bool(np.all(order[1:] == (order[:-1] + 1) % n_phases))


def entry_lags(entries: np.ndarray, heel_strikes: np.ndarray, tick: float) -> np.ndarray:
    """Compute the time from the entry into the first phase to the heel strike that belongs to it.

    A strike and an entry belong together if each is the other's nearest. ``entries``: ticks of the entries;
    ``heel_strikes``: ticks of the strikes, shape ``(m,)``. Returns the lag of every strike in [s], positive
    if the phase began before the foot landed; NaN for a strike without an entry. Shape ``(m,)``.
    """
    if len(entries) == 0 or len(heel_strikes) == 0:
        return np.full(len(heel_strikes), np.nan)
    entry = _nearest(entries, heel_strikes)
    return np.where(_nearest(heel_strikes, entry) == heel_strikes, (heel_strikes - entry) * tick, np.nan)


def _nearest(events: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """Return the event that is nearest to each tick."""
    return np.asarray(events[np.abs(events - ticks[:, None]).argmin(axis=1)])


def usual_phases(phases: np.ndarray, bounds: np.ndarray, n_phases: int) -> np.ndarray:
    """Find the phase in which a leg is in most strides, at every percent of the stride.

    Where strides pass through the phases in the same order, the phases change at the median of their
    boundaries. ``phases``: phase of each tick. Returns the index of the phase at ``PERCENT``, shape
    ``(101,)``.
    """
    is_phase = [normalise_strides((phases == phase).astype(float), bounds) for phase in range(n_phases)]
    votes = np.array([(share > 0.5).sum(axis=0) for share in is_phase])  # (n_phases, 101)
    return np.asarray(np.argmax(votes, axis=0))
