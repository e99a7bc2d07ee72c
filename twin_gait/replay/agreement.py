"""Strides of a replayed leg, and how well its phases agree with the recorded ones."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.phases import entry_lags, phase_entries, phase_spells
from twin_gait.replay.machine import Replay
from twin_gait.vocabulary import Side


class Agreement(NamedTuple):
    """Replayed against recorded phases of one leg."""

    recorded: tuple[str, ...]  # names of the rows: the phases of the table, then further names of the log
    replayed: tuple[str, ...]  # names of the columns: the phases of the table
    confusion: np.ndarray  # ticks in each pair of phases, shape ``(n_recorded, n_replayed)``, integers
    # for each phase of the table, the time in [s] by which the replay enters it later than the record, for
    # every recorded entry; NaN for one that the replay has no partner for
    lags: dict[str, np.ndarray]

    @property
    def equal_share(self) -> float:
        """Share of the ticks with equal phases."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    def phase_share(self, phase: str) -> float:
        """Share of the ticks recorded in a phase that the replay spends in it too.

        Returned in [0, 1]; NaN if it was not recorded.
        """
        index = self.recorded.index(phase)
        total = self.confusion[index].sum()
        return float(self.confusion[index, index] / total) if total else float("nan")


def agreement(result: Replay) -> dict[Side, Agreement]:
    """Compare replayed with recorded phases.

    Returns one comparison for each leg whose phases were recorded.
    """
    names = result.table.phase_names
    return {
        side: _compare(result.phases[side], recorded, names)
        for side, recorded in result.recording.phases.items()
    }


def _compare(replayed: np.ndarray, recorded: np.ndarray, names: tuple[str, ...]) -> Agreement:
    further = sorted(set(recorded.tolist()) - set(names))
    rows = (*names, *further)
    place = {name: index for index, name in enumerate(rows)}
    codes = np.array([place[name] for name in recorded.tolist()], dtype=int)
    confusion = np.zeros((len(rows), len(names)), dtype=int)
    np.add.at(confusion, (codes, replayed), 1)
    lags = {
        # entry_lags counts a phase that begins before the event as positive; a late replay is positive here.
        name: -entry_lags(_entries(replayed, index), _entries(codes, index), TICK)
        for index, name in enumerate(names)
    }
    return Agreement(rows, names, confusion, lags)


def _entries(phases: np.ndarray, phase: int) -> np.ndarray:
    """Entries into a phase, without the stay that the record begins with."""
    entries = phase_entries(phases, phase)
    return entries[entries > 0]


class StridePhases(NamedTuple):
    """Phases of one stride, from an entry into the first phase of the table to the next."""

    start: int  # first tick
    end: int  # first tick of the next stride
    phases: tuple[int, ...]  # indices of the phases in order

    @property
    def duration(self) -> float:
        """In [s]."""
        return (self.end - self.start) * TICK


def meant_cycles(table: GaitTable) -> set[tuple[int, ...]]:
    """Orders of phases that a stride may have."""
    if not table.cycles:
        return {tuple(range(len(table.phases)))}
    first = table.phase_names[0]
    rotated = [
        (*cycle[cycle.index(first) :], *cycle[: cycle.index(first)])
        for cycle in table.cycles
        if first in cycle
    ]
    return {tuple(table.phase_index(phase) for phase in cycle) for cycle in rotated}


def stride_phases(phases: np.ndarray) -> list[StridePhases]:
    """Split a leg's phases into strides. ``phases``: index of the phase at each tick, shape ``(n,)``."""
    entries = phase_entries(phases, 0)
    entries = entries[entries > 0]
    spells = phase_spells(phases)
    return [
        StridePhases(int(start), int(end), tuple(item.phase for item in spells if start <= item.start < end))
        for start, end in pairwise(entries)
    ]
