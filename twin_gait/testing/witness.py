"""What a leg has to do on a sequence of measurements, worked out a second time.

The rules of a gait table by plain recursion over its guards and plain counting of ticks. Nothing
here calls the evaluator in :mod:`twin_gait.core.guards`: the kit compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from twin_gait.gait.guards import OTHER, AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.table import TICK, GaitTable, Transition

OWN_TIME = "time_in_phase_s"
OTHER_TIME = "other.time_in_phase_s"


@dataclass(frozen=True)
class Vector:
    """Measurements of both legs in the units of the table, without the own time in the phase.

    Attributes:
        signals: Value per name; names that do not matter are 0.
        other_phase: Phase of the other leg, or None without another leg.
    """

    signals: Mapping[str, float]
    other_phase: str | None


@dataclass(frozen=True)
class Step:
    """Measurements of one tick."""

    tick: int
    vector: Vector


def to_si(name: str, value: float) -> float:
    """Convert a value from the unit in a signal's name to SI."""
    return math.radians(value) if name.endswith(("_deg", "_deg_per_s")) else value


def own_time(ticks: int) -> float:
    """Time in the phase in [s]."""
    return ticks * TICK


def holds(guard: Guard, vector: Vector, ticks: int) -> bool:
    """Whether a guard is open.

    Args:
        guard: The guard.
        vector: Measurements.
        ticks: Ticks since the phase was entered.

    Returns:
        True if it is open. Whatever reads another leg that is not there is closed.
    """
    if isinstance(guard, AllOf):
        return all(holds(inner, vector, ticks) for inner in guard.guards)
    if isinstance(guard, AnyOf):
        return any(holds(inner, vector, ticks) for inner in guard.guards)
    if isinstance(guard, PhaseMembership):
        return vector.other_phase in guard.phases
    return _compares(guard, vector, ticks)


def _compares(atom: Comparison, vector: Vector, ticks: int) -> bool:
    left = 0.0
    for name, sign in ((atom.signal, 1.0), (atom.minus, -1.0)):
        if name is None:
            continue
        if name.startswith(OTHER) and vector.other_phase is None:
            return False
        value = own_time(ticks) if name == OWN_TIME else vector.signals.get(name, 0.0)
        left += sign * to_si(name, value)
    threshold = to_si(atom.signal, atom.threshold)
    return left > threshold if atom.operator == ">" else left < threshold


def is_pure_time_out(item: Transition) -> bool:
    """Whether nothing but the time in the phase opens an exit."""
    return item.time_out_ticks is not None and item.guard == AllOf(guards=())


def exits(table: GaitTable, phase: str) -> list[int]:
    """Indices of the transitions that leave a phase, in their order of priority."""
    return [index for index, item in enumerate(table.transitions) if item.source == phase]


@dataclass
class Witness:
    """A leg that follows the rules of the table.

    Attributes:
        table: The table.
        phase: Present phase.
        entry: Tick of its entry.
        open_ticks: For each exit, on how many consecutive ticks its guard has been open.
    """

    table: GaitTable
    phase: str
    entry: int = 0
    open_ticks: dict[int, int] = field(default_factory=dict)

    def step(self, step: Step) -> int | None:
        """Advance by one tick.

        Args:
            step: The measurements.

        Returns:
            Index of the transition that is taken, or None.
        """
        stayed = step.tick - self.entry
        due = [index for index in exits(self.table, self.phase) if self._is_due(index, step, stayed)]
        if not due:
            return None
        self.phase, self.entry, self.open_ticks = self.table.transitions[due[0]].target, step.tick, {}
        return due[0]

    def _is_due(self, index: int, step: Step, stayed: int) -> bool:
        item = self.table.transitions[index]
        is_open = holds(item.guard, step.vector, stayed)
        self.open_ticks[index] = self.open_ticks.get(index, 0) + 1 if is_open else 0
        least = max(self.table.phases[item.source].minimum_ticks, item.time_out_ticks or 0)
        return self.open_ticks[index] >= item.debounce_ticks and stayed >= least


def outcomes(table: GaitTable, phase: str, steps: Sequence[Step]) -> list[int | None]:
    """Transitions that a leg takes.

    Args:
        table: The table.
        phase: Phase that the leg has entered at tick 0.
        steps: Measurements of later ticks.

    Returns:
        For every step the index of the transition, or None.
    """
    leg = Witness(table, phase)
    return [leg.step(step) for step in steps]
