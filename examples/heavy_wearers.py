"""Heavy wearers: walks that are held, the torque that they need, and changes with which they walk.

Seventy-five wearers whose legs carry 60 to 110 kg, with the shipped limits and table, with the limit of the
hardware and stance springs that grow in proportion to the carried mass, and with drives without limits. The
heaviest walk for three minutes, in which the windings become warm. Two minutes on two cores; page:
docs/background/robustness_map.md.
"""

# %%
from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.figure import Figure
from scipy.stats import qmc

from twin_gait import Experiment, Run, load_experiment, simulate
from twin_gait.palette import BLACK, BLUE, EVENT_COLOUR, GREY, JOINT_COLOURS, VERMILLION
from twin_gait.report.canvas import save, style_panel
from twin_gait.studies.batch import override_experiment, run_episodes
from twin_gait.studies.workers import Workers

DRAWS, SEED = 75, 11
DEVICE_MASS = 20.0  # [kg]
LOWEST, HIGHEST = (60.0, 0.0, 1.60, 1.1), (110.0, 1.0, 1.90, 1.6)
BANDS = (60.0, 70.0, 80.0, 90.0, 100.0, 110.0)  # [kg]
HEAVIEST = 110.0  # [kg], heaviest wearer of TWIN (table 2.1 of the thesis)
WALKED = "walked"
LONG = 180.0  # [s]
SHIPPED, HARDWARE = 60.0, 100.0  # [N·m] limits: shipped, and of the URDF
# Springs of stance grow with the carried mass over 36 kg to this power; the shipped table has 0.27.
LINEAR = {"table.scaling.carried_mass_exponent": 1.0}
HARD = {"control.limits.torque_Nm": HARDWARE}
# Limits at the ends of their accepted ranges, far above every walk.
UNLIMITED = {
    "control.limits": {"torque_Nm": 900.0, "current_A": 100.0},
    "control.safety.highest_command_Nm": 1000.0,
    "plant.battery.voltage_V": 100.0,
    **{f"plant.actuators.{joint}.peak_torque_Nm": 1000.0 for joint in ("hip", "knee")},
}
FREE = "no limits, proportional springs"
VARIANTS = {
    "60 N·m, shipped table": {},
    "100 N·m, shipped table": HARD,
    "60 N·m, proportional springs": LINEAR,
    "100 N·m, proportional springs": HARD | LINEAR,
    FREE: UNLIMITED | LINEAR,
}


# %%
def draws(count: int) -> list[dict[str, float]]:
    """Draw carried mass, wearer, height and belt speed from a Latin hypercube; return the changes."""
    points = qmc.scale(qmc.LatinHypercube(4, rng=SEED).random(count), LOWEST, HIGHEST)
    found = []
    for carried, share, height, speed in points:
        lightest = max(60.0, carried - DEVICE_MASS)
        mass = lightest + share * (HEAVIEST - lightest)
        found.append(
            {
                "patient.mass_kg": float(mass),
                "patient.height_m": float(height),
                "scenario.belt_speed_km_per_h": float(speed),
                "scenario.support.share": float(1.0 - carried / (mass + DEVICE_MASS)),
            }
        )
    return found


def unchanged(experiment: Experiment) -> Experiment:
    """Return an experiment as it is; worker processes call this function."""
    return experiment


def carried_mass(case: dict[str, float]) -> float:
    """Return the mass that the legs carry in [kg]: wearer and device, less the supported share."""
    return (case["patient.mass_kg"] + DEVICE_MASS) * (1.0 - case["scenario.support.share"])


def measured(run: Run) -> dict[str, object]:
    """Return outcome and cause of a walk, and for each joint its torque and speed at the motors' limits."""
    found: dict[str, object] = {"outcome": str(run.verdict.outcome), "cause": ""}
    if run.trip is not None:
        found["cause"] = f"{run.trip.cause}, {run.trip.location.split()[-1]}"
    for joint in ("hip", "knee"):
        drive = run.experiment.plant.actuators[joint]
        names = [f"{side}_{joint}" for side in run.sides]
        torque = np.concatenate([run.log[f"{name}_motor_torque_Nm"] for name in names])
        speed = np.concatenate([run.log[f"{name}_velocity_rad_per_s"] for name in names])
        driving = torque * speed > 0.0
        found |= {
            f"{joint}_peak_Nm": float(np.abs(torque).max()),
            f"{joint}_rms_Nm": float(np.sqrt((torque * torque).mean())),
            f"{joint}_above_60": float((np.abs(torque) > SHIPPED).mean()),
            f"{joint}_above_100": float((np.abs(torque) > HARDWARE).mean()),
            f"{joint}_beyond_voltage": float(
                (driving & (np.abs(torque) > available(drive, np.abs(speed)))).mean()
            ),
        }
        shown = np.argsort(-np.abs(torque))[:: max(1, len(torque) // 400)]
        found[f"{joint}_points"] = np.abs(np.array([speed, torque])[:, shown]).round(2).tolist()
    return found


def available(drive: object, speed: np.ndarray, voltage: float = 28.8) -> np.ndarray:
    """Return the torque in [N·m] that a voltage drives against the back-EMF at a joint speed in [rad/s]."""
    constant = drive.torque_constant * drive.gear_ratio
    return np.maximum(0.0, constant * (voltage - constant * speed) / drive.resistance)


# %%
def band_rows(walks: pd.DataFrame) -> list[dict[str, str]]:
    """Return how many walk in each band of the carried mass, a column for each variant."""
    rows = []
    for low, high in itertools.pairwise(BANDS):
        block = walks[(low <= walks["carried_kg"]) & (walks["carried_kg"] < high)]
        row = {"carried mass": f"{low:g} to {high:g} kg"}
        for variant in VARIANTS:
            outcomes = block.loc[block["variant"] == variant, "outcome"]
            row[variant] = f"{(outcomes == WALKED).sum()} of {len(outcomes)}"
        rows.append(row)
    return rows


def cause_rows(walks: pd.DataFrame) -> list[dict[str, str]]:
    """Return the causes of the walks that were held, for each variant."""
    rows = []
    for variant in VARIANTS:
        block = walks[(walks["variant"] == variant) & (walks["outcome"] != WALKED)]
        counts = block["cause"].where(block["cause"] != "", block["outcome"]).value_counts()
        causes = "; ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in counts.items())
        rows.append({"variant": variant, "not walked": len(block), "causes": causes or "none"})
    return rows


def need_rows(walks: pd.DataFrame, experiment: Experiment) -> list[dict[str, str]]:
    """Return the torque that walks without limits need, by carried mass, and that of the drives."""
    free = walks[(walks["variant"] == FREE) & (walks["outcome"] == WALKED)]
    rows = []
    for joint in ("hip", "knee"):
        drive = experiment.plant.actuators[joint]
        for low, high in itertools.pairwise(BANDS):
            block = free[(low <= free["carried_kg"]) & (free["carried_kg"] < high)]
            if not len(block):
                continue
            over = 100.0 * block[f"{joint}_above_100"].mean()
            beyond = 100.0 * block[f"{joint}_beyond_voltage"].mean()
            rows.append(
                {
                    "joint": joint,
                    "carried mass": f"{low:g} to {high:g} kg",
                    "peak, median [N·m]": f"{block[f'{joint}_peak_Nm'].median():.0f}",
                    "time above 60 N·m": f"{100.0 * block[f'{joint}_above_60'].mean():.1f} %",
                    "time above 100 N·m": f"{over:.1f} %",
                    "time beyond the voltage": f"{beyond:.1f} %",
                    "RMS [N·m]": f"{block[f'{joint}_rms_Nm'].mean():.0f}",
                    "continuous [N·m]": f"{drive.continuous_torque:g}",
                }
            )
    return rows


def long_rows(base: Experiment, cases: list[dict[str, float]], *, quick: bool) -> list[dict[str, object]]:
    """Simulate the heaviest for longer, with the limit of the hardware and proportional springs.

    The heat of a winding tends to the square of its RMS current over the continuous one, with a time constant
    of 53 s; the monitor holds the walk if it exceeds 1. Returns a row for each band of the carried mass.
    """
    rows = []
    for low, high in itertools.pairwise(BANDS[-2:]):
        block = [case for case in cases if low <= carried_mass(case) < high][: 1 if quick else None]
        changes = HARD | LINEAR | {"duration_s": 12.0 if quick else LONG}
        runs = [simulate(override_experiment(base, case | changes)) for case in block]
        hot = [run.trip.time for run in runs if run.trip is not None and run.trip.cause == "winding_heat"]
        walked = sum(run.verdict.outcome == WALKED for run in runs)
        rows.append(
            {
                "carried mass": f"{low:g} to {high:g} kg",
                f"walked for {LONG:g} s": f"{walked} of {len(runs)}",
                "held because a winding is too hot": len(hot),
                "first of them after": f"{min(hot):.0f} s" if hot else "–",
                "held for another reason": len(runs) - walked - len(hot),
            }
        )
    return rows


# %%
def draw(walks: pd.DataFrame, experiment: Experiment) -> Figure:
    """Draw the map of outcomes of two variants, and torque and speed of walks without limits."""
    figure = Figure(figsize=(13.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 4)
    for panel, variant in zip(
        panels[:2], ("60 N·m, shipped table", "100 N·m, proportional springs"), strict=True
    ):
        block = walks[walks["variant"] == variant]
        walked = block["outcome"] == WALKED
        for chosen, marker, colour, words in (
            (walked, "o", BLUE, "walked"),
            (~walked, "x", EVENT_COLOUR, "held"),
        ):
            part = block[chosen]
            panel.plot(
                part["carried_kg"], part["speed_km_per_h"], marker, color=colour, label=words, markersize=5
            )
        style_panel(panel, variant, "belt speed [km/h]")
        panel.set_xlabel("carried mass [kg]")
        panel.set_ylim(1.05, 1.75)
        panel.legend(frameon=False, ncols=2, loc="upper left", fontsize="small")
    free = walks[(walks["variant"] == FREE) & (walks["outcome"] == WALKED)]
    for panel, joint in zip(panels[2:], ("hip", "knee"), strict=True):
        for carried, points in zip(free["carried_kg"], free[f"{joint}_points"], strict=True):
            heavy = carried >= 80.0
            panel.plot(*points, ".", markersize=1.5, color=JOINT_COLOURS[joint] if heavy else "#BBBBBB")
        speeds = np.linspace(0.0, 5.0, 50)
        drive = experiment.plant.actuators[joint]
        for voltage, style in ((28.8, "-"), (24.0, ":")):
            panel.plot(
                speeds,
                available(drive, speeds, voltage),
                style,
                color=BLACK,
                label=f"{voltage:g} V",
                linewidth=1.2,
            )
        for level, colour, words in (
            (HARDWARE, VERMILLION, "hardware limit"),
            (SHIPPED, GREY, "shipped limit"),
            (drive.continuous_torque, BLUE, "continuous"),
        ):
            panel.axhline(level, color=colour, linewidth=1.0, linestyle="--", label=words)
        style_panel(panel, f"{joint}: torque without limits", "torque [N·m]")
        panel.set_xlabel("speed [rad/s]")
        panel.set_ylim(0.0, 260.0)
        panel.set_xlim(0.0, 4.5)
        panel.legend(frameon=False, fontsize="x-small", loc="upper right")
    return figure


# %%
if __name__ == "__main__":
    form = read_options("heavy_wearers")
    base = load_experiment("treadmill_guided", ["duration_s=12"]).experiment
    cases = draws(3 if form.quick else DRAWS)
    items = [case | changes for changes in VARIANTS.values() for case in cases]
    experiments = [override_experiment(base, item) for item in items]
    with Workers(form.workers) as workers:
        found = run_episodes(unchanged, measured, experiments, workers=workers)
    rows = [
        {
            "variant": variant,
            "carried_kg": carried_mass(case),
            "mass_kg": case["patient.mass_kg"],
            "speed_km_per_h": case["scenario.belt_speed_km_per_h"],
        }
        for variant in VARIANTS
        for case in cases
    ]
    walks = pd.DataFrame([row | item for row, item in zip(rows, found, strict=True)])
    save(draw(walks, base), form.out / "heavy_wearers.png", resolution=100)
    longer = long_rows(base, cases, quick=form.quick)
    above = walks[walks["carried_kg"] >= 80.0]
    shares = {
        variant: f"{(block['outcome'] == WALKED).sum()} of {len(block)}"
        for variant, block in above.groupby("variant", sort=False)
    }
    print(shares, *band_rows(walks), *cause_rows(walks), *need_rows(walks, base), sep="\n")
    form.write_results(
        {
            "walks": len(walks),
            "draws": len(cases),
            "above_80_kg": {
                "shipped": shares["60 N·m, shipped table"],
                "proportional": shares["100 N·m, proportional springs"],
            },
            "bands": band_rows(walks),
            "causes": cause_rows(walks),
            "needs": need_rows(walks, base),
            "long": longer,
        }
    )
