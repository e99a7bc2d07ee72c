"""Points of a sweep: a full grid, a Latin hypercube or a list, as overrides that are made when asked for.

Values are kept in columns, one array per key, so that a million episodes take some tens of megabytes.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from twin_gait.configuration.validation import Count, Number, Strict
from twin_gait.exceptions import ParameterError

MOST_EPISODES = 10_000_000


class Range(Strict):
    """A range of numbers, in the unit of their key."""

    model_config = ConfigDict(populate_by_name=True)

    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    count: Count | None = None  # values that a grid takes of it
    scale: Literal["linear", "log"] = "linear"

    def at(self, share: float) -> float:
        """Value at a share of the way; both ends are exact."""
        if share in (0.0, 1.0):
            return self.stop if share else self.start
        if self.scale == "log":
            return math.exp((1.0 - share) * math.log(self.start) + share * math.log(self.stop))
        return (1.0 - share) * self.start + share * self.stop


Levels = Range | Sequence[Any]
_MISSING = object()  # marks a key that a row of a list does not change


@dataclass(frozen=True, eq=False)
class Design(Sequence[Mapping[str, Any]]):
    """Overrides of every episode: each point ``repetitions`` times in a row."""

    columns: Mapping[str, np.ndarray]  # values of each key, one per point
    points: int
    repetitions: int = 1

    def __post_init__(self) -> None:
        _check_size(len(self))

    def __len__(self) -> int:
        return self.points * self.repetitions

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: Any) -> Any:
        if not 0 <= index < len(self):
            raise IndexError(index)
        values = {key: column[index // self.repetitions] for key, column in self.columns.items()}
        return {key: value for key, value in values.items() if value is not _MISSING}

    def column(self, key: str) -> list[Any]:
        """Values of a key over all episodes; None where it is not changed."""
        plain = [None if value is _MISSING else value for value in self.columns[key]]
        return [value for value in plain for _ in range(self.repetitions)]


def grid(parameters: Mapping[str, Levels], repetitions: int = 1) -> Design:
    """Every combination; the first key changes slowest."""
    levels = {key: _values(key, item) for key, item in parameters.items()}
    sizes = [len(values) for values in levels.values()]
    _check_size(math.prod(sizes) * repetitions)
    places = np.unravel_index(np.arange(math.prod(sizes)), sizes)
    columns = {key: _objects(levels[key])[place] for key, place in zip(levels, places, strict=True)}
    return Design(columns, math.prod(sizes), repetitions)


def latin_hypercube(
    parameters: Mapping[str, Levels], samples: int, seed: int, repetitions: int = 1
) -> Design:
    """A Latin hypercube: each range is cut into as many slices as there are samples, each used once."""
    from scipy.stats import qmc  # takes longer to import than a hundred walks to check

    _check_size(samples * repetitions)
    shares = qmc.LatinHypercube(len(parameters), rng=np.random.default_rng(seed)).random(samples)
    columns = {
        key: _objects([_at(key, item, share) for share in shares[:, place].tolist()])
        for place, (key, item) in enumerate(parameters.items())
    }
    return Design(columns, samples, repetitions)


def listed(rows: Sequence[Mapping[str, Any]], repetitions: int = 1) -> Design:
    """The rows of a list, which need not change the same keys."""
    keys = dict.fromkeys(key for row in rows for key in row)
    columns = {key: _objects([row.get(key, _MISSING) for row in rows]) for key in keys}
    return Design(columns, len(rows), repetitions)


def _check_size(episodes: int) -> None:
    if not 1 <= episodes <= MOST_EPISODES:
        raise ParameterError(f"expected 1 to {MOST_EPISODES} episodes, got {episodes}")


def _values(key: str, item: Levels) -> Sequence[Any]:
    if not isinstance(item, Range):
        return item
    if item.count is None or item.count < 2:
        raise ParameterError(f"{key}: expected a count of 2 or more values of the grid, got {item.count}")
    return [_at(key, item, number / (item.count - 1)) for number in range(item.count)]


def _at(key: str, item: Levels, share: float) -> Any:
    if not isinstance(item, Range):
        return item[int(share * len(item))]
    if item.start >= item.stop or (item.scale == "log" and item.start <= 0.0):
        expected = "from below to" if item.start >= item.stop else "from above 0 on a log scale"
        raise ParameterError(f"{key}: expected {expected}, got {item.start:g} and {item.stop:g}")
    return item.at(share)


def _objects(values: Sequence[Any]) -> np.ndarray:
    """Array of any values, lists among them left whole."""
    return np.fromiter(values, dtype=object, count=len(values))
