"""Ranges of the signals that a table reads, and points in them at which guards are open or closed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from twin_gait.checking.finding import CheckCase, once
from twin_gait.core.guards import evaluate_guard
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.feasibility import (
    ZERO,
    Bound,
    Case,
    Requirement,
    comparison_bound,
    enumerate_solutions,
    equal,
    rename_signals,
)
from twin_gait.gait.guards import Guard, compared_signals
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import (
    DEVICE_NAMES,
    HIGHEST_VELOCITY,
    LONGEST_STAY,
    OTHER,
    OTHER_TIME,
    TIME,
    VELOCITY,
    find_signal,
    signal_part,
    signal_scale,
)
from twin_gait.gait.table import TICK, Transition

OTHER_PHASE = "other.phase"
# Time in the phase just after a switch, at which the exits of the new phase are evaluated first.
ENTRY_TIME = "entry." + TIME
_END = "end."  # prefix of the signals at the end of a debounce

_DEGREE = math.pi / 180.0
# Ranges without a leg model: normal ranges of motion (Merck Manual: hip −15–125°, knee 0–130°,
# ankle −50–20°), extended by 5–15° for prostheses and overshoot.
JOINT_RANGES = {
    "hip": (-30.0 * _DEGREE, 130.0 * _DEGREE),
    "knee": (-5.0 * _DEGREE, 140.0 * _DEGREE),
    "ankle": (-55.0 * _DEGREE, 30.0 * _DEGREE),
}
ANY_ANGLE = (-math.pi, math.pi)

Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class SignalPoint:
    """Signals by name in the units of the table, and the phase of the other leg."""

    signals: Mapping[str, float]  # signals that decide
    other: str | None  # phase of the other leg, or None if there is none
    phase_decides: bool = False  # whether this phase decides, too


class SignalSpace:
    """Ranges of all signals that both legs of a table can measure.

    Attributes:
        case: Case that is checked.
        table: Table of the case.
        others: Phases in which the other leg can be; only None without another leg. For modes the requests,
            including None.
        opening: Function that returns signals that open an exit, time permitting, with the other leg in a
            given phase or in any.
        can_fire: Function that returns whether an exit can be open for the time of its debounce, with all
            signals free meanwhile.
    """

    def __init__(self, case: CheckCase) -> None:
        """Collect the ranges and compile the guards."""
        self.case = case
        self.table = case.table
        modes, members = isinstance(case.table, ModeTable), case.table.members
        self.others = (None, *members) if modes else members if case.has_other_leg else (None,)
        self.program = compile_guards(self.table)
        self._scales = {name: signal_scale(name) for name in self.table.signals}
        self.opening, self.can_fire = cache(self._opening), cache(self._can_fire)

    def exits(self, phase: str) -> list[int]:
        """Return the indices of the transitions that leave a phase."""
        return [index for index, item in enumerate(self.table.transitions) if item.source == phase]

    def guarded(self, phase: str) -> list[int]:
        """Return the indices of the transitions that leave a phase by a guard, not by time alone."""
        return [index for index in self.exits(phase) if not self.transition(index).is_timeout]

    def transition(self, index: int) -> Transition:
        """Return a transition of the table."""
        return self.table.transitions[index]

    def timeout(self, phase: str | None) -> float:
        """Return the time in [s] at which the first pure timeout ends a phase; an hour if there is none."""
        exits = [item for item in self.table.transitions if item.source == phase and item.is_timeout]
        return min([(item.timeout_ticks or 0) * TICK for item in exits], default=LONGEST_STAY)

    def window(self, index: int) -> tuple[float, float]:
        """Return the times in the phase in [s] at which a transition could fire without a debounce."""
        item = self.transition(index)
        earliest = max(1, self.table.phases[item.source].minimum_ticks, item.timeout_ticks or 0)
        return earliest * TICK, self.timeout(item.source)

    def range(self, name: str) -> tuple[float, float]:
        """Return the range of a measured signal of either leg in the units of the table."""
        # The unknowns of a search may have further prefixes: other, entry, noisy, end.
        signal, part = find_signal(name), signal_part(name)
        if signal is VELOCITY:
            highest = self.case.velocity_limits.get(part, HIGHEST_VELOCITY)
            low, high = -highest, highest
        else:
            low, high = signal.range or self.case.limits[part]
        return low / signal.unit.factor, high / signal.unit.factor

    def find(
        self,
        requirements: Sequence[Requirement],
        ranges: Ranges,
        *,
        other: str | None = None,
        extra_bounds: Sequence[Bound] = (),
    ) -> Iterator[SignalPoint]:
        """Find signals inside the limits that open or close guards.

        Args:
            requirements: Guards that have to be open or closed.
            ranges: Range of each time in a phase in [s] (the range of the other leg's time follows from its
                phase, any further time is free), and of signals whose range is narrower than their limits.
            other: Phase of the other leg; None for any.
            extra_bounds: Additional bounds that have to be kept, times in [s].

        Yields:
            A point for each way to fulfil the requirements, rounded if it fulfils them after rounding.

        Raises:
            GaitTableError: If the guards have too many choices to try.
        """
        if any(low > high + 0.5 * TICK for name, (low, high) in ranges.items() if name.endswith(TIME)):
            return
        others = self.others if other is None else (other,)
        read = {name for requirement in requirements for name in compared_signals(requirement.guard)}
        timed = OTHER_TIME in read and OTHER_TIME not in ranges
        for phases in [(phase,) for phase in others] if timed else [others]:
            all_ranges = {OTHER_TIME: (0.0, self.timeout(phases[0])), **ranges}
            for found in self._solutions(Case(phases, tuple(extra_bounds)), requirements, all_ranges):
                decides = found.phase_decides or (OTHER_TIME in read and found.other is not None)
                yield replace(found, phase_decides=decides)

    def first(self, guards: Sequence[Guard], ranges: Ranges, other: str | None = None) -> SignalPoint | None:
        """Return the first point of :meth:`find` at which some guards are open, or None."""
        return next(self.find([Requirement(guard) for guard in guards], ranges, other=other), None)

    def possible(
        self, requirements: Sequence[Requirement], ranges: Ranges, extra_bounds: Sequence[Bound] = ()
    ) -> bool:
        """Return whether :meth:`find` finds any point; True if there are too many choices to try."""
        try:
            return next(self.find(requirements, ranges, extra_bounds=extra_bounds), None) is not None
        except GaitTableError:
            return True

    def _solutions(
        self, start: Case, requirements: Sequence[Requirement], ranges: Ranges
    ) -> Iterator[SignalPoint]:
        def within(bound: Bound) -> list[Bound]:
            """Return a bound and the limits of the signals that it reads."""
            found = [bound]
            for name in bound.names:
                low, high = ranges.get(name) or self.range(name)
                found += [Bound(ZERO, name, -low), Bound(name, ZERO, high)]
            return [_in_ticks(item) for item in found]

        given = tuple(item for bound in start.bounds for item in within(bound))
        ways = enumerate_solutions(
            start._replace(bounds=given), requirements, lambda *atom: within(comparison_bound(*atom))
        )
        for way, values in ways:
            rounded = {name: round(value, 3) + 0.0 for name, value in values.items()}  # no -0
            shown = rounded if all(bound.is_satisfied(rounded) for bound in way.bounds) else values
            times = {name: round(TICK * value, 3) for name, value in shown.items() if name.endswith(TIME)}
            yield SignalPoint({**shown, **times}, way.phases[0], way.phases != start.phases)

    def _opening(self, index: int, other: str | None = None) -> SignalPoint | None:
        return self.first([self.transition(index).guard], {TIME: self.window(index)}, other)

    def _can_fire(self, index: int) -> bool:
        item = self.transition(index)
        if item.debounce_ticks == 1:
            return self.opening(index) is not None
        earliest, latest = self.window(index)
        stay = (item.debounce_ticks - 1) * TICK
        # Both ends of the debounce lie in the guard, so do all points between them, since a choice of bounds
        # is convex. The other leg may have switched meanwhile.
        last = rename_signals(item.guard, lambda name: _END + name, lambda membership: True)
        both = [Requirement(item.guard), Requirement(last)]
        times = {TIME: (TICK, latest), _END + TIME: (max(earliest, TICK + stay), latest)}
        return self.possible(both, times, equal(_END + TIME, TIME, stay))

    def is_open(self, index: int, point: SignalPoint) -> bool:
        """Return whether the guard of a transition is open at a point; signals without a value are 0.

        Signals may be arrays of one shape, for as many points.
        """
        absent = OTHER if point.other is None else ()
        measured = [
            math.nan if name.startswith(absent) else point.signals.get(name, 0.0) * scale
            for name, scale in self._scales.items()
        ]
        rule, other = self.program.transitions[index], self.table.member_index(point.other)
        return evaluate_guard(self.program, rule.first_node, rule.end_node, measured, other)

    def counterexample(self, point: SignalPoint) -> dict[str, float | str]:
        """Return the signals of a point that decide, for a finding; all others may have any value."""
        found: dict[str, float | str] = {
            name: point.signals[name] for name in self._scales if name in point.signals
        }
        if point.other is not None and point.phase_decides:
            found[self.table.vocabulary.quantity] = point.other
        return found


signal_space = once(SignalSpace)  # signal space of a case, built once for all rules


def _in_ticks(bound: Bound) -> Bound:
    """Convert a bound on times in [s] to a bound on whole ticks; return any other bound unchanged."""
    if not any(name.endswith(TIME) for name in bound.names):
        return bound
    return replace(bound, limit=bound.limit / TICK, margin=bound.margin / TICK, is_integer=True)


def swapped(name: str) -> str:
    """Return the name that the other leg has for a signal; signals of the device keep their name."""
    if name in DEVICE_NAMES:
        return name
    return name.removeprefix(OTHER) if name.startswith(OTHER) else OTHER + name
