"""Exits of a phase: open at once, never open, following a switch at once; idle conditions."""

import itertools
import re
from collections.abc import Callable, Iterator

from twin_gait.checking.finding import CheckCase, Finding, Severity, about, label, rule
from twin_gait.checking.signals import ENTRY_TIME, Point, SignalSpace, entered, signal_space
from twin_gait.gait.feasibility import Bound, Requirement, translated
from twin_gait.gait.guards import Comparison, Guard, PhaseMembership, atoms, compared
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import ANGLE, LOAD, OTHER_TIME, TIME, VELOCITY, signal_of
from twin_gait.gait.table import TICK, Transition

_NOISY, _ENTRY = "noisy.", (TICK, TICK)


@rule
def ambiguity(case: CheckCase) -> Iterator[Finding]:
    """Two exits of a phase with different targets can be open at once; time-outs are exempt."""
    space = signal_space(case)
    for phase in space.table.phase_names:
        guarded = [index for index in space.exits(phase) if not space.transition(index).is_time_out]
        for first, second in itertools.combinations(guarded, 2):
            if space.transition(first).target != space.transition(second).target:
                yield from _open_at_once(space, first, second)


def _open_at_once(space: SignalSpace, first: int, second: int) -> Iterator[Finding]:
    earliest = max(space.window(first)[0], space.window(second)[0])

    def holds(point: Point) -> bool:
        return space.is_open(first, point) and space.is_open(second, point)

    times = {TIME: (earliest, space.window(first)[1])}
    point = next(space.find([space.requirement(first), space.requirement(second)], times, holds), None)
    if point is None:
        return
    one, other = space.transition(first), space.transition(second)
    winner = space.winner(one.source, point, point.signals.get(TIME, earliest))
    wins = label(one if winner is None else space.transition(winner))
    ticks = one.debounce_ticks, other.debounce_ticks
    waits = f"; debounce {ticks[0]} and {ticks[1]} ms, so the order of opening counts"
    waits = waits if ticks[0] != ticks[1] else ""
    reason = f"{label(one)} and {label(other)} can be open at once; when both are due {wins} wins{waits}"
    suggestion = "let a condition of one exclude the other, or waive it if the order is meant"
    shown = space.counterexample(point)
    yield about(other, Severity.WARNING, reason, suggestion, counterexample=shown)


@rule
def never_opens(case: CheckCase) -> Iterator[Finding]:
    """The guard of an exit contradicts itself inside the limits of the signals and the time-out."""
    space = signal_space(case)
    for index, item in enumerate(space.table.transitions):
        if not item.is_time_out and space.opening(index) is None:
            reason = f"no signals inside the limits open {_short(item.guard)} {_in_time(space, index)}"
            yield about(item, Severity.ERROR, reason, "correct the thresholds, or take the transition out")


def _in_time(space: SignalSpace, index: int) -> str:
    earliest, latest = space.window(index)
    return f"from {earliest:g} to {latest:g} s in the phase"


@rule
def debounce_beyond_time_out(case: CheckCase) -> Iterator[Finding]:
    """The debounce of an exit is longer than the time for which its guard can stay open."""
    space = signal_space(case)
    for index, item in enumerate(space.table.transitions):
        if space.opening(index) is not None and not space.can_fire(index):
            reason = f"the debounce of {item.debounce_ticks} ms cannot be over {_in_time(space, index)}"
            yield about(item, Severity.ERROR, reason, "shorten the debounce, or let the time-out come later")


@rule
def threshold_beyond_limits(case: CheckCase) -> Iterator[Finding]:
    """A threshold lies outside what its signal can measure: the condition is always or never true."""
    space = signal_space(case)
    for item in space.table.transitions:
        for atom in dict.fromkeys(atoms(item.guard)):
            if not isinstance(atom, Comparison):
                continue
            low, high = _range_of(space, item, atom)
            # At the very end of the range that the condition excludes it still decides.
            end = low if atom.operator == ">" else high
            if low < atom.threshold < high or atom.threshold == end:
                continue
            side = atom.signal if atom.minus is None else f"{atom.signal} - {atom.minus}"
            truth = "always" if (atom.threshold <= low) == (atom.operator == ">") else "never"
            reason = f"{_short(atom)} is {truth} true: {side} lies in {low:.4g} … {high:.4g}"
            suggestion = "move the threshold inside the range, or take the condition out"
            yield about(item, Severity.WARNING, reason, suggestion)


def _short(guard: Guard) -> str:
    """A guard whose scaled thresholds have no more digits than anybody writes."""
    return re.sub(r"\d+\.\d{6,}", lambda number: f"{float(number[0]):.6g}", str(guard))


def _range_of(space: SignalSpace, item: Transition, atom: Comparison) -> tuple[float, float]:
    """Least and largest left side of a comparison in the units of the table."""

    def one(name: str) -> tuple[float, float]:
        if name == TIME:
            return TICK, space.time_out(item.source)
        if name == OTHER_TIME:
            return 0.0, max(space.time_out(phase) for phase in space.others)
        return space.range(name)

    (low, high), (least, most) = one(atom.signal), (0.0, 0.0) if atom.minus is None else one(atom.minus)
    return (0.0, 0.0) if atom.minus == atom.signal else (low - most, high - least)


@rule
def cascade(case: CheckCase) -> Iterator[Finding]:
    """A phase can be entered with one of its exits already open.

    A warning if the phase is left in its first tick; a note if a debounce or a minimum duration holds it for
    a while, or if it is entered by a time-out, at which the signals may be anything.
    """
    space = signal_space(case)
    for into, item in enumerate(space.table.transitions):
        for out in space.exits(item.target):
            after = space.transition(out)
            if not after.is_time_out and (after.time_out_ticks or 0) <= 1:
                yield from _straight_through(space, into, out)


def _straight_through(space: SignalSpace, into: int, out: int) -> Iterator[Finding]:
    """The finding, with signals at which the entry also wins where there are any."""
    entry, leave = space.transition(into), space.transition(out)
    earlier = [
        index
        for index in space.exits(entry.source)
        if index < into
        and space.transition(index).debounce_ticks == 1
        and space.transition(index).time_out_ticks is None
    ]
    earliest, latest = space.window(into)
    times = {TIME: (earliest, min(earliest, latest) if entry.is_time_out else latest), ENTRY_TIME: _ENTRY}
    at_entry = translated(leave.guard, lambda name: ENTRY_TIME if name == TIME else name, _lasting(space))

    def holds(point: Point) -> bool:
        return space.is_open(into, point) and space.is_open(out, entered(point))

    both = [space.requirement(into), Requirement(at_entry)]
    shut = [space.requirement(index, False) for index in earlier]
    wins, point = True, next(space.find([*both, *shut], times, holds), None)
    if point is None and shut:
        wins, point = False, next(space.find(both, times, holds), None)
    if point is None:
        return
    stay = max(leave.debounce_ticks, space.table.phases[leave.source].minimum_ticks)
    at_once = stay <= 1 and not entry.is_time_out and wins
    held = f"it is left after {stay} ms" if stay > 1 else "it is left in its first tick"
    rival = "; an exit listed earlier would win then, unless its own debounce or time holds it"
    reason = (
        f"{leave.source} can be entered by {label(entry)} with {label(leave)} already open: "
        f"{held}{'' if wins else rival}"
    )
    suggestion = "part the thresholds, or give the phase a minimum_duration_ms or its exit a debounce_ms"
    severity = Severity.WARNING if at_once else Severity.NOTE
    yield about(leave, severity, reason, suggestion, counterexample=space.counterexample(point))


def _lasting(space: SignalSpace) -> Callable[[PhaseMembership], bool] | None:
    """Truth of memberships in the tick after a switch: the request that led to it is over."""
    return (lambda item: False) if isinstance(space.table, ModeTable) else None


@rule
def hysteresis(case: CheckCase) -> Iterator[Finding]:
    """Noise can undo a switch: the way back opens within it, without a debounce or a minimum duration."""
    space = signal_space(case)
    for there, back in itertools.product(range(len(space.table.transitions)), repeat=2):
        first, second = space.transition(there), space.transition(back)
        there_and_back = (first.source, first.target) == (second.target, second.source)
        stay = max(space.table.phases[second.source].minimum_ticks, second.time_out_ticks or 0)
        held = first.is_time_out or second.debounce_ticks > 1 or stay > 1
        if there_and_back and not held:
            yield from _undone(space, there, back)


def _noisy(name: str) -> str:
    """Name of a signal in the tick after the switch, with noise on it."""
    return ENTRY_TIME if name == TIME else name if name.endswith(TIME) else _NOISY + name


def _undone(space: SignalSpace, there: int, back: int) -> Iterator[Finding]:
    first, second = space.transition(there), space.transition(back)
    # A noisy signal is as far as the noise from the signal at the switch.
    noise = [
        Bound(*pair, signal_of(name).noise)
        for name in compared(second.guard)
        if not name.endswith(TIME)
        for pair in ((_NOISY + name, name), (name, _NOISY + name))
    ]

    def holds(point: Point) -> bool:
        noisy = {name.removeprefix(_NOISY): value for name, value in point.signals.items() if _NOISY in name}
        after = entered(Point({**point.signals, **noisy}, point.other))
        return space.is_open(there, point) and space.is_open(back, after)

    undoing = translated(second.guard, _noisy, _lasting(space))
    requirements = [space.requirement(there), Requirement(undoing)]
    times = {TIME: space.window(there), ENTRY_TIME: _ENTRY}
    point = next(space.find(requirements, times, holds, beside=noise), None)
    if point is None:
        return
    reason = (
        f"{label(second)} can undo {label(first)} in the next tick: noise of {ANGLE.noise:g}°, "
        f"{VELOCITY.noise:g} deg/s or {LOAD.noise:g} of body weight is enough"
    )
    suggestion = "part the thresholds by more than the noise, or give the way back a debounce_ms"
    yield about(second, Severity.WARNING, reason, suggestion, counterexample=space.counterexample(point))


RULES = (ambiguity, never_opens, debounce_beyond_time_out, cascade, hysteresis, threshold_beyond_limits)
