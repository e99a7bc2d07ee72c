"""Rules on the graph of phases: phases that one leg reaches and leaves, and pairs that two legs reach."""

import itertools
from collections.abc import Iterator, Sequence

from twin_gait.checking.finding import CheckCase, Finding, Severity, label, once, rule, transition_finding
from twin_gait.checking.signals import OTHER_PHASE, SignalSpace, signal_space, swapped
from twin_gait.gait.feasibility import rename_signals
from twin_gait.gait.signals import OTHER, OTHER_TIME, TIME
from twin_gait.gait.table import GaitTable, Transition

Pair = tuple[str, str]
# Longest acceptable timeout of a phase; the safety monitor accepts 5 s in a phase (an assumption).
LATEST_TIMEOUT = 60.0  # [s]


def firing(case: CheckCase) -> list[Transition]:
    """Return the transitions of a table that can fire inside the limits, in their order in the table."""
    space = signal_space(case)
    return [item for index, item in enumerate(space.table.transitions) if space.can_fire(index)]


def breadth_first_paths(transitions: Sequence[Transition], start: str) -> dict[str, str | None]:
    """Search breadth first along transitions.

    Returns each phase that is reached with the phase before it, None for the start.
    """
    before: dict[str, str | None] = {start: None}
    reached = [start]
    for phase in reached:  # phases are appended while the loop runs
        found = [item.target for item in transitions if item.source == phase and item.target not in before]
        reached += dict.fromkeys(found)
        before |= dict.fromkeys(found, phase)
    return before


@rule
def unreachable_phase(case: CheckCase) -> Iterator[Finding]:
    """Find phases that no chain of transitions that can fire reaches."""
    first = case.table.phase_names[0]
    reached = {
        found
        for start in (first, *case.table.externally_entered)
        for found in breadth_first_paths(firing(case), start)
    }
    suggestion = "add or correct a transition into it, or remove the phase"
    for phase in case.table.phases:
        if phase not in reached:
            reason = f"no chain of transitions that can fire leads from {first} to {phase}"
            yield Finding(Severity.ERROR, reason, suggestion, phase=phase)


@rule
def trap(case: CheckCase) -> Iterator[Finding]:
    """Find phases, or groups of phases, that can be entered and never left."""
    table = case.table
    transitions = firing(case)
    reached = {phase: set(breadth_first_paths(transitions, phase)) for phase in table.phases}
    # If every phase that a phase reaches reaches the same phases, they are a group without a way out.
    stuck = [group for group in reached.values() if all(reached[phase] == group for phase in group)]
    groups = {tuple(phase for phase in table.phase_names if phase in group) for group in stuck}
    cycles = meant_cycles(table) if isinstance(table, GaitTable) else (table.phase_names[:1],)
    meant = [*cycles, *((phase,) for phase in table.externally_entered)]  # left from outside
    suggestion = "add a transition that leads back, or declare it under cycles if it is intended"
    for names in sorted(groups, key=lambda names: table.phase_names.index(names[0])):
        if len(table.phases) > 1 and not any(set(group) <= set(names) for group in meant):
            reason = f"{', '.join(names)} can be entered but not left"
            yield Finding(Severity.ERROR, reason, suggestion, phase=names[0])


@rule
def missing_timeout(case: CheckCase) -> Iterator[Finding]:
    """Find phases without a timeout within a minute; if no exit opens, the leg stays there forever."""
    space = signal_space(case)
    for phase in case.table.phases:
        if space.exits(phase) and space.timeout(phase) > LATEST_TIMEOUT:
            reason = (
                f"{phase} has no timeout within {LATEST_TIMEOUT:g} s: if none of its exits opens, the leg "
                "stays in it forever"
            )
            suggestion = "add a transition with after_s alone, or waive the finding if the phase is to wait"
            yield Finding(Severity.WARNING, reason, suggestion, phase=phase)


def meant_cycles(table: GaitTable) -> tuple[tuple[str, ...], ...]:
    """Return the cycles that the table declares, or one cycle of its phases in their order."""
    return table.cycles or (table.phase_names,)


@rule
def undeclared_cycle(case: CheckCase) -> Iterator[Finding]:
    """Find cycles of phases that are not intended, and declared cycles that lack a transition.

    The intended cycles are the ``cycles`` of the table; without them, its phases in their order.
    """
    table = case.gait
    transitions = firing(case)
    listed = {(item.source, item.target) for item in transitions}
    for cycle in table.cycles:
        for source, target in itertools.pairwise((*cycle, cycle[0])):
            if (source, target) not in listed:
                named = " → ".join(cycle)
                reason = f"the declared cycle {named} lacks a transition from {source} to {target}"
                suggestion = "add the transition, or correct the cycle under cycles"
                yield Finding(Severity.ERROR, reason, suggestion, phase=source)
    meant = {edge for cycle in meant_cycles(table) for edge in itertools.pairwise((*cycle, cycle[0]))}
    for item in transitions:
        before = breadth_first_paths(transitions, item.target)
        if (item.source, item.target) not in meant and item.source in before:
            reason = f"the cycle {_chain(item, before)} is neither declared nor the order of the phases"
            suggestion = "remove the transition, or declare the cycle under cycles"
            yield transition_finding(item, Severity.ERROR, reason, suggestion)


def _chain(closing: Transition, before: dict[str, str | None]) -> str:
    """Format the phases of a cycle, from the source of the transition that closes it back to that source."""
    phases = [closing.source]
    while (previous := before[phases[0]]) is not None:
        phases.insert(0, previous)
    return " → ".join([closing.source, *phases])


def starting_pairs(case: CheckCase) -> list[Pair]:
    """Return the pairs of phases in which two legs can start.

    These are the initial phases of the world; without them, one leg is in the first phase of the table and
    the other in any stance. A supervisor may send both legs into a posture.
    """
    table, starts = case.gait, case.first_phases
    left = {item.source for item in table.transitions}
    sent = [(phase, phase) for phase in table.postures if phase in left]
    if len(starts) == 2 and set(starts) <= set(table.phases):
        return [(starts[0], starts[1]), *sent]
    first = table.phase_names[0]
    stances = [phase for phase in table.phases if not table.is_swing(phase)] or [first]
    return [*((first, phase) for phase in stances), *sent]


# Phase of the other leg, and index of the transition of one leg, followed by the index of the transition that
# the other leg takes in the same tick, if any.
PairStep = tuple[str, tuple[int, ...]]


def _steps(space: SignalSpace, pair: Pair) -> Iterator[PairStep]:
    """Yield all steps out of a pair, whether signals allow them or not; the steps of one leg come first."""
    for phase, other in (pair, pair[::-1]):
        yield from ((other, (index,)) for index in space.exits(phase))
    yield from ((pair[1], taken) for taken in itertools.product(*map(space.exits, pair)))


def signals_for(space: SignalSpace, other: str, taken: tuple[int, ...]) -> dict[str, float | str] | None:
    """Return signals of the first leg and the other one that open a step; None if there are none.

    Both legs read one snapshot, ``other.phase`` is the phase before the tick, and each leg takes at most one
    transition in a tick.
    """
    first, *second = taken
    point = space.opening(first, other) if all(map(space.can_fire, taken)) else None
    if point is not None and second:
        item = space.transition(first)
        other_guard = rename_signals(
            space.transition(second[0]).guard, swapped, lambda atom: item.source in atom.phases
        )
        times = {TIME: space.window(first), OTHER_TIME: space.window(second[0])}
        point = space.first([item.guard, other_guard], times, other)
    return None if point is None else {**space.counterexample(point), OTHER_PHASE: other}


def _sorted(one: str, other: str) -> Pair:
    return min(one, other), max(one, other)


@once
def reachable_pairs(case: CheckCase) -> list[Pair]:
    """Return the pairs of phases that two legs reach with free signals; the order of the legs is ignored."""
    space = signal_space(case)
    pairs = list(dict.fromkeys(_sorted(*pair) for pair in starting_pairs(case)))
    for pair in pairs:  # breadth first: pairs are appended while the loop runs
        for other, taken in _steps(space, pair):
            entered, *others = [space.transition(index).target for index in taken]
            target = _sorted(entered, *(others or [other]))
            if target not in pairs and signals_for(space, other, taken) is not None:
                pairs.append(target)
    return pairs


@rule
def both_in_swing(case: CheckCase) -> Iterator[Finding]:
    """Find transitions by which both legs can be in swing at once under free signals.

    The finding is an error if the experiment has two legs or a guard reads the other leg. It is a warning if
    the table reads nothing of another leg and may be meant for one leg. It is a note if no name of a phase
    contains "swing", so that the rule cannot be applied. There is one finding for each transition out of
    stance that can lead to it.
    """
    if not case.has_other_leg:
        return
    swings = [phase for phase in case.table.phase_names if case.gait.is_swing(phase)]
    if not swings:
        reason = "no phase has swing in its name, so the rule cannot check whether both legs swing at once"
        yield Finding(Severity.NOTE, reason, "add the word swing to the names of the phases of swing")
        return
    space, pairs, items = signal_space(case), reachable_pairs(case), case.table.transitions
    sure = case.experiment is not None or any(OTHER in str(item.guard) for item in items)
    lifting = [
        index for index, item in enumerate(items) if item.source not in swings and item.target in swings
    ]
    for index in lifting:
        first_leg = items[index].source
        # The other leg swings already, or begins its swing in the same tick.
        steps: list[PairStep] = [(other, (index,)) for other in swings]
        for other, taken in [*steps, *((items[second].source, (index, second)) for second in lifting)]:
            found = signals_for(space, other, taken) if _sorted(first_leg, other) in pairs else None
            if found is not None:
                exits = " and ".join(dict.fromkeys(label(items[number]) for number in taken))
                together = " in the same tick" if len(taken) > 1 else ""
                reason = (
                    f"with one leg in {first_leg} and the other in {other}, {exits} can take both into "
                    f"swing{together}"
                )
                suggestion = (
                    "add other.phase in [phases of stance] to its guard, and start the legs in different "
                    "phases"
                )
                severity = Severity.ERROR if sure else Severity.WARNING
                yield transition_finding(items[index], severity, reason, suggestion, counterexample=found)
                break


@rule
def deadlock(case: CheckCase) -> Iterator[Finding]:
    """Find pairs of phases that two legs can reach and in which neither can ever switch again.

    Postures are exempt, because a supervisor may send both legs out of them.
    """
    if not case.has_other_leg or len(case.table.phases) == 1:
        return
    space = signal_space(case)
    for first, second in reachable_pairs(case):
        alone = (step for step in _steps(space, (first, second)) if len(step[1]) == 1)
        goes_on = any(signals_for(space, *step) is not None for step in alone)
        if not goes_on and not {first, second} <= set(case.gait.postures):
            reason = f"with one leg in {first} and the other in {second}, no signals let either leg switch"
            suggestion = "add a transition out of one of them for this case, or a timeout"
            yield Finding(Severity.ERROR, reason, suggestion, phase=first)


RULES = (unreachable_phase, trap, missing_timeout, undeclared_cycle, both_in_swing, deadlock)
MODE_RULES = (unreachable_phase, trap)
