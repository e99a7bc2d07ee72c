"""Small gait tables for tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin_gait.gait import GaitTable, JointImpedance, PhaseParameters, Transition
from twin_gait.gait.guards import Guard, parse_guard

JOINTS = ("hip", "knee")
FIVE_PHASES = Path(__file__).parent / "tables" / "five_phases.yaml"  # a complete table that does not change


def impedance(**changes: Any) -> JointImpedance:
    values: dict[str, Any] = {
        "stiffness": 100.0,
        "equilibrium_angle": 0.2,
        "friction_compensation_gain": 0.35,
        "damping": 20.0,
    }
    return JointImpedance(**{**values, **changes})


def phase(**changes: Any) -> PhaseParameters:
    values: dict[str, Any] = {"joints": {name: impedance() for name in JOINTS}}
    return PhaseParameters(**{**values, **changes})


def guard(text: str) -> Guard:
    return parse_guard(text)


def transition(source: str, target: str, condition: str | Guard | None = None, **changes: Any) -> Transition:
    values: dict[str, Any] = {"source": source, "target": target, "cause": f"{source}_to_{target}"}
    if condition is not None:
        values["guard"] = guard(condition) if isinstance(condition, str) else condition
    return Transition(**{**values, **changes})


def two_phase_table(
    *leaving_stance: Transition, phases: Mapping[str, PhaseParameters] | None = None, **changes: Any
) -> GaitTable:
    """Return a table of stance and swing; swing is never left, since its guard needs a hip below −1000°."""
    exits = leaving_stance or (transition("stance", "swing", "hip.angle_deg > 10"),)
    values: dict[str, Any] = {
        "name": "two_phases",
        "joints": JOINTS,
        "phases": phases or {"stance": phase(), "swing": phase()},
        "transitions": (*exits, transition("swing", "stance", "hip.angle_deg < -1000", cause="never")),
    }
    return GaitTable(**{**values, **changes})
