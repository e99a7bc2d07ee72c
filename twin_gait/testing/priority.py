"""Scenarios in which two exits of a phase are due in the same tick: the first listed wins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from twin_gait.gait.table import GaitTable
from twin_gait.testing.edges import Steps
from twin_gait.testing.leaving import LONGEST_RUN, Exit, Scenario
from twin_gait.testing.solver import Phases, Window, Wish, find
from twin_gait.testing.witness import Step, Vector, is_pure_time_out, outcomes


def swapped(table: GaitTable, first: int, second: int) -> GaitTable:
    """The table with two transitions in each other's place."""
    items = list(table.transitions)
    items[first], items[second] = items[second], items[first]
    return replace(table, transitions=tuple(items))


def priority(first: Exit, second: Exit) -> Scenario | None:
    """Both exits due at once, and no sooner: the one listed first is taken.

    Args:
        first: An exit.
        second: An exit of the same phase further down.

    Returns:
        The scenario, or None if they are never due at once.
    """
    for steps in (steps for pair in _pairs(first, second) for steps in _candidates(pair)):
        if _decides(first, second, steps):
            expected = outcomes(first.table, first.phase, steps)
            what = f"priority: wins over {second.item.target} ({second.item.cause}) when both are due"
            return Scenario(what, first.phase, steps, tuple(expected))
    return None


def _decides(first: Exit, second: Exit, steps: Steps) -> bool:
    """Whether the first is taken in the last tick only, and the second if the two change places."""
    waits: list[int | None] = [None] * (len(steps) - 1)
    other = swapped(first.table, first.index, second.index)
    return outcomes(first.table, first.phase, steps) == [*waits, first.index] and outcomes(
        other, first.phase, steps
    ) == [*waits, first.index]


@dataclass(frozen=True)
class _Pair:
    """Two exits of a phase, and what the others have to be."""

    first: Exit
    second: Exit
    rest: tuple[Wish, ...]
    phases: Phases

    def look(self, first: int, last: int, wishes: Sequence[Wish]) -> Vector | None:
        """Measurements over a window of ticks."""
        if not 1 <= first <= last <= self.first.latest:
            return None
        return find(self.phases, [*wishes, *self.rest], Window(first, last))


def _pairs(first: Exit, second: Exit) -> Iterator[_Pair]:
    """All exits beside the two are closed; if they cannot be, those listed above the second, the first."""
    others = [item for item in first.rivals if item.index != second.index]
    for below in (len(first.table.transitions), second.index, first.index):
        rest = tuple(Wish(item.item.guard, False) for item in others if item.index < below)
        yield _Pair(first, second, rest, first.table.phase_names)
    yield _Pair(first, second, tuple(Wish(item.item.guard, False) for item in others), (None,))


def _candidates(pair: _Pair) -> Iterator[Steps]:
    first, second = pair.first, pair.second
    if max(first.debounce, second.debounce) > LONGEST_RUN:
        return
    pure = [item for item in (first, second) if is_pure_time_out(item.item)]
    if len(pure) == 2:
        yield from _both_time_outs(pair)
    elif pure:
        yield from _with_time_out(pair, second if pure[0] is first else first, pure[0])
    else:
        yield from _both_gated(pair)
        yield from _staggered(pair)


def _run(first: int, vectors: Sequence[Vector]) -> Steps:
    return tuple(Step(first + place, vector) for place, vector in enumerate(vectors))


def _both_time_outs(pair: _Pair) -> Iterator[Steps]:
    if pair.first.latest > LONGEST_RUN:
        return
    due = int(pair.first.latest)
    vector = pair.look(1, due, [])
    if vector is not None:
        yield _run(1, [vector] * due)


def _with_time_out(pair: _Pair, guarded: Exit, pure: Exit) -> Iterator[Steps]:
    """The guard opens so that its debounce ends with the time-out."""
    if pure.latest == float("inf"):
        return
    due = int(pure.latest)
    start = due - guarded.debounce + 1
    opened = pair.look(start, due, [Wish(guarded.item.guard)])
    if opened is None:
        return
    lead = min(start - 1, pure.debounce)
    before = pair.look(start - lead, start - 1, [Wish(guarded.item.guard, False)]) if lead else opened
    if before is not None:
        yield _run(start - lead, [before] * lead + [opened] * guarded.debounce)
    yield _run(start, [opened] * guarded.debounce)


def _both_gated(pair: _Pair) -> Iterator[Steps]:
    """Both guards are open before, and at least one waits for the tick in which both are due."""
    due = max(pair.first.gate, pair.second.gate)
    debounce = max(pair.first.debounce, pair.second.debounce)
    for start in (max(1, due - debounce - 1), due - debounce + 1):
        opened = pair.look(start, due, [Wish(pair.first.item.guard), Wish(pair.second.item.guard)])
        if opened is not None:
            yield _run(start, [opened] * (due - start + 1))


def _staggered(pair: _Pair) -> Iterator[Steps]:
    """The guard with the longer debounce opens earlier, so that both debounces end together."""
    first, second = pair.first, pair.second
    slow, fast = (first, second) if first.debounce >= second.debounce else (second, first)
    lead = slow.debounce - fast.debounce
    gate = max(1, max(first.gate, second.gate) - slow.debounce + 1)
    for start in slow.starts(slow.debounce, gate=gate):
        last = start + slow.debounce - 1
        opened = pair.look(start + lead, last, [Wish(first.item.guard), Wish(second.item.guard)])
        if opened is None:
            continue
        only_slow = [Wish(slow.item.guard), Wish(fast.item.guard, False)]
        before = pair.look(start, start + lead - 1, only_slow) if lead else opened
        if before is not None:
            yield _run(start, [before] * lead + [opened] * fast.debounce)
