"""One exit of a phase among its rivals, and the measurements under which it decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple, TypeGuard

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.feasibility import (
    ZERO,
    Bound,
    Case,
    Phases,
    Requirement,
    comparison_bound,
    find_most_robust,
)
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import OTHER_TIME, TIME
from twin_gait.gait.table import TICK, StateTable, Transition
from twin_gait.testing.reference import Measurements, TickInput, TickInputs, exit_indices, holds, outcomes

LONGEST_RUN = 20_000  # ticks; a longer timeout is not run tick by tick


class ExitScenario(NamedTuple):
    """Measurements tick by tick, and the expected transitions of the leg."""

    description: str  # tested property in words
    phase: str  # phase that the leg enters at tick 0
    steps: TickInputs  # the measurements; empty if no measurements can test the property
    expected: tuple[int | None, ...]  # index of the transition taken at each step, or None
    expects_rejection: bool = False  # whether the last measurements are made invalid and have to be rejected


class Decisive(NamedTuple):
    """A condition of a guard, and the requirements under which it alone decides."""

    atom: Comparison | PhaseMembership  # the condition
    requirements: tuple[Requirement, ...] = ()  # required state of all other parts of the guard
    group: AllOf | AnyOf | None = None  # innermost list that contains it together with others, or None


def decisive(guard: Guard) -> Iterator[Decisive]:
    """Yield every condition of a guard with the requirements under which it alone decides.

    The other conditions of an ``all`` are open and the other conditions of an ``any`` are closed, on every
    level.
    """
    if isinstance(guard, (Comparison, PhaseMembership)):
        yield Decisive(guard)
        return
    for index, inner in enumerate(guard.guards):
        beside = guard.guards[:index] + guard.guards[index + 1 :]
        requirements = tuple(Requirement(other, isinstance(guard, AllOf)) for other in beside)
        for item in decisive(inner):
            group = item.group or (guard if beside else None)
            yield Decisive(item.atom, (*requirements, *item.requirements), group)


def reads_own_time(atom: Comparison) -> bool:
    """Return whether a comparison reads the time in the leg's own phase."""
    return TIME in (atom.signal, atom.minus)


def reads_only_own_time(atom: Comparison | PhaseMembership) -> TypeGuard[Comparison]:
    """Return whether a condition reads only the time in the leg's own phase."""
    return isinstance(atom, Comparison) and {atom.signal, atom.minus} <= {TIME, None}


def find_measurements(
    phases: Phases, requirements: Sequence[Requirement], ticks: range, pinned: Sequence[Bound] = ()
) -> Measurements | None:
    """Find measurements that fulfil requirements at some ticks, far from all thresholds; None if none do.

    ``phases``: allowed phases of the other leg, ``(None,)`` without another leg.
    """
    ends = sorted({ticks[0], ticks[-1]})

    def bounds_of(atom: Comparison, true: bool) -> list[Bound] | None:
        if reads_only_own_time(atom):
            return [] if all(holds(atom, Measurements({}, None), tick) is true for tick in ends) else None
        bound = comparison_bound(atom, true)
        return [bound.substitute(TIME, tick * TICK) for tick in ends] if reads_own_time(atom) else [bound]

    start = Case(phases, (*pinned, Bound(ZERO, OTHER_TIME, 0.0)))
    try:
        found = find_most_robust(start, requirements, bounds_of)
    except GaitTableError:  # too many choices to try
        return None
    return None if found is None else Measurements(found[1], found[0].phases[0])


Accept = Callable[["Exit", TickInputs], bool]
Stretch = tuple[Sequence[Requirement], int]  # requirements, and number of ticks for which they have to hold


@dataclass(frozen=True)
class Exit:
    """A transition, by its index in a gait table, with the properties of its phase that concern it."""

    table: StateTable
    index: int
    ignored_rival: int = -1  # index of a rival that is not closed, -1 for none

    @property
    def item(self) -> Transition:
        """The transition."""
        return self.table.transitions[self.index]

    @property
    def debounce(self) -> int:
        """Debounce of the transition in ticks."""
        return self.item.debounce_ticks

    @property
    def opens(self) -> Requirement:
        """Requirement that the guard is open."""
        return Requirement(self.item.guard)

    @property
    def closes(self) -> Requirement:
        """Requirement that the guard is closed."""
        return Requirement(self.item.guard, False)

    @property
    def gate(self) -> int:
        """First tick in the phase in which the exit may be taken, without its debounce."""
        return max(1, self.table.phases[self.item.source].minimum_ticks, self.item.timeout_ticks or 0)

    @cached_property
    def siblings(self) -> list[Exit]:
        """Exits of the same phase, including this one."""
        return exits_of(self.table, self.item.source)

    @cached_property
    def latest(self) -> float:
        """Number of ticks after which a timeout ends the phase; infinite without a timeout."""
        waits = [item for item in self.siblings if item.item.is_timeout]
        return min((max(item.item.timeout_ticks or 0, item.debounce) for item in waits), default=math.inf)

    @cached_property
    def rivals(self) -> tuple[Exit, ...]:
        """Other exits of the same phase with a guard, without the spared one."""
        others = (item for item in self.siblings if item.index not in (self.index, self.ignored_rival))
        return tuple(item for item in others if not item.item.is_timeout)

    @property
    def timed(self) -> list[tuple[Comparison, tuple[Requirement, ...]]]:
        """Conditions of the guard on the time in the phase alone, each with the requirements to decide."""
        found = decisive(self.item.guard)
        return [(atom, beside) for atom, beside, _ in found if reads_only_own_time(atom)]

    def starts(self, ticks: int, *, gate: int | None = None) -> list[int]:
        """Return the first ticks of stretches to try, before the phase is left.

        ``ticks``: length of a stretch. ``gate``: earliest first tick. The stretches begin or end near a
        threshold on the time in the phase.
        """
        earliest = self.gate if gate is None else gate
        turns = {round(atom.threshold / TICK) for item in (self, *self.rivals) for atom, _ in item.timed}
        near = {turn + shift for turn in turns for shift in range(-1, 3)}
        candidates = {earliest, *near, *(tick - ticks + 1 for tick in near)}
        return sorted(tick for tick in candidates if earliest <= tick and tick + ticks - 1 < self.latest)

    def candidate_measurements(
        self, requirements: Sequence[Requirement], ticks: range, pinned: Sequence[Bound] = ()
    ) -> Iterator[Measurements]:
        """Yield measurements that fulfil requirements, with fewer and fewer rivals closed.

        First all rivals are closed, then only those that have priority and could be due. Measurements without
        another leg come last.
        """
        able = [item for item in self.rivals if item.debounce <= len(ticks) and item.gate < ticks.stop]
        earlier = [item for item in able if item.index < self.index]
        for phases, closed in product((self.table.members or (None,), (None,)), (self.rivals, earlier)):
            found = find_measurements(
                phases, [*requirements, *(item.closes for item in closed)], ticks, pinned
            )
            if found is not None:
                yield found

    def outcomes(self, steps: TickInputs) -> list[int | None]:
        """Return the transition that a leg takes at each step, or None; it enters the phase at tick 0."""
        return outcomes(self.table, self.item.source, steps)

    def fires(self, steps: TickInputs) -> bool:
        """Return whether a leg takes the exit in the last of some steps and none before."""
        return self.outcomes(steps) == [None] * (len(steps) - 1) + [self.index]

    def stays(self, steps: TickInputs) -> bool:
        """Return whether a leg takes no exit."""
        return self.outcomes(steps) == [None] * len(steps)

    def yields(self, steps: TickInputs) -> bool:
        """Return whether a leg does not take this exit; it may take a rival that is open, too."""
        return self.index not in self.outcomes(steps)

    def search(
        self, start: int, stretches: Sequence[Stretch], accept: Accept, pinned: Sequence[Bound] = ()
    ) -> TickInputs:
        """Search for steps that pass a criterion, stretch by stretch; empty if there are none.

        ``start``: first tick. ``pinned``: bounds that hold throughout.
        """

        def ways(first: int, left: Sequence[Stretch]) -> Iterator[TickInputs]:
            if not left:
                yield ()
                return
            requirements, length = left[0]
            ticks = range(first, first + length)
            for vector in self.candidate_measurements(requirements, ticks, pinned):
                for rest in ways(ticks.stop, left[1:]):
                    yield constant(vector, ticks) + rest

        stretches = [stretch for stretch in stretches if stretch[1]]
        if start < 1 or start + sum(length for _, length in stretches) - 1 > self.latest:
            return ()
        return next((steps for steps in ways(start, stretches) if accept(self, steps)), ())

    def search_with_margin(
        self, requirements: Sequence[Requirement], *accepts: Accept, pinned: Sequence[Bound] = ()
    ) -> TickInputs:
        """Search for steps, one debounce long, that fulfil requirements with a margin.

        The steps pass one of the criteria ``accepts``; empty if there are none.
        """
        return first_of(
            self.search(start, [(requirements, self.debounce)], accept, pinned)
            for accept in accepts
            for start in self.starts(self.debounce)
        )

    def scenario(self, description: str, steps: TickInputs) -> ExitScenario:
        """Create a scenario whose expectation follows from the rules of the table."""
        return ExitScenario(description, self.item.source, steps, tuple(self.outcomes(steps)))


def exits_of(table: StateTable, phase: str) -> list[Exit]:
    """Return the exits of a phase in their order of priority."""
    return [Exit(table, index) for index in exit_indices(table, phase)]


def constant(vector: Measurements, ticks: range) -> TickInputs:
    """Repeat the same measurements for each tick."""
    return tuple(TickInput(tick, vector) for tick in ticks)


def turning_tick(atom: Comparison) -> int:
    """Return the first tick at which a comparison of the own time alone has its later truth value."""
    near = round(atom.threshold / TICK)
    start = max(0, near - 2)
    before = holds(atom, Measurements({}, None), start)
    ticks = range(start, near + 4)
    return next((tick for tick in ticks if holds(atom, Measurements({}, None), tick) is not before), start)


def first_of(tries: Iterable[TickInputs]) -> TickInputs:
    """Return the first non-empty steps of some searches; empty if all failed."""
    return next(filter(None, tries), ())
