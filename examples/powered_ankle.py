"""How much does a motor at the ankle add to the push-off of the orthosis alone, and for which wearers?

Power and work of the ankle over the stride in the presets ``treadmill_ankle`` and ``treadmill_guided``,
compared to Winter's healthy walkers; both walks with other wearers. The motor consists of data only: a URDF
with a drive, a preset and a gait table. Half a minute; page: docs/background/powered_ankle.md.
"""

# %%
from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from gallery import read_options

from twin_gait import Experiment, Run, load_experiment, simulate, summarise_run

PRESETS = {"orthosis alone": "treadmill_guided", "motor and orthosis": "treadmill_ankle"}
DURATION, SKIPPED = 20.0, 2  # [s], strides at the start
WEARERS = ((55, 1.60), (55, 1.75), (70, 1.60), (70, 1.75), (70, 1.90), (85, 1.75), (85, 1.90), (95, 1.90))
GRID = 201  # number of points of a stride

# Winter (1991), Biomechanics and Motor Control of Human Gait, per kg of body mass: peak power of the ankle
# [W/kg] of 19 people each, and its work by the trapezoidal rule over 51 points of a stride [J/kg]. They carry
# their full weight.
# The slow cadence of 86.8 steps/min and its speed of about 1.0 m/s are from memory.
WINTER = {
    "Winter, slow, about 3.6 km/h": {"peak": 2.06, "positive": 0.280, "negative": -0.129},
    "Winter, natural, 4.8 km/h": {"peak": 3.33, "positive": 0.358, "negative": -0.127},
}


# %%
def experiment(preset: str, mass: float, height: float) -> Experiment:
    """Return a shipped walk with another wearer."""
    settings = [f"patient.mass_kg={mass}", f"patient.height_m={height}", f"duration_s={DURATION}"]
    return load_experiment(preset, settings).experiment


def torque(run: Run, side: str) -> dict[str, np.ndarray]:
    """Return the torques at an ankle in [N·m]: motor less losses of friction and gear, and orthosis."""
    zero = np.zeros(len(run.log))
    motor, friction, orthosis = (
        run.log[name].to_numpy() if (name := f"{side}_ankle_{part}_torque_Nm") in run.log else zero
        for part in ("motor", "friction", "orthosis")
    )
    return {"motor": motor + friction, "orthosis": orthosis, "both": motor + friction + orthosis}


def strides(run: Run) -> list[dict[str, tuple[np.ndarray, float]]]:
    """Return the power per kg of the wearer over each stride of both legs, with its duration in [s]."""
    found = []
    for side in run.sides:
        velocity = run.log[f"{side}_ankle_velocity_rad_per_s"].to_numpy()
        power = {
            name: values * velocity / run.experiment.patient.mass
            for name, values in torque(run, side).items()
        }
        for first, last in run.leg_record(side).strides()[SKIPPED:]:
            found.append(
                {name: (values[first:last], (last - first) * 1e-3) for name, values in power.items()}
            )
    return found


def of_ankle(run: Run) -> dict[str, float]:
    """Compute peak power [W/kg] and work per stride [J/kg] as means over strides."""
    found: dict[str, list[float]] = {"peak": [], "positive": [], "negative": [], "motor": []}
    for stride in strides(run):
        power = stride["both"][0]
        found["peak"].append(float(power.max()))
        found["positive"].append(float(np.maximum(power, 0.0).sum()) * 1e-3)
        found["negative"].append(float(np.minimum(power, 0.0).sum()) * 1e-3)
        found["motor"].append(float(stride["motor"][0].sum()) * 1e-3)
    return {name: float(np.mean(values)) for name, values in found.items()}


def of_walk(run: Run) -> dict[str, float]:
    """Return the measures of the walk from the worse leg."""
    summary = summarise_run(run)
    sides = list(summary["sides"].values())
    joints = [joint for side in sides for joint in side["joints"].values()]
    return {
        "hip_rmse_deg": max(side["rmse_hip_by_contact_deg"] for side in sides),
        "knee_rmse_deg": max(side["rmse_knee_by_contact_deg"] for side in sides),
        "clearance_mm": 1e3 * min(side["walk"]["clearance_m"] for side in sides),
        "load_peak": max(side["walk"]["load_peak"] for side in sides),
        "min_load": min(side["walk"]["min_load"] for side in sides),
        "braking_peak": min(side["walk"]["braking_peak"] for side in sides),
        "fore_aft_force_N": sum(side["walk"]["fore_aft_force_N"] for side in sides),
        "saturated_percent": 100.0 * max(joint["saturated_share"] for joint in joints),
        "battery_W": summary["battery_power_mean_W"],
        "carried_kg": run.walkway.carried_weight / 9.81,
    }


# %%
def power_row(name: str, found: dict[str, float]) -> dict[str, str]:
    """Format power and work of an ankle as a row of the page."""
    net = found["positive"] + found["negative"]
    return {
        "ankle": name,
        "peak power [W/kg]": f"{found['peak']:.2f}",
        "positive work [J/kg]": f"{found['positive']:.3f}",
        "negative work [J/kg]": f"{found['negative']:.3f}",
        "net work [J/kg]": f"{net:+.3f}",
    }


def wearer_row(mass: float, height: float, runs: dict[str, Run]) -> dict[str, str]:
    """Return the results of another wearer with both ankles as a row."""
    row = {"wearer": f"{mass:g} kg, {height:.2f} m"}
    for name, run in runs.items():
        row[name] = str(run.verdict.outcome)
        if row[name] == "walked":
            ankle, walk = of_ankle(run), of_walk(run)
            row[name] += f", {ankle['positive'] + ankle['negative']:+.3f} J/kg"
            row[name] += f", RMSE {walk['hip_rmse_deg']:.1f} / {walk['knee_rmse_deg']:.1f}°"
            row[name] += f", clearance {walk['clearance_mm']:.0f} mm"
    return row


def draw(runs: dict[str, Run]) -> plt.Figure:
    """Draw angle and power of the ankle over the stride."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 6), sharex=True, layout="constrained")
    percent = np.linspace(0.0, 100.0, GRID)

    def mean(curves: list[np.ndarray]) -> np.ndarray:
        cycles = [np.interp(percent, np.linspace(0.0, 100.0, len(curve)), curve) for curve in curves]
        return np.mean(cycles, axis=0)

    for name, run in runs.items():
        angles = [
            np.degrees(run.log[f"{side}_ankle_angle_rad"].to_numpy()[first:last])
            for side in run.sides
            for first, last in run.leg_record(side).strides()[SKIPPED:]
        ]
        above.plot(percent, mean(angles), label=name)
        below.plot(percent, mean([stride["both"][0] for stride in strides(run)]), label=name)
        if name == "motor and orthosis":
            motor = mean([stride["motor"][0] for stride in strides(run)])
            below.plot(percent, motor, "--", color="grey", label="of it the motor")
    above.set_ylabel("dorsiflexion [°]")
    below.set_ylabel("power of the ankle [W/kg]")
    below.set_xlabel("stride from foot contact [%]")
    for axes in (above, below):
        axes.axhline(0.0, color="black", linewidth=0.5)
        axes.legend(frameon=False)
    return figure


# %%
if __name__ == "__main__":
    form = read_options("powered_ankle")
    walks = {name: simulate(experiment(preset, 70, 1.75)) for name, preset in PRESETS.items()}
    ankles = {name: of_ankle(run) for name, run in walks.items()}
    rows = [power_row(name, found) for name, found in (*ankles.items(), *WINTER.items())]
    for row in rows:
        print(row)
    wearers = []
    for mass, height in WEARERS if not form.quick else ():
        others = {name: simulate(experiment(preset, mass, height)) for name, preset in PRESETS.items()}
        wearers.append(wearer_row(mass, height, others))
        print(wearers[-1])
    draw(walks).savefig(form.out / "powered_ankle.png", dpi=110)
    form.write_results(
        {
            "power": rows,
            "ankle": {name.split()[0]: found for name, found in ankles.items()},
            "walk": {name.split()[0]: of_walk(run) for name, run in walks.items()},
            "wearers": wearers,
        }
    )
