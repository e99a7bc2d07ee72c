"""The numbers of a gait table that a search may change, and the table with changed numbers.

Candidates are points of the unit cube. Every number is rounded to the digits that a person would type (0.01
N·m/deg, 0.1°), so that the written table is exactly the one that walked.
"""

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.checking.published_ranges import GAIN_RANGE, STIFFNESS_RANGES
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.sections import rounded
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard
from twin_gait.gait.signals import ANGLE, find_signal
from twin_gait.gait.table import BlendingLaw, GaitTable
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName, Side
from twin_gait.yaml12 import load_data

# Key under which a candidate has the numbers of the experiment that are searched together with the table.
SETTINGS = "settings"
_DEGREES_PER_RADIAN = 180.0 / math.pi
_BOUNDS = load_data(Path(__file__).with_name("bounds.yaml"))
_BOUNDS["friction_compensation_gain"] |= {"lower": GAIN_RANGE.low, "upper": GAIN_RANGE.high}
_BOUNDS["ankle_stiffness_Nm_per_deg"]["upper"] = STIFFNESS_RANGES[JointName.ANKLE].high


@dataclass(frozen=True)
class Parameter:
    """One number of a gait table."""

    name: str  # name, from the keys of the table file
    path: tuple[str | int, ...]  # path in the document of the table
    unit: str  # unit for display; empty for a ratio
    start: float  # value at the start of the search
    lower: float  # least value
    upper: float  # largest value
    digits: int  # decimal places
    logarithmic: bool  # whether the search changes it by ratios
    guard: Comparison | None  # inequality whose threshold it is, or None

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate from 0 to 1, rounded."""
        share = min(1.0, max(0.0, coordinate))
        if self.logarithmic:
            raw = self.lower * math.pow(self.upper / self.lower, share)
        else:
            raw = self.lower + share * (self.upper - self.lower)
        return round(raw, self.digits)

    @property
    def start_coordinate(self) -> float:
        """Coordinate of the start, from 0 to 1."""
        if self.logarithmic:
            return math.log(self.start / self.lower) / math.log(self.upper / self.lower)
        return (self.start - self.lower) / (self.upper - self.lower)


def editable_document(table: GaitTable) -> dict[str, Any]:
    """Return the document of a table in the units that people type, without waivers.

    A waiver holds for the table that its author looked at, so a tuned table does not inherit it.
    """
    document = table_document(replace(table, waivers=()))
    for phases in (document["phases"], *document.get("sides", {}).values()):
        for phase in phases.values():
            for joint in table.joints:
                phase[joint] = _convert_to_degrees(phase[joint])
    return document


def split_sides(table: GaitTable) -> GaitTable:
    """Return the same table with every phase written for each side, so that a search can change one leg."""
    return replace(table, side_phases={side: table.phases_of(side) for side in Side})


def tunable_parameters(
    table: GaitTable, *, thresholds: bool = True, blending: bool = True
) -> tuple[Parameter, ...]:
    """Return the numbers of a table that can be tuned, in the order of the table.

    These are k, θ0, damping and G of every phase and joint; with ``thresholds``, also the angle thresholds of
    the transitions; with ``blending``, also the duration of the blend.
    """
    document = editable_document(table)
    sides = document.get("sides", {})
    # A phase that both sides replace is not used.
    shared = {
        name: phase
        for name, phase in document["phases"].items()
        if not all(name in sides.get(side, {}) for side in Side)
    }
    found = [*_impedances(shared, table.joints, ("phases",))]
    for side, phases in sides.items():
        found += _impedances(phases, table.joints, ("sides", side))
    if blending and table.blending.law is not BlendingLaw.NONE:
        path = ("blending", "duration_ms")
        found.append(_parameter(path, float(table.blending.duration_ticks), "duration_ms"))
    for index, item in enumerate(table.transitions if thresholds else ()):
        guard = item.guard if isinstance(item.guard, (AllOf, AnyOf)) else AllOf(guards=(item.guard,))
        found += _thresholds(guard, ("transitions", index), item.cause)
    return tuple(found)


def experiment_parameters(ranges: Mapping[str, tuple[float, float, float]]) -> tuple[Parameter, ...]:
    """Return numbers of the experiment that are searched together with the table.

    ``ranges``: least value, start and largest value by key, as for ``--set``. They are rounded to three
    digits of their range. Raises ParameterError if they do not rise.
    """
    found = []
    for key, (lower, start, upper) in ranges.items():
        rising = lower <= start <= upper and lower < upper
        require(
            rising, f"also {key}", "least value, start and largest value in this order", (lower, start, upper)
        )
        digits = max(0, 2 - math.floor(math.log10(upper - lower)))
        found.append(Parameter(key, (SETTINGS, key), "", start, lower, upper, digits, False, None))
    return tuple(found)


def apply_coordinates(
    document: Mapping[str, Any], parameters: Sequence[Parameter], coordinates: Sequence[float] | np.ndarray
) -> dict[str, Any]:
    """Put other numbers (coordinates from 0 to 1) into a copy of a document of :func:`editable_document`."""
    changed: Any = copy.deepcopy(dict(document))
    for parameter, coordinate in zip(parameters, coordinates, strict=True):
        value, section = parameter.value(float(coordinate)), changed
        for step in parameter.path[:-1]:
            section = section[step]
        whole = round(value) if parameter.digits == 0 else value
        guard = parameter.guard
        section[parameter.path[-1]] = whole if guard is None else str(replace(guard, threshold=value))
    return dict(changed)


def _convert_to_degrees(entry: Mapping[str, float]) -> dict[str, float]:
    """Convert an impedance to stiffness and equilibrium in degrees."""
    damping = [key for key in entry if key.startswith("damping")]
    return {
        "stiffness_Nm_per_deg": rounded(entry["stiffness_Nm_per_rad"] / _DEGREES_PER_RADIAN),
        "equilibrium_deg": rounded(entry["equilibrium_rad"] * _DEGREES_PER_RADIAN),
        **{key: entry[key] for key in (*damping, "friction_compensation_gain")},
    }


def _impedances(
    phases: Mapping[str, Any], joints: Sequence[str], path: tuple[str, ...]
) -> Iterator[Parameter]:
    for phase, joint in product(phases, joints):
        for key, value in phases[phase][joint].items():
            kind = f"{joint}_{key}" if key.startswith("stiffness") else key
            if value != 0.0 or kind == key:  # ratios never change zero
                yield _parameter((*path, phase, str(joint), key), value, kind)


def _parameter(
    path: tuple[str | int, ...], start: float, kind: str, name: str = "", guard: Comparison | None = None
) -> Parameter:
    """Create a number of a kind that ``bounds.yaml`` lists; its name is its path if it has none."""
    row = {"logarithmic": False, **_BOUNDS[kind]}
    reach = row.pop("reach", math.nan)
    lower, upper = row.pop("lower", start - reach), row.pop("upper", start + reach)
    name = name or ".".join(str(step) for step in path if step != "phases")
    bounds = {"lower": min(lower, start), "upper": max(upper, start)}
    return Parameter(name, path, start=start, guard=guard, **bounds, **row)


def _thresholds(guard: Guard, path: tuple[str | int, ...], cause: str) -> Iterator[Parameter]:
    """Yield the angle thresholds of a guard at a path of the document."""
    if isinstance(guard, (AllOf, AnyOf)):
        path = (*path, "all" if isinstance(guard, AllOf) else "any")
        for index, inner in enumerate(guard.guards):
            yield from _thresholds(inner, (*path, index), cause)
    elif isinstance(guard, Comparison) and find_signal(guard.signal) is ANGLE:
        left = guard.signal if guard.minus is None else f"{guard.signal} - {guard.minus}"
        yield _parameter(path, guard.threshold, "threshold", f"{cause}: {left} {guard.operator}", guard)
