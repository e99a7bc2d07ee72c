"""What arms and crutches do for a walk, and how far the trunk leans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from twin_gait.vocabulary import Side

TRUNK_PITCH = "trunk_pitch_rad"


@dataclass(frozen=True)
class CrutchUse:
    """One arm and its crutch over a run."""

    mean_share: float  # mean vertical load over the weight of wearer and device
    peak_share: float  # largest one
    impulse: float  # of the vertical load in [N s]
    push_peak: float  # largest force along the strut in [N]
    moment_peak: float  # largest moment of the shoulder, either way, in [N m]
    work_done: float  # by the arm in [J]
    work_taken: float  # that it takes up in [J], zero or negative
    plantings: int  # how often the crutch was put down


def crutch_use(log: pd.DataFrame, side: Side, tick: float, body_weight: float) -> CrutchUse | None:
    """Measures of one crutch; None without one. ``body_weight`` of wearer and device in [N]."""
    if f"{side}_crutch_normal_force_N" not in log or len(log) == 0:
        return None
    load = log[f"{side}_crutch_normal_force_N"].to_numpy()
    power = log[f"{side}_arm_power_W"].to_numpy()
    loaded = load > 0.0
    return CrutchUse(
        mean_share=float(load.mean()) / body_weight,
        peak_share=float(load.max()) / body_weight,
        impulse=float(load.sum()) * tick,
        push_peak=float(log[f"{side}_arm_push_N"].max()),
        moment_peak=float(log[f"{side}_shoulder_moment_Nm"].abs().max()),
        work_done=float(np.maximum(power, 0.0).sum()) * tick,
        work_taken=float(np.minimum(power, 0.0).sum()) * tick,
        plantings=int(np.count_nonzero(loaded[1:] & ~loaded[:-1])),
    )
