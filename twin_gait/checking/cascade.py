"""Switches that follow one another at once: straight through a phase, or back and forth."""

from __future__ import annotations

import itertools

from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.checking.polyhedra import TIME, Clause, Inequality, both, joined
from twin_gait.checking.signals import ENTRY_TIME, Point, SignalSpace, at_entry, entered
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import WALK
from twin_gait.gait.table import TICK

# Noise of a measured signal from tick to tick, by the last word of its name: assumptions. The encoder's
# own step is far below (0.0004° of the joint); cuffs, gears and the foot on the belt shake more.
NOISE = {"angle_deg": 0.5, "velocity_deg_per_s": 5.0, "load_bw": 0.02, WALK: 0.0}
NOISY = "noisy."
_ENTRY = (TICK, TICK)


def cascade(subject: Subject) -> list[Finding]:
    """A phase can be entered with one of its exits already open.

    A warning if the phase is left in its first tick; a note if a debounce or a minimum duration holds it
    for a     while, or if it is entered by a time-out, at which the signals may be anything.

    Args:
        subject: What is checked.

    Returns:
        A finding with a witness for each transition into a phase and exit of it.
    """
    space = SignalSpace(subject)
    findings = []
    for into, item in enumerate(space.table.transitions):
        for out in space.exits(item.target):
            after = space.transition(out)
            if after.is_time_out or (after.time_out_ticks or 0) > 1:
                continue
            findings += _straight_through(space, into, out)
    return findings


def _straight_through(space: SignalSpace, into: int, out: int) -> list[Finding]:
    """The finding, with a witness at which the entry also wins where there is such a point."""
    earlier = [
        index
        for index in space.exits(space.transition(into).source)
        if index < into
        and space.transition(index).debounce_ticks == 1
        and space.transition(index).time_out_ticks is None
    ]
    shut = space.closed(earlier)
    for closed in ([shut] if shut is not None else []) + [None]:
        found = _open_on_entry(space, into, out, closed)
        if found is not None:
            point, clause = found
            return [_passing(space, into, out, point, clause, wins=closed is not None or shut is None)]
    return []


def _open_on_entry(
    space: SignalSpace, into: int, out: int, closed: list[Clause] | None
) -> tuple[Point, Clause] | None:
    item = space.transition(into)
    earliest, latest = space.window(into)
    times = {TIME: (earliest, earliest if item.is_time_out else latest), ENTRY_TIME: _ENTRY}
    if earliest > latest:
        return None

    def holds(point: Point) -> bool:
        return space.is_open(into, point) and space.is_open(out, entered(point))

    exits = [clause.renamed(at_entry) for clause in space.clauses(out)]
    try:
        clauses = joined([space.clauses(into), exits, *([] if closed is None else [closed])], space.others)
    except GaitTableError:
        clauses = []
    for clause in clauses:
        point = space.find(clause.inequalities, clause.others, times, holds)
        if point is not None:
            return point, clause
    return None


def _passing(space: SignalSpace, into: int, out: int, point: Point, clause: Clause, *, wins: bool) -> Finding:
    entry, leave = space.transition(into), space.transition(out)
    stay = max(leave.debounce_ticks, space.table.phases[leave.source].minimum_ticks)
    at_once = stay <= 1 and not entry.is_time_out and wins
    held = f"it is left after {stay} ms" if stay > 1 else "it is left in its first tick"
    because = (
        "" if wins else "; an exit listed earlier would win then, unless its own debounce or time holds it"
    )
    return Finding(
        rule="cascade",
        severity=Severity.WARNING if at_once else Severity.NOTE,
        phase=leave.source,
        transition=label(leave),
        reason=(
            f"{leave.source} can be entered by {label(entry)} "
            f"with {label(leave)} already open: {held}{because}"
        ),
        suggestion="part the thresholds, or give the phase a minimum_duration_ms or its exit a debounce_ms",
        witness=space.witness(point, [clause]),
    )


def hysteresis(subject: Subject) -> list[Finding]:
    """Noise can undo a switch: the way back opens within the noise, without a debounce or a minimum duration.

    Args:
        subject: What is checked.

    Returns:
        A finding with the signals of the switch for each pair of transitions there and back.
    """
    space = SignalSpace(subject)
    findings = []
    for there, back in itertools.product(range(len(space.table.transitions)), repeat=2):
        first, second = space.transition(there), space.transition(back)
        there_and_back = (first.source, first.target) == (second.target, second.source)
        if there_and_back and not _is_held(space, there, back):
            findings += _undone(space, there, back)
    return findings


def _is_held(space: SignalSpace, there: int, back: int) -> bool:
    second = space.transition(back)
    stay = max(space.table.phases[second.source].minimum_ticks, second.time_out_ticks or 0)
    return space.transition(there).is_time_out or second.debounce_ticks > 1 or stay > 1


def _noisy(name: str) -> str:
    """Name of a signal in the tick after the switch, with noise on it."""
    return ENTRY_TIME if name == TIME else name if name.endswith(TIME) else NOISY + name


def _noise(clause: Clause) -> tuple[Inequality, ...]:
    """A noisy signal is as far as the noise from the signal at the switch."""
    read = {name for item in clause.inequalities for name in item.signals}
    names = sorted(name for name in read if not name.endswith(TIME))
    return tuple(
        Inequality(NOISY + name, name, above, (-1 if above else 1) * NOISE[name.rsplit(".", 1)[-1]], False)
        for name in names
        for above in (True, False)
    )


def _undone(space: SignalSpace, there: int, back: int) -> list[Finding]:
    times = {TIME: space.window(there), ENTRY_TIME: _ENTRY}

    def holds(point: Point) -> bool:
        noisy = {name.removeprefix(NOISY): value for name, value in point.signals.items() if NOISY in name}
        after = entered(Point({**point.signals, **noisy}, point.other))
        return space.is_open(there, point) and space.is_open(back, after)

    for first, second in itertools.product(space.clauses(there), space.clauses(back)):
        clause = both(first, second.renamed(_noisy))
        if not clause.others:
            continue
        point = space.find((*clause.inequalities, *_noise(second)), clause.others, times, holds)
        if point is not None:
            return [_chattering(space, there, back, point, clause)]
    return []


def _chattering(space: SignalSpace, there: int, back: int, point: Point, clause: Clause) -> Finding:
    first, second = space.transition(there), space.transition(back)
    return Finding(
        rule="hysteresis",
        severity=Severity.WARNING,
        phase=second.source,
        transition=label(second),
        reason=(
            f"{label(second)} can undo {label(first)} in the next tick: noise of {NOISE['angle_deg']:g}°, "
            f"{NOISE['velocity_deg_per_s']:g} deg/s or {NOISE['load_bw']:g} of body weight is enough"
        ),
        suggestion="part the thresholds by more than the noise, or give the way back a debounce_ms",
        witness=space.witness(point, [clause]),
    )


RULES = (cascade, hysteresis)
