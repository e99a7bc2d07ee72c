"""Export joint angles as a motion file of OpenSim (.mot, .sto)."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.conventions import DEGREES, RADIANS, Convention
from twin_gait.exceptions import ParameterError
from twin_gait.files import write_atomically
from twin_gait.measures.leg_record import wearer_column
from twin_gait.vocabulary import JointName, Side


def export_motion(
    log: pd.DataFrame, path: Path, convention: Convention, *, unit: str = DEGREES, device: bool = False
) -> list[str]:
    """Write the joint angles of a log as a motion of an OpenSim model.

    Hip and knee, and the ankle where the log has one, under the names and signs of the model. The pelvis is
    left out: the model keeps its own place.

    Args:
        log: One row per tick, with ``time_s`` and true angles.
        path: The file; OpenSim reads .mot and .sto alike.
        convention: Names and signs of the model.
        device: Whether the angles are the device's where braces let the wearer move against it.
        unit: ``deg``, which is usual in .mot files, or ``rad``; the header says which.

    Returns:
        Names of the columns.

    Raises:
        ParameterError: If the convention has no column names of its own, or the unit is another.
        RunDirectoryError: If it cannot be written.
    """
    if unit not in (DEGREES, RADIANS):
        raise ParameterError(f"unit: expected {DEGREES} or {RADIANS}, got {unit!r}")
    columns = _columns(log, convention, unit, () if device else log.columns)
    rows = np.column_stack(list(columns.values()))
    header = [
        path.stem,
        "version=1",
        f"nRows={len(rows)}",
        f"nColumns={len(columns)}",
        f"inDegrees={'yes' if unit == DEGREES else 'no'}",
        "endheader",
        "\t".join(columns),
    ]
    lines = ["\t".join(map(repr, row)) for row in rows.tolist()]  # all digits
    write_atomically(path, "\n".join([*header, *lines]) + "\n")
    return list(columns)


def _columns(
    log: pd.DataFrame, convention: Convention, unit: str, own: Container[str]
) -> dict[str, np.ndarray]:
    if not convention.columns:
        raise ParameterError(f"convention: {convention.name} has no column names of its own")
    columns = {"time": log["time_s"].to_numpy(dtype=float)}
    for side in Side:
        for joint in JointName:
            name = convention.columns.get((side, joint))
            column = wearer_column(own, side, joint, "angle_rad")
            if name is None or column not in log:
                continue
            angle = convention.from_house(joint, log[column].to_numpy(dtype=float))
            columns[name] = np.degrees(angle) if unit == DEGREES else angle
    return columns
