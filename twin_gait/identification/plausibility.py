"""Rows and columns that cannot be used: empty cells, disordered times, other units, missing-value marks."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.columns import Quantity
from twin_gait.identification.reading import Log
from twin_gait.identification.samples import LONGEST_GAP

FEWEST = 20  # samples of a test
_MOSTLY_EMPTY = 0.1  # share of empty cells beyond which an optional column is left out, not the rows
_PERIODS = (2e-5, 0.5)  # [s] between the samples of measured friction
_UNUSED_IN_SERIES = frozenset({Quantity.TARGET_CURRENT, Quantity.MEASURED_CURRENT})
_UNUSED_IN_LOGS = frozenset({Quantity.LOAD_TORQUE})  # computed from weight and angle
_USED_IN_LOGS = frozenset(
    {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY, Quantity.TARGET_CURRENT, Quantity.MEASURED_CURRENT}
)


def clean(log: Log, *, joint_known: bool) -> tuple[Log, dict[str, int], tuple[str, ...]]:
    """Take out rows that say nothing, and refuse a log that cannot be used.

    A column that was found by its name alone and that a series can do without is left out if it is mostly
    empty or cannot be what its name says.

    Returns:
        The log without rows that hold a NaN or repeat the one before, how many there were of each, and what a
        reader should know.
    """
    series = Quantity.FRICTION_TORQUE in log.columns
    notes: list[str] = []
    columns = _useful(log, series, notes)
    kept = np.ones(len(log), dtype=bool)
    for values in columns.values():
        kept &= np.isfinite(values)
    counts = {"read": len(log), "not_a_number": int(len(log) - kept.sum())}
    columns = {quantity: values[kept] for quantity, values in columns.items()}
    repeated = 0
    if Quantity.TIME in columns and kept.any():
        columns, repeated = (_timed_series if series else _timed_log)(log.source, columns, notes)
    counts["duplicate_time"] = repeated
    cleaned = replace(log, columns=columns)
    if len(cleaned) < FEWEST:
        raise ParameterFileError(log.source, _emptiest(log), _too_few(len(cleaned), log))
    _check_marks(cleaned)
    if series:
        optional = _optional(cleaned, series)
        cleaned = _plausible_series(cleaned, optional, notes, joint_known=joint_known)
    else:
        _check_units(cleaned)
    return cleaned, counts, tuple(notes)


def _useful(log: Log, series: bool, notes: list[str]) -> dict[Quantity, np.ndarray]:
    """Columns that this kind of log has a use for, without optional ones that are mostly empty."""
    unused = _UNUSED_IN_SERIES if series else _UNUSED_IN_LOGS
    columns = {
        quantity: values
        for quantity, values in log.columns.items()
        if quantity in log.asked or quantity not in unused
    }
    for quantity in sorted(_optional(log, series) & set(columns)):
        empty = 1.0 - float(np.isfinite(columns[quantity]).mean()) if len(log) else 0.0
        if empty > _MOSTLY_EMPTY:
            notes.append(f"{quantity} was left out: {100.0 * empty:.0f} % of its cells are empty")
            del columns[quantity]
    return columns


def _optional(log: Log, series: bool) -> set[Quantity]:
    """Columns that may be left out: not asked for, and not what the torque is computed from."""
    used = {Quantity.VELOCITY, Quantity.FRICTION_TORQUE} if series else _USED_IN_LOGS
    return set(log.columns) - set(log.asked) - used


def _emptiest(log: Log) -> str:
    """The column with the most empty cells, which is what leaves too few rows; none if no cell is empty."""
    empty = {quantity: int((~np.isfinite(values)).sum()) for quantity, values in log.columns.items()}
    worst = max(empty, key=lambda quantity: empty[quantity], default=None)
    return str(worst) if worst is not None and empty[worst] else ""


def _too_few(rows: int, log: Log) -> str:
    why = ", the others are empty here" if _emptiest(log) else ""
    return f"has {rows} usable rows of {len(log)}{why}; expected at least {FEWEST}"


def _timed_log(
    source: str, columns: dict[Quantity, np.ndarray], notes: list[str]
) -> tuple[dict[Quantity, np.ndarray], int]:
    """A log of a bench in ascending time: the balance of torques needs its derivatives."""
    time = columns[Quantity.TIME]
    _check_order(source, time)
    fresh = np.concatenate([[True], np.diff(time) > 0.0])
    repeated = int(len(time) - fresh.sum())
    if repeated > 0.5 * len(time):
        raise ParameterFileError(
            source, "time", "most rows repeat the time of the row before; the clock is too coarse"
        )
    return {quantity: values[fresh] for quantity, values in columns.items()}, repeated


def _timed_series(
    source: str, columns: dict[Quantity, np.ndarray], notes: list[str]
) -> tuple[dict[Quantity, np.ndarray], int]:
    """A series without repeated rows; where time goes back, a new record begins."""
    same = np.ones(len(columns[Quantity.TIME]) - 1, dtype=bool)
    for values in columns.values():
        same &= np.diff(values) == 0.0
    fresh = np.concatenate([[True], ~same])
    columns = {quantity: values[fresh] for quantity, values in columns.items()}
    steps = np.diff(columns[Quantity.TIME])
    back, forward = int((steps < 0.0).sum()), steps[steps > 0.0]
    if not len(forward) or back > len(steps) / FEWEST:
        what = "is the same in every row" if not len(forward) else f"goes back {back} times"
        notes.append(f"time was left out: it {what}")
        del columns[Quantity.TIME]
    else:
        _note_period(float(np.median(forward)), notes)
        if back:
            notes.append(f"time goes back {back} times: records that follow one another were taken apart")
            # A pause that is longer than any gap lets the state of a dynamic model start anew.
            steps = np.where(steps < 0.0, 2.0 * LONGEST_GAP * float(np.median(forward)), steps)
            columns[Quantity.TIME] = columns[Quantity.TIME][0] + np.concatenate([[0.0], np.cumsum(steps)])
    return columns, int(len(fresh) - fresh.sum())


def _note_period(period: float, notes: list[str]) -> None:
    if not _PERIODS[0] <= period <= _PERIODS[1]:
        notes.append(
            f"time advances by {period:.3g} s from row to row: if it is in another unit, declare it "
            "(--units time=ms); stiffness and damping of bristles depend on it"
        )


def _check_order(source: str, time: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(time) < 0.0)
    if len(back):
        row = int(back[0])
        raise ParameterFileError(
            source,
            "time",
            f"goes back from {time[row]:g} s to {time[row + 1]:g} s; one file is one test: cut it there",
        )


# Beyond these no joint of a robot goes; such a column is in another unit.
_LARGEST = {
    Quantity.ANGLE: (60.0, "rad", "deg"),
    Quantity.VELOCITY: (60.0, "rad/s", "deg/s"),
    Quantity.FRICTION_TORQUE: (2_000.0, "N m", "mNm"),
    Quantity.LOAD_TORQUE: (5_000.0, "N m", "mNm"),
    Quantity.TARGET_CURRENT: (200.0, "A", "mA"),
    Quantity.MEASURED_CURRENT: (200.0, "A", "mA"),
    Quantity.TEMPERATURE: (200.0, "°C", "degC"),
    Quantity.MASS: (200.0, "kg", "g"),
}
_SLOPE = (0.7, 1.4)  # of the velocity over the derivative of the angle
_MEASURED = frozenset(
    {
        Quantity.VELOCITY,
        Quantity.FRICTION_TORQUE,
        Quantity.TARGET_CURRENT,
        Quantity.MEASURED_CURRENT,
    }
)
_USUAL, _MARK = 0.95, 500.0  # share of the values; times as large as these is no measurement


def _plausible_series(log: Log, optional: Set[Quantity], notes: list[str], *, joint_known: bool) -> Log:
    """Leave out optional columns that cannot be right; doubt the others."""
    columns = dict(log.columns)
    for quantity in sorted(optional):
        if quantity in _LARGEST and float(np.abs(columns[quantity]).max()) > _LARGEST[quantity][0]:
            notes.append(f"{quantity} was left out: {_beyond(quantity, columns[quantity])}")
            del columns[quantity]
    slope = _velocity_slope(replace(log, columns=columns))
    if slope is not None and not _SLOPE[0] < slope < _SLOPE[1] and Quantity.ANGLE not in log.asked:
        notes.append(f"angle was left out: the velocity's integral moves {slope:.3g} times as far")
        del columns[Quantity.ANGLE]
    kept = replace(log, columns=columns)
    if joint_known:
        _check_units(kept)
    for quantity in sorted(set(columns) & set(_LARGEST)):
        if float(np.abs(columns[quantity]).max()) > _LARGEST[quantity][0]:
            notes.append(_beyond(quantity, columns[quantity]))
    if not joint_known:
        _check_velocity(kept)
    return kept


def _check_marks(log: Log) -> None:
    """Refuse values that stand for a missing one, such as -9999 or 1e30."""
    for quantity in sorted(set(log.columns) & _MEASURED):
        size = np.abs(log.columns[quantity])
        usual, row = float(np.quantile(size, _USUAL)), int(np.argmax(size))
        if size[row] > _MARK * usual > 0.0:
            raise ParameterFileError(
                log.source,
                str(quantity),
                f"is {log.columns[quantity][row]:.4g} once where {100 * _USUAL:g} % stay below {usual:.3g}: "
                "a mark for a missing value? Leave such cells empty",
            )


def _beyond(quantity: Quantity, values: np.ndarray) -> str:
    _, unit, other = _LARGEST[quantity]
    return (
        f"{quantity} reaches {float(np.abs(values).max()):.4g} {unit}: of a joint? Declare its unit, such as "
        f"--units {quantity}={other}"
    )


def _check_units(log: Log) -> None:
    """Refuse columns that are in another unit than they are read in."""
    for quantity, (largest, unit, other) in _LARGEST.items():
        if quantity not in log.columns:
            continue
        found = float(np.abs(log.columns[quantity]).max())
        if found > largest:
            raise ParameterFileError(
                log.source,
                str(quantity),
                f"reaches {found:.4g} {unit}; declare its unit, such as --units {quantity}={other}",
            )
    _check_velocity(log)


def _check_velocity(log: Log) -> None:
    """Compare the velocity with the derivative of the angle, which shows degrees and milliseconds."""
    slope = _velocity_slope(log)
    if slope is not None and not _SLOPE[0] < slope < _SLOPE[1]:
        raise ParameterFileError(
            log.source,
            "velocity",
            f"its integral moves {slope:.3g} times as far as the angle: one of time, angle and velocity is "
            "in another unit or sign; declare them with --units time=…,angle=…,velocity=…",
        )


def _velocity_slope(log: Log) -> float | None:
    """How far the integral of the velocity moves when the angle moves by one."""
    time, angle, velocity = (
        log.columns.get(quantity) for quantity in (Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY)
    )
    if time is None or angle is None or velocity is None:
        return None
    # Displacements over a tenth of the log: noise of single differences would hide the slope.
    stride = max(len(time) // 10, 1)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    moved, integrated = angle[stride:] - angle[:-stride], travelled[stride:] - travelled[:-stride]
    energy = float(moved @ moved)
    if energy < 1e-6 * len(moved):  # less than a milliradian: nothing to compare
        return None
    return float(integrated @ moved) / energy
