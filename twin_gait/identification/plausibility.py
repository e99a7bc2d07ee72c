"""Values that a joint cannot have: other units, marks for missing values, columns that disagree."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.quantities import Quantity
from twin_gait.identification.reading import Log

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


def plausible_series(log: Log, optional: Set[Quantity], notes: list[str], *, joint_known: bool) -> Log:
    """Leave out optional columns that cannot be right; doubt the others.

    Args:
        log: A series of velocity and friction torque, without NaN.
        optional: Columns that may be left out.
        notes: What a reader should know; added to.
        joint_known: Whether it is said whose joint it is; then a unit that cannot be is an error.

    Returns:
        The series.

    Raises:
        ParameterFileError: If velocity and angle disagree, or a unit of a known joint cannot be.
    """
    columns = dict(log.columns)
    for quantity in sorted(optional):
        if quantity in _LARGEST and float(np.abs(columns[quantity]).max()) > _LARGEST[quantity][0]:
            notes.append(f"{quantity} was left out: {_beyond(quantity, columns[quantity])}")
            del columns[quantity]
    slope = velocity_slope(replace(log, columns=columns))
    if slope is not None and not _SLOPE[0] < slope < _SLOPE[1] and Quantity.ANGLE not in log.asked:
        notes.append(f"angle was left out: the velocity's integral moves {slope:.3g} times as far")
        del columns[Quantity.ANGLE]
    kept = replace(log, columns=columns)
    if joint_known:
        check_units(kept)
    for quantity in sorted(set(columns) & set(_LARGEST)):
        if float(np.abs(columns[quantity]).max()) > _LARGEST[quantity][0]:
            notes.append(_beyond(quantity, columns[quantity]))
    if not joint_known:
        _check_velocity(kept)
    return kept


def check_marks(log: Log) -> None:
    """Refuse values that stand for a missing one, such as -9999 or 1e30.

    Args:
        log: Without NaN.

    Raises:
        ParameterFileError: If a column has one.
    """
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
    slope = velocity_slope(log)
    if slope is not None and not _SLOPE[0] < slope < _SLOPE[1]:
        raise ParameterFileError(
            log.source,
            "velocity",
            f"its integral moves {slope:.3g} times as far as the angle: one of time, angle and velocity is "
            "in another unit or sign; declare them with --units time=…,angle=…,velocity=…",
        )


def velocity_slope(log: Log) -> float | None:
    """How far the integral of the velocity moves when the angle moves by one.

    Args:
        log: Without NaN.

    Returns:
        1 if time, angle and velocity go together; None if one of them is missing or nothing moves.
    """
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
