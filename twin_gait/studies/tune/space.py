"""The numbers of a gait table that a search may change, and the table with other numbers in it.

Candidates are points of the unit cube. Every number is rounded to what a person would type (0.01 Nm/deg,
0.1°), so that the table that is written is the very one that walked.
"""

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from twin_gait.checking.sense import GAIN_RANGE, STIFFNESS_RANGES
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.sections import rounded
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard
from twin_gait.gait.signals import ANGLE, signal_of
from twin_gait.gait.table import BlendingLaw, GaitTable
from twin_gait.vocabulary import JointName, Side

_PER_DEGREE = 180.0 / math.pi
# Bounds of the search; a start outside widens them. Stiffness in [N m] / [deg]: the least that moves a leg
# against the friction of these drives, and a little above what the shipped table was searched with; of the
# ankle the published range (Sup et al. 2009), for lack of such a search.
SOFTEST = 0.3
STIFFEST = {JointName.HIP: 8.0, JointName.KNEE: 10.0, JointName.ANKLE: STIFFNESS_RANGES[JointName.ANKLE].most}
DAMPING_RATIOS = (0.4, 1.3)
DAMPINGS = (5.0, 80.0)  # [N m s] / [rad], for tables that give no ratio
ANGLE_REACH = 12.0  # [deg] to either side of the start
THRESHOLD_REACH = 6.0  # [deg] to either side of the start
BLENDING_MS = (15.0, 120.0)


@dataclass(frozen=True)
class Parameter:
    """One number of a gait table."""

    name: str  # what it is called, by the words of the table's file
    path: tuple[str | int, ...]  # its place in the document of the table
    unit: str  # for people; empty for a ratio
    start: float  # where the search begins
    lower: float  # least value
    upper: float  # largest value
    digits: int  # decimal places
    logarithmic: bool = False  # whether the search steps by ratios
    guard: Comparison | None = None  # the inequality that it is the threshold of, or None

    def value(self, coordinate: float) -> float:
        """Value at a coordinate from 0 to 1, rounded."""
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
    """Document of a table in the units that people type, without waivers.

    What was waived for one table has not been looked at for the next, so a tuned table does not inherit it.
    """
    document = table_document(replace(table, waivers=()))
    for phases in (document["phases"], *document.get("sides", {}).values()):
        for phase in phases.values():
            for joint in table.joints:
                phase[joint] = _in_degrees(phase[joint])
    return document


def with_own_sides(table: GaitTable) -> GaitTable:
    """The same table with every phase written for each side, so that a search can tell the legs apart."""
    return replace(table, side_phases={side: table.phases_of(side) for side in Side})


def parameters_of(
    table: GaitTable, *, thresholds: bool = True, blending: bool = True
) -> tuple[Parameter, ...]:
    """Numbers of a table that can be tuned: k, θ0, damping, G of every phase and joint, and more if asked.

    The more are angle thresholds of the transitions and the duration of the blend, in the order of the table.
    """
    document = editable_document(table)
    sides = document.get("sides", {})
    # A phase that both sides replace is nobody's.
    shared = {
        name: phase
        for name, phase in document["phases"].items()
        if not all(name in sides.get(side, {}) for side in Side)
    }
    found = [*_impedances(shared, table.joints, ("phases",))]
    for side, phases in sides.items():
        found += _impedances(phases, table.joints, ("sides", side))
    if blending and table.blending.law is not BlendingLaw.NONE:
        lower, upper = BLENDING_MS
        start = float(table.blending.duration_ticks)
        found.append(_parameter(("blending", "duration_ms"), start, "ms", lower, upper, 0))
    for index, item in enumerate(table.transitions if thresholds else ()):
        guard = item.guard if isinstance(item.guard, (AllOf, AnyOf)) else AllOf(guards=(item.guard,))
        found += _thresholds(guard, ("transitions", index), item.cause)
    return tuple(found)


def table_with(
    document: Mapping[str, Any], parameters: Sequence[Parameter], coordinates: Sequence[float] | np.ndarray
) -> dict[str, Any]:
    """Put other numbers (coordinates from 0 to 1) into a copy of a document of :func:`editable_document`."""
    changed: Any = copy.deepcopy(dict(document))
    for parameter, coordinate in zip(parameters, coordinates, strict=True):
        value, place = parameter.value(float(coordinate)), changed
        for step in parameter.path[:-1]:
            place = place[step]
        whole = round(value) if parameter.digits == 0 else value
        guard = parameter.guard
        place[parameter.path[-1]] = whole if guard is None else str(replace(guard, threshold=value))
    return dict(changed)


def _in_degrees(entry: Mapping[str, float]) -> dict[str, float]:
    """Impedance with stiffness and equilibrium in degrees."""
    known = {
        **entry,
        "stiffness_Nm_per_deg": rounded(entry["stiffness_Nm_per_rad"] / _PER_DEGREE),
        "equilibrium_deg": rounded(entry["equilibrium_rad"] * _PER_DEGREE),
    }
    order = ("stiffness_Nm_per_deg", "damping_ratio", "damping_Nms_per_rad", "equilibrium_deg")
    return {key: known[key] for key in (*order, "friction_compensation_gain") if key in known}


def _impedances(
    phases: Mapping[str, Any], joints: Sequence[str], path: tuple[str, ...]
) -> Iterator[Parameter]:
    for phase, joint in product(phases, joints):
        entry, place = phases[phase][joint], (*path, phase, str(joint))
        stiffness, angle = entry["stiffness_Nm_per_deg"], entry["equilibrium_deg"]
        bounds: dict[str, tuple[str, float, float, int]] = {
            "stiffness_Nm_per_deg": ("Nm/deg", SOFTEST, STIFFEST[JointName(joint)], 2),
            "equilibrium_deg": ("deg", angle - ANGLE_REACH, angle + ANGLE_REACH, 1),
            "damping_ratio": ("", *DAMPING_RATIOS, 2),
            "damping_Nms_per_rad": ("Nm s/rad", *DAMPINGS, 1),
            "friction_compensation_gain": ("", GAIN_RANGE.least, GAIN_RANGE.most, 2),
        }
        if stiffness == 0.0:  # steps by ratios never leave zero
            del bounds["stiffness_Nm_per_deg"]
        if "damping_ratio" in entry:
            del bounds["damping_Nms_per_rad"]
        for key in filter(entry.__contains__, bounds):
            yield _parameter((*place, key), entry[key], *bounds[key])


def _parameter(
    path: tuple[str | int, ...], start: float, unit: str, lower: float, upper: float, digits: int
) -> Parameter:
    name, stiff = ".".join(str(step) for step in path if step != "phases"), path[-1] == "stiffness_Nm_per_deg"
    least, most = min(lower, start), max(upper, start)
    return Parameter(name, path, unit, start, least, most, digits, logarithmic=stiff)


def _thresholds(guard: Guard, path: tuple[str | int, ...], cause: str) -> Iterator[Parameter]:
    """Angle thresholds of a guard that stands at a place of the document."""
    if isinstance(guard, (AllOf, AnyOf)):
        path = (*path, "all" if isinstance(guard, AllOf) else "any")
        for index, inner in enumerate(guard.guards):
            yield from _thresholds(inner, (*path, index), cause)
    elif isinstance(guard, Comparison) and signal_of(guard.signal) is ANGLE:
        left = guard.signal if guard.minus is None else f"{guard.signal} - {guard.minus}"
        name, start = f"{cause}: {left} {guard.operator}", guard.threshold
        lower, upper = start - THRESHOLD_REACH, start + THRESHOLD_REACH
        yield Parameter(name, path, "deg", start, lower, upper, 1, guard=guard)
