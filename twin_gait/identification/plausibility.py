"""Rows and columns that cannot be used: empty cells, disordered times, other units, missing-value marks."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.reading import KINDS, Log, Quantity
from twin_gait.identification.samples import LONGEST_GAP

FEWEST = 20  # samples of a test
_MOSTLY_EMPTY = 0.1  # share of empty cells beyond which an optional column is left out, not the rows
_PERIODS = (2e-5, 0.5)  # [s] between the samples of measured friction
_CURRENTS = frozenset({Quantity.TARGET_CURRENT, Quantity.MEASURED_CURRENT})
# In a series and in a log of a bench: columns that the torque is computed from, and those that are of use.
_USED = {
    True: frozenset({Quantity.VELOCITY, Quantity.FRICTION_TORQUE}),
    False: _CURRENTS | {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY},
}
_KEPT = {True: frozenset(Quantity) - _CURRENTS, False: frozenset(Quantity) - {Quantity.LOAD_TORQUE}}
_MEASURED = _CURRENTS | {Quantity.VELOCITY, Quantity.FRICTION_TORQUE}
_SLOPE = (0.7, 1.4)  # of the velocity over the derivative of the angle
_USUAL, _MARK = 0.95, 500.0  # share of the values; times as large as these is no measurement

Columns = dict[Quantity, np.ndarray]


def clean(log: Log, *, joint_known: bool) -> tuple[Log, dict[str, int], tuple[str, ...]]:
    """Take out rows that hold a NaN or repeat the one before, and refuse a log that cannot be used.

    A column that was found by its name alone and that a series can do without is left out if it is mostly
    empty or cannot be what its name says. Also: how many rows there were of each, and what one should know.
    """
    series = Quantity.FRICTION_TORQUE in log.columns
    columns = {name: log.columns[name] for name in log.columns if name in log.asked | _KEPT[series]}
    optional = set(columns) - log.asked - _USED[series]
    notes: list[str] = []
    for quantity in sorted(optional):
        empty = float(np.isnan(columns[quantity]).mean())
        if empty > _MOSTLY_EMPTY:
            notes.append(f"{quantity} was left out: {100.0 * empty:.0f} % of its cells are empty")
            del columns[quantity]
    kept = ~np.logical_or.reduce([np.isnan(values) for values in columns.values()])
    counts = {"read": len(log), "not_a_number": int((~kept).sum()), "duplicate_time": 0}
    columns = {quantity: values[kept] for quantity, values in columns.items()}
    if Quantity.TIME in columns and kept.any():
        timed = _timed_series(columns, notes) if series else _timed_log(log.source, columns)
        columns, counts["duplicate_time"] = timed
    cleaned = replace(log, columns=columns)
    if len(cleaned) < FEWEST:
        empty_cells = {int(np.isnan(values).sum()): quantity for quantity, values in log.columns.items()}
        most = max(empty_cells)
        key, why = (empty_cells[most], ", the others are empty here") if most else ("", "")
        text = f"has {len(cleaned)} usable rows of {len(log)}{why}; expected at least {FEWEST}"
        raise ParameterFileError(log.source, key, text)
    _check_marks(cleaned)
    strict = joint_known or not series
    return _plausible(cleaned, optional & set(columns), notes, strict=strict), counts, tuple(notes)


def _timed_log(source: str, columns: Columns) -> tuple[Columns, int]:
    """A log of a bench in ascending time: the balance of torques needs its derivatives."""
    time = columns[Quantity.TIME]
    steps = np.diff(time)
    if (steps < 0.0).any():
        row = int(np.argmax(steps < 0.0))
        text = f"goes back from {time[row]:g} s to {time[row + 1]:g} s; one file is one test: cut it there"
        raise ParameterFileError(source, "time", text)
    fresh = np.concatenate([[True], steps > 0.0])
    repeated = int(len(time) - fresh.sum())
    if repeated > 0.5 * len(time):
        text = "most rows repeat the time of the row before; the clock is too coarse"
        raise ParameterFileError(source, "time", text)
    return {quantity: values[fresh] for quantity, values in columns.items()}, repeated


def _timed_series(columns: Columns, notes: list[str]) -> tuple[Columns, int]:
    """A series without repeated rows; where time goes back, a new record begins."""
    same = np.logical_and.reduce([np.diff(values) == 0.0 for values in columns.values()])
    fresh = np.concatenate([[True], ~same])
    columns = {quantity: values[fresh] for quantity, values in columns.items()}
    time = columns[Quantity.TIME]
    steps = np.diff(time)
    back, forward = int((steps < 0.0).sum()), steps[steps > 0.0]
    if not len(forward) or back > len(steps) / FEWEST:
        what = "is the same in every row" if not len(forward) else f"goes back {back} times"
        notes.append(f"time was left out: it {what}")
        del columns[Quantity.TIME]
        return columns, int(same.sum())
    period = float(np.median(forward))
    if not _PERIODS[0] <= period <= _PERIODS[1]:
        notes.append(
            f"time advances by {period:.3g} s from row to row: if it is in another unit, declare it "
            "(--units time=ms); stiffness and damping of bristles depend on it"
        )
    if back:
        notes.append(f"time goes back {back} times: records that follow one another were taken apart")
        # A pause that is longer than any gap lets the state of a dynamic model start anew.
        steps = np.where(steps < 0.0, 2.0 * LONGEST_GAP * period, steps)
        columns[Quantity.TIME] = time[0] + np.concatenate([[0.0], np.cumsum(steps)])
    return columns, int(same.sum())


def _plausible(log: Log, optional: set[Quantity], notes: list[str], *, strict: bool) -> Log:
    """Leave out optional columns that cannot be right; doubt the others, or refuse them if strict."""
    columns = dict(log.columns)
    for quantity in sorted(columns):
        if doubt := _beyond(quantity, columns[quantity]):
            if quantity in optional:
                notes.append(f"{quantity} was left out: {quantity} {doubt}")
                del columns[quantity]
            elif strict:
                raise ParameterFileError(log.source, str(quantity), doubt)
            else:
                notes.append(f"{quantity} {doubt}")
    slope = _wrong_slope(columns)
    if slope is not None and Quantity.ANGLE not in optional:
        raise ParameterFileError(
            log.source,
            "velocity",
            f"its integral moves {slope:.3g} times as far as the angle: one of time, angle and velocity is "
            "in another unit or sign; declare them with --units time=…,angle=…,velocity=…",
        )
    if slope is not None:
        notes.append(f"angle was left out: the velocity's integral moves {slope:.3g} times as far")
        del columns[Quantity.ANGLE]
    return replace(log, columns=columns)


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
    """What is said of values beyond what a joint can do; nothing of others."""
    found, (unit, other, *_) = float(np.abs(values).max()), KINDS[quantity].units
    if found <= KINDS[quantity].largest:
        return ""
    return f"reaches {found:.4g} {unit}: of a joint? Declare its unit, such as --units {quantity}={other}"


def _wrong_slope(columns: Mapping[Quantity, np.ndarray]) -> float | None:
    """How far the integral of the velocity moves when the angle moves by one, unless it is about as far."""
    if not {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY} <= set(columns):
        return None
    time, angle, velocity = (columns[name] for name in (Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY))
    # Displacements over a tenth of the log: noise of single differences would hide the slope.
    stride = max(len(time) // 10, 1)
    travelled = cumulative_trapezoid(velocity, time, initial=0)
    moved, integrated = angle[stride:] - angle[:-stride], travelled[stride:] - travelled[:-stride]
    energy = float(moved @ moved)
    if energy < 1e-6 * len(moved):  # less than a milliradian: nothing to compare
        return None
    slope = float(integrated @ moved) / energy
    return None if _SLOPE[0] < slope < _SLOPE[1] else slope
