"""Scenarios at the thresholds of a guard: just past, just below, exactly on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from twin_gait.gait.guards import AnyOf, Comparison, PhaseMembership
from twin_gait.testing.bounds import ZERO, Bound, equal
from twin_gait.testing.leaving import LONGEST_RUN, Decisive, Exit, Scenario, constant, turning_tick
from twin_gait.testing.solver import Window, Wish, reads_only_own_time, reads_own_time
from twin_gait.testing.witness import OWN_TIME, Step, Vector, outcomes, own_time, to_si

MARGIN = 1e-9  # distance from a threshold, relative to it or to 1, in the unit of the table

Steps = tuple[Step, ...]
Accept = Callable[[Exit, Steps], bool]


def fires(leave: Exit, steps: Steps) -> bool:
    """Whether a leg takes the exit in the last of some steps and none before."""
    return outcomes(leave.table, leave.phase, steps) == [None] * (len(steps) - 1) + [leave.index]


def stays(leave: Exit, steps: Steps) -> bool:
    """Whether a leg takes no exit."""
    return outcomes(leave.table, leave.phase, steps) == [None] * len(steps)


def yields(leave: Exit, steps: Steps) -> bool:
    """Whether a leg does not take the exit, but perhaps a rival that is open too."""
    return leave.index not in outcomes(leave.table, leave.phase, steps)


def scenario(leave: Exit, what: str, steps: Steps) -> Scenario:
    """Scenario with what the rules of the table demand."""
    return Scenario(what, leave.phase, steps, tuple(outcomes(leave.table, leave.phase, steps)))


def edges(leave: Exit, entry: Decisive) -> Iterator[Scenario | str]:
    """Scenarios about one condition of a guard.

    Args:
        leave: The exit.
        entry: The condition.

    Yields:
        Scenarios, or the name of one that no measurements can show.
    """
    if leave.debounce > LONGEST_RUN:
        return
    if isinstance(entry.atom, PhaseMembership):
        yield from _memberships(leave, entry)
        return
    past = _edge(leave, entry, MARGIN, fires)
    yield _or_name(leave, f"fires just past {entry.atom}", past)
    yield _or_name(leave, f"holds just below {entry.atom}", _below(leave, entry, past))
    if not reads_own_time(entry.atom):
        on = _on(leave, entry, past)
        if on is not None:
            yield scenario(leave, f"holds on the threshold of {entry.atom}", on)


def _or_name(leave: Exit, what: str, steps: Steps | None) -> Scenario | str:
    return what if steps is None else scenario(leave, what, steps)


def _below(leave: Exit, entry: Decisive, past: Steps | None) -> Steps | None:
    """The same measurements with that one signal moved, or others if a rival opens there."""
    assert isinstance(entry.atom, Comparison)
    if past is not None and not reads_own_time(entry.atom):
        moved = _moved(past, entry.atom, -_distance(entry.atom, MARGIN) * 2.0)
        if stays(leave, moved):
            return moved
    return _edge(leave, entry, -MARGIN, stays) or _edge(leave, entry, -MARGIN, yields)


def _distance(atom: Comparison, margin: float) -> float:
    """Distance above the threshold, negative below, for a margin into the open side."""
    sign = 1.0 if atom.operator == ">" else -1.0
    return sign * margin * max(1.0, abs(atom.threshold))


def _moved(steps: Steps, atom: Comparison, change: float) -> Steps:
    signals = dict(steps[0].vector.signals)
    signals[atom.signal] = signals.get(atom.signal, 0.0) + change
    vector = replace(steps[0].vector, signals=signals)
    return tuple(replace(step, vector=vector) for step in steps)


def _edge(leave: Exit, entry: Decisive, margin: float, accept: Accept) -> Steps | None:
    """Steps, one debounce long, with a condition by a margin inside (or outside, if negative)."""
    assert isinstance(entry.atom, Comparison)
    own = reads_only_own_time(entry.atom)
    for start in _turns(leave, entry.atom, margin > 0.0) if own else leave.starts(leave.debounce):
        window = Window(start, start + leave.debounce - 1)
        pinned = [] if own else _pinned(entry.atom, margin, window)
        for vector in leave.look(entry.wishes, window, pinned):
            steps = constant(vector, start, int(window.last))
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
    ends, shift = [], 0.0
    for name, sign in ((atom.signal, 1.0), (atom.minus, -1.0)):
        if name == OWN_TIME:
            early = (sign > 0.0) is ((atom.operator == ">") is (margin > 0.0))
            shift += sign * own_time(window.first if early else int(window.last))
            name = ZERO
        ends.append(ZERO if name is None else name)
    return equal(ends[0], ends[1], atom.threshold - shift + _distance(atom, margin))


def _on(leave: Exit, entry: Decisive, past: Steps | None) -> Steps | None:
    """Steps exactly on a threshold; of a difference one signal is zero, so that no digit is lost."""
    atom = entry.atom
    assert isinstance(atom, Comparison)
    if past is not None and atom.minus is None:
        exact = _placed(past, atom.signal, atom.threshold)
        if stays(leave, exact):
            return exact
    zeros = [None] if atom.minus is None else [atom.signal, atom.minus]
    for start in leave.starts(leave.debounce):
        window = Window(start, start + leave.debounce - 1)
        for zero in zeros:
            pinned = equal(atom.signal, atom.minus or ZERO, atom.threshold)
            pinned += [] if zero is None else equal(zero, ZERO, 0.0)
            for vector in leave.look(entry.wishes, window, pinned):
                steps = constant(vector, start, int(window.last))
                if _is_on(atom, vector) and yields(leave, steps):
                    return steps
    return None


def _placed(steps: Steps, signal: str, value: float) -> Steps:
    vector = replace(steps[0].vector, signals={**steps[0].vector.signals, signal: value})
    return tuple(replace(step, vector=vector) for step in steps)


def _is_on(atom: Comparison, vector: Vector) -> bool:
    minus = 0.0 if atom.minus is None else to_si(atom.minus, vector.signals[atom.minus])
    return to_si(atom.signal, vector.signals[atom.signal]) - minus == to_si(atom.signal, atom.threshold)


def _memberships(leave: Exit, entry: Decisive) -> Iterator[Scenario | str]:
    assert isinstance(entry.atom, PhaseMembership)
    for phase in leave.table.phase_names:
        inside = phase in entry.atom.phases
        what = f"{'fires' if inside else 'holds'} while the other leg is in {phase}"
        accepts: tuple[Accept, ...] = (fires,) if inside else (stays, yields)
        here = Wish(PhaseMembership(phases=(phase,)))
        found = (comfortable(leave, [*entry.wishes, here], accept) for accept in accepts)
        yield _or_name(leave, what, next((steps for steps in found if steps is not None), None))


def comfortable(leave: Exit, wishes: list[Wish], accept: Accept) -> Steps | None:
    """Steps, one debounce long, that fulfil the wishes with room.

    Args:
        leave: The exit.
        wishes: What has to be open or closed.
        accept: :func:`fires`, :func:`stays` or :func:`yields`.

    Returns:
        The steps, or None if there are none.
    """
    for start in leave.starts(leave.debounce):
        window = Window(start, start + leave.debounce - 1)
        for vector in leave.look(wishes, window):
            steps = constant(vector, start, int(window.last))
            if accept(leave, steps):
                return steps
    return None


def groups(leave: Exit, entry: Decisive) -> Iterator[Scenario | str]:
    """One condition of an ``all`` missing, or one condition of an ``any`` alone, far from thresholds.

    Args:
        leave: The exit.
        entry: The condition.

    Yields:
        A scenario, or its name if no measurements can show it; nothing for a condition by itself.
    """
    if entry.group is None or leave.debounce > LONGEST_RUN:
        return
    alone = isinstance(entry.group, AnyOf)
    what = f"any: fires by {entry.atom} alone" if alone else f"all: holds while only {entry.atom} is missing"
    wishes = [*entry.wishes, Wish(entry.atom, alone)]
    accepts: tuple[Accept, ...] = (fires,) if alone else (stays, yields)
    found = (comfortable(leave, wishes, accept) for accept in accepts)
    yield _or_name(leave, what, next((steps for steps in found if steps is not None), None))
