"""Rules on the exits of a phase: ambiguous, never open, open on entry, undone by noise; idle conditions."""

import itertools
import re
from collections.abc import Iterator
from dataclasses import replace

from twin_gait.checking.finding import CheckCase, Finding, Severity, label, rule, transition_finding
from twin_gait.checking.signals import ENTRY_TIME, SignalSpace, signal_space
from twin_gait.gait.feasibility import Requirement, rename_signals
from twin_gait.gait.guards import Comparison, Guard, PhaseMembership, atoms, compared_signals, map_atoms
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import ANGLE, LOAD, TIME, VELOCITY, find_signal
from twin_gait.gait.table import TICK

_ENTRY = (TICK, TICK)


@rule
def ambiguity(case: CheckCase) -> Iterator[Finding]:
    """Find two exits of a phase with different targets that can be open at once; timeouts are exempt."""
    space = signal_space(case)
    pairs = [pair for phase in space.table.phases for pair in itertools.combinations(space.guarded(phase), 2)]
    for first, second in pairs:
        one, other = space.transition(first), space.transition(second)
        windows = space.window(first), space.window(second)
        times = {TIME: (max(earliest for earliest, _ in windows), windows[0][1])}
        point = None if one.target == other.target else space.first([one.guard, other.guard], times)
        if point is not None:
            reason = (
                f"{label(one)} and {label(other)} can be open at once; if both are due, {label(one)} is taken"
            )
            suggestion = "let a condition of one exclude the other, or waive the finding if this is intended"
            shown = space.counterexample(point)
            yield transition_finding(other, Severity.WARNING, reason, suggestion, counterexample=shown)


@rule
def never_opens(case: CheckCase) -> Iterator[Finding]:
    """Find exits whose guard never opens inside limits and timeout, or closes before its debounce ends."""
    space = signal_space(case)
    for index, item in enumerate(space.table.transitions):
        opens = space.opening(index) is not None
        if space.can_fire(index) or (item.is_timeout and not opens):
            continue
        earliest, latest = space.window(index)
        too_long = f"the debounce of {item.debounce_ticks} ms cannot end"
        problem = too_long if opens else f"no signals inside the limits open {_short(item.guard)}"
        reason = f"{problem} from {earliest:g} to {latest:g} s in the phase"
        suggestion = "correct thresholds, debounce or timeout, or remove the transition"
        yield transition_finding(item, Severity.ERROR, reason, suggestion)


@rule
def threshold_beyond_limits(case: CheckCase) -> Iterator[Finding]:
    """Find thresholds outside the range of their signal: the condition is always or never true."""
    space = signal_space(case)
    for item in space.table.transitions:
        times = {TIME: (TICK, space.timeout(item.source))}
        for atom in dict.fromkeys(atoms(item.guard)):
            missing = [
                truth for truth in (True, False) if not space.possible([Requirement(atom, truth)], times)
            ]
            if missing and isinstance(atom, Comparison):
                ranges = {
                    name: space.range(name) for name in compared_signals(atom) if not name.endswith(TIME)
                }
                lies = [f"{name} is in {low:.4g} … {high:.4g}" for name, (low, high) in ranges.items()]
                truth = "never" if True in missing else "always"
                reason = "; ".join([f"{_short(atom)} is {truth} true", *lies])
                suggestion = "move the threshold inside the range, or remove the condition"
                yield transition_finding(item, Severity.WARNING, reason, suggestion)


def _short(guard: Guard) -> str:
    """Format a guard and round its scaled thresholds to six significant digits."""
    return re.sub(r"\d+\.\d{6,}", lambda number: f"{float(number[0]):.6g}", str(guard))


@rule
def cascade(case: CheckCase) -> Iterator[Finding]:
    """Find phases that can be entered while one of their exits is already open.

    The finding is a warning if the phase is left in its first tick. It is a note if a debounce or a minimum
    duration holds the phase for a while, or if the phase is entered by a timeout, at which the signals may
    have any values.
    """
    space = signal_space(case)
    suggestion = "separate the thresholds, or give the phase a minimum_duration_ms or its exit a debounce_ms"
    for into, entry in enumerate(space.table.transitions):
        earliest, latest = space.window(into)
        times = {TIME: (earliest, min(earliest, latest) if entry.is_timeout else latest), ENTRY_TIME: _ENTRY}
        for out in space.guarded(entry.target):
            leave = space.transition(out)
            at_once = (leave.timeout_ticks or 0) <= 1
            point = space.first([entry.guard, _at_entry(space, leave.guard)], times) if at_once else None
            if point is not None:
                stay = max(leave.debounce_ticks, space.table.phases[leave.source].minimum_ticks)
                held = f"it is left after {stay} ms" if stay > 1 else "it is left in its first tick"
                way = f"{leave.source} can be entered by {label(entry)} with {label(leave)} already open"
                severity = Severity.NOTE if stay > 1 or entry.is_timeout else Severity.WARNING
                shown = space.counterexample(point)
                yield transition_finding(leave, severity, f"{way}: {held}", suggestion, counterexample=shown)


def _at_entry(space: SignalSpace, guard: Guard) -> Guard:
    """Return a guard as it is evaluated in the tick after a switch.

    For tables of modes, the request that led to the switch is over in this tick.
    """
    over = (lambda item: False) if isinstance(space.table, ModeTable) else None
    return rename_signals(guard, lambda name: ENTRY_TIME if name == TIME else name, over)


@rule
def hysteresis(case: CheckCase) -> Iterator[Finding]:
    """Find switches that noise can undo, because the way back has no debounce and no minimum duration.

    The guard of the way back can open in the tick after the switch, within the noise of the signals.
    """
    space = signal_space(case)
    suggestion = "separate the thresholds by more than the noise, or give the transition back a debounce_ms"
    for there, first in enumerate(space.table.transitions):
        for back in space.exits(first.target) if not first.is_timeout else ():
            second = space.transition(back)
            stay = max(space.table.phases[second.source].minimum_ticks, second.timeout_ticks or 0)
            if second.target != first.source or max(stay, second.debounce_ticks) > 1:
                continue
            undoing = _at_entry(space, map_atoms(second.guard, _within_noise))
            point = space.first([first.guard, undoing], {TIME: space.window(there), ENTRY_TIME: _ENTRY})
            if point is not None:
                reason = (
                    f"{label(second)} can undo {label(first)} in the next tick: noise of {ANGLE.noise:g}°, "
                    f"{VELOCITY.noise:g} deg/s or {LOAD.noise:g} of body weight is enough"
                )
                shown = space.counterexample(point)
                yield transition_finding(second, Severity.WARNING, reason, suggestion, counterexample=shown)


def _within_noise(atom: Comparison | PhaseMembership) -> Guard:
    """Return a condition that is open wherever noise of the signals that it reads can open the given one."""
    if isinstance(atom, PhaseMembership):
        return atom
    noise = sum(find_signal(name).noise for name in atom.names if not name.endswith(TIME))
    return replace(atom, threshold=atom.threshold + (noise if atom.operator == "<" else -noise))


RULES = (ambiguity, never_opens, cascade, hysteresis, threshold_beyond_limits)
