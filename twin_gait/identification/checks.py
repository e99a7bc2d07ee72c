"""Take out rows that say nothing, and refuse logs with too little in them or times in the wrong order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.plausibility import check_marks, check_units, plausible_series
from twin_gait.identification.quantities import Quantity
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

    Args:
        log: As it was read.
        joint_known: Whether it is said whose joint it is; then a unit that cannot be is an error in a series
            too, otherwise a note.

    Returns:
        The log without rows that hold a NaN or repeat the one before, how many there were of each, and what a
        reader should know.

    Raises:
        ParameterFileError: If times go backwards in a log of a bench, too little is left, or a column is in
            the wrong unit.
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
    check_marks(cleaned)
    if series:
        optional = _optional(cleaned, series)
        cleaned = plausible_series(cleaned, optional, notes, joint_known=joint_known)
    else:
        check_units(cleaned)
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
