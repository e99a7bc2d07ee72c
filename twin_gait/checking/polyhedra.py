"""Guards as unions of polyhedra, and points inside them by linear programming.

A guard in disjunctive form is a list of clauses; each clause is a polyhedron, cut out by linear
inequalities over signals in the units of the table, together with the phases that the other leg may be
in. Whether clauses can hold together is a linear program (HiGHS), with times as whole ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import OTHER, WALK, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.table import TICK

MOST_CLAUSES = 256
TIME = "time_in_phase_s"

# A comfortable distance from a threshold, by the last word of a signal: the slack is counted in it.
UNITS = {"angle_deg": 1.0, "velocity_deg_per_s": 5.0, "load_bw": 0.05, TIME: 0.01, WALK: 0.25}
# Guards that overlap by less than a millionth of a unit are taken to touch.
LEAST_SLACK = 1e-6
MOST_ROOM = 1e3  # units; only keeps the program bounded


@dataclass(frozen=True)
class Inequality:
    """``signal [- minus]`` above or below a threshold, in the units of the table.

    Attributes:
        signal: Name of the signal.
        minus: Name of a signal that is subtracted, or None.
        above: Whether it has to be above the threshold.
        threshold: The threshold.
        strict: Whether the threshold itself is excluded.
    """

    signal: str
    minus: str | None
    above: bool
    threshold: float
    strict: bool = True

    @property
    def signals(self) -> tuple[str, ...]:
        """Names that are read."""
        return (self.signal,) if self.minus is None else (self.signal, self.minus)

    def renamed(self, name: Callable[[str], str]) -> Inequality:
        """The same over other signals."""
        return replace(self, signal=name(self.signal), minus=None if self.minus is None else name(self.minus))


@dataclass(frozen=True)
class Clause:
    """Inequalities that hold together while the other leg is in one of some phases.

    Attributes:
        inequalities: The inequalities.
        others: Phases of the other leg; None stands for a leg that is not there.
    """

    inequalities: tuple[Inequality, ...]
    others: frozenset[str | None]

    def renamed(self, name: Callable[[str], str]) -> Clause:
        """The same over other signals."""
        return replace(self, inequalities=tuple(item.renamed(name) for item in self.inequalities))


def disjunctive_form(guard: Guard, others: frozenset[str | None], *, negated: bool = False) -> list[Clause]:
    """Write a guard, or its negation, as clauses of which one has to hold.

    Args:
        guard: The guard.
        others: Phases that the other leg can be in; only None without another leg, whose signals then
            open no comparison.
        negated: Whether to write the negation.

    Returns:
        The clauses; none if it can never hold.

    Raises:
        GaitTableError: If there are more than ``MOST_CLAUSES``.
    """
    if isinstance(guard, Comparison):
        return _comparison(guard, others, negated)
    if isinstance(guard, PhaseMembership):
        fitting = frozenset(phase for phase in others if (phase in guard.phases) is not negated)
        return [Clause((), fitting)] if fitting else []
    parts = [disjunctive_form(inner, others, negated=negated) for inner in guard.guards]
    if isinstance(guard, AnyOf) is not negated:
        return _limited([clause for part in parts for clause in part])
    return joined(parts, others)


def _comparison(guard: Comparison, others: frozenset[str | None], negated: bool) -> list[Clause]:
    reads_other = any(name is not None and name.startswith(OTHER) for name in (guard.signal, guard.minus))
    if reads_other and others == {None}:
        return [Clause((), others)] if negated else []
    above = (guard.operator == ">") is not negated
    inequality = Inequality(guard.signal, guard.minus, above, guard.threshold, strict=not negated)
    return [Clause((inequality,), others)]


def joined(parts: Sequence[Sequence[Clause]], others: frozenset[str | None]) -> list[Clause]:
    """Clauses that hold while one clause of every part holds.

    Args:
        parts: Disjunctive forms.
        others: Phases that the other leg can be in.

    Returns:
        Their conjunction in disjunctive form.

    Raises:
        GaitTableError: If there are more than ``MOST_CLAUSES``.
    """
    result = [Clause((), others)]
    for part in parts:
        pairs = [both(first, second) for first in result for second in part]
        result = _limited([clause for clause in pairs if clause.others])
    return result


def both(first: Clause, second: Clause) -> Clause:
    """Clause that holds while two clauses hold."""
    inequalities = tuple(dict.fromkeys((*first.inequalities, *second.inequalities)))
    return Clause(inequalities, first.others & second.others)


def _limited(clauses: list[Clause]) -> list[Clause]:
    if len(clauses) > MOST_CLAUSES:
        raise GaitTableError(
            f"a guard opens in more than {MOST_CLAUSES} ways, too many to check; use fewer any inside all"
        )
    return clauses


def find_point(
    inequalities: Sequence[Inequality], bounds: Mapping[str, tuple[float, float]]
) -> Mapping[str, float] | None:
    """Find signals that fulfil inequalities, with the largest slack up to one unit each.

    Of such points one far from the ends of the ranges is taken. Times are whole ticks.

    Args:
        inequalities: All of them have to hold.
        bounds: Range of every signal that they read, ends included.

    Returns:
        Value of every signal, or None if the largest slack is not above zero.
    """
    names = list(dict.fromkeys(name for item in inequalities for name in item.signals))
    if any(bounds[name][0] > bounds[name][1] for name in names):
        return None
    if not names:
        return {}
    return _solve(tuple(inequalities), tuple((name, *bounds[name]) for name in names))


@lru_cache(maxsize=4096)
def _solve(
    inequalities: tuple[Inequality, ...], ranges: tuple[tuple[str, float, float], ...]
) -> Mapping[str, float] | None:
    """Solve one program; several rules ask for the same ones."""
    names = [name for name, _, _ in ranges]
    bounds = {name: (low, high) for name, low, high in ranges}
    result = milp(
        c=np.array([*np.zeros(len(names)), -1.0, -1e-3]),
        integrality=np.array([*(int(_is_time(name)) for name in names), 0, 0]),
        bounds=_box(names, bounds),
        constraints=_constraints(names, inequalities, bounds),
    )
    if result.x is None or result.x[-2] < LEAST_SLACK:
        return None
    return {name: _value(name, float(result.x[column])) for column, name in enumerate(names)}


def _is_time(name: str) -> bool:
    return name.endswith(TIME)


def _scale(name: str) -> float:
    """Unit of the program's variable in that of the signal: ticks for times."""
    return TICK if _is_time(name) else 1.0


def _value(name: str, variable: float) -> float:
    return round(variable) * TICK if _is_time(name) else variable


def _unit(name: str) -> float:
    return UNITS[name.rsplit(".", 1)[-1]]


def _box(names: Sequence[str], bounds: Mapping[str, tuple[float, float]]) -> Bounds:
    """Ranges of the signals, of the slack and of the room at the ends of the ranges."""
    lower = [bounds[name][0] / _scale(name) for name in names]
    upper = [bounds[name][1] / _scale(name) for name in names]
    return Bounds([*lower, 0.0, 0.0], [*upper, 1.0, MOST_ROOM])


def _constraints(
    names: Sequence[str], inequalities: Sequence[Inequality], bounds: Mapping[str, tuple[float, float]]
) -> LinearConstraint:
    """Rows over the signals, the slack and the room, each at least its limit."""
    rows = [_row(names, item) for item in inequalities]
    for name in names:
        # A time is on a tick and a fixed signal has no room.
        if not _is_time(name) and bounds[name][0] < bounds[name][1]:
            rows += _room(names, name, *bounds[name])
    return LinearConstraint(
        np.array([row for row, _ in rows]), np.array([limit for _, limit in rows]), np.inf
    )


def _row(names: Sequence[str], item: Inequality) -> tuple[np.ndarray, float]:
    """``±(signal - minus) - slack >= ±threshold``, counted in units: the solver's tolerances are absolute."""
    sign = (1.0 if item.above else -1.0) / _unit(item.signal)
    row = np.zeros(len(names) + 2)
    row[names.index(item.signal)] += sign * _scale(item.signal)
    if item.minus is not None:
        row[names.index(item.minus)] -= sign * _scale(item.minus)
    row[-2] = -1.0 if item.strict else 0.0
    return row, sign * item.threshold


def _room(names: Sequence[str], name: str, low: float, high: float) -> list[tuple[np.ndarray, float]]:
    """The room is at most the distance of a signal, in units, from both ends of its range."""
    rows = []
    for sign, end in ((1.0, low), (-1.0, high)):
        row = np.zeros(len(names) + 2)
        row[names.index(name)], row[-1] = sign / _unit(name), -1.0
        rows.append((row, sign * end / _unit(name)))
    return rows
