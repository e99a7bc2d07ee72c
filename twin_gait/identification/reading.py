"""Reading of logs and series of measurements from text tables with any column names and units.

Rows and columns that cannot be used are removed: empty cells, disordered times, other units, marks of missing
values.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from twin_gait.exceptions import ParameterFileError
from twin_gait.runs.column_units import ANGLES, TIMES, find_unit, plain_name, split_heading
from twin_gait.runs.log_files import LogTable, read_text_table


class Quantity(StrEnum):
    """Quantity of a column that the identification can use."""

    TIME = "time"
    ANGLE = "angle"
    VELOCITY = "velocity"
    FRICTION_TORQUE = "friction_torque"
    LOAD_TORQUE = "load_torque"
    TARGET_CURRENT = "target_current"
    MEASURED_CURRENT = "measured_current"
    TEMPERATURE = "temperature"


class ColumnPattern(NamedTuple):
    """Names and units by which the column of a quantity is recognized."""

    names: tuple[str, ...]  # names of its columns without their unit, lower case, best first
    units: Mapping[str, float]  # factor to SI by the notation of a unit, the SI unit first
    largest: float = math.inf  # no joint of a robot exceeds this; a column that does is in another unit


_TURN = ANGLES["turn"]  # [rad]
_SPEEDS = {**{f"{name}/s": factor for name, factor in ANGLES.items()}, "rev/s": _TURN, "rpm": _TURN / 60.0}
_TORQUES = {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
_AMPERES = {"A": 1.0, "mA": 1e-3}
COLUMN_PATTERNS: Mapping[Quantity, ColumnPattern] = {
    Quantity.TIME: ColumnPattern(("time", "t", "timestamp"), TIMES),
    Quantity.ANGLE: ColumnPattern(("position", "angle", "theta", "q"), ANGLES, 60.0),
    Quantity.VELOCITY: ColumnPattern(("velocity", "omega", "speed", "dq", "qd"), _SPEEDS, 60.0),
    Quantity.FRICTION_TORQUE: ColumnPattern(
        ("friction_torque", "torque_friction", "t_fr", "tau_f"), _TORQUES, 2_000.0
    ),
    Quantity.LOAD_TORQUE: ColumnPattern(("load_torque", "torque_load"), _TORQUES, 5_000.0),
    Quantity.TARGET_CURRENT: ColumnPattern(("target_current", "current_target"), _AMPERES, 200.0),
    Quantity.MEASURED_CURRENT: ColumnPattern(
        ("measured_current", "current_measured", "current"), _AMPERES, 200.0
    ),
    Quantity.TEMPERATURE: ColumnPattern(("temperature", "temp"), {"°C": 1.0, "degC": 1.0, "C": 1.0}, 200.0),
}

_WEIGHT = re.compile(r"(?<![\d.])(\d+(?:[.,p]\d+)?)[ _]?kg(?![a-z])", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class ColumnOptions:
    """Columns of the quantities in a log."""

    # Column of a quantity; a minus in front of it reverses the sign.
    names: Mapping[Quantity, str] = field(default_factory=dict)
    # Unit of a quantity whose column does not state it; SI without one.
    units: Mapping[Quantity, str] = field(default_factory=dict)
    unwrap: bool = False  # whether the angle is that of an encoder that starts again at each turn


def _columns_of(table: LogTable, columns: ColumnOptions) -> dict[Quantity, tuple[str, float]]:
    """Return the name of the column of each quantity, and the factor to SI with the sign."""
    found: dict[Quantity, tuple[str, float]] = {}
    requested_names = {name.lstrip("-") for name in columns.names.values()}
    free = [name for name in table.names if name not in requested_names]
    for quantity in Quantity:
        requested = columns.names.get(quantity)
        if requested is None:
            name, sign = _known_column(free, quantity), 1.0
        else:
            name, sign = table.signed_name(requested)
        if name is not None:
            if name in (held for held, _ in found.values()):
                raise ParameterFileError(table.source, name, f"is given for {quantity} and another quantity")
            factor = _factor(table.source, name, quantity, columns.units.get(quantity))
            found[quantity] = (name, sign * factor)
    return found


def _known_column(names: Sequence[str], quantity: Quantity) -> str | None:
    """Return the only column with a name of the quantity; None for an optional one in an unknown unit."""
    units = COLUMN_PATTERNS[quantity].units
    plain = [plain_name(name, units) for name in names]
    known = next((name for name in COLUMN_PATTERNS[quantity].names if plain.count(name) == 1), None)
    if known is None:
        return None
    index = plain.index(known)
    stated = split_heading(names[index], units)[1]
    strange = stated is not None and find_unit(stated, units) is None
    optional = quantity not in (Quantity.VELOCITY, Quantity.FRICTION_TORQUE)
    return None if optional and strange else names[index]


def _factor(source: str, column: str, quantity: Quantity, given: str | None) -> float:
    """Return the factor of a column to SI: by the unit in its name, else by the given one, else 1."""
    units = COLUMN_PATTERNS[quantity].units
    _, stated = split_heading(column, units)
    stated_unit, given_unit = find_unit(stated, units), find_unit(given, units)
    wrong = given if given and not given_unit else stated if not given_unit and not stated_unit else None
    if wrong:
        text = f"there is no unit {wrong!r} of {quantity}; give one of {', '.join(units)} with --units"
        raise ParameterFileError(source, column, f"{text} {quantity}=…")
    if stated_unit and given_unit and units[stated_unit] != units[given_unit]:
        text = f"is in {stated_unit} by its name; leave --units {quantity}={given} out"
        raise ParameterFileError(source, column, text)
    unit = stated_unit or given_unit
    return units[unit] if unit else 1.0


@dataclass(frozen=True, eq=False)
class Log:
    """Log in SI units, as it was recorded."""

    source: str  # path of the file
    # Values of each quantity in the log, shape ``(n,)``; NaN where a cell is empty.
    columns: Mapping[Quantity, np.ndarray]
    mass: float | None = None  # weight on the link in [kg], if the file's name contains it
    notices: tuple[str, ...] = ()  # deviations from the format that were accepted, one line each

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_log(path: Path, columns: ColumnOptions | None = None) -> Log:
    """Read a log.

    The separator may be a comma, a semicolon, a tab or blanks; lines that begin with # are comments. A file
    without column names has columns 1, 2 and so on. Columns with a known name are found without being named
    in ``columns``. The file's name may contain the weight on the link: ``knee_2.5kg_1.log``.

    Raises ParameterFileError if the file cannot be read as numbers; one line with file, column and row.
    """
    columns = columns or ColumnOptions()
    table = read_text_table(path, {name.lstrip("-") for name in columns.names.values()})
    found = _columns_of(table, columns)
    if not found:
        advice = "name them with --columns velocity=NAME,friction_torque=NAME"
        raise ParameterFileError(
            path, "", f"no column is known among {table.format_column_names()}; {advice}"
        )
    values = {quantity: table.numbers(name, gaps=True) * factor for quantity, (name, factor) in found.items()}
    weight = _WEIGHT.search(path.name)
    mass = float(re.sub("[,p]", ".", weight[1].lower())) if weight else None
    if columns.unwrap and Quantity.ANGLE in values:
        angle = values[Quantity.ANGLE]
        known = np.isfinite(angle)
        angle[known] = np.unwrap(angle[known])
    return Log(str(path), values, mass, table.notices)


FEWEST = 20  # least number of samples of a test
_MOSTLY_EMPTY = 0.1  # share of empty cells beyond which an optional column is removed instead of the rows
_PERIODS = (2e-5, 0.5)  # [s], plausible periods of the samples of measured friction
_CURRENTS = frozenset({Quantity.TARGET_CURRENT, Quantity.MEASURED_CURRENT})
# Columns from which the torque is computed, and those without use, in a series (True) and in a log of a
# bench.
_NEEDED = {
    True: frozenset({Quantity.VELOCITY, Quantity.FRICTION_TORQUE}),
    False: _CURRENTS | {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY},
}
_USELESS = {True: _CURRENTS, False: frozenset({Quantity.LOAD_TORQUE})}
_SLOPE = (0.7, 1.4)  # plausible ratios of the velocity to the derivative of the angle
_MEASURED = _CURRENTS | {Quantity.VELOCITY, Quantity.FRICTION_TORQUE}
_WRAP = 0.1  # Largest motion of the joint while the encoder wraps, as a share of a turn.
_USUAL, _MARK = 0.95, 500.0  # share of usual values; a value larger by this factor is not a measurement


def clean(log: Log, *, joint_known: bool) -> tuple[Log, dict[str, int], tuple[str, ...]]:
    """Remove rows that contain a NaN or repeat the previous one, and reject a log that cannot be used.

    An optional column is removed if it is mostly empty or cannot be the quantity of its name. Returns the
    log, the numbers of rows read and removed by cause, and remarks.
    """
    series = Quantity.FRICTION_TORQUE in log.columns
    columns = {name: values for name, values in log.columns.items() if name not in _USELESS[series]}
    needed, notes = _NEEDED[series], list(log.notices)

    def reject(quantity: Quantity, reason: str) -> None:
        """Remove a column; raise ParameterFileError if it is needed."""
        if quantity in needed:
            raise ParameterFileError(log.source, quantity, reason)
        notes.append(f"{quantity} was left out: {reason}")
        del columns[quantity]

    for quantity in sorted(set(columns) - needed):
        empty = int(np.isnan(columns[quantity]).sum())
        if empty > _MOSTLY_EMPTY * len(log):
            reject(quantity, f"{100 * empty / len(log):.0f} % of its cells are empty")
    rows = pd.DataFrame(columns).dropna()
    counts = {"read": len(log), "not_a_number": len(log) - len(rows), "duplicate_time": 0}
    if Quantity.TIME in rows:
        # A clock may repeat its time in a series; derivatives of a log of a bench need one that advances.
        clocks = rows if series else rows[[Quantity.TIME]]
        same = (clocks.diff() == 0.0).all(axis=1)
        rows, counts["duplicate_time"] = rows[~same], int(same.sum())
        if not series and same.mean() > 0.5:
            reject(Quantity.TIME, "is equal to that of the row before in most rows; the clock is too coarse")
    if len(rows) < FEWEST:
        text = f"has {len(rows)} usable rows of {len(log)}, with no cell empty; expected at least {FEWEST}"
        raise ParameterFileError(log.source, "", text)
    columns.update({quantity: rows[quantity].to_numpy() for quantity in columns})
    for quantity in sorted(_MEASURED.intersection(columns)):
        _check_mark(log.source, quantity, columns[quantity])
    if Quantity.ANGLE in columns and (doubt := _wrapping(columns[Quantity.ANGLE])):
        reject(Quantity.ANGLE, doubt)
    if doubt := _disorder(columns, notes, series=series):
        reject(Quantity.TIME, doubt)
    for quantity in sorted(columns):
        if doubt := _range_problem(quantity, columns[quantity]):
            if joint_known or not series or quantity not in needed:
                reject(quantity, doubt)
            else:
                notes.append(f"{quantity} {doubt}")
    if doubt := _wrong_slope(columns):
        reject(Quantity.ANGLE, doubt)
    return replace(log, columns=columns), counts, tuple(notes)


def _disorder(columns: Mapping[Quantity, np.ndarray], notes: list[str], *, series: bool) -> str:
    """Return the problem of times that cannot be used; empty for others, with a note if they are unusual.

    In a series records may follow one another.
    """
    if Quantity.TIME not in columns:
        return ""
    time = columns[Quantity.TIME]
    steps = np.diff(time)
    back, forward = int((steps < 0.0).sum()), steps[steps > 0.0]
    if back > (len(steps) / FEWEST if series else 0):
        row = int(np.argmax(steps < 0.0))
        text = f"goes back {back} times, from {time[row]:g} s to {time[row + 1]:g} s first"
        return f"{text}; a file must be one test, so divide it there"
    if not len(forward):
        return "is the same in every row"
    period = float(np.median(forward))
    if series and not _PERIODS[0] <= period <= _PERIODS[1]:
        notes.append(
            f"time advances by {period:.3g} s from row to row: if it is in another unit, declare it "
            "(--units time=ms); stiffness and damping of bristles depend on it"
        )
    return ""


def _check_mark(source: str, quantity: Quantity, values: np.ndarray) -> None:
    """Reject values that mark a missing one, such as -9999 or 1e30."""
    size = np.abs(values)
    usual, row = float(np.quantile(size, _USUAL)), int(np.argmax(size))
    if size[row] > _MARK * usual > 0.0:
        text = (
            f"is {values[row]:.4g} in a row, but {100 * _USUAL:g} % of the values are below {usual:.3g}; "
            "if it marks a missing value, leave such cells empty"
        )
        raise ParameterFileError(source, quantity, text)


def _range_problem(quantity: Quantity, values: np.ndarray) -> str:
    """Return the problem of values beyond the range of a joint; empty for others."""
    found, (unit, other, *_) = float(np.abs(values).max()), COLUMN_PATTERNS[quantity].units
    if found <= COLUMN_PATTERNS[quantity].largest:
        return ""
    remedy = f"declare its unit, such as --units {quantity}={other}"
    return f"reaches {found:.4g} {unit}, which is too large for a joint; {remedy}"


def _wrapping(angle: np.ndarray) -> str:
    """Return the problem of an encoder that starts again at each turn; empty if the angle is continuous."""
    jumps = np.abs(np.abs(np.diff(angle)) - _TURN) < _WRAP * _TURN
    if not jumps.any():
        return ""
    return f"jumps by a turn {jumps.sum()} times, as an encoder that starts again at each turn: add --unwrap"


def _wrong_slope(columns: Mapping[Quantity, np.ndarray]) -> str:
    """Return the problem of an angle that moves much less or more than the integral of the velocity."""
    if not {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY} <= set(columns):
        return ""
    time, angle, velocity = (columns[name] for name in (Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY))
    # Displacements over a tenth of the log are used, because noise of single differences would hide the
    # slope.
    stride = max(len(time) // 10, 1)
    elapsed = np.maximum(np.diff(time, prepend=time[:1]), 0.0).cumsum()  # without steps back to a new record
    travelled = cumulative_trapezoid(velocity, elapsed, initial=0)
    moved, integrated = angle[stride:] - angle[:-stride], travelled[stride:] - travelled[:-stride]
    energy = float(moved @ moved)
    if energy < 1e-6 * len(moved):  # less than a milliradian: nothing to compare
        return ""
    slope = float(integrated @ moved) / energy
    if _SLOPE[0] < slope < _SLOPE[1]:
        return ""
    return (
        f"the velocity's integral moves {slope:.3g} times as far: time, angle or velocity is in another "
        "unit or sign; declare them with --units time=…,angle=…,velocity=…"
    )
