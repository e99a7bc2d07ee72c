"""What arms and crutches do for a walk, and how far the trunk leans."""

import math

import numpy as np
import pandas as pd

from twin_gait.vocabulary import Side

TRUNK_PITCH = "trunk_pitch_rad"


def crutch_use(log: pd.DataFrame, side: Side, tick: float, body_weight: float) -> dict[str, float] | None:
    """Measures of one arm and its crutch over a run, as a summary has them; None without one.

    ``body_weight`` of wearer and device in [N]. Shares of it are the mean and the largest vertical load, the
    push is along the strut, the moment that of the shoulder either way; the work that an arm takes up is zero
    or negative; ``plantings`` count how often the crutch was put down.
    """
    if f"{side}_crutch_normal_force_N" not in log or len(log) == 0:
        return None
    load = log[f"{side}_crutch_normal_force_N"].to_numpy()
    power = log[f"{side}_arm_power_W"].to_numpy()
    loaded, weight = load > 0.0, body_weight or math.nan  # nothing weighs anything without gravity
    return {
        "mean_share": float(load.mean()) / weight,
        "peak_share": float(load.max()) / weight,
        "impulse_Ns": float(load.sum()) * tick,
        "push_peak_N": float(log[f"{side}_arm_push_N"].max()),
        "moment_peak_Nm": float(log[f"{side}_shoulder_moment_Nm"].abs().max()),
        "work_done_J": float(np.maximum(power, 0.0).sum()) * tick,
        "work_taken_J": float(np.minimum(power, 0.0).sum()) * tick,
        "plantings": int(np.count_nonzero(loaded[1:] & ~loaded[:-1])),
    }
