"""Proofs that a mutant which no test detects is equivalent to the machine, each with a reason.

"Never" here means that no choice of bounds that opens or closes some guards
(:mod:`twin_gait.gait.feasibility`) has a solution, for any measurements, with the other leg in any phase or
absent. :func:`feasible` decides that exactly for strict bounds, without the margin of the package.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from kit_mutants import Mutant

from twin_gait.gait.feasibility import ZERO, Bound, Case, Requirement, comparison_bound, enumerate_cases
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard
from twin_gait.gait.signals import OTHER_TIME, TIME
from twin_gait.gait.table import TICK, GaitTable, Transition
from twin_gait.testing.exits import Exit, decisive, reads_only_own_time, reads_own_time, turning_tick
from twin_gait.testing.reference import Measurements, exit_indices, holds

SAME = "nothing has changed: zero is zero in every unit"
ONE_CONDITION = "a list of one condition: all and any are the same"
SAME_GUARD = "no measurements distinguish the two guards"
SHADOWED = "where the guards differ, an exit listed above is taken"
DEAD = "the exit can never be taken"
LONG_OPEN = "a timeout is open from the entry on: the debounce is over before it"
OTHER_WAIT = "the exit waits as long for something else"
NO_EXIT_SOONER = "no exit can be taken in the ticks that it changes"
NEVER_BOTH = "the two, and those between them, are never due in one tick with different outcomes"


class TickWindow(NamedTuple):
    """Range of ticks in a phase: both ends, or if ``free`` one time in between that the solver finds."""

    first: int
    last: float
    free: bool = False


def feasible(bounds: Sequence[Bound]) -> bool:
    """Return whether some numbers satisfy all bounds, however close: no cycle of bounds is contradictory."""
    names = list(dict.fromkeys([ZERO, *(name for item in bounds for name in (item.upper, item.lower))]))
    # The strict one of two equal limits is the shorter path: it comes first in the order of pairs.
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


def reason(table: GaitTable, mutant: Mutant) -> str | None:
    """Prove that a mutant is equivalent.

    Args:
        table: The gait table.
        mutant: A mutant of it.

    Returns:
        The reason, or None if there is no proof.
    """
    if (mutant.table.transitions, mutant.table.phases) == (table.transitions, table.phases):
        return SAME
    if mutant.kind == "order":
        return NEVER_BOTH if _order_is_free(table, *mutant.transitions) else None
    if mutant.kind == "minimum duration":
        return NO_EXIT_SOONER if _minimum_duration_is_free(table, mutant) else None
    (index,) = mutant.transitions
    return _entry_reason(table, mutant.table, index)


def _entry_reason(table: GaitTable, changed: GaitTable, index: int) -> str | None:
    after = Exit(changed, index)
    if index >= len(table.transitions):  # an additional exit
        return DEAD if is_dead(after) else None
    before = Exit(table, index)
    if is_dead(before) and is_dead(after):
        return DEAD
    if (before.item.source, before.item.target) != (after.item.source, after.item.target):
        return None
    if before.item.guard != after.item.guard:
        return _guard_reason(before, after.item.guard)
    return _wait_reason(before, after.item)


def is_dead(leave: Exit) -> bool:
    """Return whether an exit can never be taken.

    Its guard never opens in time, its timeout is too late, or whenever it opens, an exit without waiting
    time that is listed above it is open too.

    Args:
        leave: The exit.

    Returns:
        True if that is proved.
    """
    due = max(leave.gate, leave.debounce)
    if any((tick, index) < (due, leave.index) for tick, index in _sure_exits(leave)):
        return True
    above = [item for item in leave.rivals if item.index < leave.index and _acts_at_once(item)]
    shut = [Requirement(item.item.guard, False) for item in above]
    guards = [leave.item.guard, *(item.guard for item in shut)]
    windows = _windows(leave, guards)
    return not any(
        possible(leave.table, [Requirement(leave.item.guard), *shut], window) for window in windows
    )


def _sure_exits(leave: Exit) -> list[tuple[int, int]]:
    """Return the ticks at which other exits with guards that never close leave the phase, and their index."""
    others = [item for item in leave.siblings if item.index != leave.index]
    always = TickWindow(1, math.inf, free=True)
    return [
        (max(item.gate, item.debounce), item.index)
        for item in others
        if not possible(leave.table, [Requirement(item.item.guard, False)], always)
    ]


def possible(table: GaitTable, requirements: Sequence[Requirement], window: TickWindow) -> bool:
    """Return whether measurements can fulfil all requirements, with the other leg in any phase or absent."""
    if window.first > window.last:
        return False
    ends = sorted({window.first, window.last})
    start = [Bound(ZERO, OTHER_TIME, 0.0)]
    if window.free:
        start += [Bound(ZERO, TIME, -window.first * TICK), Bound(TIME, ZERO, window.last * TICK)]

    def bounds_of(atom: Comparison, true: bool) -> list[Bound] | None:
        if window.free or not reads_own_time(atom):
            return [comparison_bound(atom, true)]
        if reads_only_own_time(atom):
            return (
                [] if all(holds(atom, Measurements({}, None), int(tick)) is true for tick in ends) else None
            )
        return [comparison_bound(atom, true).substitute(TIME, tick * TICK) for tick in ends]

    return any(
        next(enumerate_cases(Case(phases, tuple(start)), requirements, bounds_of, feasible), None) is not None
        for phases in (table.phase_names, (None,))
    )


def _guard_reason(before: Exit, after: Guard) -> str | None:
    guard = before.item.guard
    if _flatten(guard) == _flatten(after):
        return ONE_CONDITION
    if not _differ(before, guard, after, []):
        return SAME_GUARD
    above = [item for item in before.rivals if item.index < before.index and _acts_at_once(item)]
    if before.debounce == 1 and not _differ(before, guard, after, above):
        return SHADOWED
    return None


def _acts_at_once(leave: Exit) -> bool:
    return leave.debounce == 1 and leave.item.timeout_ticks is None


def _flatten(guard: Guard) -> Guard:
    """Return the guard without lists of one condition."""
    if not isinstance(guard, (AllOf, AnyOf)):
        return guard
    inner = tuple(_flatten(item) for item in guard.guards)
    return inner[0] if len(inner) == 1 else type(guard)(guards=inner)


def _differ(leave: Exit, guard: Guard, other: Guard, closed: Sequence[Exit]) -> bool:
    """Return whether two guards differ for some measurements at which given exits are closed."""
    shut = [Requirement(item.item.guard, False) for item in closed]
    return any(
        possible(leave.table, [Requirement(guard, one), Requirement(other, not one), *shut], window)
        for window in _windows(leave, [guard, other, *(item.guard for item in shut)])
        for one in (True, False)
    )


def _windows(leave: Exit, guards: Sequence[Guard]) -> list[TickWindow]:
    """Return representative times: around each threshold in time, or any time if a guard is a difference."""
    atoms = [entry.atom for guard in guards for entry in decisive(guard)]
    times = [atom for atom in atoms if isinstance(atom, Comparison) and reads_own_time(atom)]
    if not all(reads_only_own_time(atom) for atom in times):
        return [TickWindow(1, leave.latest, free=True)]
    turns = {turning_tick(atom) for atom in times}
    ticks = {1, *turns, *(turn - 1 for turn in turns)}
    return [TickWindow(tick, tick) for tick in sorted(ticks) if 1 <= tick <= leave.latest]


def _wait_reason(before: Exit, after: Transition) -> str | None:
    """Return the reason if only debounce or timeout has changed; None if there is no proof."""
    item = before.item
    waits = [max(entry.timeout_ticks or 0, entry.debounce_ticks) for entry in (item, after)]
    if waits[0] == waits[1] and item.is_timeout:
        return LONG_OPEN
    if item.debounce_ticks == after.debounce_ticks:
        shortest = before.table.phases[before.item.source].minimum_ticks
        gates = [max(wait, shortest, 1) for wait in waits]
        return OTHER_WAIT if gates[0] == gates[1] else None
    return None


def _minimum_duration_is_free(table: GaitTable, mutant: Mutant) -> bool:
    """Return whether no exit can be due in a tick that only one of the minimum durations allows."""
    ticks = sorted(item.phases[mutant.phase].minimum_ticks for item in (table, mutant.table))
    for index in exit_indices(table, mutant.phase):
        item = table.transitions[index]
        first = max(1, ticks[0], item.timeout_ticks or 0, item.debounce_ticks)
        if possible(table, [Requirement(item.guard)], TickWindow(first, ticks[1] - 1, free=True)):
            return False
    return True


def _order_is_free(table: GaitTable, first: int, second: int) -> bool:
    """Return whether the order of two exits, and of those between them, has no effect."""
    phase = table.transitions[first].source
    between = [index for index in exit_indices(table, phase) if first <= index <= second]
    pairs = {(first, index) for index in between[1:]} | {(index, second) for index in between[:-1]}
    return all(_pair_is_free(Exit(table, one), Exit(table, two)) for one, two in pairs)


def _pair_is_free(one: Exit, two: Exit) -> bool:
    if (one.item.target, one.item.cause) == (two.item.target, two.item.cause):
        return True
    if is_dead(one) or is_dead(two):
        return True
    due = [
        max(item.item.timeout_ticks or 0, item.debounce) if item.item.is_timeout else None
        for item in (one, two)
    ]
    known = [tick for tick in due if tick is not None]
    if len(known) == 2:
        return known[0] != known[1]
    both = [Requirement(one.item.guard), Requirement(two.item.guard)]
    window = TickWindow(known[0], known[0]) if known else TickWindow(1, one.latest, free=True)
    return not possible(one.table, both, window)
