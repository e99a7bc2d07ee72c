"""Scenarios in time and across phases: debounce, minimum duration, time-outs, the clock of the next phase."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from twin_gait.gait.feasibility import Requirement
from twin_gait.gait.guards import AllOf
from twin_gait.gait.table import TICK, StateTable
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
    if leave.minimum > 1 and leave.gate == leave.minimum:
        what = f"minimum duration: open before, fires after {leave.minimum} ticks"
        yield leave.scenario(what, _waits(leave, leave.minimum))
    time = leave.item.time_out_ticks
    if time is not None:
        yield leave.scenario(f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _waits(leave: Exit, until: int) -> Steps:
    """Steps with an open guard whose debounce is over before a tick, up to that tick."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest or leave.debounce > LONGEST_RUN:
        return ()
    return leave.search(start, [([leave.opens], until - start + 1)], Exit.fires)


def from_entry(leave: Exit) -> Iterator[Scenario]:
    """Measurements that keep an exit open from the entry on: it fires once all waiting is over."""
    if leave.debounce > LONGEST_RUN:
        return
    times = [[*beside, Requirement(atom)] for atom, beside in leave.timed]
    for requirements in ([leave.opens], *times):
        steps = _since_entry(leave, leave.comfortable(requirements, Exit.fires))
        if steps:
            yield leave.scenario(f"waiting: open from the entry on, fires in tick {steps[-1].tick}", steps)


def _since_entry(leave: Exit, inside: Steps) -> Steps:
    """The same measurements from the first tick on, until the exit is taken."""
    if not inside or not 1 < inside[-1].tick <= LONGEST_RUN:
        return ()
    steps = constant(inside[0].vector, 1, inside[-1].tick)
    taken = leave.outcomes(steps)
    due = next((place for place, index in enumerate(taken) if index is not None), 0)
    return steps[: due + 1] if due and taken[due] == leave.index else ()


def time_out(leave: Exit) -> Iterator[Scenario]:
    """With all guards closed a pure time-out fires at its tick and not before."""
    time = leave.item.time_out_ticks or 0
    yield leave.scenario(f"time-out: fires after {time * TICK:g} s, not a tick before", _quiet(leave))


def _quiet(leave: Exit) -> Steps:
    """Steps with all guards closed until a pure time-out fires; the last ``LONGEST_RUN`` ticks of them."""
    due = max(leave.item.time_out_ticks or 0, leave.debounce)
    starts = (max(1, due - LONGEST_RUN), max(1, due - leave.debounce))
    return first_of(leave.search(first, [([], due - first + 1)], Exit.fires) for first in starts)


def _last_wait(leave: Exit) -> Steps:
    """Steps about as long as its debounce before a pure time-out fires."""
    return _quiet(leave)[-leave.debounce - 1 :]


def clock(leave: Exit, steps: Steps) -> Iterator[Scenario]:
    """Times and debounces in the phase that follows count from its entry, which some steps lead to."""
    table, target = leave.table, leave.item.target
    for follower in exits_of(table, target):
        pure = follower.item.is_time_out
        waits = [_last_wait(follower)] if pure else [item.steps for item in from_entry(follower)]
        for later in filter(None, waits):
            both = _chain([steps, later])
            taken = [index for index in leave.outcomes(both) if index is not None]
            if taken == [leave.index, follower.index]:
                cause = follower.item.cause
                what = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield leave.scenario(what, both)


def elsewhere(leave: Exit, phase: str) -> Iterator[Scenario]:
    """In another phase the exit does not exist; nothing if there is always something that leaves it."""
    if leave.debounce > LONGEST_RUN:
        return
    table = leave.table
    closed = [item.closes for item in exits_of(table, phase) if item.item.guard != AllOf(guards=())]
    gate = max(leave.gate, table.phases[phase].minimum_ticks)
    for first in leave.starts(leave.debounce, gate=gate) or [gate]:
        window = Window(first, first + leave.debounce - 1)
        found = find(table.others, [leave.opens, *closed], window)
        steps = () if found is None else constant(found, *window)
        if steps and not any(index is not None for index in outcomes(table, phase, steps)):
            yield Scenario(f"holds in {phase}, which it does not leave", phase, steps, (None,) * len(steps))
            return


def again(leave: Exit) -> Iterator[Scenario]:
    """A debounce that was cut short by another exit is counted anew when the phase is entered again."""
    if not 1 < leave.debounce <= LONGEST_RUN:
        return
    last = leave.comfortable([leave.opens], Exit.fires)
    for cutter in leave.siblings:
        home = _way(leave.table, cutter.item.target, leave.phase)
        if not last or cutter.index == leave.index or home is None:
            continue
        for cut in _cuts(leave, cutter):
            steps = _chain([cut, *home, last])
            taken = [entry for entry in leave.outcomes(steps) if entry is not None]
            if taken[0] == cutter.index and taken[-1] == leave.index and len(taken) == len(home) + 2:
                what = f"debounce: {leave.debounce} ticks counted anew after {cutter.item.cause} and back"
                yield leave.scenario(what, steps)
                return


def _cuts(leave: Exit, cutter: Exit) -> Iterator[Steps]:
    """Steps with an open guard that another exit ends before the debounce is over."""
    starts, ticks = cutter.starts(cutter.debounce), cutter.debounce
    if cutter.item.is_time_out:
        starts, ticks = [int(cutter.latest) - leave.debounce + 2], leave.debounce - 1
    if ticks < leave.debounce:
        sparing, stretch = replace(cutter, spared=leave.index), ([leave.opens, cutter.opens], ticks)
        yield from filter(None, (sparing.search(start, [stretch], Exit.fires) for start in starts))


def _way(table: StateTable, start: str, end: str) -> list[Steps] | None:
    """Steps that lead from one phase to another, phase by phase."""
    found: dict[str, list[Steps]] = {start: []}
    waits = [start]
    while waits and end not in found:
        phase = waits.pop(0)
        for leave in exits_of(table, phase):
            target = leave.item.target
            steps = () if target in found else _taking(leave)
            if steps:
                found[target] = [*found[phase], steps]
                waits.append(target)
    return found.get(end)


def _taking(leave: Exit) -> Steps:
    return _last_wait(leave) if leave.item.is_time_out else leave.comfortable([leave.opens], Exit.fires)


def _chain(parts: Sequence[Steps]) -> Steps:
    """Parts one after the other, each counted from the last tick of the part before it."""
    steps: Steps = ()
    for part in parts:
        entered = steps[-1].tick if steps else 0
        steps = (*steps, *(step._replace(tick=step.tick + entered) for step in part))
    return steps
