"""What people read of a run: its wearer, a table of the walk, what the CAN bus has carried."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from twin_gait.experiment import Experiment
from twin_gait.measures.strides import ErrorParts, stride_count
from twin_gait.measures.walk import WalkMeasures
from twin_gait.simulation.engine import BusTraffic


def describe(experiment: Experiment) -> str:
    """One line on the wearer, the speed of a belt between its ramps, and the weight that is supported."""
    patient, walking = experiment.patient, experiment.scenario.walking
    parts = ["no wearer" if patient is None else f"{patient.mass:g} kg, {patient.height:.2f} m"]
    if walking is not None and walking.belt.cruise:
        parts.append(f"{3.6 * walking.belt.cruise:.2f} km/h")
    if walking is not None and walking.support_share:
        parts.append(f"{100.0 * walking.support_share:.0f} % of the weight supported")
    return ", ".join(parts)


DASH = "–"
_DEGREE = math.degrees(1.0)
# Units of the measures in a summary, at the end of their names; all others are shares.
_UNITS = {
    "stride_time": "s", "cadence": "per_min", "step_length": "m", "braking_impulse": "Ns",
    "propulsion_impulse": "Ns", "fore_aft_force": "N", "ankle_range": "deg", "hip_lowest": "deg",
    "knee_at_contact": "deg", "knee_yield": "deg", "clearance": "m", "slip": "m", "swing_load": "N",
    "belt_power": "W", "wearer_power": "W",
}  # fmt: skip
# What a summary has under names of its own.
_ELSEWHERE = {"strides", "stride_time", "further_contacts"}


def amount(value: float | None, unit: str = "") -> str:
    """A number with its unit and as many places as a person reads; a dash for None."""
    if value is None:
        return DASH
    places = sum(abs(value) < bound for bound in (1.0, 10.0, 100.0))
    return f"{round(value, places) + 0.0:.{places}f} {unit}".strip().replace("-", "−")


def summary_of_leg(measures: WalkMeasures) -> dict[str, float]:
    """Measures of a leg for a summary, but for those that it has already."""
    names = (item.name for item in fields(measures) if item.name != "motor_power")
    found = with_units({name: getattr(measures, name) for name in names if name not in _ELSEWHERE})
    return found | {f"{joint}_motor_power_W": power for joint, power in measures.motor_power.items()}


def with_units(measures: Mapping[str, float]) -> dict[str, float]:
    """Names that end in units, and angles in degrees. ``measures`` by the names of :class:`WalkMeasures`."""
    found = {}
    for name, value in measures.items():
        unit = _UNITS.get(name, "")
        found[f"{name}_{unit}" if unit else name] = value * _DEGREE if unit == "deg" else value
    return found


def summary_of_errors(parts: ErrorParts) -> dict[str, float]:
    """Parts of the error of an angle for a summary, from [rad]."""
    lengths = {f"{name}_deg": _DEGREE * getattr(parts, name) for name in ErrorParts._fields[:-1]}
    return {**lengths, "shift_percent": 100.0 * parts.shift}


def table_of_walk(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Measures of the legs beside those of healthy walking, by their names in the summary.

    ``summary`` of a run; one of an earlier version has no such measures. Returns a head and a row for each
    measure; nothing without strides on a belt. Peaks and loads without a unit are over carried weight.
    """
    legs = {side: leg for side, leg in summary["sides"].items() if leg.get("walk") and leg["strides_counted"]}
    if not legs:
        return []
    healthy = summary["walk_reference"]
    found = [_measures(leg) for leg in legs.values()]
    rows = [("", *legs, "healthy")]
    for name in found[0]:
        values = [measures[name] for measures in found]
        if any(value is not None for value in values):
            reference = amount(healthy[name]) if name in healthy else ""
            rows.append((name.replace("_", " "), *map(amount, values), reference))
    return rows


def _measures(leg: Mapping[str, Any]) -> dict[str, float | None]:
    found = {"stride_time_s": leg["stride_time_mean_s"], **leg["walk"]}
    for joint, parts in leg.get("errors", {}).items():
        found |= {f"{joint}_error_{part}": value for part, value in parts.items()}
    return found


def carried_by_belt(summary: Mapping[str, Any]) -> str:
    """That the belt carries a walk, where it does; else empty."""
    power = summary.get("power")
    if not power or not power["carried_by_belt"]:
        return ""
    force = amount(power["guide_force_N"], "N")
    return f"The belt carries this walk: it drags the feet back, and {force} at the pelvis hold against it."


def strides_of(leg: Mapping[str, Any]) -> str:
    """Strides of a leg of a summary, their time and swing; by its phases where it has no ground."""
    by = "_by_phase" if leg["strides"] is None else ""
    counted = leg[f"strides{by}_counted"]
    told = f"{'in the air, by its phases ' if by else ''}{stride_count(counted, leg[f'strides{by}'])}"
    if counted:
        told += f" of {leg[f'stride_time{by}_mean_s']:.2f} s"
    if leg.get("swing_share") is not None:
        told += f", swing {100.0 * leg['swing_share']:.0f} %"
    return told


def lines_of(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table in lines of text, numbers to the right."""
    widths = [max(len(row[place]) for row in table) for place in range(len(table[0]))] if table else []
    for row in table:
        cells = [text.rjust(width) for text, width in zip(row[1:], widths[1:], strict=True)]
        yield "  ".join([row[0].ljust(widths[0]), *cells]).rstrip()


def summary_of_traffic(traffic: BusTraffic) -> dict[str, Any]:
    """What a bus has carried, for a summary; times in [s]."""
    frames = {frame.name: frame._asdict() for frame in traffic.frames}
    for frame in frames.values():
        del frame["name"]  # it is the key
    totals = {key: sum(frame[key] for frame in frames.values()) for key in ("sent", "lost", "destroyed")}
    return {"bus_load": traffic.load, **totals, "bus_offs": dict(traffic.bus_offs), "frames": frames}
