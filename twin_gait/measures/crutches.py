"""Load, moment and work of arms and crutches, and the log column of the trunk's lean."""

import math

import numpy as np
import pandas as pd

from twin_gait.vocabulary import Side

TRUNK_PITCH = "trunk_pitch_rad"


def crutch_use(log: pd.DataFrame, side: Side, tick: float, body_weight: float) -> dict[str, float] | None:
    """Compute the measures of one arm and its crutch over a run, by their names in a summary.

    ``body_weight``: weight of wearer and device in [N]. The mean and the largest vertical load are shares of
    it; the push is the force along the strut; the moment is the largest magnitude of the shoulder's moment;
    the work that an arm takes up is zero or negative; ``plantings`` counts how often the crutch was put down.
    Returns None if the log has no crutch on this side or no rows.
    """
    if f"{side}_crutch_normal_force_N" not in log or len(log) == 0:
        return None
    load = log[f"{side}_crutch_normal_force_N"].to_numpy()
    power = log[f"{side}_arm_power_W"].to_numpy()
    loaded, weight = load > 0.0, body_weight or math.nan  # shares are not defined without gravity
    return {
        "mean_share": float(load.mean()) / weight,
        "peak_share": float(load.max()) / weight,
        "impulse_Ns": float(load.sum()) * tick,
        "axial_force_peak_N": float(log[f"{side}_arm_axial_force_N"].max()),
        "moment_peak_Nm": float(log[f"{side}_shoulder_moment_Nm"].abs().max()),
        "work_done_J": float(np.maximum(power, 0.0).sum()) * tick,
        "work_absorbed_J": float(np.minimum(power, 0.0).sum()) * tick,
        "plantings": int(np.count_nonzero(loaded[1:] & ~loaded[:-1])),
    }
