"""Points of a sweep: a full grid, a Latin hypercube or a list, as overrides that are made when asked for.

Values are kept in columns, one array per key, so that a million episodes take some tens of megabytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from twin_gait.exceptions import ParameterError

MOST_EPISODES = 10_000_000


class Scale(StrEnum):
    """How the values of a range are spaced."""

    LINEAR = "linear"
    LOG = "log"


@dataclass(frozen=True, kw_only=True)
class Range:
    """A range of numbers.

    Attributes:
        start: First value, in the unit of its key.
        stop: Last value.
        count: Values that a grid takes of it.
        scale: Spacing.
    """

    start: float
    stop: float
    count: int | None = None
    scale: Scale = Scale.LINEAR

    def __post_init__(self) -> None:
        """Check the ends."""
        if self.start >= self.stop:
            raise ParameterError(f"expected from below to, got {self.start:g} and {self.stop:g}")
        if self.scale is Scale.LOG and self.start <= 0.0:
            raise ParameterError(f"expected from above 0 on a log scale, got {self.start:g}")

    def at(self, share: float) -> float:
        """Value at a share of the way."""
        if share in (0.0, 1.0):
            return self.stop if share else self.start
        if self.scale is Scale.LOG:
            return math.exp((1.0 - share) * math.log(self.start) + share * math.log(self.stop))
        return (1.0 - share) * self.start + share * self.stop


Levels = Range | Sequence[Any]


class _Missing:
    """Marks a key that a row of a list does not change."""


@dataclass(frozen=True, eq=False)
class Design(Sequence[Mapping[str, Any]]):
    """Overrides of every episode: each point ``repetitions`` times in a row.

    Attributes:
        columns: Values of each key, one per point.
        points: How many points.
        repetitions: Episodes per point.
    """

    columns: Mapping[str, np.ndarray]
    points: int
    repetitions: int = 1

    def __post_init__(self) -> None:
        """Check the size."""
        if not 1 <= len(self) <= MOST_EPISODES:
            raise ParameterError(f"expected 1 to {MOST_EPISODES} episodes, got {len(self)}")

    def __len__(self) -> int:
        return self.points * self.repetitions

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: Any) -> Any:
        if not 0 <= index < len(self):
            raise IndexError(index)
        values = {key: column[index // self.repetitions] for key, column in self.columns.items()}
        return {key: _plain(value) for key, value in values.items() if value is not _Missing}

    def column(self, key: str) -> list[Any]:
        """Values of a key over all episodes; None where it is not changed."""
        plain = [None if value is _Missing else _plain(value) for value in self.columns[key]]
        return [value for value in plain for _ in range(self.repetitions)]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def grid(parameters: Mapping[str, Levels], repetitions: int = 1) -> Design:
    """Every combination; the first key changes slowest.

    Raises:
        ParameterError: If a range has no count, or there are too many episodes.
    """
    levels = {key: _values(key, item) for key, item in parameters.items()}
    sizes = [len(values) for values in levels.values()]
    points = math.prod(sizes)
    if points * repetitions > MOST_EPISODES:
        raise ParameterError(f"expected at most {MOST_EPISODES} episodes, got {points * repetitions}")
    places = np.unravel_index(np.arange(points), sizes)
    columns = {
        key: _objects(values)[place] for (key, values), place in zip(levels.items(), places, strict=True)
    }
    return Design(columns, points, repetitions)


def latin_hypercube(
    parameters: Mapping[str, Levels], samples: int, seed: int, repetitions: int = 1
) -> Design:
    """A Latin hypercube: each range is cut into as many slices as there are samples, each used once.

    Raises:
        ParameterError: If there are too many episodes.
    """
    if not 1 <= samples * repetitions <= MOST_EPISODES:
        raise ParameterError(f"expected 1 to {MOST_EPISODES} episodes, got {samples * repetitions}")
    from scipy.stats import qmc  # takes longer to import than a hundred walks to check

    cube = qmc.LatinHypercube(len(parameters), rng=np.random.default_rng(seed))
    shares = cube.random(samples)
    columns = {
        key: _sampled(item, shares[:, position]) for position, (key, item) in enumerate(parameters.items())
    }
    return Design(columns, samples, repetitions)


def listed(rows: Sequence[Mapping[str, Any]], repetitions: int = 1) -> Design:
    """The rows of a list, which need not change the same keys.

    Raises:
        ParameterError: If there are no or too many episodes.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row))
    columns = {key: _objects([row.get(key, _Missing) for row in rows]) for key in keys}
    return Design(columns, len(rows), repetitions)


def _values(key: str, item: Levels) -> Sequence[Any]:
    if not isinstance(item, Range):
        return item
    if item.count is None:
        raise ParameterError(f"{key}: expected a count, the values that a grid takes of the range")
    if item.count < 2:
        raise ParameterError(f"{key}: expected a count of 2 or more, got {item.count}")
    return [item.at(number / (item.count - 1)) for number in range(item.count)]


def _sampled(item: Levels, shares: np.ndarray) -> np.ndarray:
    if isinstance(item, Range):
        return np.array([item.at(share) for share in shares.tolist()])
    chosen: np.ndarray = _objects(item)[(shares * len(item)).astype(int)]
    return chosen


def _objects(values: Sequence[Any]) -> np.ndarray:
    """Array of any values, lists among them left whole."""
    array = np.empty(len(values), dtype=object)
    for index, value in enumerate(values):
        array[index] = value
    return array
