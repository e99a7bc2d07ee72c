"""Scenarios of the test kit for an exit: thresholds, lists, debounce, times, priority, other phases."""

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
    """Yield all scenarios of an exit.

    A scenario has no steps if there are no measurements with which its property can be tested.
    """
    found = list(_phase_scenarios(leave))
    yield from found
    taking = [item for item in found if item.expected and item.expected[-1] == leave.index]
    if taking:
        yield from _scenarios_after_exit(leave, min(taking, key=lambda item: len(item.steps)))


def _phase_scenarios(leave: Exit) -> Iterator[ExitScenario]:
    if leave.item.is_timeout:
        time = leave.item.timeout_ticks or 0
        yield leave.scenario(
            f"timeout: fires after {time * TICK:g} s, not a tick before", _timeout_steps(leave)
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
    """Yield scenarios that reuse measurements with which the exit is taken."""
    last = taking.steps[-leave.debounce - 1 :]
    yield from _clock(leave, last)
    yield from _other_phase_scenarios(leave)
    steps = leave.search_with_margin([leave.opens], Exit.fires) or last
    alone = tuple(step._replace(vector=step.vector._replace(other_phase=None)) for step in steps)
    if leave.yields(alone):
        words = leave.table.vocabulary.member
        yield leave.scenario(f"holds without {'another leg' if words == 'phase' else f'a {words}'}", alone)
    invalid = leave.scenario("rejects signals that are NaN, infinite or missing", steps)
    yield invalid._replace(expects_rejection=True)


# ---------------------------------------------------------------------- thresholds and lists


def edges(leave: Exit, entry: Decisive) -> Iterator[ExitScenario]:
    """Yield scenarios for a condition of a guard, and for the list ``all`` or ``any`` that contains it."""
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
        description = f"any: fires by {atom} alone" if alone else f"all: holds while only {atom} is missing"
        yield _far_scenario(leave, description, entry, Requirement(atom, alone), alone)


def _below_threshold_steps(leave: Exit, entry: Decisive, atom: Comparison, past: TickInputs) -> TickInputs:
    """Return steps just below a threshold: ``past`` with one signal changed, if no other exit opens then."""
    if past and not reads_own_time(atom):
        signals = past[0].vector.signals
        moved = {**signals, atom.signal: signals.get(atom.signal, 0.0) - 2.0 * _signed_margin(atom, MARGIN)}
        steps = tuple(step._replace(vector=step.vector._replace(signals=moved)) for step in past)
        if leave.stays(steps):
            return steps
    return _edge(leave, entry, atom, -MARGIN, Exit.stays, Exit.yields)


def _signed_margin(atom: Comparison, margin: float) -> float:
    """Return the signed distance from the threshold; with a positive ``margin`` the condition is true."""
    return (margin if atom.operator == ">" else -margin) * max(1.0, abs(atom.threshold))


def _edge(leave: Exit, entry: Decisive, atom: Comparison, margin: float, *accepts: Accept) -> TickInputs:
    """Return steps of one debounce in which a condition is true by a margin; false if it is negative."""
    in_time = reads_only_own_time(atom)
    starts = _turns(leave, atom, margin > 0.0) if in_time else leave.starts(leave.debounce)
    stretch = (entry.requirements, leave.debounce)
    return first_of(
        leave.search(start, [stretch], accept, _pinned(atom, margin, start, start + leave.debounce - 1))
        for accept in accepts
        for start in starts
    )


def _turns(leave: Exit, atom: Comparison, inside: bool) -> list[int]:
    """Return the start tick of a debounce that just fits a threshold in time, or misses it by one tick.

    ``inside``: whether it fits. Returns an empty list if the phase leaves no time for it.
    """
    turn = turning_tick(atom)
    start = turn if atom.operator == ">" else turn - leave.debounce
    outward = -1 if atom.operator == ">" else 1
    start += 0 if inside else outward
    fits = leave.gate <= start and start + leave.debounce - 1 < leave.latest
    return [start] if fits else []


def _pinned(atom: Comparison, margin: float, first: int, last: int) -> list[Bound]:
    """Return bounds that fix the value of a comparison at its threshold plus a margin.

    The time in the phase is fixed at the tick of the debounce that is nearest to the threshold. There are no
    bounds for a condition on this time alone.
    """
    if reads_only_own_time(atom):
        return []
    late = (atom.operator == ">") is (margin > 0.0)
    tick = first if late is (atom.signal == TIME) else last
    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold + _signed_margin(atom, margin))
    return [item.substitute(TIME, tick * TICK) for item in pins]


def _on_threshold_steps(leave: Exit, entry: Decisive, atom: Comparison) -> TickInputs:
    """Return steps exactly on a threshold; one signal of a difference is zero, to avoid rounding."""

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
        description = f"{'fires' if inside else 'holds'} {when}"
        yield _far_scenario(leave, description, entry, Requirement(replace(atom, phases=(phase,))), inside)


def _far_scenario(
    leave: Exit, description: str, entry: Decisive, more: Requirement, opens: bool
) -> ExitScenario:
    """Return a scenario with signals far from all thresholds; ``opens``: whether the exit must be taken."""
    accepts = (Exit.fires,) if opens else (Exit.stays, Exit.yields)
    return leave.scenario(description, leave.search_with_margin([*entry.requirements, more], *accepts))


# ---------------------------------------------------------------------- time


def _debounce(leave: Exit) -> Iterator[ExitScenario]:
    """Yield scenarios of the debounce: the exit is taken after consecutive ticks with an open guard.

    One tick with a closed guard restarts the count.
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
    """Yield scenarios in which a guard opens early, and the exit waits for the minimum duration or time."""
    minimum, time = leave.table.phases[leave.item.source].minimum_ticks, leave.item.timeout_ticks
    if minimum > 1 and leave.gate == minimum:
        description = f"minimum duration: open before, fires after {minimum} ticks"
        yield leave.scenario(description, _waits(leave, minimum))
    if time is not None:
        yield leave.scenario(f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _waits(leave: Exit, until: int) -> TickInputs:
    """Return steps up to the tick ``until``, with an open guard whose debounce ends before it."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest:
        return ()
    return leave.search(start, [([leave.opens], until - start + 1)], Exit.fires)


def _timeout_steps(leave: Exit) -> TickInputs:
    """Return steps with all guards closed until a pure timeout is taken.

    There are at most ``LONGEST_RUN`` steps.
    """
    due = max(leave.item.timeout_ticks or 0, leave.debounce)
    starts = (max(1, due - LONGEST_RUN), max(1, due - leave.debounce))
    return first_of(leave.search(first, [([], due - first + 1)], Exit.fires) for first in starts)


# ---------------------------------------------------------------------- other exits and phases


def _priority(first: Exit, second: Exit) -> Iterator[ExitScenario]:
    """Yield a scenario in which two exits become due in the same tick and the first in the list is taken.

    Yields nothing if they never become due in the same tick.
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
        description = f"priority: wins over {second.item.target} ({second.item.cause}) when both are due"
        yield first.scenario(description, steps)


def _schedules(first: Exit, second: Exit) -> Iterator[tuple[int, Sequence[Stretch]]]:
    """Yield start ticks and stretches in which both exits may become due in the same tick."""
    slow, fast = (first, second) if first.debounce >= second.debounce else (second, first)
    both, due = [first.opens, second.opens], max(first.gate, second.gate)
    waits = [item for item in (first, second) if item.item.is_timeout]
    if waits:
        # The guards open so that their debounce ends in the tick of the timeout.
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
                description = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield leave.scenario(description, both)


def _steps_from_entry(leave: Exit) -> Iterator[TickInputs]:
    """Yield steps that keep an exit open from the entry until it is taken.

    For a timeout, only the last steps are yielded.
    """
    if leave.item.is_timeout:
        yield _timeout_steps(leave)[-leave.debounce - 1 :]
        return
    for requirements in [[leave.opens], *([*beside, Requirement(atom)] for atom, beside in leave.timed)]:
        inside = leave.search_with_margin(requirements, Exit.fires)
        if inside and 1 < inside[-1].tick <= LONGEST_RUN:
            steps = constant(inside[0].vector, range(1, inside[-1].tick + 1))
            taken = leave.outcomes(steps)
            due = next((step for step, index in enumerate(taken) if index is not None), 0)
            yield steps[: due + 1] if due and taken[due] == leave.index else ()


def _other_phase_scenarios(leave: Exit) -> Iterator[ExitScenario]:
    """Yield scenarios in which signals that open the exit have no effect in another phase.

    A phase is skipped if one of its own exits opens with all such signals.
    """
    for phase in leave.table.phase_names:
        if phase != leave.item.source and (steps := _idle(leave, phase)):
            description = f"holds in {phase}, which it does not leave"
            yield ExitScenario(description, phase, steps, (None,) * len(steps))


def _idle(leave: Exit, phase: str) -> TickInputs:
    """Return steps that would take the exit in its own phase, and take no exit of another phase."""
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
