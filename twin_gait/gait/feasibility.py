"""Find signals for which guards are true or false, as bounds on differences, ``upper - lower <= limit``.

Every condition of a gait table has this form: one signal against a threshold, the difference of two, or a set
of phases of the other leg. The tree of a guard leaves choices (which condition of an ``all`` is false, which
one of an ``any`` is true); they are tried in turn. A set of bounds has a solution if and only if no cycle of
them adds up to less than zero, or to zero with a strict bound in it, which is decided by shortest paths
(Floyd and Warshall). Nothing is sampled, and "impossible" is a proof, up to the rounding of sums.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership, map_atoms
from twin_gait.gait.signals import OTHER, find_signal

ZERO = ""  # Name of the number zero, against which single signals are bounded.
STRICT_MARGIN = 1e-12  # Distance of a solution from strict limits, relative to them or to 1.
SHARES = (1.0, 1e-2, 1e-4, 0.0)  # Shares of the comfortable distance; the largest feasible one is kept.
MAX_BRANCHES = 20_000

Phases = tuple[str | None, ...]  # Phases of the other leg; None represents an absent leg.


@dataclass(frozen=True)
class Bound:
    """The inequality ``upper - lower < limit`` (strict) or ``<= limit``."""

    upper: str  # Name of a number, or ``ZERO``.
    lower: str  # Name of a number, or ``ZERO``.
    limit: float  # Limit of the difference.
    strict: bool = False  # Whether the limit itself is excluded.
    margin: float = 0.0  # Comfortable distance from the limit, kept in part or in whole; 0 for none.
    is_integer: bool = False  # Whether the difference is a whole number.

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers in the bound, without ``ZERO``."""
        return tuple(name for name in (self.upper, self.lower) if name != ZERO)

    def is_satisfied(self, values: Mapping[str, float]) -> bool:
        """Check whether numbers fulfil the bound."""
        difference = values.get(self.upper, 0.0) - values.get(self.lower, 0.0)
        return difference < self.limit if self.strict else difference <= self.limit

    def tightened_limit(self, share: float) -> float:
        """Return the limit minus a share of the comfortable distance."""
        if self.is_integer:
            near = round(self.limit)
            limit = near if math.isclose(near, self.limit, abs_tol=1e-6) else self.limit
            return math.floor(
                (math.ceil(limit) - 1 if self.strict else math.floor(limit)) - share * self.margin
            )
        margin = STRICT_MARGIN * max(1.0, abs(self.limit)) if self.strict else 0.0
        return self.limit - max(share * self.margin, margin)

    def substitute(self, name: str, value: float) -> Bound:
        """Return the bound with one number replaced by its value."""
        if name == self.upper:
            return replace(self, upper=ZERO, limit=self.limit - value).substitute(name, value)
        return replace(self, lower=ZERO, limit=self.limit + value) if name == self.lower else self


def equal(name: str, other: str, value: float) -> list[Bound]:
    """Return two bounds that fix a difference to a value."""
    return [Bound(name, other, value), Bound(other, name, -value)]


def comparison_bound(atom: Comparison, true: bool) -> Bound:
    """Convert a comparison, or its negation, to a bound in the units of the table."""
    room = find_signal(atom.signal).margin
    if (atom.operator == "<") is true:
        return Bound(atom.signal, atom.minus or ZERO, atom.threshold, strict=true, margin=room)
    return Bound(atom.minus or ZERO, atom.signal, -atom.threshold, strict=true, margin=room)


def solve(bounds: Sequence[Bound], share: float = 0.0) -> dict[str, float] | None:
    """Find numbers that fulfil all bounds; None if there are none.

    Each number is as close to zero as those before it allow. ``share``: share of the comfortable distance
    that is kept from each limit.
    """
    names = list(dict.fromkeys([ZERO, *(name for item in bounds for name in (item.upper, item.lower))]))
    paths = {a: {b: 0.0 if a == b else math.inf for b in names} for a in names}
    for item in bounds:
        row = paths[item.upper]
        row[item.lower] = min(row[item.lower], item.tightened_limit(share))
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
    values = {ZERO: 0.0}
    for name in names[1:]:
        low = max(value - paths[known][name] for known, value in values.items())
        high = min(value + paths[name][known] for known, value in values.items())
        values[name] = min(max(0.0, low), high)
    del values[ZERO]
    return values


class Requirement(NamedTuple):
    """A guard and its required truth value."""

    guard: Guard
    true: bool = True


class Case(NamedTuple):
    """One choice that fulfils requirements: phases of the other leg, and bounds on the signals."""

    phases: Phases
    bounds: tuple[Bound, ...] = ()


# Function that returns bounds for a required truth value of a comparison; None if it is impossible.
BoundsOf = Callable[[Comparison, bool], Sequence[Bound] | None]


def enumerate_cases(
    start: Case,
    requirements: Sequence[Requirement],
    bounds_of: BoundsOf,
    possible: Callable[[Sequence[Bound]], bool],
) -> Iterator[Case]:
    """Yield all ways to fulfil requirements, one after the other; contradictory ways are not followed.

    ``start``: phases of the other leg and bounds that are always valid. Without another leg (``(None,)``) no
    comparison that reads it is true. ``requirements``: guards with their required truth values.
    ``bounds_of``: function that converts a comparison to bounds. ``possible``: function that checks whether
    bounds have a solution. Raises GaitTableError if there are more than ``MAX_BRANCHES`` choices to try.
    """
    left = iter(range(MAX_BRANCHES))

    def grown(way: Case, atom: Comparison | PhaseMembership, true: bool) -> Case | None:
        if isinstance(atom, PhaseMembership):
            kept = tuple(name for name in way.phases if (name in atom.phases) is true)
            return way._replace(phases=kept) if kept else None
        if way.phases == (None,) and any(name.startswith(OTHER) for name in atom.names):
            return None if true else way
        bounds = bounds_of(atom, true)
        if not bounds:
            return None if bounds is None else way
        more = way._replace(bounds=(*way.bounds, *bounds))
        return more if possible(more.bounds) else None

    def branches(agenda: list[Requirement], way: Case) -> Iterator[Case]:
        if next(left, None) is None:
            raise GaitTableError(
                f"the guards have more than {MAX_BRANCHES} combinations of conditions; use fewer any in all"
            )
        if not agenda:
            yield way
            return
        (guard, true), *rest = agenda = sorted(agenda, key=_is_choice)
        if isinstance(guard, (Comparison, PhaseMembership)):
            more = grown(way, guard, true)
            if more is not None:
                yield from branches(rest, more)
        elif _is_choice(agenda[0]):
            for inner in guard.guards:
                yield from branches([Requirement(inner, true), *rest], way)
        else:
            yield from branches([*(Requirement(inner, true) for inner in guard.guards), *rest], way)

    if possible(start.bounds):
        yield from branches(list(requirements), start)


def _is_choice(requirement: Requirement) -> bool:
    return (isinstance(requirement.guard, AnyOf) and requirement.true) or (
        isinstance(requirement.guard, AllOf) and not requirement.true
    )


def _is_feasible_with_margin(share: float) -> Callable[[Sequence[Bound]], bool]:
    return lambda bounds: solve(bounds, share) is not None


Solution = tuple[Case, dict[str, float]]


def enumerate_solutions(
    start: Case, requirements: Sequence[Requirement], bounds_of: BoundsOf
) -> Iterator[Solution]:
    """Yield the cases of :func:`enumerate_cases` with signals as far from their thresholds as possible."""
    for way in enumerate_cases(start, requirements, bounds_of, _is_feasible_with_margin(SHARES[-1])):
        yield way, next(found for share in SHARES if (found := solve(way.bounds, share)) is not None)


def find_most_robust(
    start: Case, requirements: Sequence[Requirement], bounds_of: BoundsOf
) -> Solution | None:
    """Return the way to fulfil requirements that is furthest from all thresholds, or None."""
    feasible = next(
        enumerate_cases(start, requirements, bounds_of, _is_feasible_with_margin(SHARES[-1])), None
    )
    for share in SHARES if feasible else ():
        for way in enumerate_cases(start, requirements, bounds_of, _is_feasible_with_margin(share)):
            return way, solve(way.bounds, share) or {}
    return None


def rename_signals(
    guard: Guard, rename: Callable[[str], str], member: Callable[[PhaseMembership], bool] | None = None
) -> Guard:
    """Rename the signals of a guard, for example to those of the other leg.

    ``member``: function that returns the truth of a membership if it is known; None to leave memberships
    unchanged.
    """

    def changed(atom: Comparison | PhaseMembership) -> Guard:
        if isinstance(atom, Comparison):
            minus = None if atom.minus is None else rename(atom.minus)
            return replace(atom, signal=rename(atom.signal), minus=minus)
        if member is None:
            return atom
        return AllOf(guards=()) if member(atom) else PhaseMembership(phases=())

    return map_atoms(guard, changed)
