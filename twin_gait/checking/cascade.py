"""Switches that follow one another at once: straight through a phase, or back and forth."""

from __future__ import annotations

import itertools

from twin_gait.checking.finding import CheckCase, Finding, Severity, about, label
from twin_gait.checking.signals import ENTRY_TIME, Point, SignalSpace, entered, signal_space
from twin_gait.gait.feasibility import TIME, Bound, Wish, atoms, translated
from twin_gait.gait.guards import WALK, Comparison
from twin_gait.gait.table import TICK

# Noise of a measured signal from tick to tick, by the last word of its name: assumptions. The encoder's
# own step is far below (0.0004° of the joint); cuffs, gears and the foot on the belt shake more.
NOISE = {"angle_deg": 0.5, "velocity_deg_per_s": 5.0, "load_bw": 0.02, WALK: 0.0}
_NOISY = "noisy."
_ENTRY = (TICK, TICK)


def cascade(case: CheckCase) -> list[Finding]:
    """A phase can be entered with one of its exits already open.

    A warning if the phase is left in its first tick; a note if a debounce or a minimum duration holds it for
    a while, or if it is entered by a time-out, at which the signals may be anything.
    """
    space = signal_space(case)
    findings = []
    for into, item in enumerate(space.table.transitions):
        for out in space.exits(item.target):
            after = space.transition(out)
            if not after.is_time_out and (after.time_out_ticks or 0) <= 1:
                findings += _straight_through(space, into, out)
    return findings


def _straight_through(space: SignalSpace, into: int, out: int) -> list[Finding]:
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
    at_entry = translated(leave.guard, lambda name: ENTRY_TIME if name == TIME else name)

    def holds(point: Point) -> bool:
        return space.is_open(into, point) and space.is_open(out, entered(point))

    both = [space.wish(into), Wish(at_entry)]
    shut = [space.wish(index, False) for index in earlier]
    wins, point = True, next(space.find([*both, *shut], times, holds), None)
    if point is None and shut:
        wins, point = False, next(space.find(both, times, holds), None)
    if point is None:
        return []
    stay = max(leave.debounce_ticks, space.table.phases[leave.source].minimum_ticks)
    at_once = stay <= 1 and not entry.is_time_out and wins
    held = f"it is left after {stay} ms" if stay > 1 else "it is left in its first tick"
    rival = "; an exit listed earlier would win then, unless its own debounce or time holds it"
    return [
        about(
            leave,
            "cascade",
            Severity.WARNING if at_once else Severity.NOTE,
            f"{leave.source} can be entered by {label(entry)} with {label(leave)} already open: "
            f"{held}{'' if wins else rival}",
            "part the thresholds, or give the phase a minimum_duration_ms or its exit a debounce_ms",
            space.counterexample(point),
        )
    ]


def hysteresis(case: CheckCase) -> list[Finding]:
    """Noise can undo a switch: the way back opens within it, without a debounce or a minimum duration."""
    space = signal_space(case)
    findings = []
    for there, back in itertools.product(range(len(space.table.transitions)), repeat=2):
        first, second = space.transition(there), space.transition(back)
        there_and_back = (first.source, first.target) == (second.target, second.source)
        stay = max(space.table.phases[second.source].minimum_ticks, second.time_out_ticks or 0)
        held = first.is_time_out or second.debounce_ticks > 1 or stay > 1
        if there_and_back and not held:
            findings += _undone(space, there, back)
    return findings


def _noisy(name: str) -> str:
    """Name of a signal in the tick after the switch, with noise on it."""
    return ENTRY_TIME if name == TIME else name if name.endswith(TIME) else _NOISY + name


def _undone(space: SignalSpace, there: int, back: int) -> list[Finding]:
    first, second = space.transition(there), space.transition(back)
    compared = [atom for atom in atoms(second.guard) if isinstance(atom, Comparison)]
    read = dict.fromkeys(name for atom in compared for name in (atom.signal, atom.minus or atom.signal))
    # A noisy signal is as far as the noise from the signal at the switch.
    noise = [
        Bound(*pair, NOISE[name.rsplit(".", 1)[-1]])
        for name in read
        if not name.endswith(TIME)
        for pair in ((_NOISY + name, name), (name, _NOISY + name))
    ]

    def holds(point: Point) -> bool:
        noisy = {name.removeprefix(_NOISY): value for name, value in point.signals.items() if _NOISY in name}
        after = entered(Point({**point.signals, **noisy}, point.other))
        return space.is_open(there, point) and space.is_open(back, after)

    wishes = [space.wish(there), Wish(translated(second.guard, _noisy))]
    times = {TIME: space.window(there), ENTRY_TIME: _ENTRY}
    point = next(space.find(wishes, times, holds, beside=noise), None)
    if point is None:
        return []
    return [
        about(
            second,
            "hysteresis",
            Severity.WARNING,
            f"{label(second)} can undo {label(first)} in the next tick: noise of {NOISE['angle_deg']:g}°, "
            f"{NOISE['velocity_deg_per_s']:g} deg/s or {NOISE['load_bw']:g} of body weight is enough",
            "part the thresholds by more than the noise, or give the way back a debounce_ms",
            space.counterexample(point),
        )
    ]


RULES = (cascade, hysteresis)
