"""Evaluation of guards by plain recursion over their tree, in the units of the table.

The module is independent of :mod:`twin_gait.core.guards`. Measurements that open or close the guards of a
table are found by :mod:`twin_gait.testing`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin_gait.gait import TICK
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership

OWN_TIME = "time_in_phase_s"
OTHER_TIME = "other.time_in_phase_s"


def difference(comparison: Comparison, signals: Mapping[str, float]) -> float:
    """Return the left side of a comparison in the units of the table."""
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


@dataclass(frozen=True)
class Measurements:
    """Measurements of one tick in the units of the table."""

    signals: Mapping[str, float]
    other_phase: str | None

    @property
    def tick(self) -> int:
        """Number of ticks in the phase, from the time in phase."""
        return round(self.signals[OWN_TIME] / TICK)
