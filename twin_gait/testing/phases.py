"""Scenarios across phases: an exit elsewhere, and a debounce after the phase was left and entered again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from twin_gait.gait.guards import AllOf
from twin_gait.gait.table import GaitTable
from twin_gait.testing.edges import Steps, comfortable, fires, scenario
from twin_gait.testing.leaving import LONGEST_RUN, Exit, Scenario, constant
from twin_gait.testing.solver import Window, Wish, find
from twin_gait.testing.timing import quiet
from twin_gait.testing.witness import exits, is_pure_time_out, outcomes


def elsewhere(leave: Exit, phase: str) -> Iterator[Scenario]:
    """In another phase the exit does not exist.

    Args:
        leave: An exit.
        phase: Another phase.

    Yields:
        A scenario in which nothing happens; none if there is always something that leaves that phase.
    """
    if leave.debounce > LONGEST_RUN:
        return
    table = leave.table
    here = tuple(Wish(table.transitions[index].guard, False) for index in exits(table, phase))
    guarded = tuple(wish for wish in here if wish.guard != AllOf(guards=()))
    gate = max(leave.gate, table.phases[phase].minimum_ticks)
    for first in leave.starts(leave.debounce, gate=gate) or [gate]:
        window = Window(first, first + leave.debounce - 1)
        found = find(table.phase_names, [Wish(leave.item.guard), *guarded], window)
        steps = () if found is None else constant(found, first, int(window.last))
        if steps and not any(index is not None for index in outcomes(table, phase, steps)):
            yield Scenario(f"holds in {phase}, which it does not leave", phase, steps, (None,) * len(steps))
            return


def again(leave: Exit) -> Iterator[Scenario]:
    """A debounce that was cut short by another exit is counted anew when the phase is entered again.

    Args:
        leave: An exit with a debounce.

    Yields:
        A scenario; none without a debounce, or if no other exit can cut it short.
    """
    last = comfortable(leave, [Wish(leave.item.guard)], fires) if 1 < leave.debounce <= LONGEST_RUN else None
    if last is None:
        return
    for index in exits(leave.table, leave.phase):
        cutter = Exit(leave.table, index)
        home = _way(leave.table, cutter.item.target, leave.phase)
        for cut in _cuts(leave, cutter) if index != leave.index and home is not None else ():
            steps = _chain([cut, *(home or []), last])
            taken = [entry for entry in outcomes(leave.table, leave.phase, steps) if entry is not None]
            if taken[0] == index and taken[-1] == leave.index and len(taken) == len(home or []) + 2:
                what = f"debounce: {leave.debounce} ticks counted anew after {cutter.item.cause} and back"
                yield scenario(leave, what, steps)
                return


def _cuts(leave: Exit, cutter: Exit) -> Iterator[Steps]:
    """Steps with an open guard that another exit ends before the debounce is over."""
    wishes = [Wish(leave.item.guard), Wish(cutter.item.guard)]
    if is_pure_time_out(cutter.item):
        starts = [int(cutter.latest) - leave.debounce + 2]
        ticks = leave.debounce - 1
    else:
        starts, ticks = cutter.starts(cutter.debounce), cutter.debounce
    if ticks >= leave.debounce:
        return
    rest = [
        Wish(item.item.guard, False) for item in leave.rivals if item.index not in (leave.index, cutter.index)
    ]
    for start in (tick for tick in starts if tick >= 1):
        vector = find(leave.table.phase_names, [*wishes, *rest], Window(start, start + ticks - 1))
        if vector is not None:
            yield constant(vector, start, start + ticks - 1)


def _way(table: GaitTable, start: str, end: str) -> list[Steps] | None:
    """Steps that lead from one phase to another, phase by phase."""
    ways: dict[str, list[Steps]] = {start: []}
    waiting = [start]
    while waiting and end not in ways:
        phase = waiting.pop(0)
        for leave in (Exit(table, index) for index in exits(table, phase)):
            steps = _taking(leave) if leave.item.target not in ways else None
            if steps is not None:
                ways[leave.item.target] = [*ways[phase], steps]
                waiting.append(leave.item.target)
    return ways.get(end)


def _taking(leave: Exit) -> Steps | None:
    if not is_pure_time_out(leave.item):
        return comfortable(leave, [Wish(leave.item.guard)], fires)
    steps = quiet(leave, max(leave.item.time_out_ticks or 0, leave.debounce))
    return None if steps is None else steps[-leave.debounce - 1 :]


def _chain(parts: list[Steps]) -> Steps:
    """Parts one after the other, each counted from the last tick of the part before it."""
    steps: Steps = ()
    for part in parts:
        entered = steps[-1].tick if steps else 0
        steps = (*steps, *(replace(step, tick=step.tick + entered) for step in part))
    return steps
