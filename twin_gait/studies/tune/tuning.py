"""Where a tuning stands, and what it came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from twin_gait.simulation import RunStatus
from twin_gait.studies.tune.parts import excess_cost
from twin_gait.studies.tune.screening import Effect
from twin_gait.studies.tune.search import Generation
from twin_gait.studies.tune.space import Parameter
from twin_gait.studies.tune.state import State
from twin_gait.studies.tune.walks import WalkResult

NOMINAL_WEIGHT = 0.75  # of the nominal case in the cost of a candidate; the other cases share the rest


class Progress(NamedTuple):
    """Where a tuning stands.

    Attributes:
        stage: ``compiling``, ``screening``, ``search``, ``robust set`` or ``departures``.
        done: Of this stage: walks, or generations.
        total: In all, or None while only the time ends it.
        elapsed: In [s].
        start_cost: Of the table that it began with.
        best_cost: Of the best candidate so far.
        best_values: Parts of its nominal walk; empty if it was found before the tuning was resumed.
    """

    stage: str
    done: int
    total: int | None
    elapsed: float
    start_cost: float
    best_cost: float
    best_values: Mapping[str, float | None]


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set.

    Attributes:
        table: Its document.
        points: Coordinates of what was searched for; None for the table that it began with.
        search_cost: In the search.
        walks: Name of the case and result, nominal first.
    """

    table: dict[str, Any]
    points: tuple[float, ...] | None
    search_cost: float
    walks: tuple[tuple[str, WalkResult], ...]

    @property
    def falls(self) -> int:
        """Cases in which it fell."""
        return sum(walk.fell for _, walk in self.walks)

    @property
    def cost(self) -> float:
        """Cost over the robust set; the nominal case weighs as much as in the search."""
        return weighted_cost([walk for _, walk in self.walks])


@dataclass(frozen=True, eq=False)
class Tuning:
    """What a tuning came to.

    Attributes:
        status: ``COMPLETED``, or ``INTERRUPTED``: then only the state is kept.
        parameters: All numbers that could be changed.
        searched: Those that the search changed.
        effects: From the screening; empty without.
        state: With all generations.
        before: The table that was to be bettered.
        ranked: All finalists, the best first; ``before`` is one of them.
        began_with: Name of the table that the search began with, see :func:`start_tables`.
    """

    status: RunStatus
    parameters: tuple[Parameter, ...]
    searched: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    state: State
    before: Finalist | None
    ranked: tuple[Finalist, ...]
    began_with: str


def weighted_cost(walks: Sequence[WalkResult]) -> float:
    """Cost of a table over its cases.

    Args:
        walks: The nominal case first.

    Returns:
        The nominal walk's, with what missed goals cost on top, and the mean of the others, weighted; the
        nominal cost alone of a table that must not walk.
    """
    nominal, *others = walks
    if nominal.errors or not others:
        return nominal_cost(nominal)
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal_cost(nominal) + (1.0 - NOMINAL_WEIGHT) * mean


def nominal_cost(walk: WalkResult) -> float:
    """Cost of the walk that a table is tuned for: its own, and for each goal that it misses some more."""
    return walk.cost if walk.fell else walk.cost + excess_cost(walk.values)


def best_so_far(start_cost: float, generations: Sequence[Generation]) -> np.ndarray:
    """Cost of the best candidate after each generation, the start's first, shape ``(n + 1,)``."""
    least = [start_cost, *(min(item.costs) for item in generations)]
    return np.minimum.accumulate(np.array(least))
