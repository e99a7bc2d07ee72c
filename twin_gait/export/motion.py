"""Export of logs as CSV and as motions of OpenSim (.mot, .sto).

A storage file of OpenSim has a header, ``endheader``, the names of the columns and rows of numbers.
"""

import re
from collections.abc import Container, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.conventions import DEGREES, RADIANS, Convention
from twin_gait.exceptions import ParameterError
from twin_gait.files import write_atomically
from twin_gait.measures.leg_record import wearer_column
from twin_gait.parameters.quantities import require


def export_motion(
    log: pd.DataFrame, path: str | Path, convention: Convention, *, unit: str = DEGREES, device: bool = False
) -> None:
    """Write the joint angles of a log as a motion of an OpenSim model.

    The file contains hip and knee, and the ankle if the log has one, with the names and signs of the model.
    It leaves the pelvis out, so that the model keeps its own pelvis coordinates.

    ``log``: one row per tick, with ``time_s`` and true angles. ``unit``: ``deg``, which is usual in .mot
    files, or ``rad``; the header states it. ``device``: whether to write the angles of the device if braces
    allow the wearer to move relative to it. Raises ParameterError if the convention has no column names of
    its own, or the unit is another.
    """
    require(unit in (DEGREES, RADIANS), "unit", f"{DEGREES} or {RADIANS}", unit)
    columns = {"time": log["time_s"].to_numpy(dtype=float)}
    columns |= joint_angles(log, convention, unit, device=device)
    write_storage(path, columns, in_degrees=unit == DEGREES)


def joint_angles(
    log: pd.DataFrame, convention: Convention, unit: str, *, device: bool
) -> dict[str, np.ndarray]:
    """Return the angles of all joints of a log by column, with the names and signs of a model."""
    if not convention.columns:
        raise ParameterError(f"convention: {convention.name} has no column names; choose another one")
    searched: Container[str] = () if device else log.columns
    columns = {}
    for (side, joint), name in convention.columns.items():
        column = wearer_column(searched, side, joint, "angle_rad")
        if column in log:
            angle = convention.convert_angle(joint, log[column].to_numpy(dtype=float))
            if unit == DEGREES:  # a name that contains a unit contains the written one
                name, angle = re.sub("_rad$", "_deg", name), np.degrees(angle)
            columns[name] = angle
    return columns


def write_storage(path: str | Path, columns: Mapping[str, np.ndarray], *, in_degrees: bool) -> None:
    """Write columns to a .mot or .sto file, ``time`` first, with all digits."""
    table = pd.DataFrame(columns)
    header = [
        Path(path).stem,
        "version=1",
        f"nRows={len(table)}",
        f"nColumns={len(columns)}",
        f"inDegrees={'yes' if in_degrees else 'no'}",
        "endheader\n",
    ]
    write_atomically(path, "\n".join(header) + table.to_csv(sep="\t", index=False, lineterminator="\n"))


def export_csv(log: pd.DataFrame, path: str | Path) -> None:
    """Write a log as CSV: a header with units in the names, one row per tick, all digits."""
    write_atomically(path, log.to_csv(index=False, lineterminator="\n"))
