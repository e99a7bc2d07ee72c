"""Guards evaluated by plain recursion over their tree, in the units of the table.

Written for tests and independent of :mod:`twin_gait.core.guards`. Measurements that open or close the
guards of a table are found by :mod:`twin_gait.testing`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from twin_gait.gait import TICK, LegSignals
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership

OWN_TIME = "time_in_phase_s"
OTHER_TIME = "other.time_in_phase_s"


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
            walk=self.signals.get("walk", 1.0),
            step=self.signals.get("step", 1.0),
            trunk_pitch=math.radians(self.signals.get("trunk.pitch_deg", 0.0)),
        )
