"""For which wearers do the shipped devices walk that drive only some joints, and how do their joints move?

Fifty random wearers walk 20 s with each device and an own gait, with the prostheses also after one change of
the published table. For each driven joint, the walk of the preset gives angle, moment and power by phase
beside healthy walking. Five minutes; page: docs/background/device_walks.md.
"""

# %%
from __future__ import annotations

import itertools
import math
from collections import Counter

import numpy as np
import pandas as pd
from gallery import read_options

from twin_gait import JointName, Run, load_experiment, simulate, simulate_batch
from twin_gait.measures.phases import usual_phases
from twin_gait.measures.reference import normative_moment, reference_curve
from twin_gait.measures.strides import PERCENT, normalise_strides
from twin_gait.studies.workers import Workers

PRESETS = ("hip_exoskeleton", "knee_orthosis", "osl_prosthesis", "sup_prosthesis")
COUNT, SEED, DURATION = 50, 51, 20.0
# Of a random wearer: mass [kg], height [m], support, belt speed [km/h].
RANGES = {
    "patient.mass_kg": (55.0, 95.0),
    "patient.height_m": (1.55, 1.90),
    "scenario.support.share": (0.4, 0.7),
    "scenario.belt_speed_km_per_h": (1.5, 2.5),
}
# Changes of the published tables, one at a time, with the same own gait: by preset and name.
SWITCH, ANKLE = "table.transitions[2].all", "table.phases.late_stance.ankle"
CHANGES: dict[str, dict[str, dict[str, object]]] = {
    "osl_prosthesis": {
        **{
            f"early swing ends at {angle}° instead of 50°": {
                SWITCH: [f"knee.angle_deg > {angle}", "knee.velocity_deg_per_s < 3"]
            }
            for angle in (45, 40, 35, 30)
        },
        "no least time in late swing": {"table.phases.late_swing.minimum_duration_ms": 0},
        "θ0 of the ankle in late stance −10° instead of −20°": {f"{ANKLE}.equilibrium_deg": -10},
    },
    "sup_prosthesis": {
        "k of the ankle in late stance 2 instead of 4 N·m/deg": {f"{ANKLE}.stiffness_Nm_per_deg": 2},
        "θ0 of the ankle in late stance −8° instead of −16°": {f"{ANKLE}.equilibrium_deg": -8},
        "late stance blended in over 100 ms": {
            "table.blending.law": "minimum_jerk",
            "table.phases.late_stance.blending_ms": 100,
        },
    },
}


# %%
def wearers(count: int, seed: int) -> list[dict[str, float | str]]:
    """Draw wearers with their support and belt speed, uniformly within the ranges."""
    random, found = np.random.default_rng(seed), []
    for _ in range(count):
        drawn: dict[str, float | str] = {key: float(random.uniform(*ends)) for key, ends in RANGES.items()}
        found.append({**drawn, "patient.sex": str(random.choice(["male", "female"]))})
    return found


def walks_of(
    preset: str, changes: dict[str, object], count: int, duration: float, workers: Workers
) -> pd.DataFrame:
    """Simulate the walks of random wearers with a device whose experiment has some changes."""
    base = load_experiment(preset, [f"duration_s={duration}"]).experiment
    return simulate_batch(base, [{**changes, **one} for one in wearers(count, SEED)], workers=workers)


def outcome_row(walks: pd.DataFrame) -> dict[str, object]:
    """Return how many wearers walk, and medians of those who walk."""
    walked = walks[walks["outcome"] == "walked"]
    others = Counter(walks[walks["outcome"] != "walked"]["outcome"])
    row: dict[str, object] = {
        "walk": f"{len(walked)} of {len(walks)}",
        "others": ", ".join(f"{number} {name}" for name, number in sorted(others.items())) or "none",
    }
    for joint in ("hip", "knee"):
        for side in ("left", "right"):
            row[f"{side} {joint} error [°]"] = median(walked[f"{side}_rmse_{joint}_by_contact_deg"], 1)
    row["load peak / carried weight"] = median(peaks(walked), 2)
    return row


def peaks(walks: pd.DataFrame) -> pd.Series:
    """Return the load peak over the carried weight of each walk, of the leg with the larger one."""
    return walks[["left_load_peak", "right_load_peak"]].max(axis=1)


def carried_rows(walks: dict[str, pd.DataFrame]) -> list[dict[str, object]]:
    """Return the load peaks of those who walk with a prosthesis, by the carried mass of the wearer."""
    rows = []
    for low, high in itertools.pairwise((16, 25, 30, 35, 40, 57)):
        row: dict[str, object] = {"carried mass of the wearer [kg]": f"{low} to {high}"}
        for preset, table in walks.items():
            carried = table["patient.mass_kg"] * (1.0 - table["scenario.support.share"])
            inside = table[(table["outcome"] == "walked") & (carried >= low) & (carried < high)]
            row[f"{preset}: walks"] = len(inside)
            row[f"{preset}: left load peak"] = median(inside["left_load_peak"], 2)
            row[f"{preset}: right load peak"] = median(inside["right_load_peak"], 2)
        rows.append(row)
    return rows


def median(values: pd.Series, digits: int) -> float | None:
    """Return the rounded median of the defined values; None without any."""
    known = values.dropna().to_numpy(dtype=float)
    return round(float(np.median(known)), digits) if len(known) else None


# %%
def phase_rows(run: Run) -> list[dict[str, object]]:
    """Return angle, moment and power of each driven joint of the left leg by phase, and healthy values.

    Moments are those of the motor at the joint less friction, per kg of the wearer, positive in flexion. The
    healthy angle is Koopman's at the same speed; the healthy moment of the knee is that of Winter's slow
    walkers, times the carried share of the weight in stance.
    """
    leg, patient, walking = run.leg_record(run.experiment.sides[0]), run.experiment.patient, run.walkway
    bounds = leg.strides()
    if patient is None or walking is None or not len(bounds):
        return []
    names, share = run.table.phase_names, run.experiment.scenario.walking.carried_share
    phases, rows = usual_phases(leg.phases, bounds, len(names)), []
    speed = run.experiment.scenario.walking.speed
    for joint in leg.driven:
        name = f"{leg.side}_{joint}"
        velocity = run.log[f"{name}_velocity_rad_per_s"].to_numpy()
        moment = (
            run.log[f"{name}_motor_torque_Nm"].to_numpy() + run.log[f"{name}_friction_torque_Nm"].to_numpy()
        )
        curves = {
            "angle [°]": np.degrees(normalise_strides(leg.angles[joint], bounds).mean(axis=0)),
            "moment [N·m/kg]": normalise_strides(moment, bounds).mean(axis=0) / patient.mass,
            "power [W/kg]": normalise_strides(moment * velocity, bounds).mean(axis=0) / patient.mass,
        }
        healthy = np.degrees(reference_curve(joint, PERCENT, speed=speed, height=patient.height))
        for number, phase in enumerate(names):
            where = phases == number
            if not where.any():
                continue
            row: dict[str, object] = {"joint": str(joint), "phase": phase, "share [%]": int(where[:-1].sum())}
            row |= {label: round(float(curve[where].mean()), 2) for label, curve in curves.items()}
            row["healthy angle [°]"] = round(float(healthy[where].mean()), 1)
            normative = None
            if joint is not JointName.ANKLE:
                carried = 1.0 if run.table.is_swing(phase) else share
                normative = round(float(carried * normative_moment(joint, PERCENT)[where].mean()), 2)
            row["healthy moment [N·m/kg]"] = normative
            rows.append(row)
    return rows


# %%
if __name__ == "__main__":
    form = read_options("device_walks")
    count, duration = (2, 6.0) if form.quick else (COUNT, DURATION)
    results: dict[str, object] = {}
    with Workers(form.workers) as workers:
        walks = {preset: walks_of(preset, {}, count, duration, workers) for preset in PRESETS}
        names = {preset: load_experiment(preset).experiment.device.name for preset in PRESETS}
        results["outcomes"] = [{"device": names[preset], **outcome_row(walks[preset])} for preset in PRESETS]
        for preset, changes in CHANGES.items():
            rows = [{"change": "none", **outcome_row(walks[preset])}]
            for name, change in [] if form.quick else changes.items():
                changed = walks_of(preset, change, count, duration, workers)
                rows.append({"change": name, **outcome_row(changed)})
            results[f"{preset}_changes"] = rows
    results["carried"] = carried_rows({preset: walks[preset] for preset in CHANGES})
    for rows in results.values():
        print(pd.DataFrame(rows).to_string())
    for preset in PRESETS:
        run = simulate(load_experiment(preset, [f"duration_s={duration}"]).experiment)
        results[preset] = phase_rows(run)
        assert not results[preset] or all(math.isfinite(row["angle [°]"]) for row in results[preset])
    form.write_results(results)
