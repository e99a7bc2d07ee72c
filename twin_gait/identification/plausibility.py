"""Rows and columns that cannot be used: empty cells, disordered times, other units, missing-value marks."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.reading import KINDS, Log, Quantity

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


def clean(log: Log, *, joint_known: bool) -> tuple[Log, dict[str, int], tuple[str, ...]]:
    """Take out rows that hold a NaN or repeat the one before, and refuse a log that cannot be used.

    A column that was found by its name alone and that a series can do without is left out if it is mostly
    empty or cannot be what its name says. Also: how many rows there were of each, and what one should know.
    """
    series = Quantity.FRICTION_TORQUE in log.columns
    columns = {name: log.columns[name] for name in log.columns if name in log.asked | _KEPT[series]}
    optional = set(columns) - log.asked - _USED[series]
    notes: list[str] = []

    def refuse(quantity: Quantity, why: str) -> None:
        """Leave an optional column out; a log is not read without another."""
        if quantity not in optional:
            raise ParameterFileError(log.source, quantity, why)
        notes.append(f"{quantity} was left out: {why}")
        del columns[quantity]

    for quantity in sorted(optional):
        empty = float(np.isnan(columns[quantity]).mean())
        if empty > _MOSTLY_EMPTY:
            refuse(quantity, f"{100.0 * empty:.0f} % of its cells are empty")
    kept = ~np.logical_or.reduce([np.isnan(values) for values in columns.values()])
    columns = {quantity: values[kept] for quantity, values in columns.items()}
    counts = {"read": len(log), "not_a_number": int((~kept).sum()), "duplicate_time": 0}
    if Quantity.TIME in columns and kept.any():
        # A clock may stand still in a series; derivatives of a log of a bench cannot.
        clocks = columns.values() if series else (columns[Quantity.TIME],)
        same = np.logical_and.reduce([np.diff(values, prepend=np.nan) == 0.0 for values in clocks])
        columns = {quantity: values[~same] for quantity, values in columns.items()}
        counts["duplicate_time"] = int(same.sum())
        if not series and same.mean() > 0.5:
            refuse(Quantity.TIME, "is that of the row before in most rows; the clock is too coarse")
        if doubt := _disorder(columns[Quantity.TIME], notes, series=series):
            optional |= {Quantity.TIME} if series else set()
            refuse(Quantity.TIME, doubt)
    rows = len(next(iter(columns.values()), ()))
    if rows < FEWEST:
        text = f"has {rows} usable rows of {len(log)}, with no cell empty; expected at least {FEWEST}"
        raise ParameterFileError(log.source, "", text)
    for quantity in sorted(_MEASURED.intersection(columns)):
        _check_mark(log.source, quantity, columns[quantity])
    for quantity in sorted(columns):
        if doubt := _beyond(quantity, columns[quantity]):
            if joint_known or not series or quantity in optional:
                refuse(quantity, doubt)
            else:
                notes.append(f"{quantity} {doubt}")
    if doubt := _wrong_slope(columns):
        refuse(Quantity.ANGLE, doubt)
    return replace(log, columns=columns), counts, tuple(notes)


def _disorder(time: np.ndarray, notes: list[str], *, series: bool) -> str:
    """What is said of times that cannot be used; nothing of others, or a note.

    In a series records may follow one another.
    """
    steps = np.diff(time)
    back, forward = int((steps < 0.0).sum()), steps[steps > 0.0]
    if back > (len(steps) / FEWEST if series else 0):
        row = int(np.argmax(steps < 0.0))
        text = f"goes back {back} times, from {time[row]:g} s to {time[row + 1]:g} s first"
        return f"{text}; one file is one test: cut it there"
    if not len(forward):
        return "is the same in every row"
    period = float(np.median(forward))
    if series and not _PERIODS[0] <= period <= _PERIODS[1]:
        notes.append(
            f"time advances by {period:.3g} s from row to row: if it is in another unit, declare it "
            "(--units time=ms); stiffness and damping of bristles depend on it"
        )
    if back:
        notes.append(f"time goes back {back} times: records that follow one another were taken apart")
    return ""


def _check_mark(source: str, quantity: Quantity, values: np.ndarray) -> None:
    """Refuse values that stand for a missing one, such as -9999 or 1e30."""
    size = np.abs(values)
    usual, row = float(np.quantile(size, _USUAL)), int(np.argmax(size))
    if size[row] > _MARK * usual > 0.0:
        text = (
            f"is {values[row]:.4g} once where {100 * _USUAL:g} % stay below {usual:.3g}: a mark for a "
            "missing value? Leave such cells empty"
        )
        raise ParameterFileError(source, quantity, text)


def _beyond(quantity: Quantity, values: np.ndarray) -> str:
    """What is said of values beyond what a joint can do; nothing of others."""
    found, (unit, other, *_) = float(np.abs(values).max()), KINDS[quantity].units
    if found <= KINDS[quantity].largest:
        return ""
    return f"reaches {found:.4g} {unit}: of a joint? Declare its unit, such as --units {quantity}={other}"


def _wrong_slope(columns: Mapping[Quantity, np.ndarray]) -> str:
    """What is said of an angle that does not move about as far as the integral of the velocity."""
    if not {Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY} <= set(columns):
        return ""
    time, angle, velocity = (columns[name] for name in (Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY))
    # Displacements over a tenth of the log: noise of single differences would hide the slope.
    stride = max(len(time) // 10, 1)
    elapsed = np.maximum(np.diff(time, prepend=time[:1]), 0.0).cumsum()  # without the way to another record
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
