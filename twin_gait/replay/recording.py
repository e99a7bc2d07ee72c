"""Readers of recorded walks: from the columns of a log file, or from the literature."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin_gait.control.safety import SafetyState
from twin_gait.conventions import CONVENTIONS, DEGREES, OWN_CONVENTION, RADIANS, Convention
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.gait.signals import DEVICE_SIGNALS
from twin_gait.gait.table import TICK
from twin_gait.measures import locohub, reference
from twin_gait.parameters.quantities import POSITIVE, require
from twin_gait.parameters.wearer import Patient
from twin_gait.replay.samples import LONGEST_GAP, Recording, repeat_stride, resample_to_ticks
from twin_gait.replay.stride_recording import read_stride_recording
from twin_gait.runs.c3d_files import OFF, STRIKE
from twin_gait.runs.column_units import ANGLES, FORCES, TIMES, find_unit, plain_name, split_heading
from twin_gait.runs.log_files import LogTable, parse_number, read_log_table
from twin_gait.vocabulary import JointName, Side

TIME = "time"
STRIDES = 8  # number of strides of a walk that repeats one stride
_ANGLES = {f"{side}_{joint}_angle": (side, joint) for side, joint in product(Side, JointName)}
_LOADS = {side: f"{side}_foot_normal_force" for side in Side}
_PHASES = {side: f"{side}_phase" for side in Side}
_DEVICE_QUANTITIES = {signal.field: signal for signal in DEVICE_SIGNALS if signal.column}
_UNITS: Mapping[str, Mapping[str, float]] = {
    TIME: TIMES,
    **dict.fromkeys(_ANGLES, ANGLES),
    **dict.fromkeys(_LOADS.values(), FORCES),
    **{name: {} for name in _PHASES.values()},
    **{name: ANGLES if signal.column.endswith("_rad") else {} for name, signal in _DEVICE_QUANTITIES.items()},
}
# Usual names of the column of a quantity, without the unit. The preferred one is first: the controller reads
# the measured angle.
_USUAL_NAMES: Mapping[str, tuple[str, ...]] = {
    TIME: ("time", "t", "timestamp"),
    **{name: (f"{name[:-5]}measured_angle", name) for name in _ANGLES},
    **{name: (name.lower(),) for name in (*_LOADS.values(), *_PHASES.values())},
    **{name: (plain_name(signal.column, _UNITS[name]),) for name, signal in _DEVICE_QUANTITIES.items()},
}


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """Description of the columns, units and signs of a log."""

    # names and signs of the angles; None means those of this package, and is rejected for files of OpenSim,
    # because its models differ
    convention: Convention | None = None
    # column of a quantity that has a name of its own, such as ``{"left_hip_angle": "hip_l"}``; a minus before
    # the name reverses the sign
    columns: Mapping[str, str] = field(default_factory=dict)
    units: str | None = None  # ``rad`` or ``deg``, for columns whose names do not state it
    time_unit: str | None = None  # unit of the time, if its column does not state it; None means seconds
    max_gap: float = LONGEST_GAP  # longest gap that is interpolated in [s]
    # duration of the stride in [s], if the log is one stride with its time as a share; the stride is repeated
    cycle_time: float | None = None
    subject: str | None = None  # person, if a C3D or LocoHub file has several
    task: str | None = None  # task or task_id, if a LocoHub file has several

    def __post_init__(self) -> None:
        """Check names, units and numbers."""
        for quantity in self.columns:
            if quantity not in _USUAL_NAMES:
                raise ParameterError(f"columns: expected one of {', '.join(_USUAL_NAMES)}, got {quantity!r}")
        require(self.units in (None, RADIANS, DEGREES), "units", "rad or deg", self.units)
        require(self.time_unit in (None, *TIMES), "time_unit", " or ".join(TIMES), self.time_unit)
        POSITIVE.require("max_gap", self.max_gap)
        if self.cycle_time is not None:
            POSITIVE.require("cycle_time", self.cycle_time)


def read_recording(path: Path, log_format: LogFormat | None = None) -> Recording:
    """Read a recorded walk.

    ``path``: a .parquet or .csv file with columns such as ``left_hip_angle_rad``, or with any columns whose
    names are given; a .mot or .sto file of OpenSim; a .c3d file with the angles of a model; or a .parquet
    file with strides of LocoHub. ``log_format``: columns, units and signs of the file. If the file is the
    log of a run whose legs were held by a trip, the part before the trip is read.

    Returns the walk at the ticks of the controller, in the signs of this package. Raises ParameterFileError
    if the file has a mistake; the message names file, column and remedy.
    """
    log_format = log_format or LogFormat()
    if path.suffix.lower() == ".parquet" and locohub.is_locohub(path):
        plain = LogFormat(cycle_time=log_format.cycle_time, subject=log_format.subject, task=log_format.task)
        if log_format != plain:
            text = "has the columns, units and signs of LocoHub; leave those of the log and its gaps out"
            raise ParameterFileError(path, "", text)
        return read_stride_recording(
            path, subject=plain.subject, task=plain.task, cycle_time=plain.cycle_time
        )
    table = read_log_table(path, log_format.subject)
    if "safety_state" in table:  # after a trip no guard switches the legs
        held = np.flatnonzero(table.numbers("safety_state") == SafetyState.HOLD.code)
        table = replace(table, frame=table.frame.iloc[: held[0]]) if len(held) else table
    if log_format.convention is None and table.opensim:
        text = (
            "OpenSim's models differ in the sign of the knee: add --convention opensim_gait2392 "
            "(flexion negative) or rajagopal (flexion positive)"
        )
        raise ParameterFileError(table.source, "convention", text)
    convention = log_format.convention or table.convention or OWN_CONVENTION
    found = _find_columns(table, log_format, convention)
    table, time = _drop_repeated_rows(table, *_read_time(table, found, log_format))

    def values(quantity: str) -> np.ndarray:
        column, sign = found[quantity]
        return (
            sign * _factor(table, quantity, column, log_format, convention) * table.numbers(column, gaps=True)
        )

    angles: dict[tuple[Side, str], np.ndarray] = {
        (side, joint): convention.convert_angle(joint, values(name))
        for name, (side, joint) in _ANGLES.items()
        if name in found
    }
    loads = {side: values(name) for side, name in _LOADS.items() if name in found}
    phases = {side: table.texts(found[name][0]) for side, name in _PHASES.items() if name in found}
    device = {signal.name: values(name) for name, signal in _DEVICE_QUANTITIES.items() if name in found}
    warnings = (*table.notices, *_unit_notices(table, found, log_format))
    strikes, offs = (
        {side: times for (side, kind), times in table.events.items() if kind == wanted}
        for wanted in (STRIKE, OFF)
    )
    recording = Recording(
        table.source,
        0.0,
        angles,
        loads,
        phases,
        device,
        warnings=warnings,
        foot_strikes=strikes,
        foot_offs=offs,
    )
    if log_format.cycle_time is not None:
        recording, time = repeat_stride(recording, time, log_format.cycle_time, STRIDES)
    return resample_to_ticks(recording, time, max_gap=log_format.max_gap)


_Columns = Mapping[str, tuple[str, float]]  # name and sign of the column of each quantity


def _find_columns(table: LogTable, log_format: LogFormat, convention: Convention) -> _Columns:
    """Return the column that is named for each quantity, or else its first usual one in the table."""
    usual = dict(_USUAL_NAMES)
    if convention.name != OWN_CONVENTION.name:
        columns = convention.columns
        usual |= {
            name: (columns[joint].lower(),) if joint in columns else () for name, joint in _ANGLES.items()
        }
    found = {quantity: table.signed_name(column) for quantity, column in log_format.columns.items()}
    named = {name for name, _ in found.values()}
    for quantity in usual.keys() - found.keys():
        plain = {name: plain_name(name, _UNITS[quantity]) for name in table.names if name not in named}
        known = [name for stem in usual[quantity] for name in plain if plain[name] == stem]
        if known:
            found[quantity] = known[0], 1.0
    if not _ANGLES.keys() & found.keys():
        names = ", ".join(convention.columns.values()) or f"columns, of which {convention.name} names none"
        way_out = "name the columns with --columns, or choose one of --convention"
        advice = f"{way_out} {', '.join(CONVENTIONS)}; there are {table.format_column_names()}"
        text = f"has none of {names}; {advice}"
        if table.without_angles:
            there = (
                f"or name the points of another model with --columns; there are {table.format_column_names()}"
            )
            text = f"{table.without_angles}; {there}"
        raise ParameterFileError(table.source, "", text)
    users = dict[str, str]()
    for quantity, (name, sign) in found.items():
        if name in users:
            text = f"is given for {users[name]} and {quantity}; each needs a column of its own"
            raise ParameterFileError(table.source, name, text)
        users[name] = quantity
        if sign < 0.0 and quantity in _PHASES.values():
            raise ParameterFileError(table.source, name, f"is a {quantity}, whose sign cannot be inverted")
    return found


def _read_time(table: LogTable, found: _Columns, log_format: LogFormat) -> tuple[np.ndarray, str]:
    """Return the time of each row in [s], and its column."""
    column, sign = found.get(TIME, (TIME, 1.0))
    values = sign * table.numbers(column)
    if log_format.cycle_time is not None:
        return values, column
    stated, given = find_unit(split_heading(column, TIMES)[1], TIMES), log_format.time_unit
    if stated and given and TIMES[stated] != TIMES[given]:
        text = f"is in {stated} by its name; leave --time-unit {given} out"
        raise ParameterFileError(table.source, column, text)
    return values * TIMES[stated or given or "s"], column


def _drop_repeated_rows(table: LogTable, time: np.ndarray, column: str) -> tuple[LogTable, np.ndarray]:
    """Remove each row that equals the row before, with a notice."""
    same = np.flatnonzero(np.diff(time) == 0.0) + 1
    if not len(same):
        return table, time
    rows = table.frame.iloc[same].astype(str).to_numpy()
    before = table.frame.iloc[same - 1].astype(str).to_numpy()
    repeated = same[(rows == before).all(axis=1)]
    if not len(repeated):
        return table, time
    kept = np.setdiff1d(np.arange(len(time)), repeated)
    text = f"{len(repeated)} rows that repeat the row before were left out (row {repeated[0] + 1} first)"
    return replace(table, frame=table.frame.iloc[kept], notices=(*table.notices, text)), time[kept]


def _factor(
    table: LogTable, quantity: str, column: str, log_format: LogFormat, convention: Convention
) -> float:
    """Return the factor from a column to SI units.

    The unit is stated by the name of the column, else by ``units``, the file or the convention.
    """
    units = _UNITS[quantity]
    stated = find_unit(split_heading(column, units)[1], units)
    if units is ANGLES:
        stated = stated or log_format.units or table.unit or convention.unit
        if stated is None:
            problem = "does not state its unit; add --units deg or --units rad"
            raise ParameterFileError(table.source, column, problem)
    return units[stated] if stated else 1.0


def _unit_notices(table: LogTable, found: _Columns, log_format: LogFormat) -> list[str]:
    """Return a notice if ``units`` has no effect, or overrides the header of the file."""
    given, columns = log_format.units, [found[name][0] for name in found if _UNITS[name] is ANGLES]
    if given is None:
        return []
    if all(find_unit(split_heading(column, ANGLES)[1], ANGLES) for column in columns):
        return [f"--units {given} has no effect: the names of all columns of angles state their unit"]
    if table.unit not in (None, given):
        return [f"--units {given} was used, although the header says {table.unit}"]
    return []


KOOPMAN, WINTER = "koopman", "winter"


def is_normative(name: str) -> bool:
    """Return whether a name refers to a walk from the literature."""
    return name == WINTER or name.startswith(f"{KOOPMAN}@")


class NormativeCurves(NamedTuple):
    """Curves of the literature."""

    angle: Callable[[JointName, np.ndarray], np.ndarray]  # angle in [rad] at instants in [%] of the cycle
    joints: tuple[JointName, ...]
    cycle_time: float  # duration of a stride in [s]


def normative_curves(name: str) -> NormativeCurves:
    """Return the curves of a walk from the literature; name and errors as in :func:`normative_walk`."""
    if name == WINTER:
        return NormativeCurves(
            reference.normative_angle, reference.WINTER_JOINTS, reference.WINTER_CYCLE_TIME
        )
    kind, _, text = name.partition("@")
    speed, height = parse_number(text) / reference.KILOMETRES_PER_HOUR, Patient().height
    expected = f"{WINTER}, or {KOOPMAN}@ and the speed in km/h"
    require(kind == KOOPMAN and math.isfinite(speed), "log", expected, name)
    curve = partial(reference.reference_curve, speed=speed, height=height)
    return NormativeCurves(curve, tuple(JointName), reference.reference_cycle_time(speed, height))


def normative_walk(name: str, *, strides: int = STRIDES) -> Recording:
    """Create a walk from curves of the literature.

    The left leg begins at heel contact, the right one half a stride later. ``name``: ``koopman@1.5`` for the
    regression of Koopman et al. (2014) at a walking speed in km/h, or ``winter`` for the means of Winter
    (1991) at natural cadence. ``strides``: number of strides. Raises ParameterError if there is no such walk,
    or the speed is outside the range of the regression.
    """
    curve, joints, cycle_time = normative_curves(name)
    time = np.arange(round(strides * cycle_time / TICK)) * TICK
    angles = dict[tuple[Side, str], np.ndarray]()
    for side, lead in ((Side.LEFT, 0.0), (Side.RIGHT, 0.5)):
        percent = reference.CYCLE * np.mod(time / cycle_time + lead, 1.0)
        angles |= {(side, joint): curve(joint, percent) for joint in joints}
    return Recording(name, 0.0, angles, {}, {})
