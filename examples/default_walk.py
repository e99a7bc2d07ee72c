"""Quality of the shipped walks, and the range of wearers and belts in which they still walk.

The walks of the treadmill compared with goals from human walking; combined draws of wearer, support and
speed; speeds of the belt; small changes of support and mass; ways to hold the trunk. Two minutes on two
cores; page: docs/background/default_walk.md.
"""

# %%
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from gallery import read_options
from scipy.stats import qmc

from twin_gait import Experiment, Run, load_experiment, presets, simulate, summarise_run
from twin_gait.studies.batch import override_experiment, run_episodes
from twin_gait.studies.workers import Workers

# Presets, or other tables in the world of the guided walk.
DEFAULT, GUIDED = "treadmill", "treadmill_guided"
WALKS = (DEFAULT, GUIDED, "treadmill_pre_swing")
DURATION = 20.0  # [s]
# Ranges of the combined draws: mass [kg], height [m], supported share, belt speed [km/h].
KEYS = ("patient.mass_kg", "patient.height_m", "scenario.support.share", "scenario.belt_speed_km_per_h")
LOWEST, HIGHEST = (50.0, 1.50, 0.2, 0.8), (110.0, 1.95, 0.8, 1.9)
DRAWS, SEED = 75, 19
GEARS = (1.0, 0.9, 0.85, 0.7)  # efficiencies
# Wearers, supports and ways to hold the trunk of the map of harnesses, on the default walk.
WEARERS = [(mass, height) for mass in (55.0, 75.0, 95.0) for height in (1.60, 1.75, 1.90)]
SUPPORTS = (0.7, 0.6, 0.5, 0.4, 0.3, 0.2)
LEVER = "scenario.support.strap_lever_m"
HARNESSES: dict[str, dict[str, object]] = {
    "locked": {"scenario.support.pitch": "locked"},
    **{f"straps at {100 * lever:g} cm": {LEVER: lever} for lever in (0.05, 0.10, 0.15, 0.20)},
    "free": {"scenario.support.pitch": "free"},
}
# Motors alone, which feed back the braking power.
NO_ELECTRONICS = {
    "plant.electronics.inverter_resistance_Ohm": 0.0,
    "plant.electronics.inverter_power_W": 0.0,
    "plant.electronics.constant_power_W": 0.0,
    "plant.electronics.regeneration": 1.0,
}


@dataclass(frozen=True)
class Goal:
    """Goal of a measure of a walk: from ``low`` to ``high``, and better from ``best`` on."""

    label: str
    key: str
    low: float
    high: float
    best: tuple[float, float]

    @staticmethod
    def text(low: float, high: float) -> str:
        """Format a range in words; empty for a range without a finite value."""
        if math.isinf(low) and math.isinf(high):
            return "rising" if low > 0 else ""
        if math.isinf(high):
            return f"≥ {low:g}"
        return f"≤ {high:g}" if low in (0.0, -math.inf) else f"{low:g} to {high:g}"

    def rated(self, value: float) -> str:
        """Return the rating of a value as one word."""
        if self.best[0] <= value <= self.best[1]:
            return "better than required"
        return "met" if self.low <= value <= self.high else "missed"


INF = math.inf
GOALS = (
    Goal("RMSE of the hip from heel strike [°]", "hip_rmse_deg", 0.0, 3.5, (0.0, 3.0)),
    Goal("RMSE of the knee from heel strike [°]", "knee_rmse_deg", 0.0, 4.5, (0.0, 3.8)),
    Goal("stride time [s]", "stride_time_s", 1.65, 1.95, (1.70, 1.80)),
    Goal("peak vertical force / carried weight", "load_peak", 0.0, 1.15, (0.0, 1.1)),
    Goal("trough in midstance", "trough", 0.7, INF, (0.8, INF)),
    Goal("least load over 6 to 20 % of the cycle", "min_load", 0.4, INF, (INF, INF)),
    Goal("mean fore-aft force of both feet [N]", "fore_aft_force_N", -5.0, 5.0, (-0.5, 0.5)),
    Goal("power of the belt [W]", "belt_power_W", -1.0, 1.0, (-0.15, 0.15)),
    Goal("braking peak / carried weight", "braking_peak", 0.0, 0.12, (0.0, 0.065)),
    Goal("propulsion peak / that of the reference", "propulsion_share", 0.5, INF, (0.9, 1.1)),
    Goal("knee at contact [°]", "knee_at_contact_deg", -INF, 9.0, (-INF, 4.0)),
    Goal("knee yield after it [°]", "knee_yield_deg", 4.0, INF, (7.0, INF)),
    Goal("clearance in mid-swing [mm]", "clearance_mm", 10.0, INF, (15.0, INF)),
    Goal("share of ticks with any joint at a limit [%]", "any_saturated_percent", 0.0, 5.0, (0.0, 1.0)),
    Goal("further contacts", "further_contacts", 0, 0, (0, 0)),
)


# %%
def measured(run: Run) -> dict[str, float | str]:
    """Return the measures of a walk, from the worse leg where the legs differ."""
    found: dict[str, float | str] = {"outcome": str(run.verdict.outcome)}
    power = run.walk_power()
    if found["outcome"] != "walked" or power is None:
        return found
    summary, legs = summarise_run(run), list(run.walk_measures().values())
    sides = list(summary["sides"].values())
    reference = summary["walk_reference"]
    return found | {
        "hip_rmse_deg": max(side["rmse_hip_by_contact_deg"] for side in sides),
        "knee_rmse_deg": max(side["rmse_knee_by_contact_deg"] for side in sides),
        "stride_time_s": float(np.mean([side["stride_time_mean_s"] for side in sides])),
        "load_peak": max(leg["load_peak"] for leg in legs),
        "trough": min(leg["min_midstance_load"] for leg in legs),
        "min_load": min(leg["min_load"] for leg in legs),
        "fore_aft_force_N": sum(leg["fore_aft_force_N"] for leg in legs),
        "belt_power_W": power["belt_W"],
        "propulsion_share": min(leg["propulsion_peak"] for leg in legs) / reference["propulsion_peak"],
        "braking_peak": max(-leg["braking_peak"] for leg in legs),
        "braking_share": min(leg["braking_peak"] for leg in legs) / reference["braking_peak"],
        "knee_at_contact_deg": max(leg["knee_at_contact_deg"] for leg in legs),
        "knee_yield_deg": min(leg["knee_yield_deg"] for leg in legs),
        "clearance_mm": min(1e3 * leg["clearance_m"] for leg in legs),
        "any_saturated_percent": 100.0 * summary["any_joint_saturated_share"],
        "further_contacts": sum(side["further_contacts"] for side in sides),
    }


def walk_of(item: tuple[str, Mapping[str, object]]) -> Experiment:
    """Return the experiment of a preset or a table, with some changes."""
    name, changes = item
    preset, table = (name, []) if name in presets() else (GUIDED, [f"table={name}"])
    settings = [*table, f"duration_s={DURATION}"]
    return override_experiment(load_experiment(preset, settings).experiment, changes)


def draws(count: int) -> list[dict[str, float]]:
    """Draw wearers, supports and speeds together from a Latin hypercube."""
    points = qmc.scale(qmc.LatinHypercube(len(KEYS), rng=SEED).random(count), LOWEST, HIGHEST)
    return [dict(zip(KEYS, map(float, point), strict=True)) for point in points]


def moves() -> dict[str, dict[str, float]]:
    """Return changes of the defaults: support by ten percentage points, mass by a tenth."""
    experiment = load_experiment(DEFAULT).experiment
    share, mass = experiment.scenario.support.share, experiment.patient.mass
    return {
        "10 points less support": {"scenario.support.share": share - 0.1},
        "10 points more support": {"scenario.support.share": share + 0.1},
        "a tenth less mass": {"patient.mass_kg": 0.9 * mass},
        "a tenth more mass": {"patient.mass_kg": 1.1 * mass},
    }


def harness_walks() -> dict[tuple[float, str], list[dict[str, object]]]:
    """Return the changes of the default walk for each support and harness, by wearer."""
    return {
        (share, name): [
            {KEYS[0]: mass, KEYS[1]: height, KEYS[2]: share, **harness} for mass, height in WEARERS
        ]
        for share in SUPPORTS
        for name, harness in HARNESSES.items()
    }


def outcome(run: Run) -> str:
    """Return the outcome of a run as one word."""
    return str(run.verdict.outcome)


def speed_range(speeds: Sequence[float], walked: Sequence[bool], around: float) -> tuple[float, float] | None:
    """Return the ends of the continuous range of walking around a speed; None if the table does not walk."""
    middle = int(np.argmin(np.abs(np.array(speeds) - around)))
    if not walked[middle]:
        return None
    low = high = middle
    while low > 0 and walked[low - 1]:
        low -= 1
    while high < len(speeds) - 1 and walked[high + 1]:
        high += 1
    return float(speeds[low]), float(speeds[high])


def worked(name: str, changes: Mapping[str, object]) -> dict[str, float]:
    """Return the effort of the motors in a walk with some changes, as maxima or means."""
    run = simulate(walk_of((name, changes)))
    summary = summarise_run(run)
    sides = list(summary["sides"].values())
    joints = [joint for side in sides for joint in side["joints"].values()]
    return {
        "stride_s": float(np.mean([side["stride_time_mean_s"] for side in sides])),
        "stride_variation": max(side["stride_time_variation"] for side in sides),
        "swing_share": float(np.mean([side["swing_share"] for side in sides])),
        "hip_rmse_deg": max(side["rmse_hip_by_contact_deg"] for side in sides),
        "knee_rmse_deg": max(side["rmse_knee_by_contact_deg"] for side in sides),
        "lag_s": max(abs(side["early_stance_lag_max_abs_s"]) for side in sides),
        "saturated_share": summary["worst_joint_saturated_share"],
        "any_joint_saturated_share": summary["any_joint_saturated_share"],
        "double_support_share": float(np.mean([side["double_support_share"] for side in sides])),
        "torque_rms_Nm": max(joint["torque_rms_Nm"] for joint in joints),
        "friction_W": -float(run.log["friction_work_J"].iloc[-1]) / run.duration,
        "battery_W": summary["battery_power_mean_W"],
        "battery_life_h": summary["battery_life_h"],
    }


def gear_rows() -> list[dict[str, str]]:
    """Simulate the guided walk with gears of different efficiency and return a row for each."""
    rows = []
    for efficiency in GEARS:
        gears = {f"plant.actuators.{joint}.gear_efficiency": efficiency for joint in ("hip", "knee")}
        found = worked(GUIDED, gears)
        rows.append(
            {
                "η": f"{efficiency:g}",
                "stride [s]": f"{found['stride_s']:.2f}",
                "RMSE hip / knee [°]": f"{found['hip_rmse_deg']:.1f} / {found['knee_rmse_deg']:.1f}",
                "friction [W]": f"{found['friction_W']:.1f}",
                "battery [W]": f"{found['battery_W']:.1f}",
                "battery lasts [h]": f"{found['battery_life_h']:.1f}",
            }
        )
    return rows


# %%
def goal_rows(walks: dict[str, dict]) -> list[dict]:
    """Return every goal and the value of each walk."""
    rows = []
    for goal in GOALS:
        row = {"measure": goal.label, "goal": goal.text(goal.low, goal.high)}
        row |= {"better": goal.text(*goal.best)}
        for name, walk in walks.items():
            value = walk.get(goal.key, math.nan)
            row[name] = f"{value:.2f}, {goal.rated(value)}"
        rows.append(row)
    return rows


def moved_rows(walks: dict[tuple[str, str], dict], nominal: dict[str, dict]) -> list[dict]:
    """Return the growth of the errors if support or mass change."""
    rows = []
    for move in moves():
        row = {"moved": move}
        for name, walk in nominal.items():
            moved = walks[name, move]
            growth = [
                moved.get(key, math.nan) - walk.get(key, math.nan)
                for key in ("hip_rmse_deg", "knee_rmse_deg")
            ]
            row[name] = f"hip {growth[0]:+.1f}°, knee {growth[1]:+.1f}°"
        rows.append(row)
    return rows


# %%
if __name__ == "__main__":
    form = read_options("default_walk")
    count, speeds = (
        (DRAWS, np.round(np.arange(0.5, 3.01, 0.1), 1)) if not form.quick else (2, np.array([1.5]))
    )
    # The quick form leaves out the default walk, because the loop for its braces takes a minute to compile.
    names = WALKS if not form.quick else WALKS[1:]
    jobs: dict[tuple[str, str], dict[str, float]] = {}
    for name in names:
        jobs[name, "nominal"] = {}
        jobs |= {(name, f"draw {number}"): draw for number, draw in enumerate(draws(count))}
        jobs |= {(name, f"{speed} km/h"): {KEYS[-1]: float(speed)} for speed in speeds}
        jobs |= {(name, move): changes for move, changes in moves().items()}
    items = [(name, changes) for (name, _), changes in jobs.items()]
    with Workers(form.workers) as workers:
        results = run_episodes(walk_of, measured, items, workers=workers)
        held = harness_walks() if not form.quick else {}
        outcomes = run_episodes(
            walk_of,
            outcome,
            [(DEFAULT, item) for cell in held.values() for item in cell],
            workers=workers,
        )
    walks = dict(zip(jobs, results, strict=True))
    cells = {cell: outcomes[len(WEARERS) * number :][: len(WEARERS)] for number, cell in enumerate(held)}
    harnesses = [
        {"support": f"{100 * share:g} %"}
        | {name: f"{cells[share, name].count('walked')} of {len(WEARERS)}" for name in HARNESSES}
        for share in (SUPPORTS if held else ())
    ]
    nominal = {name: walks[name, "nominal"] for name in names}
    summary = []
    for name in names:
        walked = [walks[name, f"draw {number}"]["outcome"] == "walked" for number in range(count)]
        at_speed = [walks[name, f"{speed} km/h"]["outcome"] == "walked" for speed in speeds]
        found = speed_range(speeds.tolist(), at_speed, 1.5)
        text = "none" if found is None else f"{found[0]:.1f} to {found[1]:.1f} km/h"
        summary.append({"walk": name, "combined draws that walk": f"{sum(walked)} of {count}", "belt": text})
        print(name, nominal[name], summary[-1], sep="\n  ")
    form.write_results(
        {
            "goals": goal_rows(nominal),
            "reach": summary,
            "harnesses": harnesses,
            "moved": moved_rows(walks, nominal),
            "draws": count,
            "nominal": nominal,
            "worked": {name: worked(name, {}) for name in names},
            "gears": gear_rows(),
            "without_electronics": worked(GUIDED, NO_ELECTRONICS),
        }
    )
