"""Refuse logs that cannot be what they are read as: wrong units, wrong order, too little."""

from __future__ import annotations

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.quantities import Quantity
from twin_gait.identification.reading import Log

FEWEST = 20  # samples of a test
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


def clean(log: Log) -> tuple[Log, dict[str, int]]:
    """Take out rows that say nothing, and refuse a log that cannot be used.

    Args:
        log: As it was read.

    Returns:
        The log without rows that hold a NaN or repeat a time, and how many there were of each.

    Raises:
        ParameterFileError: If times go backwards, too little is left, or a column is in the wrong unit.
    """
    kept = np.ones(len(log), dtype=bool)
    for values in log.columns.values():
        kept &= np.isfinite(values)
    counts = {"read": len(log), "not_a_number": int(len(log) - kept.sum())}
    columns = {quantity: values[kept] for quantity, values in log.columns.items()}
    time = columns.get(Quantity.TIME)
    counts["duplicate_time"] = 0
    if time is not None and len(time):
        _check_order(log.source, time)
        fresh = np.concatenate([[True], np.diff(time) > 0.0])
        counts["duplicate_time"] = int(len(time) - fresh.sum())
        if counts["duplicate_time"] > 0.5 * len(time):
            raise ParameterFileError(
                log.source, "time", "most rows repeat the time of the row before; the clock is too coarse"
            )
        columns = {quantity: values[fresh] for quantity, values in columns.items()}
    cleaned = Log(log.source, columns, log.mass)
    if len(cleaned) < FEWEST:
        raise ParameterFileError(
            log.source, "", f"has {len(cleaned)} usable rows of {len(log)}; expected at least {FEWEST}"
        )
    check_units(cleaned)
    return cleaned, counts


def _check_order(source: str, time: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(time) < 0.0)
    if len(back):
        row = int(back[0])
        raise ParameterFileError(
            source,
            "time",
            f"goes back from {time[row]:g} s to {time[row + 1]:g} s; one file is one test: cut it there",
        )


def check_units(log: Log) -> None:
    """Refuse columns that are in another unit than they are read in.

    Args:
        log: Without NaN.

    Raises:
        ParameterFileError: If a value is beyond what a joint can do, or velocity and angle disagree.
    """
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
    time, angle, velocity = (
        log.columns.get(quantity) for quantity in (Quantity.TIME, Quantity.ANGLE, Quantity.VELOCITY)
    )
    if time is None or angle is None or velocity is None:
        return
    # Displacements over a tenth of the log: noise of single differences would hide the slope.
    stride = max(len(time) // 10, 1)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    moved, integrated = angle[stride:] - angle[:-stride], travelled[stride:] - travelled[:-stride]
    energy = float(moved @ moved)
    if energy < 1e-6 * len(moved):  # less than a milliradian: nothing to compare
        return
    slope = float(integrated @ moved) / energy
    if not _SLOPE[0] < slope < _SLOPE[1]:
        raise ParameterFileError(
            log.source,
            "velocity",
            f"its integral moves {slope:.3g} times as far as the angle: one of time, angle and velocity is "
            "in another unit or sign; declare them with --units time=…,angle=…,velocity=…",
        )
