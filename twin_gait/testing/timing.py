"""Scenarios in time: debounce, minimum duration, time-outs, and the clock of the next phase."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from twin_gait.gait.guards import Comparison
from twin_gait.gait.table import TICK
from twin_gait.testing.edges import Steps, comfortable, fires, scenario
from twin_gait.testing.leaving import LONGEST_RUN, Exit, Scenario, constant, decisive
from twin_gait.testing.solver import Window, Wish, reads_only_own_time
from twin_gait.testing.witness import Step, exits, is_pure_time_out, outcomes


def debounce(leave: Exit) -> Iterator[Scenario | str]:
    """The guard has to be open on consecutive ticks; one closed tick starts the count anew.

    Args:
        leave: An exit with a guard.

    Yields:
        Scenarios, or the name of one that no measurements can show; nothing without a debounce.
    """
    ticks = leave.debounce
    if ticks == 1 or 2 * ticks > LONGEST_RUN:
        return
    steps = comfortable(leave, [Wish(leave.item.guard)], fires)
    first = f"debounce: holds for {ticks - 1} ticks, fires on tick {ticks}"
    yield first if steps is None else scenario(leave, first, steps)
    again = f"debounce: one closed tick starts the count of {ticks} anew"
    interrupted = _interrupted(leave)
    yield again if interrupted is None else scenario(leave, again, interrupted)


def _interrupted(leave: Exit) -> Steps | None:
    ticks = leave.debounce
    for start in leave.starts(2 * ticks):
        window = Window(start, start + 2 * ticks - 1)
        for inside in leave.look([Wish(leave.item.guard)], window):
            for outside in leave.look([Wish(leave.item.guard, False)], window):
                vectors = [inside] * (ticks - 1) + [outside] + [inside] * ticks
                steps = tuple(Step(start + place, vector) for place, vector in enumerate(vectors))
                if fires(leave, steps):
                    return steps
    return None


def minimum_duration(leave: Exit) -> Iterator[Scenario | str]:
    """A guard that is open long before waits for the minimum duration in the phase, and fires in its tick.

    Args:
        leave: An exit with a guard.

    Yields:
        A scenario, or its name if something else decides; nothing without a minimum duration.
    """
    if leave.minimum > 1 and leave.gate == leave.minimum:
        what = f"minimum duration: open before, fires after {leave.minimum} ticks"
        yield _or_name(leave, what, _waits(leave, leave.minimum))


def waiting(leave: Exit) -> Iterator[Scenario | str]:
    """An exit with a guard and a time waits for the time, and fires in its tick.

    Args:
        leave: An exit with a guard.

    Yields:
        A scenario, or its name if something else decides; nothing without a time.
    """
    time = leave.item.time_out_ticks
    if time is not None:
        yield _or_name(leave, f"time: open before, fires after {time * TICK:g} s", _waits(leave, time))


def _or_name(leave: Exit, what: str, steps: Steps | None) -> Scenario | str:
    return what if steps is None else scenario(leave, what, steps)


def _waits(leave: Exit, until: int) -> Steps | None:
    """Steps with an open guard whose debounce is over before a tick, up to that tick."""
    start = max(1, until - leave.debounce - 1)
    if start + leave.debounce - 1 >= until or until >= leave.latest or leave.debounce > LONGEST_RUN:
        return None
    window = Window(start, until)
    for vector in leave.look([Wish(leave.item.guard)], window):
        steps = constant(vector, start, until)
        if fires(leave, steps):
            return steps
    return None


def from_entry(leave: Exit) -> Iterator[Scenario]:
    """Measurements that keep an exit open from the entry on: it fires once all waiting is over.

    Args:
        leave: An exit with a guard.

    Yields:
        A scenario; nothing if it fires at once, or a rival is taken before.
    """
    if leave.debounce > LONGEST_RUN:
        return
    times = [
        [*entry.wishes, Wish(entry.atom)]
        for entry in decisive(leave.item.guard)
        if isinstance(entry.atom, Comparison) and reads_only_own_time(entry.atom)
    ]
    for wishes in ([Wish(leave.item.guard)], *times):
        inside = comfortable(leave, wishes, fires)
        steps = None if inside is None else _since_entry(leave, inside)
        if steps is not None:
            what = f"waiting: open from the entry on, fires in tick {steps[-1].tick}"
            yield scenario(leave, what, steps)


def _since_entry(leave: Exit, inside: Steps) -> Steps | None:
    """The same measurements from the first tick on, until the exit is taken."""
    if not 1 < inside[-1].tick <= LONGEST_RUN:
        return None
    steps = constant(inside[0].vector, 1, inside[-1].tick)
    taken = outcomes(leave.table, leave.phase, steps)
    due = next((place for place, index in enumerate(taken) if index is not None), 0)
    return steps[: due + 1] if due and taken[due] == leave.index else None


def time_out(leave: Exit) -> Iterator[Scenario | str]:
    """With all guards closed a time-out fires at its tick and not before.

    Args:
        leave: A pure time-out.

    Yields:
        A scenario, or its name if the phase is always left otherwise.
    """
    time = leave.item.time_out_ticks
    assert time is not None  # the caller hands in pure time-outs
    due = max(time, leave.debounce)
    yield _or_name(leave, f"time-out: fires after {time * TICK:g} s, not a tick before", quiet(leave, due))


def quiet(leave: Exit, due: int) -> Steps | None:
    """Steps with all guards of the phase closed, from the entry on until a pure time-out fires.

    Args:
        leave: The time-out.
        due: Tick at which it fires.

    Returns:
        The steps; shortened to the last ``LONGEST_RUN`` ticks; None if another exit is taken.
    """
    start = max(1, due - LONGEST_RUN)
    for window in (Window(start, due), Window(max(1, due - leave.debounce), due)):
        for vector in leave.look([], window):
            steps = constant(vector, window.first, due)
            if fires(leave, steps):
                return steps
    return None


def clock(leave: Exit, steps: Sequence[Step]) -> Iterator[Scenario]:
    """Times and debounces in the phase that follows count from its entry.

    Args:
        leave: An exit.
        steps: Steps that take it.

    Yields:
        A scenario for each exit of the phase that follows that has something to wait for.
    """
    table, target = leave.table, leave.item.target
    entered = steps[-1].tick
    for follower in (Exit(table, index) for index in exits(table, target)):
        for later in _waits_of(follower):
            both = (*steps, *(replace(step, tick=step.tick + entered) for step in later))
            taken = [index for index in outcomes(table, leave.phase, both) if index is not None]
            if taken == [leave.index, follower.index]:
                cause = follower.item.cause
                what = f"clock: {later[-1].tick} ticks for {cause} count from the entry of {target}"
                yield scenario(leave, what, both)


def _waits_of(leave: Exit) -> list[Steps]:
    """Steps that take an exit as soon as the waiting from the entry on is over."""
    if not is_pure_time_out(leave.item):
        return [item.steps for item in from_entry(leave)]
    steps = quiet(leave, max(leave.item.time_out_ticks or 0, leave.debounce))
    return [] if steps is None else [steps[-leave.debounce - 1 :]]
