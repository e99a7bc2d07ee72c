"""The braces of a run in numbers, for ``summary.json``."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from twin_gait.measures.effort import root_mean_square
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.runs.summary.side import reference_error
from twin_gait.simulation.columns import BRACE_COLUMNS, PELVIS_BRACE_COLUMNS
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName


def interaction_summary(
    run: Run, skip_strides: int = SKIPPED_STRIDES
) -> dict[str, dict[str, dict[str, float]]]:
    """What device and wearer do to each other, and how far they move apart.

    Args:
        run: The run.
        skip_strides: Strides at the start that do not count.

    Returns:
        Under ``interaction``, by joint, root mean square and peak of the torque, peak of the relative angle
        and the device's own distance from healthy walking by contact (that of the side is the wearer's), at
        the pelvis of the force and of the relative height; nothing without braces.
    """
    if run.experiment.interface is None or len(run.log) == 0:
        return {}
    columns = (f"{side}_{joint}_{BRACE_COLUMNS[-1]}" for side in run.sides for joint in JointName)
    joints = [name.removesuffix(f"_{BRACE_COLUMNS[-1]}") for name in columns if name in run.log]
    found = {name: _joint(run.log, name) for name in joints}
    for side in run.sides:
        device = run.leg_record(side, device=True)
        for joint in device.angles:
            error = reference_error(run, device, joint, device.strides(skip=skip_strides))
            found[f"{side}_{joint}"]["rmse_of_device_deg"] = error
    return {"interaction": found | _pelvis(run.log)}


def _joint(log: pd.DataFrame, name: str) -> dict[str, float]:
    torque = log[f"{name}_{BRACE_COLUMNS[-1]}"].to_numpy()
    apart = (log[f"{name}_angle_rad"] - log[f"{name}_{BRACE_COLUMNS[0]}"]).to_numpy()
    return {
        "torque_rms_Nm": root_mean_square(torque),
        "torque_peak_Nm": float(np.abs(torque).max()),
        "motion_peak_deg": math.degrees(float(np.abs(apart).max())),
    }


def _pelvis(log: pd.DataFrame) -> dict[str, dict[str, float]]:
    height, _, brace = PELVIS_BRACE_COLUMNS
    if brace not in log:
        return {}
    force = log[brace].to_numpy()
    apart = (log["pelvis_height_m"] - log[height]).to_numpy()
    numbers = {
        "force_rms_N": root_mean_square(force),
        "force_peak_N": float(np.abs(force).max()),
        "motion_peak_mm": 1e3 * float(np.abs(apart).max()),
    }
    return {"pelvis": numbers}
