"""Systems of bounds on differences of two numbers, ``upper - lower <= limit``.

Every condition of a gait table has this form: one signal against a threshold, or the difference of
two. Such a system has a solution exactly if no cycle of bounds adds up to less than zero, or to zero with
a strict bound in it; shortest paths (Floyd and Warshall) decide that. Nothing is sampled, and "impossible"
is a proof, up to the rounding of sums of limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

ZERO = ""  # the number zero, against which single signals are bounded
HAIR = 1e-12  # a solution keeps this distance from strict limits, relative to them or to 1


@dataclass(frozen=True)
class Bound:
    """``upper - lower < limit`` (strict) or ``<= limit``.

    Attributes:
        upper: Name of a number, or ``ZERO``.
        lower: Name of a number, or ``ZERO``.
        limit: The limit.
        strict: Whether the limit itself is excluded.
        room: Comfortable distance from the limit, asked for in part or in whole; 0 for none.
    """

    upper: str
    lower: str
    limit: float
    strict: bool = False
    room: float = 0.0

    def tightened(self, share: float) -> float:
        """Limit less a share of the comfortable distance."""
        hair = HAIR * max(1.0, abs(self.limit)) if self.strict else 0.0
        return self.limit - max(share * self.room, hair)


def equal(name: str, other: str, value: float) -> list[Bound]:
    """Bounds that pin a difference to a value."""
    return [Bound(name, other, value), Bound(other, name, -value)]


def solve(bounds: Sequence[Bound], share: float = 0.0) -> dict[str, float] | None:
    """Find numbers that keep all bounds.

    Args:
        bounds: The bounds.
        share: Share of the comfortable distance that is kept from each limit.

    Returns:
        The numbers, each as near to zero as those before it allow; None if there are none.
    """
    paths = _shortest_paths(bounds, share)
    return None if paths is None else _nearest_to_zero(paths)


def feasible(bounds: Sequence[Bound]) -> bool:
    """Whether any numbers keep all bounds, however narrow the room for them.

    Args:
        bounds: The bounds.

    Returns:
        True if no cycle of bounds contradicts itself.
    """
    names = _names(bounds)
    # Of two equal limits the strict one is the shorter path: it comes first in the order of pairs.
    open_end = (math.inf, 1)
    paths = {a: {b: (0.0, 1) if a == b else open_end for b in names} for a in names}
    for item in bounds:
        limit = (item.limit, 0 if item.strict else 1)
        paths[item.upper][item.lower] = min(paths[item.upper][item.lower], limit)
    for middle in names:
        for row in paths.values():
            reach, loose = row[middle]
            for end, (length, also_loose) in paths[middle].items():
                row[end] = min(row[end], (reach + length, loose & also_loose))
        if any(paths[name][name] < (0.0, 1) for name in names):
            return False
    return True


def _names(bounds: Sequence[Bound]) -> list[str]:
    return list(dict.fromkeys([ZERO, *(name for item in bounds for name in (item.upper, item.lower))]))


def _shortest_paths(bounds: Sequence[Bound], share: float) -> dict[str, dict[str, float]] | None:
    names = _names(bounds)
    paths = {a: {b: 0.0 if a == b else math.inf for b in names} for a in names}
    for item in bounds:
        limit = item.tightened(share)
        paths[item.upper][item.lower] = min(paths[item.upper][item.lower], limit)
    for middle in names:
        onward = paths[middle]
        for row in paths.values():
            reach = row[middle]
            if reach == math.inf:
                continue
            for end, length in onward.items():
                if reach + length < row[end]:
                    row[end] = reach + length
        if any(paths[name][name] < 0.0 for name in names):
            return None
    return paths


def _nearest_to_zero(paths: dict[str, dict[str, float]]) -> dict[str, float]:
    values = {ZERO: 0.0}
    for name in paths:
        if name == ZERO:
            continue
        low = max(value - paths[known][name] for known, value in values.items())
        high = min(value + paths[name][known] for known, value in values.items())
        values[name] = min(max(0.0, low), high)
    del values[ZERO]
    return values
