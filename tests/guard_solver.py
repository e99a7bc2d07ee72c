"""Measurements that open or close the guards of a table.

Written for tests and independent of :mod:`twin_gait.core.guards`: a guard is evaluated by plain
recursion over its tree in the units of the table, and signals are found by linear programming.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from twin_gait.gait import TICK, GaitTable, LegSignals
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership, all_signal_names

OWN_TIME = "time_in_phase_s"
OTHER_TIME = "other.time_in_phase_s"

# Range of each signal, and the distance from a threshold that counts as comfortable.
_RANGES = {
    "angle_deg": (-90.0, 150.0, 1.0),
    "velocity_deg_per_s": (-400.0, 400.0, 5.0),
    "load_bw": (0.0, 2.0, 0.05),
    "time_in_phase_s": (0.0, 10.0, 0.01),
}


def _range(name: str) -> tuple[float, float, float]:
    return _RANGES[name.rsplit(".", 1)[-1]]


def difference(comparison: Comparison, signals: Mapping[str, float]) -> float:
    """Left side of a comparison in the units of the table."""
    minus = 0.0 if comparison.minus is None else signals[comparison.minus]
    return signals[comparison.signal] - minus


def holds(guard: Guard, signals: Mapping[str, float], other_phase: str | None) -> bool:
    """Evaluate a guard by recursion over its tree."""
    if isinstance(guard, AllOf):
        return all(holds(inner, signals, other_phase) for inner in guard.guards)
    if isinstance(guard, AnyOf):
        return any(holds(inner, signals, other_phase) for inner in guard.guards)
    if isinstance(guard, PhaseMembership):
        return other_phase in guard.phases
    left = difference(guard, signals)
    return left > guard.threshold if guard.operator == ">" else left < guard.threshold


Atom = Comparison | PhaseMembership


def clauses(guard: Guard) -> list[tuple[Atom, ...]]:
    """Disjunctive normal form: the guard holds while all atoms of one of the clauses hold."""
    if isinstance(guard, AnyOf):
        return [clause for inner in guard.guards for clause in clauses(inner)]
    if isinstance(guard, AllOf):
        parts = [clauses(inner) for inner in guard.guards]
        return [tuple(itertools.chain(*chosen)) for chosen in itertools.product(*parts)]
    return [(guard,)]


@dataclass(frozen=True)
class Wish:
    """One thing that a set of measurements has to fulfil.

    Attributes:
        atom: The atom.
        true: Whether it has to hold.
        edge: Distance from the threshold, in the unit of the signal, that is wanted exactly; None
            for any comfortable distance.
    """

    atom: Atom
    true: bool = True
    edge: float | None = None


@dataclass(frozen=True)
class Measurements:
    """A set of measurements in the units of the table."""

    signals: Mapping[str, float]
    other_phase: str | None

    @property
    def tick(self) -> int:
        """Ticks in the phase that the time in phase stands for."""
        return round(self.signals[OWN_TIME] / TICK)

    def leg(self, joints: Sequence[str], prefix: str = "") -> LegSignals:
        """Signals of this leg, or with the prefix ``other.`` of the other, in SI units."""
        return LegSignals(
            angles=tuple(math.radians(self.signals[f"{prefix}{name}.angle_deg"]) for name in joints),
            velocities=tuple(
                math.radians(self.signals[f"{prefix}{name}.velocity_deg_per_s"]) for name in joints
            ),
            foot_load=self.signals[f"{prefix}foot.load_bw"],
        )


def closing(guard: Guard, *, allow_time: bool = True) -> Iterator[tuple[Wish, ...]]:
    """Ways to keep a guard closed: from each clause one atom that does not hold."""
    options = []
    for clause in clauses(guard):
        atoms = [atom for atom in clause if allow_time or not _reads_own_time(atom)]
        if not atoms:
            return
        options.append(atoms)
    for chosen in itertools.product(*options):
        yield tuple(Wish(atom, true=False) for atom in dict.fromkeys(chosen))


def _reads_own_time(atom: Atom) -> bool:
    return isinstance(atom, Comparison) and OWN_TIME in (atom.signal, atom.minus)


def solve(
    table: GaitTable, wishes: Sequence[Wish], earliest: float = 0.0, latest: float = math.inf
) -> Measurements | None:
    """Find measurements that fulfil all wishes.

    Args:
        table: The table.
        wishes: What has to be true.
        earliest: Least time in the phase in [s].
        latest: Largest time in the phase in [s].

    Returns:
        The measurements, or None if there are none.
    """
    memberships = [wish for wish in wishes if isinstance(wish.atom, PhaseMembership)]
    phases = [
        name
        for name in (*table.phase_names, None)
        if all((name in wish.atom.phases) is wish.true for wish in memberships)  # type: ignore[union-attr]
    ]
    if not phases:
        return None
    comparisons = [wish for wish in wishes if isinstance(wish.atom, Comparison)]
    signals = _signals(table, comparisons, earliest, latest)
    if signals is None:
        return None
    # The other leg is there unless the wishes exclude all its phases.
    return Measurements(signals, phases[0])


def _signals(
    table: GaitTable, wishes: Sequence[Wish], earliest: float, latest: float
) -> dict[str, float] | None:
    names = all_signal_names(table.joints)
    rows, limits, equal_rows, equal_limits = [], [], [], []
    for wish in wishes:
        atom = wish.atom
        assert isinstance(atom, Comparison)
        # Orient the row so that the wish is row·x > limit.
        sign = 1.0 if (atom.operator == ">") is wish.true else -1.0
        row = np.zeros(len(names) + 1)
        row[names.index(atom.signal)] += sign
        if atom.minus is not None:
            row[names.index(atom.minus)] -= sign
        if wish.edge is not None:
            equal_rows.append(row)
            equal_limits.append(sign * atom.threshold + wish.edge)
        else:
            row[-1] = -_range(atom.signal)[2]
            rows.append(-row)
            limits.append(-sign * atom.threshold)
    bounds = [_range(name)[:2] for name in names]
    bounds[names.index(OWN_TIME)] = (earliest, min(latest, bounds[names.index(OWN_TIME)][1]))
    if bounds[names.index(OWN_TIME)][0] > bounds[names.index(OWN_TIME)][1]:
        return None
    objective = np.zeros(len(names) + 1)
    objective[-1] = -1.0  # the last variable is the distance from all other thresholds
    result = linprog(
        objective,
        A_ub=np.array(rows) if rows else None,
        b_ub=limits or None,
        A_eq=np.array(equal_rows) if equal_rows else None,
        b_eq=equal_limits or None,
        bounds=[*bounds, (0.2, 1.0)],
        method="highs",
    )
    if result.status != 0:
        return None
    found = dict(zip(names, (float(value) for value in result.x), strict=False))
    return {name: _whole_ticks(name, value) for name, value in found.items()}


def _whole_ticks(name: str, value: float) -> float:
    return round(value / TICK) * TICK if name in (OWN_TIME, OTHER_TIME) else value


def solve_with_closed(
    table: GaitTable,
    wishes: Sequence[Wish],
    closed: Sequence[Guard],
    earliest: float = 0.0,
    latest: float = math.inf,
    *,
    allow_time: bool = True,
) -> Measurements | None:
    """Find measurements that fulfil the wishes and keep some guards closed."""
    for ways in itertools.product(*(list(closing(guard, allow_time=allow_time)) for guard in closed)):
        found = solve(table, [*wishes, *itertools.chain(*ways)], earliest, latest)
        if found is not None:
            return found
    return None


def exits(table: GaitTable, source: str) -> list[int]:
    """Indices of the transitions that leave a phase, in the order of the table."""
    return [index for index, item in enumerate(table.transitions) if item.source == source]


def earliest_time_out(table: GaitTable, source: str) -> float:
    """Ticks after which the first pure time-out of a phase fires; infinite without one."""
    leaving = [table.transitions[index] for index in exits(table, source)]
    ticks = [item.time_out_ticks for item in leaving if item.is_time_out]
    return min((item for item in ticks if item is not None), default=math.inf)


def edge_of(atom: Comparison, true: bool) -> float:
    """Distance just beyond a threshold: the next tick for times, a thousandth of a comfortable one else."""
    names = (atom.signal, atom.minus)
    if OWN_TIME not in names and OTHER_TIME not in names:
        return 1e-3 * _range(atom.signal)[2]
    sign = 1.0 if (atom.operator == ">") is true else -1.0
    nearest = round(atom.threshold / TICK)
    distances = [sign * ((nearest + k) * TICK - atom.threshold) for k in range(-3, 4)]
    # Strict: a comparison that must not hold may lie on its threshold.
    return min(item for item in distances if item > 0.0 or (item == 0.0 and not true))


def other_guards(table: GaitTable, index: int) -> list[Guard]:
    """Guards of the other exits of a transition's phase that are not pure time-outs."""
    return [
        table.transitions[other].guard
        for other in exits(table, table.transitions[index].source)
        if other != index and not table.transitions[other].is_time_out
    ]
