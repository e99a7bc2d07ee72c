"""Scenarios at the thresholds of a guard: just past, just below, on them; and of two exits due at once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from twin_gait.gait.feasibility import ZERO, Bound, Requirement, equal
from twin_gait.gait.guards import AnyOf, Comparison, PhaseMembership
from twin_gait.gait.signals import TIME, signal_scale
from twin_gait.gait.table import TICK
from twin_gait.testing.exits import (
    LONGEST_RUN,
    Accept,
    Decisive,
    Exit,
    Scenario,
    Stretch,
    Window,
    first_of,
    reads_only_own_time,
    reads_own_time,
    turning_tick,
)
from twin_gait.testing.reference import Steps

MARGIN = 1e-9  # distance from a threshold, relative to it or to 1, in the unit of the table


def edges(leave: Exit, entry: Decisive) -> Iterator[Scenario]:
    """Scenarios about one condition of a guard."""
    if leave.debounce > LONGEST_RUN:
        return
    if isinstance(entry.atom, PhaseMembership):
        yield from _memberships(leave, entry, entry.atom)
        return
    atom = entry.atom
    past = _edge(leave, entry, atom, MARGIN, Exit.fires)
    yield leave.scenario(f"fires just past {atom}", past)
    yield leave.scenario(f"holds just below {atom}", _below(leave, entry, atom, past))
    if not reads_own_time(atom):
        on = _on(leave, entry, atom)
        if on:
            yield leave.scenario(f"holds on the threshold of {atom}", on)


def _below(leave: Exit, entry: Decisive, atom: Comparison, past: Steps) -> Steps:
    """The same measurements with that one signal moved, or others if a rival opens there."""
    if past and not reads_own_time(atom):
        signals = past[0].vector.signals
        below = {**signals, atom.signal: signals.get(atom.signal, 0.0) - 2.0 * _distance(atom, MARGIN)}
        moved = tuple(step._replace(vector=step.vector._replace(signals=below)) for step in past)
        if leave.stays(moved):
            return moved
    return first_of(_edge(leave, entry, atom, -MARGIN, accept) for accept in (Exit.stays, Exit.yields))


def _distance(atom: Comparison, margin: float) -> float:
    """Distance above the threshold, negative below, for a margin into the open side."""
    sign = 1.0 if atom.operator == ">" else -1.0
    return sign * margin * max(1.0, abs(atom.threshold))


def _edge(leave: Exit, entry: Decisive, atom: Comparison, margin: float, accept: Accept) -> Steps:
    """Steps, one debounce long, with a condition by a margin inside (or outside, if negative)."""
    in_time = reads_only_own_time(atom)
    starts = _turns(leave, atom, margin > 0.0) if in_time else leave.starts(leave.debounce)
    windows = (Window(start, start + leave.debounce - 1) for start in starts)
    stretch = (entry.requirements, leave.debounce)
    return first_of(
        leave.search(window.first, [stretch], accept, _pinned(atom, margin, window)) for window in windows
    )


def _turns(leave: Exit, atom: Comparison, inside: bool) -> list[int]:
    """Start of the debounce that just fits, or just does not fit, a threshold in time."""
    turn = turning_tick(atom)
    start = turn if atom.operator == ">" else turn - leave.debounce
    outward = -1 if atom.operator == ">" else 1
    start += 0 if inside else outward
    fits = leave.gate <= start and start + leave.debounce - 1 < leave.latest
    return [start] if fits else []


def _pinned(atom: Comparison, margin: float, window: Window) -> list[Bound]:
    """Bounds that put a difference to its edge, at the tick nearest to it; none of a time alone."""
    if reads_only_own_time(atom):
        return []
    late = (atom.operator == ">") is (margin > 0.0)
    tick = window.first if late is (atom.signal == TIME) else window.last
    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold + _distance(atom, margin))
    return [item.at(TIME, tick * TICK) for item in pins]


def _on(leave: Exit, entry: Decisive, atom: Comparison) -> Steps:
    """Steps exactly on a threshold; of a difference one signal is zero, so that no digit is lost."""

    def on(leave: Exit, steps: Steps) -> bool:
        signals = steps[0].vector.signals
        scale = signal_scale(atom.signal)
        minus = 0.0 if atom.minus is None else signals[atom.minus] * scale
        exact = signals[atom.signal] * scale - minus == atom.threshold * scale
        return exact and leave.yields(steps)

    pins = equal(atom.signal, atom.minus or ZERO, atom.threshold)
    ends = [] if atom.minus is None else [atom.signal, atom.minus]
    zeros = [equal(name, ZERO, 0.0) for name in ends] or [[]]
    return first_of(leave.comfortable(entry.requirements, on, pinned=[*pins, *zero]) for zero in zeros)


def _memberships(leave: Exit, entry: Decisive, atom: PhaseMembership) -> Iterator[Scenario]:
    words = leave.table.words.member
    for phase in leave.table.members:
        inside = phase in atom.phases
        when = f"while the other leg is in {phase}" if words == "phase" else f"on the {words} {phase}"
        what = f"{'fires' if inside else 'holds'} {when}"
        yield _far(leave, what, entry, Requirement(replace(atom, phases=(phase,))), inside)


def groups(leave: Exit, entry: Decisive) -> Iterator[Scenario]:
    """One condition of an ``all`` missing, or one condition of an ``any`` alone, far from thresholds."""
    if entry.group is None or leave.debounce > LONGEST_RUN:
        return
    alone = isinstance(entry.group, AnyOf)
    what = f"any: fires by {entry.atom} alone" if alone else f"all: holds while only {entry.atom} is missing"
    yield _far(leave, what, entry, Requirement(entry.atom, alone), alone)


def _far(leave: Exit, what: str, entry: Decisive, more: Requirement, opens: bool) -> Scenario:
    """The exit is taken, or not, with a condition as it is required, far from thresholds."""
    accepts = (Exit.fires,) if opens else (Exit.stays, Exit.yields)
    return leave.scenario(what, leave.comfortable([*entry.requirements, more], *accepts))


def priority(first: Exit, second: Exit) -> Iterator[Scenario]:
    """Both exits due at once, and no sooner: the one listed first is taken; nothing if they never are."""
    items = list(first.table.transitions)
    items[first.index], items[second.index] = items[second.index], items[first.index]
    swapped = Exit(replace(first.table, transitions=tuple(items)), first.index)

    def wins(leave: Exit, steps: Steps) -> bool:
        """In each other's place the other one is taken."""
        return leave.fires(steps) and swapped.fires(steps)

    sparing = replace(first, spared=second.index)
    steps = first_of(sparing.search(*schedule, wins) for schedule in _schedules(first, second))
    if steps:
        what = f"priority: wins over {second.item.target} ({second.item.cause}) when both are due"
        yield first.scenario(what, steps)


def _schedules(first: Exit, second: Exit) -> Iterator[tuple[int, Sequence[Stretch]]]:
    """Ticks from which on, and stretches in which, both exits may come to be due at once."""
    slow, fast = (first, second) if first.debounce >= second.debounce else (second, first)
    if slow.debounce > LONGEST_RUN:
        return
    both, due = [first.opens, second.opens], max(first.gate, second.gate)
    waits = [item for item in (first, second) if item.item.is_time_out]
    if waits:
        # A guard opens so that its debounce ends with the time-out.
        guarded = [item for item in (first, second) if not item.item.is_time_out]
        due, ticks = int(first.latest), max((item.debounce for item in guarded), default=1)
        lead = max(0, min(due - ticks, max(item.debounce for item in waits)))
        closed = [item.closes for item in guarded]
        yield due - ticks - lead + 1, [(closed, lead), (both, ticks)]
        return
    # Both guards are open before, and at least one waits for the tick in which both are due.
    for start in (max(1, due - slow.debounce - 1), due - slow.debounce + 1):
        yield start, [(both, due - start + 1)]
    # The guard with the longer debounce opens earlier, so that both debounces end together.
    for start in slow.starts(slow.debounce, gate=max(1, due - slow.debounce + 1)):
        yield start, [([slow.opens, fast.closes], slow.debounce - fast.debounce), (both, fast.debounce)]
