"""The graph of phases: what is reached, what is left again, and in which cycles."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from twin_gait.checking.ambiguity import can_fire
from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.checking.signals import SignalSpace
from twin_gait.gait.table import GaitTable, Transition


def firing(subject: Subject) -> list[Transition]:
    """Transitions of a table that can fire inside the limits, in its order."""
    space = SignalSpace(subject)
    return [item for index, item in enumerate(space.table.transitions) if can_fire(space, index)]


def path(transitions: Sequence[Transition], start: str, goal: str | None = None) -> dict[str, str | None]:
    """Search breadth first along transitions.

    Args:
        transitions: The transitions.
        start: Phase to start from.
        goal: Phase to stop at; None to find all.

    Returns:
        For each phase that is found the phase before it, None for the start.
    """
    before: dict[str, str | None] = {start: None}
    waiting = deque([start])
    while waiting and goal not in before:
        phase = waiting.popleft()
        for item in transitions:
            if item.source == phase and item.target not in before:
                before[item.target] = phase
                waiting.append(item.target)
    return before


def unreachable_phase(subject: Subject) -> list[Finding]:
    """No chain of transitions that can fire reaches a phase.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such phase.
    """
    transitions = firing(subject)
    first = subject.table.phase_names[0]
    reached = set(path(transitions, first))
    return [
        Finding(
            rule="unreachable_phase",
            severity=Severity.ERROR,
            phase=phase,
            reason=f"no chain of transitions that can fire leads from {first} to {phase}",
            suggestion="add or correct a transition into it, or take the phase out",
        )
        for phase in subject.table.phases
        if phase not in reached
    ]


def trap(subject: Subject) -> list[Finding]:
    """A phase, or a group of phases, can be entered and never left.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such group that holds no whole cycle that is meant.
    """
    table = subject.table
    transitions = firing(subject)
    reached = {phase: set(path(transitions, phase)) for phase in table.phases}
    findings = []
    # What a phase reaches and nothing beyond leads back to: a group without a way out.
    groups = {
        frozenset(group) for group in reached.values() if all(reached[phase] == group for phase in group)
    }
    for group in sorted(groups, key=lambda group: table.phase_names.index(_first(table, group))):
        if any(set(cycle) <= group for cycle in meant_cycles(table)) or len(table.phases) == 1:
            continue
        names = [phase for phase in table.phase_names if phase in group]
        findings.append(
            Finding(
                rule="trap",
                severity=Severity.ERROR,
                phase=names[0],
                reason=f"{', '.join(names)} can be entered but not left",
                suggestion="add a transition that leads back, or declare it under cycles if it is meant",
            )
        )
    return findings


def _first(table: GaitTable, group: frozenset[str]) -> str:
    return next(phase for phase in table.phase_names if phase in group)


def missing_time_out(subject: Subject) -> list[Finding]:
    """A phase has no time-out: if its exits stay shut, the leg stays in it for ever.

    Args:
        subject: What is checked.

    Returns:
        A finding for each phase that is left, but by no time-out.
    """
    table = subject.table
    return [
        Finding(
            rule="missing_time_out",
            severity=Severity.WARNING,
            phase=phase,
            reason=f"{phase} has no time-out: if none of its exits opens, the leg stays in it for ever",
            suggestion=f"add a transition from {phase} with after_s alone, or waive it if the leg is to wait",
        )
        for phase in table.phases
        if (leaving := [item for item in table.transitions if item.source == phase])
        and not any(item.is_time_out for item in leaving)
    ]


def meant_cycles(table: GaitTable) -> tuple[tuple[str, ...], ...]:
    """Cycles that the table declares, or its phases in their order."""
    return table.cycles or (table.phase_names,)


def undeclared_cycle(subject: Subject) -> list[Finding]:
    """Phases can be passed in a cycle that is not meant, or a declared cycle lacks a transition.

    Meant are the ``cycles`` of the table; without them its phases in their order.

    Args:
        subject: What is checked.

    Returns:
        A finding for each transition that closes such a cycle, and for each gap in a declared one.
    """
    table = subject.table
    transitions = firing(subject)
    meant = {
        edge for cycle in meant_cycles(table) for edge in zip(cycle, (*cycle[1:], cycle[0]), strict=True)
    }
    findings = _gaps(table, transitions)
    for item in transitions:
        before = path(transitions, item.target, item.source)
        if (item.source, item.target) in meant or item.source not in before:
            continue
        findings.append(
            Finding(
                rule="undeclared_cycle",
                severity=Severity.ERROR,
                phase=item.source,
                transition=label(item),
                reason=f"the cycle {_chain(item, before)} is not one that is meant",
                suggestion="take the transition out, or declare the cycle under cycles",
            )
        )
    return findings


def _chain(closing: Transition, before: dict[str, str | None]) -> str:
    """Phases of a cycle, from the source of the transition that closes it back to that source."""
    phases = [closing.source]
    previous: str | None = closing.source
    while (previous := before[previous]) is not None:  # type: ignore[index]  # the loop ends at None
        phases.insert(0, previous)
    return " → ".join([closing.source, *phases])


def _gaps(table: GaitTable, transitions: Sequence[Transition]) -> list[Finding]:
    edges = {(item.source, item.target) for item in transitions}
    return [
        Finding(
            rule="undeclared_cycle",
            severity=Severity.ERROR,
            phase=source,
            reason=f"the declared cycle {' → '.join(cycle)} lacks a transition from {source} to {target}",
            suggestion="add the transition, or correct the cycle under cycles",
        )
        for cycle in table.cycles
        for source, target in zip(cycle, (*cycle[1:], cycle[0]), strict=True)
        if (source, target) not in edges
    ]


RULES = (unreachable_phase, trap, missing_time_out, undeclared_cycle)
