"""Test of policies and other controllers on wearers and pushes that the training did not contain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from policies.training import WEARERS
from scipy.stats import t as student

from twin_gait import load_experiment
from twin_gait.studies.batch import simulate_batch

SEED = 4000  # seed of the wearers of the test
MEASURES = ["torque_rms_Nm", "rmse_hip_deg", "rmse_knee_deg", "battery_W"]
# Changes of the experiment by controller.
CONTROLLERS: Mapping[str, Mapping[str, Any]] = {
    "table": {},
    "low_effort": {"control.mode": "policy", "control.policy": "low_effort"},
    "assist_as_needed (policy)": {"control.mode": "policy", "control.policy": "assist_as_needed"},
    "assist_as_needed (Emken)": {"control.assistance.adaptive": True},
    "nine tenths of the table": {"control.assistance.hip": 0.9, "control.assistance.knee": 0.9},
    "four fifths of the table": {"control.assistance.hip": 0.8, "control.assistance.knee": 0.8},
    "position": {"control.mode": "position"},
}
# Pushes of 20 N·m for 0.2 s, by time in [s].
PUSHES = {5.0: "left_knee", 7.3: "right_hip", 9.7: "right_knee", 12.1: "left_hip"}


def draw_wearers(count: int) -> list[dict[str, float | int]]:
    """Return the values of some wearers, from the distribution of the training with another seed."""
    generator = np.random.default_rng(SEED)
    drawn = [
        {key: float(generator.uniform(*bounds)) for key, bounds in WEARERS.items()} for _ in range(count)
    ]
    return [{**values, "seed": SEED + number} for number, values in enumerate(drawn)]


def evaluate(
    count: int, duration: float, controllers: Mapping[str, Mapping[str, Any]], workers: int
) -> pd.DataFrame:
    """Walk with every wearer and controller, without and with pushes; one row for each walk."""
    experiment = load_experiment("treadmill_guided", [f"duration_s={duration}"]).experiment
    events = [
        {"time_s": time, "push": {"joint": joint, "torque_Nm": 20, "duration_ms": 200}}
        for time, joint in PUSHES.items()
        if time < duration - 1.0
    ]
    parts = []
    for name, changes in controllers.items():
        for pushed in (False, True):
            more = {"events": events} if pushed and events else {}
            walks = simulate_batch(
                experiment, [{**wearer, **changes, **more} for wearer in draw_wearers(count)], workers=workers
            )
            parts.append(measures_of(walks).assign(controller=name, pushed=pushed, wearer=range(count)))
            print(f"{name}, {'with' if pushed else 'without'} pushes: {parts[-1]['walked'].sum()} of {count}")
    return pd.concat(parts, ignore_index=True)


def measures_of(walks: pd.DataFrame) -> pd.DataFrame:
    """Return the compared measures of walks; NaN for those that ended early."""
    walked = walks["outcome"] == "walked"
    joints = [f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee")]
    squares = walks[[f"{joint}_torque_rms_Nm" for joint in joints]].astype(float) ** 2
    found = {"torque_rms_Nm": np.sqrt(squares.mean(axis=1))}
    for joint in ("hip", "knee"):
        errors = walks[[f"{side}_rmse_{joint}_by_contact_deg" for side in ("left", "right")]].astype(float)
        found[f"rmse_{joint}_deg"] = errors.mean(axis=1)
    found["battery_W"] = walks["battery_power_mean_W"].astype(float)
    return pd.DataFrame(found).where(walked).assign(walked=walked.to_numpy(bool))


def interval(values: pd.Series) -> str:
    """Return mean and half-width of the 95 % confidence interval, with a sign."""
    width = student.ppf(0.975, len(values) - 1) * values.sem() if len(values) > 1 else np.nan
    return f"{values.mean():+.1f} ± {width:.1f}"


def rows_of(table: pd.DataFrame, *, pushed: bool) -> list[dict[str, Any]]:
    """Return a row for each controller; differences from the table are of wearers who walk with both."""
    chosen, rows = table[table["pushed"] == pushed].set_index("wearer"), []
    base = chosen[chosen["controller"] == "table"]
    for name, walks in chosen.groupby("controller", sort=False):
        both = walks["walked"] & base["walked"]
        apart = walks[both][MEASURES] - base[both][MEASURES]
        ratio = 100.0 * apart["torque_rms_Nm"] / base[both]["torque_rms_Nm"]
        rows.append(
            {
                "controller": name,
                "walked": f"{int(walks['walked'].sum())} of {len(walks)}",
                "motor torque, RMS [N·m]": f"{walks['torque_rms_Nm'].mean():.1f}",
                "change [%]": interval(ratio),
                "RMSE hip, change [°]": interval(apart["rmse_hip_deg"]),
                "RMSE knee, change [°]": interval(apart["rmse_knee_deg"]),
                "battery, change [W]": interval(apart["battery_W"]),
            }
        )
    return rows
