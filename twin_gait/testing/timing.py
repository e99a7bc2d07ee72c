"""Scenarios in time and across phases: debounce, minimum duration, time-outs, the clock of the next phase."""

from collections.abc import Iterator

from twin_gait.gait.feasibility import Requirement
from twin_gait.gait.guards import AllOf
from twin_gait.gait.table import TICK
from twin_gait.testing.exits import LONGEST_RUN, Exit, Scenario, Window, constant, exits_of, find, first_of
from twin_gait.testing.reference import Steps, outcomes


def debounce(leave: Exit) -> Iterator[Scenario]:
    """The guard has to be open on consecutive ticks; one closed tick starts the count anew."""
    ticks = leave.debounce
    if ticks == 1 or 2 * ticks > LONGEST_RUN:
        return
    steps = leave.comfortable([leave.opens], Exit.fires)
    yield leave.scenario(f"debounce: holds for {ticks - 1} ticks, fires on tick {ticks}", steps)
    stretches = [([leave.opens], ticks - 1), ([leave.closes], 1), ([leave.opens], ticks)]
    steps = first_of(leave.search(start, stretches, Exit.fires) for start in leave.starts(2 * ticks))
    yield leave.scenario(f"debounce: one closed tick starts the count of {ticks} anew", steps)


def waiting(leave: Exit) -> Iterator[Scenario]:
    """A guard that is open long before waits for the minimum duration or the time, and fires in its tick."""
    minimum = leave.table.phases[leave.phase].minimum_ticks
    if minimum > 1 and leave.gate == minimum:
        what = f"minimum duration: open before, fires after {minimum} ticks"
        yield leave.scenario(what, _waits(leave, minimum))
    time = leave.item.time_out_ticks
    if time is not None:
        yield leave.scenario(f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _waits(leave: Exit, until: int) -> Steps:
    """Steps with an open guard whose debounce is over before a tick, up to that tick."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest or leave.debounce > LONGEST_RUN:
        return ()
    return leave.search(start, [([leave.opens], until - start + 1)], Exit.fires)


def time_out(leave: Exit) -> Iterator[Scenario]:
    """With all guards closed a pure time-out fires at its tick and not before."""
    time = leave.item.time_out_ticks or 0
    yield leave.scenario(f"time-out: fires after {time * TICK:g} s, not a tick before", _quiet(leave))


def _quiet(leave: Exit) -> Steps:
    """Steps with all guards closed until a pure time-out fires; the last ``LONGEST_RUN`` ticks of them."""
    due = max(leave.item.time_out_ticks or 0, leave.debounce)
    starts = (max(1, due - LONGEST_RUN), max(1, due - leave.debounce))
    return first_of(leave.search(first, [([], due - first + 1)], Exit.fires) for first in starts)


def clock(leave: Exit, before: Steps) -> Iterator[Scenario]:
    """Times and debounces in the phase that follows count from its entry, which some steps lead to."""
    table, target = leave.table, leave.item.target
    for follower in exits_of(table, target):
        for later in filter(None, _from_entry(follower)):
            both = (*before, *(step._replace(tick=step.tick + before[-1].tick) for step in later))
            taken = [index for index in leave.outcomes(both) if index is not None]
            if taken == [leave.index, follower.index]:
                cause = follower.item.cause
                what = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield leave.scenario(what, both)


def _from_entry(leave: Exit) -> Iterator[Steps]:
    """Steps that keep an exit open from the entry on until it is taken; its last wait if it is a time-out."""
    if leave.item.is_time_out:
        yield _quiet(leave)[-leave.debounce - 1 :]
        return
    for requirements in [[leave.opens], *([*beside, Requirement(atom)] for atom, beside in leave.timed)]:
        inside = leave.comfortable(requirements, Exit.fires) if leave.debounce <= LONGEST_RUN else ()
        if inside and 1 < inside[-1].tick <= LONGEST_RUN:
            steps = constant(inside[0].vector, 1, inside[-1].tick)
            taken = leave.outcomes(steps)
            due = next((place for place, index in enumerate(taken) if index is not None), 0)
            yield steps[: due + 1] if due and taken[due] == leave.index else ()


def elsewhere(leave: Exit) -> Iterator[Scenario]:
    """In another phase the exit does not exist; nothing if there is always something that leaves it."""
    if leave.debounce <= LONGEST_RUN:
        others = (phase for phase in leave.table.phase_names if phase != leave.phase)
        yield from (
            Scenario(f"holds in {phase}, which it does not leave", phase, steps, (None,) * len(steps))
            for phase in others
            if (steps := _idle(leave, phase))
        )


def _idle(leave: Exit, phase: str) -> Steps:
    """Steps in another phase with which an exit would be taken in its own, and nothing is there."""
    table = leave.table
    closed = [item.closes for item in exits_of(table, phase) if item.item.guard != AllOf(guards=())]
    gate = max(leave.gate, table.phases[phase].minimum_ticks)
    for first in leave.starts(leave.debounce, gate=gate) or [gate]:
        window = Window(first, first + leave.debounce - 1)
        found = find(table.members or (None,), [leave.opens, *closed], window)
        steps = () if found is None else constant(found, *window)
        if steps and not any(index is not None for index in outcomes(table, phase, steps)):
            return steps
    return ()
