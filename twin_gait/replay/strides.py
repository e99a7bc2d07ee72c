"""Strides of a replayed leg, and the cycles of phases that a table means them to have."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.phases import phase_entries, phase_spells


class StridePhases(NamedTuple):
    """Phases of one stride, from an entry into the first phase of the table to the next.

    Attributes:
        start: First tick.
        end: First tick of the next stride.
        phases: Indices of the phases in order.
    """

    start: int
    end: int
    phases: tuple[int, ...]

    @property
    def duration(self) -> float:
        """In [s]."""
        return (self.end - self.start) * TICK


def meant_cycles(table: GaitTable) -> set[tuple[int, ...]]:
    """Orders of phases that a stride may have.

    Args:
        table: The gait table.

    Returns:
        The cycles that the table states, from its first phase on, or without any all phases in their order.
    """
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
    """Split a leg's phases into strides.

    Args:
        phases: Index of the phase at each tick, shape ``(n,)``.

    Returns:
        The whole strides; a stay in the first phase that the record begins with starts none.
    """
    entries = phase_entries(phases, 0)
    entries = entries[entries > 0]
    spells = phase_spells(phases)
    return [
        StridePhases(int(start), int(end), tuple(item.phase for item in spells if start <= item.start < end))
        for start, end in pairwise(entries)
    ]
