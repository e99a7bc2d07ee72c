"""Scenarios at the thresholds of a guard: just past, just below, on them; and of two exits due at once."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from twin_gait.gait.feasibility import ZERO, Bound, Phases, Requirement, equal
from twin_gait.gait.guards import AnyOf, Comparison, PhaseMembership
from twin_gait.gait.signals import TIME, signal_scale
from twin_gait.gait.table import TICK
from twin_gait.testing.exits import (
    LONGEST_RUN,
    Accept,
    Decisive,
    Exit,
    Scenario,
    Window,
    comfortable,
    constant,
    find,
    fires,
    reads_only_own_time,
    reads_own_time,
    scenario,
    shown,
    stays,
    turning_tick,
    yields,
)
from twin_gait.testing.reference import Step, Steps, Vector, is_pure_time_out

MARGIN = 1e-9  # distance from a threshold, relative to it or to 1, in the unit of the table


def edges(leave: Exit, entry: Decisive) -> Iterator[Scenario | str]:
    """Scenarios about one condition of a guard, or the name of one that no measurements can show."""
    if leave.debounce > LONGEST_RUN:
        return
    if isinstance(entry.atom, PhaseMembership):
        yield from _memberships(leave, entry, entry.atom)
        return
    past = _edge(leave, entry, entry.atom, MARGIN, fires)
    yield shown(leave, f"fires just past {entry.atom}", past)
    yield shown(leave, f"holds just below {entry.atom}", _below(leave, entry, entry.atom, past))
    if not reads_own_time(entry.atom):
        on = _on(leave, entry, entry.atom, past)
        if on is not None:
            yield scenario(leave, f"holds on the threshold of {entry.atom}", on)


def _below(leave: Exit, entry: Decisive, atom: Comparison, past: Steps | None) -> Steps | None:
    """The same measurements with that one signal moved, or others if a rival opens there."""
    if past is not None and not reads_own_time(atom):
        present = past[0].vector.signals.get(atom.signal, 0.0)
        moved = _placed(past, atom.signal, present - _distance(atom, MARGIN) * 2.0)
        if stays(leave, moved):
            return moved
    return _edge(leave, entry, atom, -MARGIN, stays) or _edge(leave, entry, atom, -MARGIN, yields)


def _distance(atom: Comparison, margin: float) -> float:
    """Distance above the threshold, negative below, for a margin into the open side."""
    sign = 1.0 if atom.operator == ">" else -1.0
    return sign * margin * max(1.0, abs(atom.threshold))


def _placed(steps: Steps, signal: str, value: float) -> Steps:
    vector = steps[0].vector._replace(signals={**steps[0].vector.signals, signal: value})
    return tuple(step._replace(vector=vector) for step in steps)


def _edge(leave: Exit, entry: Decisive, atom: Comparison, margin: float, accept: Accept) -> Steps | None:
    """Steps, one debounce long, with a condition by a margin inside (or outside, if negative)."""
    own = reads_only_own_time(atom)
    for start in _turns(leave, atom, margin > 0.0) if own else leave.starts(leave.debounce):
        window = Window(start, start + leave.debounce - 1)
        pinned = [] if own else _pinned(atom, margin, window)
        for vector in leave.look(entry.requirements, window, pinned):
            steps = constant(vector, *window)
            if accept(leave, steps):
                return steps
    return None


def _turns(leave: Exit, atom: Comparison, inside: bool) -> list[int]:
    """Start of the debounce that just fits, or just does not fit, a threshold in time."""
    turn = turning_tick(atom)
    start = turn if atom.operator == ">" else turn - leave.debounce
    outward = -1 if atom.operator == ">" else 1
    start += 0 if inside else outward
    fits = leave.gate <= start and start + leave.debounce - 1 < leave.latest
    return [start] if fits else []


def _pinned(atom: Comparison, margin: float, window: Window) -> list[Bound]:
    """Bounds that put a difference to its edge, at the tick that is the nearest to it."""
    late = (atom.operator == ">") is (margin > 0.0)
    tick = window.first if late is (atom.signal == TIME) else window.last
    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold + _distance(atom, margin))
    return [item.at(TIME, tick * TICK) for item in pins]


def _on(leave: Exit, entry: Decisive, atom: Comparison, past: Steps | None) -> Steps | None:
    """Steps exactly on a threshold; of a difference one signal is zero, so that no digit is lost."""
    if past is not None and atom.minus is None:
        exact = _placed(past, atom.signal, atom.threshold)
        if stays(leave, exact):
            return exact

    def on(leave: Exit, steps: Steps) -> bool:
        signals = steps[0].vector.signals
        scale = signal_scale(atom.signal)
        minus = 0.0 if atom.minus is None else signals[atom.minus] * scale
        exact = signals[atom.signal] * scale - minus == atom.threshold * scale
        return exact and yields(leave, steps)

    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold)
    ends = [] if atom.minus is None else [atom.signal, atom.minus]
    zeros = [equal(name, ZERO, 0.0) for name in ends] or [[]]
    found = (comfortable(leave, entry.requirements, on, pinned=[*pins, *zero]) for zero in zeros)
    return next((steps for steps in found if steps is not None), None)


def _memberships(leave: Exit, entry: Decisive, atom: PhaseMembership) -> Iterator[Scenario | str]:
    words = leave.table.words.member
    for phase in leave.table.members:
        inside = phase in atom.phases
        when = f"while the other leg is in {phase}" if words == "phase" else f"on the {words} {phase}"
        what = f"{'fires' if inside else 'holds'} {when}"
        requirements = [*entry.requirements, Requirement(replace(atom, phases=(phase,)))]
        yield shown(leave, what, comfortable(leave, requirements, *((fires,) if inside else (stays, yields))))


def groups(leave: Exit, entry: Decisive) -> Iterator[Scenario | str]:
    """One condition of an ``all`` missing, or one condition of an ``any`` alone, far from thresholds."""
    if entry.group is None or leave.debounce > LONGEST_RUN:
        return
    alone = isinstance(entry.group, AnyOf)
    what = f"any: fires by {entry.atom} alone" if alone else f"all: holds while only {entry.atom} is missing"
    requirements = [*entry.requirements, Requirement(entry.atom, alone)]
    yield shown(leave, what, comfortable(leave, requirements, *((fires,) if alone else (stays, yields))))


def priority(first: Exit, second: Exit) -> Scenario | None:
    """Both exits due at once, and no sooner: the one listed first is taken; None if they never are."""
    items = list(first.table.transitions)
    items[first.index], items[second.index] = items[second.index], items[first.index]
    swapped = Exit(replace(first.table, transitions=tuple(items)), first.index)
    for steps in (steps for pair in _pairs(first, second) for steps in _candidates(pair)):
        # In each other's place the other one is taken.
        if fires(first, steps) and fires(swapped, steps):
            what = f"priority: wins over {second.item.target} ({second.item.cause}) when both are due"
            return scenario(first, what, steps)
    return None


@dataclass(frozen=True)
class _Pair:
    """Two exits of a phase, and what the others have to be."""

    first: Exit
    second: Exit
    rest: tuple[Requirement, ...]
    phases: Phases

    def look(self, first: int, last: int, requirements: Sequence[Requirement]) -> Vector | None:
        """Measurements over a window of ticks."""
        if not 1 <= first <= last <= self.first.latest:
            return None
        return find(self.phases, [*requirements, *self.rest], Window(first, last))


def _pairs(first: Exit, second: Exit) -> Iterator[_Pair]:
    """All exits beside the two are closed; if they cannot be, those listed above the second, the first."""
    others = [item for item in first.rivals if item.index != second.index]
    for below in (len(first.table.transitions), second.index, first.index):
        rest = tuple(Requirement(item.item.guard, False) for item in others if item.index < below)
        yield _Pair(first, second, rest, first.table.others)
    yield _Pair(first, second, tuple(Requirement(item.item.guard, False) for item in others), (None,))


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
        yield constant(vector, 1, due)


def _with_time_out(pair: _Pair, guarded: Exit, pure: Exit) -> Iterator[Steps]:
    """The guard opens so that its debounce ends with the time-out."""
    due = int(pure.latest)
    start = due - guarded.debounce + 1
    opened = pair.look(start, due, [Requirement(guarded.item.guard)])
    if opened is None:
        return
    lead = min(start - 1, pure.debounce)
    before = pair.look(start - lead, start - 1, [Requirement(guarded.item.guard, False)]) if lead else opened
    if before is not None:
        yield _run(start - lead, [before] * lead + [opened] * guarded.debounce)
    yield constant(opened, start, due)


def _both_gated(pair: _Pair) -> Iterator[Steps]:
    """Both guards are open before, and at least one waits for the tick in which both are due."""
    due = max(pair.first.gate, pair.second.gate)
    debounce = max(pair.first.debounce, pair.second.debounce)
    for start in (max(1, due - debounce - 1), due - debounce + 1):
        opened = pair.look(
            start, due, [Requirement(pair.first.item.guard), Requirement(pair.second.item.guard)]
        )
        if opened is not None:
            yield constant(opened, start, due)


def _staggered(pair: _Pair) -> Iterator[Steps]:
    """The guard with the longer debounce opens earlier, so that both debounces end together."""
    first, second = pair.first, pair.second
    slow, fast = (first, second) if first.debounce >= second.debounce else (second, first)
    lead = slow.debounce - fast.debounce
    gate = max(1, max(first.gate, second.gate) - slow.debounce + 1)
    for start in slow.starts(slow.debounce, gate=gate):
        last = start + slow.debounce - 1
        opened = pair.look(
            start + lead, last, [Requirement(first.item.guard), Requirement(second.item.guard)]
        )
        if opened is None:
            continue
        only_slow = [Requirement(slow.item.guard), Requirement(fast.item.guard, False)]
        before = pair.look(start, start + lead - 1, only_slow) if lead else opened
        if before is not None:
            yield _run(start, [before] * lead + [opened] * fast.debounce)
