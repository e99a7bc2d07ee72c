"""Scenarios that the kit tests for an exit: thresholds, lists, debounce, times, priority, other phases."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from twin_gait.gait.feasibility import ZERO, Bound, Requirement, equal
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, PhaseMembership
from twin_gait.gait.signals import TIME, signal_scale
from twin_gait.gait.table import TICK
from twin_gait.testing.exits import (
    LONGEST_RUN,
    Accept,
    Decisive,
    Exit,
    ExitScenario,
    Stretch,
    constant,
    decisive,
    exits_of,
    find_measurements,
    first_of,
    reads_only_own_time,
    reads_own_time,
    turning_tick,
)
from twin_gait.testing.reference import TickInputs, outcomes

MARGIN = 1e-9  # distance from a threshold, relative to it or to 1, in the unit of the table


def scenarios(leave: Exit) -> Iterator[ExitScenario]:
    """Yield all scenarios of an exit; a scenario has no steps if no measurements can test its property."""
    found = list(_phase_scenarios(leave))
    yield from found
    taking = [item for item in found if item.expected and item.expected[-1] == leave.index]
    if taking:
        yield from _scenarios_after_exit(leave, min(taking, key=lambda item: len(item.steps)))


def _phase_scenarios(leave: Exit) -> Iterator[ExitScenario]:
    if leave.item.is_timeout:
        time = leave.item.timeout_ticks or 0
        yield leave.scenario(
            f"time-out: fires after {time * TICK:g} s, not a tick before", _timeout_steps(leave)
        )
    else:
        for entry in decisive(leave.item.guard):
            yield from edges(leave, entry)
        yield from _debounce(leave)
        yield from _waiting(leave)
    for second in leave.siblings:
        if second.index > leave.index:
            yield from _priority(leave, second)


def _scenarios_after_exit(leave: Exit, taking: ExitScenario) -> Iterator[ExitScenario]:
    """Yield scenarios that start from measurements with which the exit is taken."""
    last = taking.steps[-leave.debounce - 1 :]
    yield from _clock(leave, last)
    yield from _other_phase_scenarios(leave)
    steps = leave.search_with_margin([leave.opens], Exit.fires) or last
    alone = tuple(step._replace(vector=step.vector._replace(other_phase=None)) for step in steps)
    if leave.yields(alone):
        words = leave.table.vocabulary.member
        yield leave.scenario(f"holds without {'another leg' if words == 'phase' else f'a {words}'}", alone)
    refused = leave.scenario("refuses signals that are NaN, infinite or missing", steps)
    yield refused._replace(expects_rejection=True)


# ---------------------------------------------------------------------- thresholds and lists


def edges(leave: Exit, entry: Decisive) -> Iterator[ExitScenario]:
    """Yield scenarios for one condition of a guard, and for the list that contains it."""
    atom = entry.atom
    if isinstance(atom, PhaseMembership):
        yield from _memberships(leave, entry, atom)
    else:
        past = _edge(leave, entry, atom, MARGIN, Exit.fires)
        yield leave.scenario(f"fires just past {atom}", past)
        yield leave.scenario(f"holds just below {atom}", _below_threshold_steps(leave, entry, atom, past))
        on = () if reads_own_time(atom) else _on_threshold_steps(leave, entry, atom)
        if on:
            yield leave.scenario(f"holds on the threshold of {atom}", on)
    if entry.group is not None:
        alone = isinstance(entry.group, AnyOf)
        what = f"any: fires by {atom} alone" if alone else f"all: holds while only {atom} is missing"
        yield _far_scenario(leave, what, entry, Requirement(atom, alone), alone)


def _below_threshold_steps(leave: Exit, entry: Decisive, atom: Comparison, past: TickInputs) -> TickInputs:
    """Return the same measurements with that one signal moved, or others if a rival opens there."""
    if past and not reads_own_time(atom):
        signals = past[0].vector.signals
        moved = {**signals, atom.signal: signals.get(atom.signal, 0.0) - 2.0 * _signed_margin(atom, MARGIN)}
        steps = tuple(step._replace(vector=step.vector._replace(signals=moved)) for step in past)
        if leave.stays(steps):
            return steps
    return _edge(leave, entry, atom, -MARGIN, Exit.stays, Exit.yields)


def _signed_margin(atom: Comparison, margin: float) -> float:
    """Return the distance above the threshold, negative below, for a margin into the open side."""
    return (margin if atom.operator == ">" else -margin) * max(1.0, abs(atom.threshold))


def _edge(leave: Exit, entry: Decisive, atom: Comparison, margin: float, *accepts: Accept) -> TickInputs:
    """Return steps, one debounce long, with a condition inside by a margin (outside if it is negative)."""
    in_time = reads_only_own_time(atom)
    starts = _turns(leave, atom, margin > 0.0) if in_time else leave.starts(leave.debounce)
    stretch = (entry.requirements, leave.debounce)
    return first_of(
        leave.search(start, [stretch], accept, _pinned(atom, margin, start, start + leave.debounce - 1))
        for accept in accepts
        for start in starts
    )


def _turns(leave: Exit, atom: Comparison, inside: bool) -> list[int]:
    """Return the start of the debounce that just fits, or just does not fit, a threshold in time."""
    turn = turning_tick(atom)
    start = turn if atom.operator == ">" else turn - leave.debounce
    outward = -1 if atom.operator == ">" else 1
    start += 0 if inside else outward
    fits = leave.gate <= start and start + leave.debounce - 1 < leave.latest
    return [start] if fits else []


def _pinned(atom: Comparison, margin: float, first: int, last: int) -> list[Bound]:
    """Return bounds that fix a difference at its edge, at the nearest tick; none for a time alone."""
    if reads_only_own_time(atom):
        return []
    late = (atom.operator == ">") is (margin > 0.0)
    tick = first if late is (atom.signal == TIME) else last
    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold + _signed_margin(atom, margin))
    return [item.substitute(TIME, tick * TICK) for item in pins]


def _on_threshold_steps(leave: Exit, entry: Decisive, atom: Comparison) -> TickInputs:
    """Return steps exactly on a threshold; one signal of a difference is zero, so that no digit is lost."""

    def on(leave: Exit, steps: TickInputs) -> bool:
        signals = steps[0].vector.signals
        scale = signal_scale(atom.signal)
        minus = 0.0 if atom.minus is None else signals[atom.minus] * scale
        exact = signals[atom.signal] * scale - minus == atom.threshold * scale
        return exact and leave.yields(steps)

    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold)
    ends = [] if atom.minus is None else [atom.signal, atom.minus]
    zeros = [equal(name, ZERO, 0.0) for name in ends] or [[]]
    return first_of(leave.search_with_margin(entry.requirements, on, pinned=[*pins, *zero]) for zero in zeros)


def _memberships(leave: Exit, entry: Decisive, atom: PhaseMembership) -> Iterator[ExitScenario]:
    words = leave.table.vocabulary.member
    for phase in leave.table.members:
        inside = phase in atom.phases
        when = f"while the other leg is in {phase}" if words == "phase" else f"on the {words} {phase}"
        what = f"{'fires' if inside else 'holds'} {when}"
        yield _far_scenario(leave, what, entry, Requirement(replace(atom, phases=(phase,))), inside)


def _far_scenario(leave: Exit, what: str, entry: Decisive, more: Requirement, opens: bool) -> ExitScenario:
    """Return a scenario in which the exit is taken, or not, with a condition far from its thresholds."""
    accepts = (Exit.fires,) if opens else (Exit.stays, Exit.yields)
    return leave.scenario(what, leave.search_with_margin([*entry.requirements, more], *accepts))


# ---------------------------------------------------------------------- time


def _debounce(leave: Exit) -> Iterator[ExitScenario]:
    """Yield scenarios of the debounce: the guard has to be open on consecutive ticks.

    One closed tick restarts the count.
    """
    ticks = leave.debounce
    if ticks == 1:
        return
    steps = leave.search_with_margin([leave.opens], Exit.fires)
    yield leave.scenario(f"debounce: holds for {ticks - 1} ticks, fires on tick {ticks}", steps)
    stretches = [([leave.opens], ticks - 1), ([leave.closes], 1), ([leave.opens], ticks)]
    steps = first_of(leave.search(start, stretches, Exit.fires) for start in leave.starts(2 * ticks))
    yield leave.scenario(f"debounce: one closed tick starts the count of {ticks} anew", steps)


def _waiting(leave: Exit) -> Iterator[ExitScenario]:
    """Yield scenarios in which an early open guard waits for the minimum duration or the time, then fires."""
    minimum, time = leave.table.phases[leave.item.source].minimum_ticks, leave.item.timeout_ticks
    if minimum > 1 and leave.gate == minimum:
        what = f"minimum duration: open before, fires after {minimum} ticks"
        yield leave.scenario(what, _waits(leave, minimum))
    if time is not None:
        yield leave.scenario(f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _waits(leave: Exit, until: int) -> TickInputs:
    """Return steps with an open guard whose debounce is over before a tick, up to that tick."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest:
        return ()
    return leave.search(start, [([leave.opens], until - start + 1)], Exit.fires)


def _timeout_steps(leave: Exit) -> TickInputs:
    """Return steps with all guards closed until a pure time-out fires.

    These are at most the last ``LONGEST_RUN`` ticks before it.
    """
    due = max(leave.item.timeout_ticks or 0, leave.debounce)
    starts = (max(1, due - LONGEST_RUN), max(1, due - leave.debounce))
    return first_of(leave.search(first, [([], due - first + 1)], Exit.fires) for first in starts)


# ---------------------------------------------------------------------- other exits and phases


def _priority(first: Exit, second: Exit) -> Iterator[ExitScenario]:
    """Yield a scenario in which both exits become due in the same tick: the one listed first is taken.

    Yields nothing if they never become due together.
    """
    items = list(first.table.transitions)
    items[first.index], items[second.index] = items[second.index], items[first.index]
    swapped = Exit(replace(first.table, transitions=tuple(items)), first.index)

    def wins(leave: Exit, steps: TickInputs) -> bool:
        """Return whether the first exit is taken, and the second one if their order is swapped."""
        return leave.fires(steps) and swapped.fires(steps)

    sparing = replace(first, ignored_rival=second.index)
    steps = first_of(sparing.search(*schedule, wins) for schedule in _schedules(first, second))
    if steps:
        what = f"priority: wins over {second.item.target} ({second.item.cause}) when both are due"
        yield first.scenario(what, steps)


def _schedules(first: Exit, second: Exit) -> Iterator[tuple[int, Sequence[Stretch]]]:
    """Yield start ticks and stretches in which both exits may become due in the same tick."""
    slow, fast = (first, second) if first.debounce >= second.debounce else (second, first)
    both, due = [first.opens, second.opens], max(first.gate, second.gate)
    waits = [item for item in (first, second) if item.item.is_timeout]
    if waits:
        # A guard opens so that its debounce ends with the time-out.
        guarded = [item for item in (first, second) if not item.item.is_timeout]
        due, ticks = int(first.latest), max((item.debounce for item in guarded), default=1)
        lead = max(0, min(due - ticks, max(item.debounce for item in waits)))
        closed = [item.closes for item in guarded]
        yield due - ticks - lead + 1, [(closed, lead), (both, ticks)]
        return
    # Both guards are open earlier, and at least one waits for the tick in which both are due.
    start = max(1, due - slow.debounce - 1)
    yield start, [(both, due - start + 1)]
    # The guard with the longer debounce opens earlier, so that both debounces end together.
    for start in slow.starts(slow.debounce, gate=max(1, due - slow.debounce + 1)):
        yield start, [([slow.opens, fast.closes], slow.debounce - fast.debounce), (both, fast.debounce)]


def _clock(leave: Exit, before: TickInputs) -> Iterator[ExitScenario]:
    """Yield scenarios in which times and debounces of the next phase count from its entry.

    ``before``: steps that lead to the entry.
    """
    target = leave.item.target
    for follower in exits_of(leave.table, target):
        for later in filter(None, _steps_from_entry(follower)):
            both = (*before, *(step._replace(tick=step.tick + before[-1].tick) for step in later))
            taken = [index for index in leave.outcomes(both) if index is not None]
            if taken == [leave.index, follower.index]:
                cause = follower.item.cause
                what = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield leave.scenario(what, both)


def _steps_from_entry(leave: Exit) -> Iterator[TickInputs]:
    """Yield steps that keep an exit open from the entry until it is taken; for a time-out, its last wait."""
    if leave.item.is_timeout:
        yield _timeout_steps(leave)[-leave.debounce - 1 :]
        return
    for requirements in [[leave.opens], *([*beside, Requirement(atom)] for atom, beside in leave.timed)]:
        inside = leave.search_with_margin(requirements, Exit.fires)
        if inside and 1 < inside[-1].tick <= LONGEST_RUN:
            steps = constant(inside[0].vector, range(1, inside[-1].tick + 1))
            taken = leave.outcomes(steps)
            due = next((place for place, index in enumerate(taken) if index is not None), 0)
            yield steps[: due + 1] if due and taken[due] == leave.index else ()


def _other_phase_scenarios(leave: Exit) -> Iterator[ExitScenario]:
    """Yield scenarios in which the exit does not exist in another phase.

    Phases that another exit always leaves are skipped.
    """
    for phase in leave.table.phase_names:
        if phase != leave.item.source and (steps := _idle(leave, phase)):
            what = f"holds in {phase}, which it does not leave"
            yield ExitScenario(what, phase, steps, (None,) * len(steps))


def _idle(leave: Exit, phase: str) -> TickInputs:
    """Return steps in another phase with which an exit would be taken in its own, and no exit is open."""
    table = leave.table
    closed = [item.closes for item in exits_of(table, phase) if item.item.guard != AllOf(guards=())]
    gate = max(leave.gate, table.phases[phase].minimum_ticks)
    for first in leave.starts(leave.debounce, gate=gate) or [gate]:
        ticks = range(first, first + leave.debounce)
        found = find_measurements(table.members or (None,), [leave.opens, *closed], ticks)
        steps = () if found is None else constant(found, ticks)
        if steps and not any(index is not None for index in outcomes(table, phase, steps)):
            return steps
    return ()
