"""Account of the battery power of the guided walk, and the changes that save most.

Every loss and every work of the guided walk, which add up to the battery power; the same walk with other
electronics, gears, motors and tables; the share of walking with which the battery lasts the 4 h of table 2.1
of the thesis. Ten seconds on two cores; page: docs/background/default_walk.md.
"""

# %%
from __future__ import annotations

import numpy as np
from gallery import read_options
from matplotlib.figure import Figure

from twin_gait import Experiment, Run, load_experiment, summarise_run
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, VERMILLION
from twin_gait.report.canvas import save, style_panel
from twin_gait.studies.batch import override_experiment, run_episodes

SOFT = "springs 20 % softer"
THESIS_HOURS = 4.0  # battery autonomy, table 2.1 of the thesis; it does not state for which use
JOINTS = ("hip", "knee")
PHASES = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")
COLOURS = (BLACK, GREY, REDDISH_PURPLE, VERMILLION, ORANGE, "#F0C869", BLUISH_GREEN, BLUE)


# %% [markdown]
# ## The account
# The motors draw $R I^2 + R_{inv} I^2 + \tau\omega$, of which the mechanical power covers the friction of the
# joints, the losses of the gears under load and the work on the legs. Power that the brakes feed into the
# bus and that no other consumer takes returns to the battery with losses.


# %%
def account(run: Run) -> dict[str, float]:
    """Return the mean powers in [W] that add up to the mean battery power, by name."""
    log, plant = run.log, run.experiment.plant
    electronics, friction = plant.electronics, plant.true_friction()
    names = [(f"{side}_{joint}", joint) for side in run.sides for joint in JOINTS]
    copper = conduction = mechanical = unloaded = lost = np.zeros(len(log))
    for name, joint in names:
        velocity, current = log[f"{name}_velocity_rad_per_s"], log[f"{name}_measured_current_A"]
        law, squared = friction[joint], current.to_numpy() ** 2
        torque = [
            rotational_friction_torque(
                speed,
                law.breakaway_torque,
                law.coulomb_friction,
                law.breakaway_velocity,
                law.viscous_friction,
            )
            for speed in velocity
        ]
        copper = copper + plant.actuators[joint].resistance * squared
        conduction = conduction + electronics.inverter_resistance * squared
        mechanical = mechanical + (log[f"{name}_motor_torque_Nm"] * velocity).to_numpy()
        unloaded = unloaded + np.array(torque) * velocity.to_numpy()
        lost = lost - (log[f"{name}_friction_torque_Nm"] * velocity).to_numpy()
    fixed = electronics.constant_power + len(names) * electronics.inverter_power
    surplus = np.maximum(0.0, -(copper + conduction + mechanical + fixed))
    powers = {
        "computers, sensors, radio": electronics.constant_power,
        "inverters, constant": len(names) * electronics.inverter_power,
        "inverters, conduction": conduction.mean(),
        "copper of the windings": copper.mean(),
        "friction without load": unloaded.mean(),
        "gears under load": (lost - unloaded).mean(),
        "legs, ground, orthoses": (mechanical - lost).mean(),
        "braking power not stored": (1.0 - electronics.regeneration) * surplus.mean(),
    }
    return {name: float(power) for name, power in powers.items()}


def exchange(run: Run) -> dict[str, float]:
    """Return the positive and the negative mechanical power of all motors [W], and their common part.

    The common part is the power that braking motors supply to driving ones at the same time.
    """
    names = [f"{side}_{joint}" for side in run.sides for joint in JOINTS]
    powers = np.array(
        [run.log[f"{name}_motor_torque_Nm"] * run.log[f"{name}_velocity_rad_per_s"] for name in names]
    )
    driving, braking = np.maximum(powers, 0.0).sum(axis=0), -np.minimum(powers, 0.0).sum(axis=0)
    return {
        "driving_W": float(driving.mean()),
        "braking_W": float(braking.mean()),
        "passed_on_W": float(np.minimum(driving, braking).mean()),
    }


# %% [markdown]
# ## What if


# %%
def each_phase(experiment: Experiment, key: str, ratio: float) -> dict[str, float]:
    """Return the changes that multiply a number of every phase and joint of the table by a ratio."""
    attribute = key.removesuffix("_Nm_per_rad")
    return {
        f"table.phases.{phase}.{joint}.{key}": ratio * getattr(values, attribute)
        for phase in PHASES
        for joint, values in experiment.table.phases[phase].joints.items()
    }


def what_if(experiment: Experiment) -> dict[str, dict[str, float]]:
    """Return the changes of the guided walk by label."""
    electronics, actuator = "plant.electronics.", "plant.actuators.{}.".format
    resistances = {joint: experiment.plant.actuators[joint].resistance for joint in JOINTS}
    halved = {f"{actuator(joint)}resistance_Ohm": 0.5 * value for joint, value in resistances.items()}
    gears = {
        efficiency: {f"{actuator(joint)}gear_efficiency": efficiency for joint in JOINTS}
        for efficiency in (0.75, 0.95)
    }
    every = {
        f"{electronics}constant_power_W": 3.0,
        f"{electronics}regeneration": 1.0,
        **halved,
        **gears[0.95],
    }
    return {
        "guided walk": {},
        "no regeneration": {f"{electronics}regeneration": 0.0},
        "regeneration without loss": {f"{electronics}regeneration": 1.0},
        "inverter resistance doubled": {f"{electronics}inverter_resistance_Ohm": 0.04},
        "electronics 3 W instead of 6": {f"{electronics}constant_power_W": 3.0},
        "G halved": each_phase(experiment, "friction_compensation_gain", 0.5),
        "no compensation, G = 0": each_phase(experiment, "friction_compensation_gain", 0.0),
        SOFT: each_phase(experiment, "stiffness_Nm_per_rad", 0.8),
        "springs 40 % softer": each_phase(experiment, "stiffness_Nm_per_rad", 0.6),
        "gear efficiency 0.75": gears[0.75],
        "gear efficiency 0.95": gears[0.95],
        "windings with half the resistance": halved,
        "electronics, regeneration, gears, windings": every,
        "these, and springs 20 % softer": every | each_phase(experiment, "stiffness_Nm_per_rad", 0.8),
    }


def measured(run: Run) -> dict[str, object]:
    """Return outcome, battery power and life of a walk, and its account."""
    summary = summarise_run(run)
    errors = {
        f"{joint}_error_deg": max(side[f"rmse_{joint}_by_contact_deg"] for side in summary["sides"].values())
        for joint in JOINTS
    }
    return {
        "outcome": summary["outcome"],
        "battery_W": summary["battery_power_mean_W"],
        "hours": summary["battery_life_h"],
        "account": account(run),
        **errors,
        **exchange(run),
    }


# %%
def draw(default: dict, walks: dict[str, dict], goal: float) -> Figure:
    """Draw the account of the guided walk, and the battery power after each change."""
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    start = 0.0
    for row, (power, colour) in enumerate(zip(default["account"].values(), COLOURS, strict=True)):
        left.barh(row, power, left=start, color=colour, height=0.7)
        left.annotate(
            f"{power:.1f} W", (max(start, start + power), row), (4, 0), textcoords="offset points",
            va="center", fontsize="small",
        )  # fmt: skip
        start += power
    left.set_yticks(range(len(COLOURS)), list(default["account"]))
    left.invert_yaxis()
    left.axvline(start, color=GREY, linewidth=0.8)
    left.set_xlim(0.0, 1.15 * start)
    style_panel(left, f"Account of the guided walk: {default['battery_W']:.1f} W", "")
    left.set_xlabel("mean power [W]")
    labels = list(walks)
    powers = [walk["battery_W"] for walk in walks.values()]
    right.barh(labels, powers, height=0.7, color=[GREY, *[BLUE] * (len(labels) - 1)])
    for row, walk in enumerate(walks.values()):
        text = f"{walk['battery_W']:.1f} W, {walk['hours']:.1f} h"
        text += "" if walk["outcome"] == "walked" else f", {walk['outcome']}"
        right.annotate(
            text, (walk["battery_W"], row), (4, 0), textcoords="offset points", va="center", fontsize="small"
        )
    right.axvline(goal, color=VERMILLION, linewidth=1.2)
    words = f"{THESIS_HOURS:g} h: {goal:.0f} W"
    right.annotate(words, (goal, -0.75), (4, 0), textcoords="offset points", color=VERMILLION, va="center")
    right.set_ylim(len(labels) - 0.4, -1.2)
    right.set_xlim(0.0, 1.3 * max(powers))
    style_panel(right, "Battery power with one change", "")
    right.set_xlabel("mean battery power [W]")
    for panel in (left, right):
        panel.grid(axis="y", visible=False)
    return figure


# %%
if __name__ == "__main__":
    form = read_options("battery_account")
    base = load_experiment("treadmill_guided", [f"duration_s={6 if form.quick else 20}"]).experiment
    changes = what_if(base)
    if form.quick:
        changes = {label: changes[label] for label in ("guided walk", "no regeneration")}
    experiments = [override_experiment(base, change) for change in changes.values()]
    results = run_episodes(lambda item: item, measured, experiments)
    walks = dict(zip(changes, results, strict=True))
    default = walks["guided walk"]
    goal = base.plant.battery.energy / 3600.0 / THESIS_HOURS
    save(draw(default, walks, goal), form.out / "battery_account.png", resolution=100)
    standby = default["account"]["computers, sensors, radio"] + default["account"]["inverters, constant"]
    rows = [
        {"term": name, "power [W]": f"{power:.1f}", "share": f"{power / default['battery_W']:.0%}"}
        for name, power in default["account"].items()
    ]
    assert all(walk["outcome"] == "walked" for walk in walks.values())
    changed = [
        {
            "change": label,
            "battery [W]": f"{walk['battery_W']:.1f}",
            "saved [W]": f"{default['battery_W'] - walk['battery_W']:.1f}".replace("-", "−"),
            "battery lasts [h]": f"{walk['hours']:.1f}",
            "hip / knee error [°]": f"{walk['hip_error_deg']:.1f} / {walk['knee_error_deg']:.1f}",
        }
        for label, walk in walks.items()
    ]
    print(*changed, sep="\n")
    form.write_results(
        {
            "rows": rows,
            "what_if": changed,
            "default": default,
            "best_hours": max(walk["hours"] for walk in walks.values()),
            "saved_W": {
                key: default["battery_W"] - walks[label]["battery_W"]
                for key, label in (("soft", SOFT), ("regeneration", "no regeneration"))
                if label in walks
            },
            "sum_W": sum(default["account"].values()),
            "goal_W": goal,
            "standby_W": standby,
            "walking_share_for_goal": (goal - standby) / (default["battery_W"] - standby),
        }
    )
