"""Ranges of the signals that a table reads, and points in them where guards are open."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_gait.checking.finding import Subject
from twin_gait.checking.polyhedra import (
    TIME,
    Clause,
    Inequality,
    disjunctive_form,
    find_point,
    joined,
)
from twin_gait.core.guards import END_NODE, FIRST_NODE, NO_TRANSITION, guard_holds, next_transition
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import OTHER, WALK, all_signal_names, signal_scale
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import TICK, Transition

OTHER_PHASE = "other.phase"
OTHER_TIME = OTHER + TIME
# Time in the phase just after a switch, at which the exits of the new phase are read first.
ENTRY_TIME = "entry." + TIME
HIGHEST_LOAD = 2.0  # [body weight]: walking loads a foot with 1.2 at most, running with 2 to 3
LONGEST_STAY = 3600.0  # [s], for a phase without a time-out

_DEGREE = math.pi / 180.0
# Where no leg model says more: normal ranges of motion (Merck Manual: hip -15 … 125°, knee 0 … 130°,
# ankle -50 … 20°), with 5 to 15° more for prostheses and overshoot.
JOINT_RANGES = {
    "hip": (-30.0 * _DEGREE, 130.0 * _DEGREE),
    "knee": (-5.0 * _DEGREE, 140.0 * _DEGREE),
    "ankle": (-55.0 * _DEGREE, 30.0 * _DEGREE),
}
ANY_ANGLE = (-math.pi, math.pi)
# [rad] / [s]: an assumption; the knee reaches 400 deg/s in the swing of a normal walk.
HIGHEST_VELOCITY = 500.0 * _DEGREE


@dataclass(frozen=True)
class Point:
    """Signals by name in the units of the table, and the phase of the other leg."""

    signals: Mapping[str, float]
    other: str | None


class SignalSpace:
    """What both legs of a table can measure, inside their limits.

    Attributes:
        subject: What is checked.
        table: Its table.
        others: Phases that the other leg can be in; only None without another leg.
    """

    def __init__(self, subject: Subject) -> None:
        """Lay out the ranges and compile the guards."""
        self.subject = subject
        self.table = subject.table
        self.others: frozenset[str | None] = (
            frozenset(self.table.phase_names) if subject.has_other_leg else frozenset({None})
        )
        self.program = compile_guards(self.table)
        self.names = all_signal_names(self.table.joints)
        self._scales = {name: signal_scale(name) for name in self.names}
        self._clauses = [disjunctive_form(item.guard, self.others) for item in self.table.transitions]

    # ------------------------------------------------------------------ the table

    def exits(self, phase: str) -> list[int]:
        """Indices of the transitions that leave a phase."""
        return [index for index, item in enumerate(self.table.transitions) if item.source == phase]

    def transition(self, index: int) -> Transition:
        """A transition of the table."""
        return self.table.transitions[index]

    def clauses(self, index: int) -> list[Clause]:
        """Guard of a transition in disjunctive form."""
        return self._clauses[index]

    def closed(self, indices: Sequence[int]) -> list[Clause] | None:
        """Clauses that keep exits closed.

        Args:
            indices: The exits.

        Returns:
            The clauses, or None if there are too many.
        """
        try:
            parts = [
                disjunctive_form(self.transition(index).guard, self.others, negated=True) for index in indices
            ]
            return joined(parts, self.others)
        except GaitTableError:
            return None

    def time_out(self, phase: str | None) -> float:
        """Time in [s] at which the first pure time-out ends a phase, an hour without one."""
        ticks = [
            item.time_out_ticks
            for item in self.table.transitions
            if item.source == phase and item.is_time_out and item.time_out_ticks is not None
        ]
        return min([tick * TICK for tick in ticks], default=LONGEST_STAY)

    def window(self, index: int) -> tuple[float, float]:
        """Times in the phase in [s] at which a transition could fire without a debounce."""
        item = self.transition(index)
        earliest = max(1, self.table.phases[item.source].minimum_ticks, item.time_out_ticks or 0)
        return earliest * TICK, self.time_out(item.source)

    # ------------------------------------------------------------------ ranges

    def range(self, name: str) -> tuple[float, float]:
        """Range of a measured signal in the units of the table; either leg's."""
        if name.rpartition(".")[2] == WALK:
            return 0.0, 1.0
        # The variables of a program may have further words in front: other, entry, noisy, end.
        _, joint_or_foot, quantity = f".{name}".rsplit(".", 2)
        if quantity == "load_bw":
            return 0.0, HIGHEST_LOAD
        if quantity == "velocity_deg_per_s":
            highest = self.subject.velocity_limits.get(joint_or_foot, HIGHEST_VELOCITY) / _DEGREE
            return -highest, highest
        low, high = self.subject.limits[joint_or_foot]
        return low / _DEGREE, high / _DEGREE

    def find(
        self,
        inequalities: Sequence[Inequality],
        others: frozenset[str | None],
        times: Mapping[str, tuple[float, float]],
        holds: Callable[[Point], bool],
    ) -> Point | None:
        """Find signals inside the limits that fulfil inequalities.

        Args:
            inequalities: All of them have to hold.
            others: Phases that the other leg may be in.
            times: Range of each time in a phase in [s]; the other leg's follows from its phase, any
                further one is free.
            holds: What has to be true of the point by the evaluator of guards; also after rounding.

        Returns:
            The point, rounded as far as it stays true, or None.
        """
        names = {name for item in inequalities for name in item.signals}
        candidates = [phase for phase in (*self.table.phase_names, None) if phase in others]
        for other in candidates if OTHER_TIME in names else candidates[:1]:
            ranges = {OTHER_TIME: (0.0, self.time_out(other)), **times}
            bounds = {
                name: ranges.get(name, (0.0, LONGEST_STAY)) if name.endswith(TIME) else self.range(name)
                for name in names
            }
            found = find_point(inequalities, bounds)
            if found is not None:
                point = _rounded(Point(found, other), holds)
                if point is not None:
                    return point
        return None

    # ------------------------------------------------------------------ evaluation

    def array(self, point: Point) -> np.ndarray:
        """Signal array of a point as the evaluator reads it; signals that it leaves open are 0."""
        values = np.array([point.signals.get(name, 0.0) * scale for name, scale in self._scales.items()])
        if point.other is None:
            values[len(values) // 2 :] = np.nan
        return values

    def is_open(self, index: int, point: Point) -> bool:
        """Whether the guard of a transition is open at a point."""
        row = self.program.transitions[index]
        other = -1 if point.other is None else self.table.phase_index(point.other)
        return guard_holds(
            self.program.nodes,
            int(row[FIRST_NODE]),
            int(row[END_NODE]),
            self.program.comparisons,
            self.array(point),
            other,
        )

    def winner(self, phase: str, point: Point, time: float) -> int | None:
        """Transition that a leg takes at a point when the debounce of all its exits is over.

        Args:
            phase: Phase of the leg.
            point: Its signals.
            time: In the phase in [s].

        Returns:
            Index of the transition, or None.
        """
        debounce = np.array([item.debounce_ticks - 1 for item in self.table.transitions], dtype=np.int64)
        index = next_transition(
            self.table.phase_index(phase),
            round(time / TICK),
            int(self.program.minimum_ticks[self.table.phase_index(phase)]),
            self.program.transitions,
            self.program.nodes,
            self.program.comparisons,
            self.array(point),
            -1 if point.other is None else self.table.phase_index(point.other),
            debounce,
        )
        return None if index == NO_TRANSITION else index

    def witness(self, point: Point, clauses: Sequence[Clause]) -> dict[str, float | str]:
        """Signals of a point that clauses read, for a finding; the rest may have any value."""
        names = {name for clause in clauses for item in clause.inequalities for name in item.signals}
        found: dict[str, float | str] = {
            name: point.signals[name] for name in self.names if name in names and name in point.signals
        }
        reads_phase = any(clause.others != self.others for clause in clauses)
        if point.other is not None and (reads_phase or OTHER_TIME in names):
            found[OTHER_PHASE] = point.other
        return found


def at_entry(name: str) -> str:
    """Name of a signal as the exits of a phase read it in the tick after the switch to it."""
    return ENTRY_TIME if name == TIME else name


def entered(point: Point) -> Point:
    """A point as the exits of a phase read it in the tick after the switch to it."""
    return Point({**point.signals, TIME: TICK}, point.other)


def swapped(name: str) -> str:
    """Name that the other leg has for a signal; both are told the same."""
    if name == WALK:
        return name
    return name.removeprefix(OTHER) if name.startswith(OTHER) else OTHER + name


def _rounded(point: Point, holds: Callable[[Point], bool]) -> Point | None:
    """The point with as few decimals as keep it true."""
    for decimals in range(1, 7):
        signals = {
            # Adding 0 turns -0 into 0.
            name: round(value, max(decimals, 3) if name.endswith(TIME) else decimals) + 0.0
            for name, value in point.signals.items()
        }
        rounded = Point(signals, point.other)
        if holds(rounded):
            return rounded
    return point if holds(point) else None
