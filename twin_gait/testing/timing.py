"""Scenarios in time and across phases: debounce, minimum duration, time-outs, the clock of the next phase."""

from collections.abc import Iterator, Sequence

from twin_gait.gait.feasibility import Requirement
from twin_gait.gait.guards import AllOf, Comparison
from twin_gait.gait.table import TICK, StateTable
from twin_gait.testing.exits import (
    LONGEST_RUN,
    Exit,
    Scenario,
    Window,
    comfortable,
    constant,
    decisive,
    find,
    fires,
    reads_only_own_time,
    scenario,
    shown,
)
from twin_gait.testing.reference import Step, Steps, exits, is_pure_time_out, outcomes


def debounce(leave: Exit) -> Iterator[Scenario | str]:
    """The guard has to be open on consecutive ticks; one closed tick starts the count anew."""
    ticks = leave.debounce
    if ticks == 1 or 2 * ticks > LONGEST_RUN:
        return
    steps = comfortable(leave, [Requirement(leave.item.guard)], fires)
    yield shown(leave, f"debounce: holds for {ticks - 1} ticks, fires on tick {ticks}", steps)
    yield shown(leave, f"debounce: one closed tick starts the count of {ticks} anew", _interrupted(leave))


def _interrupted(leave: Exit) -> Steps | None:
    ticks = leave.debounce
    for start in leave.starts(2 * ticks):
        window = Window(start, start + 2 * ticks - 1)
        for inside in leave.look([Requirement(leave.item.guard)], window):
            for outside in leave.look([Requirement(leave.item.guard, False)], window):
                vectors = [inside] * (ticks - 1) + [outside] + [inside] * ticks
                steps = tuple(Step(start + place, vector) for place, vector in enumerate(vectors))
                if fires(leave, steps):
                    return steps
    return None


def waiting(leave: Exit) -> Iterator[Scenario | str]:
    """A guard that is open long before waits for the minimum duration or the time, and fires in its tick."""
    if leave.minimum > 1 and leave.gate == leave.minimum:
        what = f"minimum duration: open before, fires after {leave.minimum} ticks"
        yield shown(leave, what, _waits(leave, leave.minimum))
    time = leave.item.time_out_ticks
    if time is not None:
        yield shown(leave, f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _waits(leave: Exit, until: int) -> Steps | None:
    """Steps with an open guard whose debounce is over before a tick, up to that tick."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest or leave.debounce > LONGEST_RUN:
        return None
    for vector in leave.look([Requirement(leave.item.guard)], Window(start, until)):
        steps = constant(vector, start, until)
        if fires(leave, steps):
            return steps
    return None


def from_entry(leave: Exit) -> Iterator[Scenario]:
    """Measurements that keep an exit open from the entry on: it fires once all waiting is over."""
    if leave.debounce > LONGEST_RUN:
        return
    times = [
        [*entry.requirements, Requirement(entry.atom)]
        for entry in decisive(leave.item.guard)
        if isinstance(entry.atom, Comparison) and reads_only_own_time(entry.atom)
    ]
    for requirements in ([Requirement(leave.item.guard)], *times):
        inside = comfortable(leave, requirements, fires)
        steps = None if inside is None else _since_entry(leave, inside)
        if steps is not None:
            yield scenario(leave, f"waiting: open from the entry on, fires in tick {steps[-1].tick}", steps)


def _since_entry(leave: Exit, inside: Steps) -> Steps | None:
    """The same measurements from the first tick on, until the exit is taken."""
    if not 1 < inside[-1].tick <= LONGEST_RUN:
        return None
    steps = constant(inside[0].vector, 1, inside[-1].tick)
    taken = outcomes(leave.table, leave.phase, steps)
    due = next((place for place, index in enumerate(taken) if index is not None), 0)
    return steps[: due + 1] if due and taken[due] == leave.index else None


def time_out(leave: Exit) -> Iterator[Scenario | str]:
    """With all guards closed a pure time-out fires at its tick and not before."""
    time = leave.item.time_out_ticks or 0
    what = f"time-out: fires after {time * TICK:g} s, not a tick before"
    yield shown(leave, what, _quiet(leave))


def _quiet(leave: Exit) -> Steps | None:
    """Steps with all guards closed until a pure time-out fires; the last ``LONGEST_RUN`` ticks of them."""
    due = max(leave.item.time_out_ticks or 0, leave.debounce)
    for first in (max(1, due - LONGEST_RUN), max(1, due - leave.debounce)):
        for vector in leave.look([], Window(first, due)):
            steps = constant(vector, first, due)
            if fires(leave, steps):
                return steps
    return None


def _last_wait(leave: Exit) -> Steps | None:
    """Steps about as long as its debounce before a pure time-out fires."""
    steps = _quiet(leave)
    return None if steps is None else steps[-leave.debounce - 1 :]


def clock(leave: Exit, steps: Steps) -> Iterator[Scenario]:
    """Times and debounces in the phase that follows count from its entry, which some steps lead to."""
    table, target = leave.table, leave.item.target
    for follower in (Exit(table, index) for index in exits(table, target)):
        pure = is_pure_time_out(follower.item)
        waits = [_last_wait(follower)] if pure else [item.steps for item in from_entry(follower)]
        for later in (item for item in waits if item is not None):
            both = _chain([steps, later])
            taken = [index for index in outcomes(table, leave.phase, both) if index is not None]
            if taken == [leave.index, follower.index]:
                cause = follower.item.cause
                what = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield scenario(leave, what, both)


def elsewhere(leave: Exit, phase: str) -> Iterator[Scenario]:
    """In another phase the exit does not exist; nothing if there is always something that leaves it."""
    if leave.debounce > LONGEST_RUN:
        return
    table = leave.table
    here = tuple(Requirement(table.transitions[index].guard, False) for index in exits(table, phase))
    guarded = tuple(requirement for requirement in here if requirement.guard != AllOf(guards=()))
    gate = max(leave.gate, table.phases[phase].minimum_ticks)
    for first in leave.starts(leave.debounce, gate=gate) or [gate]:
        window = Window(first, first + leave.debounce - 1)
        found = find(table.others, [Requirement(leave.item.guard), *guarded], window)
        steps = () if found is None else constant(found, *window)
        if steps and not any(index is not None for index in outcomes(table, phase, steps)):
            yield Scenario(f"holds in {phase}, which it does not leave", phase, steps, (None,) * len(steps))
            return


def again(leave: Exit) -> Iterator[Scenario]:
    """A debounce that was cut short by another exit is counted anew when the phase is entered again."""
    last = (
        comfortable(leave, [Requirement(leave.item.guard)], fires)
        if 1 < leave.debounce <= LONGEST_RUN
        else None
    )
    if last is None:
        return
    for cutter in (Exit(leave.table, index) for index in exits(leave.table, leave.phase)):
        home = _way(leave.table, cutter.item.target, leave.phase)
        if cutter.index == leave.index or home is None:
            continue
        for cut in _cuts(leave, cutter):
            steps = _chain([cut, *home, last])
            taken = [entry for entry in outcomes(leave.table, leave.phase, steps) if entry is not None]
            if taken[0] == cutter.index and taken[-1] == leave.index and len(taken) == len(home) + 2:
                what = f"debounce: {leave.debounce} ticks counted anew after {cutter.item.cause} and back"
                yield scenario(leave, what, steps)
                return


def _cuts(leave: Exit, cutter: Exit) -> Iterator[Steps]:
    """Steps with an open guard that another exit ends before the debounce is over."""
    starts, ticks = cutter.starts(cutter.debounce), cutter.debounce
    if is_pure_time_out(cutter.item):
        starts, ticks = [int(cutter.latest) - leave.debounce + 2], leave.debounce - 1
    if ticks >= leave.debounce:
        return
    requirements = [Requirement(leave.item.guard), Requirement(cutter.item.guard)]
    requirements += [
        Requirement(item.item.guard, False) for item in leave.rivals if item.index != cutter.index
    ]
    for start in (tick for tick in starts if tick >= 1):
        vector = find(leave.table.others, requirements, Window(start, start + ticks - 1))
        if vector is not None:
            yield constant(vector, start, start + ticks - 1)


def _way(table: StateTable, start: str, end: str) -> list[Steps] | None:
    """Steps that lead from one phase to another, phase by phase."""
    found: dict[str, list[Steps]] = {start: []}
    waits = [start]
    while waits and end not in found:
        phase = waits.pop(0)
        for leave in (Exit(table, index) for index in exits(table, phase)):
            target = leave.item.target
            steps = None if target in found else _taking(leave)
            if steps is not None:
                found[target] = [*found[phase], steps]
                waits.append(target)
    return found.get(end)


def _taking(leave: Exit) -> Steps | None:
    if is_pure_time_out(leave.item):
        return _last_wait(leave)
    return comfortable(leave, [Requirement(leave.item.guard)], fires)


def _chain(parts: Sequence[Steps]) -> Steps:
    """Parts one after the other, each counted from the last tick of the part before it."""
    steps: Steps = ()
    for part in parts:
        entered = steps[-1].tick if steps else 0
        steps = (*steps, *(step._replace(tick=step.tick + entered) for step in part))
    return steps
