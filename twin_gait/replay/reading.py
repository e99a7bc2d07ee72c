"""From the columns of a log file to a recording: which column is what, in which unit and sign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from twin_gait.conventions import CONVENTIONS, DEGREES, HOUSE, RADIANS, Convention
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.gait.signals import DEVICE_SIGNALS
from twin_gait.replay.recording import Recording, at_ticks
from twin_gait.replay.tables import LogTable, read_table
from twin_gait.vocabulary import JointName, Side

TIME = "time"
_TIME_COLUMNS = ("time_s", "time", "Time", "t")
_UNIT_ENDINGS = {"_rad": RADIANS, "_deg": DEGREES, "[rad]": RADIANS, "[deg]": DEGREES, "(deg)": DEGREES}


def _angle_key(side: Side, joint: JointName) -> str:
    return f"{side}_{joint}_angle"


def _load_key(side: Side) -> str:
    return f"{side}_foot_normal_force"


def _phase_key(side: Side) -> str:
    return f"{side}_phase"


# Signals of the device by quantity.
_OF_DEVICE = {signal.field: signal for signal in DEVICE_SIGNALS if signal.column}

QUANTITIES = (
    TIME, *(_angle_key(side, joint) for side in Side for joint in JointName),
    *(_load_key(side) for side in Side), *(_phase_key(side) for side in Side), *_OF_DEVICE,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """How to read a log."""

    # names and signs of the angles; None takes this package's own, and asks for one for files of OpenSim,
    # whose models differ
    convention: Convention | None = None
    # column of a quantity, where it has a name of its own: ``{"left_hip_angle": "hip_l"}``
    columns: Mapping[str, str] = field(default_factory=dict)
    units: str | None = None  # ``rad`` or ``deg``, for columns that do not say
    # added to the angles of a joint in [rad], after its sign was put right: posture of the pelvis, or another
    # zero
    offsets: Mapping[JointName, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check names and units."""
        for quantity in self.columns:
            if quantity not in QUANTITIES:
                raise ParameterError(f"columns: no quantity {quantity!r}; there are {', '.join(QUANTITIES)}")
        if self.units not in (None, RADIANS, DEGREES):
            raise ParameterError(f"units: expected rad or deg, got {self.units!r}")
        for joint, offset in self.offsets.items():
            if not math.isfinite(offset):
                raise ParameterError(f"offset of the {joint}: expected a finite angle, got {offset}")


def read_recording(path: Path, log_format: LogFormat | None = None) -> Recording:
    """Read a recorded walk.

    ``path``: a .parquet or .csv file with columns such as ``left_hip_angle_rad``, or any with the names
    given; or a .mot or .sto file of OpenSim; ``log_format``: how to read it. Returns the walk at the ticks of
    the controller, in the signs of this package. Raises ParameterFileError if the file has a mistake; the
    message names file, column and the way out.
    """
    table = read_table(path)
    log_format = log_format or LogFormat()
    convention = _convention(table, log_format)
    time = table.numbers(_time_column(table, log_format))
    angles = _angles(table, log_format, convention)
    loads, phases = {}, {}
    for side in angles:
        load = log_format.columns.get(_load_key(side), f"{side}_foot_normal_force_N")
        if load in table or _load_key(side) in log_format.columns:
            loads[side] = table.numbers(load)
        phase = log_format.columns.get(_phase_key(side), f"{side}_phase")
        if phase in table or _phase_key(side) in log_format.columns:
            phases[side] = table.words(phase)
    device = {}
    for key, signal in _OF_DEVICE.items():
        column = log_format.columns.get(key, signal.column)
        if column in table or key in log_format.columns:
            turns = signal.column.endswith("_rad")
            values = _radians(table, log_format, convention, column) if turns else table.numbers(column)
            device[signal.name] = values
    return at_ticks(table.source, time, angles, loads, phases, device)


def shifted(recording: Recording, offsets: Mapping[JointName, float]) -> Recording:
    """Add a constant angle to joints. ``offsets``: per joint in [rad]."""
    if not offsets:
        return recording
    return replace(
        recording,
        angles={
            side: {joint: values + offsets.get(JointName(joint), 0.0) for joint, values in joints.items()}
            for side, joints in recording.angles.items()
        },
    )


def _convention(table: LogTable, log_format: LogFormat) -> Convention:
    convention = log_format.convention
    if convention is None:
        if table.opensim:
            raise ParameterFileError(
                table.source,
                "convention",
                "OpenSim's models differ in the sign of the knee: add --convention opensim_gait2392 "
                "(flexion negative) or rajagopal (flexion positive)",
            )
        convention = HOUSE
    if not convention.columns and not log_format.columns:
        raise ParameterFileError(
            table.source,
            "convention",
            f"{convention.name} has no column names of its own: give --columns right_knee_angle=NAME,…",
        )
    return replace(convention, offsets=log_format.offsets) if log_format.offsets else convention


def _time_column(table: LogTable, log_format: LogFormat) -> str:
    if TIME in log_format.columns:
        return log_format.columns[TIME]
    return next((name for name in _TIME_COLUMNS if name in table), TIME)


def _angles(
    table: LogTable, log_format: LogFormat, convention: Convention
) -> dict[Side, dict[str, np.ndarray]]:
    angles: dict[Side, dict[str, np.ndarray]] = {}
    for side in Side:
        for joint in JointName:
            column = _angle_column(table, log_format, convention, side, joint)
            if column is None:
                continue
            values = _radians(table, log_format, convention, column)
            angles.setdefault(side, {})[str(joint)] = convention.to_house(joint, values)
    if not angles:
        asked = ", ".join(convention.columns.values()) or "the given columns"
        raise ParameterFileError(
            table.source,
            "",
            f"has none of {asked}; name the columns with --columns, or choose one of --convention "
            f"{', '.join(CONVENTIONS)}",
        )
    return angles


def _radians(table: LogTable, log_format: LogFormat, convention: Convention, column: str) -> np.ndarray:
    values = table.numbers(column)
    return np.radians(values) if _unit(table, log_format, convention, column) == DEGREES else values


def _angle_column(
    table: LogTable, log_format: LogFormat, convention: Convention, side: Side, joint: JointName
) -> str | None:
    key = _angle_key(side, joint)
    if key in log_format.columns:
        return log_format.columns[key]
    names = [convention.columns.get((side, joint))]
    if convention.name == HOUSE.name:
        # The controller saw the measured angle; a log of another device may have degrees.
        names = [f"{side}_{joint}_measured_angle_rad", *names, f"{key}_deg"]
    return next((name for name in names if name is not None and name in table), None)


def _unit(table: LogTable, log_format: LogFormat, convention: Convention, column: str) -> str:
    """Unit of a column: what its name says, then the file, then the user, then the convention."""
    lower = column.lower()
    stated = next((unit for ending, unit in _UNIT_ENDINGS.items() if lower.endswith(ending)), table.unit)
    if stated is not None:
        if log_format.units not in (None, stated):
            raise ParameterFileError(
                table.source,
                column,
                f"is in {stated} by name or header; leave --units {log_format.units} out",
            )
        return stated
    unit = log_format.units or convention.unit
    if unit is None:
        raise ParameterFileError(
            table.source, column, "does not say its unit: add --units deg or --units rad"
        )
    return unit
