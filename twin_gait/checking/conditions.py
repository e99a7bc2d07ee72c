"""Conditions of a guard that decide nothing: beyond the limits, or said already."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.checking.polyhedra import TIME, disjunctive_form, joined
from twin_gait.checking.signals import OTHER_TIME, SignalSpace
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard
from twin_gait.gait.table import TICK, Transition


def threshold_beyond_limits(subject: Subject) -> list[Finding]:
    """A threshold lies outside what its signal can measure: the condition is always or never true.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such condition.
    """
    space = SignalSpace(subject)
    findings = []
    for item in space.table.transitions:
        for comparison in dict.fromkeys(_comparisons(item.guard)):
            low, high = _range_of(space, item, comparison)
            if low < comparison.threshold < high or _decides_at_end(comparison, low, high):
                continue
            above = comparison.threshold <= low
            truth = "always" if above == (comparison.operator == ">") else "never"
            findings.append(
                Finding(
                    rule="threshold_beyond_limits",
                    severity=Severity.WARNING,
                    phase=item.source,
                    transition=label(item),
                    reason=f"{comparison} is {truth} true: the left side lies in {low:.4g} … {high:.4g}",
                    suggestion="move the threshold inside the range, or take the condition out",
                )
            )
    return findings


def _comparisons(guard: Guard) -> Iterator[Comparison]:
    if isinstance(guard, Comparison):
        yield guard
    elif isinstance(guard, (AllOf, AnyOf)):
        for inner in guard.guards:
            yield from _comparisons(inner)


def _decides_at_end(comparison: Comparison, low: float, high: float) -> bool:
    """Whether the threshold is the very end of the range that the condition excludes."""
    return comparison.threshold == (low if comparison.operator == ">" else high)


def _range_of(space: SignalSpace, item: Transition, comparison: Comparison) -> tuple[float, float]:
    """Least and largest left side of a comparison in the units of the table."""
    low, high = _signal_range(space, item, comparison.signal)
    if comparison.minus is None:
        return low, high
    if comparison.minus == comparison.signal:
        return 0.0, 0.0
    minus_low, minus_high = _signal_range(space, item, comparison.minus)
    return low - minus_high, high - minus_low


def _signal_range(space: SignalSpace, item: Transition, name: str) -> tuple[float, float]:
    if name == TIME:
        return TICK, space.time_out(item.source)
    if name == OTHER_TIME:
        return 0.0, max(space.time_out(phase) for phase in space.others)
    return space.range(name)


def redundant_condition(subject: Subject) -> list[Finding]:
    """A condition follows from those beside it, or opens nothing that they do not open.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such condition.
    """
    space = SignalSpace(subject)
    findings = []
    for index, item in enumerate(space.table.transitions):
        for group in _groups(item.guard):
            for member, rest in _superfluous(space, index, group):
                findings.append(_superfluous_finding(item, group, member, rest))
    return findings


def _groups(guard: Guard) -> Iterator[AllOf | AnyOf]:
    """Every ``all`` and ``any`` inside a guard."""
    if isinstance(guard, (AllOf, AnyOf)):
        yield guard
        for inner in guard.guards:
            yield from _groups(inner)


def _superfluous(
    space: SignalSpace, index: int, group: AllOf | AnyOf
) -> Iterator[tuple[Guard, tuple[Guard, ...]]]:
    """Members of a group that could be taken out one after the other, with those that remain."""
    kept = list(group.guards)
    for member in reversed(group.guards):
        rest = [guard for guard in kept if guard is not member]
        if not rest or not _satisfiable(space, index, [member]):
            continue
        if isinstance(group, AllOf):
            # Alone it must decide something, and the rest must be possible: other rules report the rest.
            if not _satisfiable(space, index, [], [member]) or not _satisfiable(space, index, rest):
                continue
            decides = _satisfiable(space, index, rest, [member])
        else:
            decides = _satisfiable(space, index, [member], rest)
        if not decides:
            kept = rest
            yield member, tuple(rest)


def _satisfiable(space: SignalSpace, index: int, true: Sequence[Guard], false: Sequence[Guard] = ()) -> bool:
    """Whether some guards can hold while others do not; taken as given where that is too much to try."""
    try:
        parts = [
            *(disjunctive_form(guard, space.others) for guard in true),
            *(disjunctive_form(guard, space.others, negated=True) for guard in false),
        ]
        clauses = joined(parts, space.others)
    except GaitTableError:
        return True
    times = {TIME: (TICK, space.window(index)[1])}
    return any(
        space.find(clause.inequalities, clause.others, times, lambda point: True) is not None
        for clause in clauses
    )


def _superfluous_finding(
    item: Transition, group: AllOf | AnyOf, member: Guard, rest: tuple[Guard, ...]
) -> Finding:
    others = (AllOf if isinstance(group, AllOf) else AnyOf)(guards=rest)
    says = "is true whenever" if isinstance(group, AllOf) else "is true only when"
    return Finding(
        rule="redundant_condition",
        severity=Severity.WARNING,
        phase=item.source,
        transition=label(item),
        reason=f"{member} {says} {others} is, so it decides nothing",
        suggestion="take it out, or correct its threshold",
    )


RULES = (threshold_beyond_limits, redundant_condition)
