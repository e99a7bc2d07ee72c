"""Exits of one phase that contend: open at once, never open, or always behind another."""

from __future__ import annotations

import itertools

from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.checking.polyhedra import TIME, Clause, Inequality, both, joined
from twin_gait.checking.signals import Point, SignalSpace
from twin_gait.gait.table import TICK

END = "end."


def ambiguity(subject: Subject) -> list[Finding]:
    """Two exits of a phase with different targets can be open at once; time-outs are exempt.

    Args:
        subject: What is checked.

    Returns:
        A finding with a witness for each such pair.
    """
    space = SignalSpace(subject)
    findings = []
    for phase in space.table.phase_names:
        guarded = [index for index in space.exits(phase) if not space.transition(index).is_time_out]
        for first, second in itertools.combinations(guarded, 2):
            if space.transition(first).target != space.transition(second).target:
                findings += _open_at_once(space, first, second)
    return findings


def _open_at_once(space: SignalSpace, first: int, second: int) -> list[Finding]:
    earliest = max(space.window(first)[0], space.window(second)[0])
    times = {TIME: (earliest, space.window(first)[1])}

    def holds(point: Point) -> bool:
        return space.is_open(first, point) and space.is_open(second, point)

    for clauses in itertools.product(space.clauses(first), space.clauses(second)):
        clause = both(*clauses)
        point = space.find(clause.inequalities, clause.others, times, holds) if clause.others else None
        if point is not None:
            return [_ambiguous(space, first, second, point, clause)]
    return []


def _ambiguous(space: SignalSpace, first: int, second: int, point: Point, clause: Clause) -> Finding:
    one, other = space.transition(first), space.transition(second)
    earliest = max(space.window(first)[0], space.window(second)[0])
    winner = space.winner(one.source, point, point.signals.get(TIME, earliest))
    wins = label(one if winner is None else space.transition(winner))
    waits = ""
    if one.debounce_ticks != other.debounce_ticks:
        waits = (
            f"; debounce {one.debounce_ticks} and {other.debounce_ticks} ms, so the order of opening counts"
        )
    return Finding(
        rule="ambiguity",
        severity=Severity.WARNING,
        phase=one.source,
        transition=label(other),
        reason=f"{label(one)} and {label(other)} can be open at once; when both are due {wins} wins{waits}",
        suggestion="let a condition of one exclude the other, or waive it if the order is meant",
        witness=space.witness(point, [clause]),
    )


def never_opens(subject: Subject) -> list[Finding]:
    """The guard of an exit contradicts itself inside the limits of the signals and the time-out.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such exit.
    """
    space = SignalSpace(subject)
    return [
        Finding(
            rule="never_opens",
            severity=Severity.ERROR,
            phase=item.source,
            transition=label(item),
            reason=f"no signals inside the limits open {item.guard} {_in_time(space, index)}",
            suggestion="correct the thresholds, or take the transition out",
        )
        for index, item in enumerate(space.table.transitions)
        if not item.is_time_out and not can_open(space, index)
    ]


def _in_time(space: SignalSpace, index: int) -> str:
    earliest, latest = space.window(index)
    return f"from {earliest:g} to {latest:g} s in the phase"


def debounce_beyond_time_out(subject: Subject) -> list[Finding]:
    """The debounce of an exit is longer than the time for which its guard can stay open.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such exit.
    """
    space = SignalSpace(subject)
    return [
        Finding(
            rule="debounce_beyond_time_out",
            severity=Severity.ERROR,
            phase=item.source,
            transition=label(item),
            reason=f"the debounce of {item.debounce_ticks} ms cannot be over {_in_time(space, index)}",
            suggestion="shorten the debounce, or let the time-out come later",
        )
        for index, item in enumerate(space.table.transitions)
        if can_open(space, index) and not can_fire(space, index)
    ]


def can_open(space: SignalSpace, index: int, others: frozenset[str | None] | None = None) -> bool:
    """Whether an exit can be open, and not held back by time, inside the limits.

    Args:
        space: Signals of the table.
        index: The transition.
        others: Phases that the other leg may be in; None for all.
    """
    return opening(space, index, others) is not None


def opening(
    space: SignalSpace, index: int, others: frozenset[str | None] | None = None
) -> tuple[Point, Clause] | None:
    """Signals that open an exit, with the clause that they fulfil; None if there are none."""
    times = {TIME: space.window(index)}
    if times[TIME][0] > times[TIME][1]:
        return None
    for clause in space.clauses(index):
        allowed = clause.others if others is None else clause.others & others
        if allowed:
            point = space.find(clause.inequalities, allowed, times, lambda point: space.is_open(index, point))
            if point is not None:
                return point, clause
    return None


def can_fire(space: SignalSpace, index: int) -> bool:
    """Whether an exit can be open for as long as its debounce asks, all signals free meanwhile."""
    item = space.transition(index)
    if item.debounce_ticks == 1:
        return can_open(space, index)
    earliest, latest = space.window(index)
    stay = (item.debounce_ticks - 1) * TICK
    times = {TIME: (TICK, latest), END + TIME: (max(earliest, TICK + stay), latest)}
    if times[END + TIME][0] > latest + 0.5 * TICK:
        return False
    apart = tuple(
        Inequality(END + TIME, TIME, above, stay + (-0.5 if above else 0.5) * TICK, strict=False)
        for above in (True, False)
    )
    # Both ends of the debounce in the guard: what lies between is too, as a clause is convex.
    for first, last in itertools.product(space.clauses(index), repeat=2):
        inequalities = (*first.inequalities, *last.renamed(lambda name: END + name).inequalities, *apart)
        if space.find(inequalities, first.others, times, lambda point: True) is not None:
            return True
    return False


def shadowed_exit(subject: Subject) -> list[Finding]:
    """An exit never wins, because exits listed earlier are due whenever it is.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such exit.
    """
    space = SignalSpace(subject)
    findings = []
    for index, item in enumerate(space.table.transitions):
        before = [other for other in space.exits(item.source) if _is_due_before(space, other, index)]
        possible = item.is_time_out or can_open(space, index)
        if before and possible and not _wins_somewhere(space, index, before):
            names = ", ".join(label(space.transition(other)) for other in before)
            findings.append(
                Finding(
                    rule="shadowed_exit",
                    severity=Severity.WARNING,
                    phase=item.source,
                    transition=label(item),
                    reason=f"{label(item)} never wins: {names} is due whenever it is, and comes first",
                    suggestion="list it earlier, or take it out",
                )
            )
    return findings


def _is_due_before(space: SignalSpace, other: int, index: int) -> bool:
    """Whether another exit, while open, is due no later than this one and wins against it."""
    first, item = space.transition(other), space.transition(index)
    if first.is_time_out and item.is_time_out:
        return (first.time_out_ticks or 0, other) < (item.time_out_ticks or 0, index)
    no_later = (first.time_out_ticks or 0) <= (item.time_out_ticks or 0)
    return other < index and first.debounce_ticks <= item.debounce_ticks and no_later


def _wins_somewhere(space: SignalSpace, index: int, before: list[int]) -> bool:
    """Whether the exit can be open while those before it are closed."""
    if any(space.transition(other).is_time_out for other in before):
        return False
    # Exits that debounce may take turns in being open, so that none of them is ever due.
    quick = [other for other in before if space.transition(other).debounce_ticks == 1]
    slow = [[other] for other in before if space.transition(other).debounce_ticks > 1]
    return all(_open_behind(space, index, group) for group in [quick, *slow])


def _open_behind(space: SignalSpace, index: int, closed: list[int]) -> bool:
    shut = space.closed(closed)
    if shut is None:
        return True
    times = {TIME: space.window(index)}
    clauses = joined([space.clauses(index), shut], space.others)
    return any(
        space.find(clause.inequalities, clause.others, times, lambda point: space.is_open(index, point))
        for clause in clauses
    )


RULES = (ambiguity, never_opens, debounce_beyond_time_out, shadowed_exit)
