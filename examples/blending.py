"""Blending: how smoothly do stiffness, damping and equilibrium change from phase to phase?

The guided walk with parameters that change in a step, linearly, or along the minimum-jerk polynomial, for
several durations: jumps of the command torque, jerk, energy added to the virtual springs, tracking error, and
the number of 16 wearers, speeds and supports that walk with each law. The walks take ten seconds, the
robustness a minute on one core; page: docs/background/blending.md.
"""

# %% [markdown]
# ## Ways to blend
# A blend of zero duration is a step for every law, so that one case represents all of them.

# %%
from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait import JointName, Run, load_experiment, simulate, simulate_batch, summarise_run
from twin_gait.gait.table import TICK, BlendingLaw
from twin_gait.palette import BLACK, BLUISH_GREEN, JOINT_COLOURS, ORANGE, REDDISH_PURPLE
from twin_gait.report.canvas import put_legend, save, style_panel
from twin_gait.report.state_diagram import name_to_words

Blend = tuple[str, int]  # law and duration in [ms], equal to ticks
NONE, LINEAR, MINIMUM_JERK = (
    str(law) for law in (BlendingLaw.NONE, BlendingLaw.LINEAR, BlendingLaw.MINIMUM_JERK)
)
BLENDS: tuple[Blend, ...] = ((NONE, 0), *itertools.product((LINEAR, MINIMUM_JERK), (25, 60, 140)))
JOINTS = (JointName.HIP, JointName.KNEE)
# Variations of the guided walk: the grid of the robustness map, of which every twentieth point is used.
VARIED = {
    "patient.mass_kg": (55.0, 65.0, 75.0, 85.0, 95.0),
    "patient.height_m": (1.60, 1.70, 1.80, 1.90),
    "scenario.belt_speed_m_per_s": (0.30, 0.34, 0.38, 0.42),
    "scenario.support.share": (0.40, 0.50, 0.60, 0.70),
}


def settings_of(blend: Blend) -> dict[str, Any]:
    law, duration = blend
    return {"table.blending.law": law, "table.blending.duration_ms": duration}


def walk(blend: Blend, duration: float, preset: str = "treadmill_guided") -> Run:
    """Simulate a preset with one blending, and all other settings equal."""
    settings = {"duration_s": duration, **settings_of(blend)}
    return simulate(load_experiment(preset, [f"{key}={value}" for key, value in settings.items()]).experiment)


# %% [markdown]
# ## Cost of a walk
# Torques are those of the leg with the larger value, all other measures are means of both legs. The keys are
# those of `summary.json`.

# %%
LARGEST = {"torque_jump_Nm": "switch_torque_jump_Nm", "torque_change_Nm": "switch_torque_change_Nm"}
AVERAGED = ("jerk_rms_rad_per_s3", "jerk_dimensionless", "switch_energy_J", "saturated_share")


def measures(run: Run) -> dict[str, Any]:
    """Return outcome, stride time and the measures of each joint as ``hip_…`` and ``knee_…``."""
    summary = summarise_run(run)
    sides = list(summary["sides"].values())
    found: dict[str, Any] = {
        "outcome": summary["outcome"],
        "stride_time_s": over([side.get("stride_time_mean_s") for side in sides], np.mean),
    }
    for joint in JOINTS:
        legs = [side["joints"][joint] for side in sides]
        found |= {
            f"{joint}_{name}": over([leg[key] for leg in legs], np.max) for name, key in LARGEST.items()
        }
        found |= {f"{joint}_{name}": over([leg[name] for leg in legs], np.mean) for name in AVERAGED}
        errors = [side.get(f"rmse_{joint}_by_contact_deg") for side in sides]
        found[f"{joint}_rmse_deg"] = over(errors, np.mean)
    return found


def over(values: Sequence[float | None], reduce: Any) -> float:
    """Reduce the defined values to mean or maximum; NaN without any."""
    defined = [value for value in values if value is not None]
    return float(reduce(defined)) if defined else float("nan")


# %% [markdown]
# ## Effect of a switch
# A switch changes the command torque and the energy ½ k (θ − θ0)² of the virtual spring: the firmware changes
# k and θ0 at the start of a tick, with the joint at the measured angle, so that the added energy is a sum of
# differences.


# %%
SIGNALS = ("motor_command_torque_Nm", "measured_angle_rad", "stiffness_Nm_per_rad", "equilibrium_rad")


def switch_effects(run: Run) -> pd.DataFrame:
    """Compute the effects of every switch on every joint of its leg.

    Returns:
        Rows with ``tick``, ``side``, ``from``, ``to``, ``joint``, ``kind`` (the last four in words),
        ``torque_jump_Nm`` (largest change of the command torque in one tick until the end of the blend),
        ``torque_change_Nm`` (largest change from before the switch) and ``energy_J`` (added to the spring).
    """
    blending, log, rows = run.experiment.table.blending, run.log, []
    length = blending.duration_ticks if blending.law is not BlendingLaw.NONE else 0
    for side in run.sides:
        switches = [item for item in run.switches if item.side is side and 0 < item.tick < len(log)]
        ends = [item.tick for item in switches[1:]] + [len(log)]  # the next switch ends a blend
        for switch, joint in itertools.product(range(len(switches)), JOINTS):
            tick, source, target = switches[switch].tick, switches[switch].source, switches[switch].target
            span = slice(tick - 1, min(tick + length + 1, ends[switch]))
            names = (
                "motor_command_torque_Nm",
                "measured_angle_rad",
                "stiffness_Nm_per_rad",
                "equilibrium_rad",
            )
            torque, angle, k, rest = (log[f"{side}_{joint}_{name}"].to_numpy() for name in names)
            before, after = (
                0.5 * k[span][part] * (angle[span][1:] - rest[span][part]) ** 2
                for part in (slice(None, -1), slice(1, None))
            )
            kind = f"{side} {joint}, {name_to_words(source)} to {name_to_words(target)}"
            jump = np.abs(np.diff(torque[span])).max()
            change = np.abs(torque[tick : tick + length + 1] - torque[tick - 1]).max()
            energy = float((after - before).sum())
            rows.append((tick, str(side), source, target, str(joint), kind, jump, change, energy))
    columns = "tick side from to joint kind torque_jump_Nm torque_change_Nm energy_J".split()
    return pd.DataFrame(rows, columns=columns)


def select_switches(effects: dict[Blend, pd.DataFrame]) -> list[str]:
    """Return the switch of largest torque change without a blend, and that which blends worsen most."""
    means = {blend: table.groupby("kind")["torque_change_Nm"].mean() for blend, table in effects.items()}
    first = means[BLENDS[0]]
    if first.empty:
        return []
    gains = pd.concat(list(means.values()), axis=1).max(axis=1) - first
    return list(dict.fromkeys([str(first.idxmax()), str(gains.idxmax())]))


# %% [markdown]
# ## Pictures and tables

# %%
BEFORE, AFTER = 30, 170  # [ticks] around a switch
PANELS = (
    ("torque_jump_Nm", "torque jump within a tick", "N·m"),
    ("jerk_rms_rad_per_s3", "RMS jerk", "rad/s³"),
    ("switch_energy_J", "energy by switching, per stride", "J"),
    ("rmse_deg", "RMSE to the reference", "°"),
)
STYLES = {LINEAR: ("--", "o"), MINIMUM_JERK: ("-", "s")}
COLOURS = {0: BLACK, 25: ORANGE, 60: BLUISH_GREEN, 140: REDDISH_PURPLE}


def draw(table: pd.DataFrame, runs: dict[Blend, Run], effects: dict[Blend, pd.DataFrame]) -> Figure:
    """Draw the torque around two switches above, and the cost of each blending below."""
    figure = Figure(figsize=(11.0, 7.8), layout="constrained")
    figure.suptitle("Ways to blend, on the same walk", fontsize="large")
    shown = select_switches(effects)
    above, below = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
    for axes, kind in zip(above.subplots(1, max(1, len(shown)), squeeze=False)[0], shown, strict=False):
        for blend, run in runs.items():
            draw_trace(axes, run, effects[blend][effects[blend]["kind"] == kind], blend)
        style_panel(axes, f"commanded torque: {kind}", "N·m")
        axes.set(xlabel="time since the switch [ms]", xlim=(-BEFORE, AFTER))
    for axes, (column, title, unit) in zip(below.subplots(1, len(PANELS)), PANELS, strict=True):
        for joint, (law, (line, marker)) in itertools.product(JOINTS, STYLES.items()):
            rows = table[table["law"].isin([law, NONE])].sort_values("duration_ms")
            look = {"color": JOINT_COLOURS[joint], "linestyle": line, "marker": marker, "markersize": 4.5}
            axes.plot(rows["duration_ms"], rows[f"{joint}_{column}"], linewidth=1.4, **look)
        style_panel(axes, title, unit)
        axes.set(xlabel="duration of the blend [ms]", xticks=sorted(table["duration_ms"].unique()))
        if column == "torque_jump_Nm":
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)
    put_legend(figure, measure_handles(), [Line2D([], [], **style(blend)) for blend in runs])
    return figure


def draw_trace(axes: Axes, run: Run, rows: pd.DataFrame, blend: Blend) -> None:
    """Draw the torque around the last switch that has enough log before and after it."""
    rows = rows[rows["tick"].between(BEFORE, len(run.log) - AFTER - 1)]
    if rows.empty:
        return
    last, span = rows.iloc[-1], np.arange(-BEFORE, AFTER + 1)
    torque = run.log[f"{last['side']}_{last['joint']}_motor_command_torque_Nm"].to_numpy()
    axes.plot(span * TICK * 1e3, torque[last["tick"] + span], **style(blend))


def style(blend: Blend) -> dict[str, Any]:
    law, duration = blend
    label = "no blending" if law == NONE else f"{name_to_words(law)}, {duration} ms"
    dashes = STYLES[law][0] if law in STYLES else "-"
    return {"color": COLOURS[duration], "linestyle": dashes, "linewidth": 1.4, "label": label}


def measure_handles() -> list[Line2D]:
    joints = [Line2D([], [], color=JOINT_COLOURS[joint], linewidth=3, label=str(joint)) for joint in JOINTS]
    laws = [
        Line2D([], [], color="0.4", linestyle=line, marker=marker, label=name_to_words(law))
        for law, (line, marker) in STYLES.items()
    ]
    return [*joints, *laws]


CELLS = {
    "torque jump in a tick [N·m]": ("torque_jump_Nm", 1.0, ".1f"),
    "torque change over the blend [N·m]": ("torque_change_Nm", 1.0, ".0f"),
    "RMS jerk [rad/s³]": ("jerk_rms_rad_per_s3", 1.0, ".0f"),
    "dimensionless jerk [10³]": ("jerk_dimensionless", 1e-3, ".0f"),
    "switching energy per stride [J]": ("switch_energy_J", 1.0, ".1f"),
    "RMSE [°]": ("rmse_deg", 1.0, ".2f"),
    "saturated [%]": ("saturated_share", 1e2, ".1f"),
}


def cells(row: dict[Any, Any]) -> dict[str, str]:
    """Format a row for the page; two numbers in a cell are hip and knee."""
    shown = {
        "law": name_to_words(row["law"]),
        "ms": f"{row['duration_ms']}",
        "outcome": row["outcome"],
        "stride [s]": f"{row['stride_time_s']:.2f}",
    }
    for head, (column, scale, form) in CELLS.items():
        shown[head] = " / ".join(format(scale * row[f"{joint}_{column}"], form) for joint in JOINTS)
    return shown


def switch_rows(effects: pd.DataFrame) -> list[dict[str, str]]:
    """Return the mean effects of each kind of switch after 5 s, for both sides together."""
    settled = effects[effects["tick"] > 5000].groupby(["joint", "from", "to"], sort=False)
    means = settled[["torque_jump_Nm", "torque_change_Nm", "energy_J"]].mean().reset_index()
    return [
        {
            "switch": f"{name_to_words(row['from'])} to {name_to_words(row['to'])}",
            "joint": row["joint"],
            "torque jump in a tick [N·m]": f"{row['torque_jump_Nm']:.1f}",
            "torque change [N·m]": f"{row['torque_change_Nm']:.0f}",
            "energy [J]": f"{row['energy_J']:+.1f}",
        }
        for row in means.sort_values("joint", kind="stable").to_dict("records")
    ]


def comparisons(table: pd.DataFrame) -> dict[str, float]:
    """Return least and largest differences of laws and durations over joints (and durations)."""
    rows = table.set_index(["law", "duration_ms"])
    lines, curves = rows.loc[LINEAR], rows.loc[MINIMUM_JERK]
    jerk = [1.0 - lines[name] / curves[name] for name in (f"{joint}_jerk_rms_rad_per_s3" for joint in JOINTS)]
    energy = {joint: table[f"{joint}_switch_energy_J"] for joint in JOINTS}
    energies = [lines[item.name] / curves[item.name] - 1.0 for item in energy.values()]
    return {
        "jerk_saved_least": float(np.min(jerk)),
        "jerk_saved_most": float(np.max(jerk)),
        **{f"{joint}_energy_least_J": float(energy[joint].min()) for joint in JOINTS},
        **{f"{joint}_energy_most_J": float(energy[joint].max()) for joint in JOINTS},
        "energy_difference_of_laws": float(np.abs(energies).max()),
    }


def overshoot() -> dict[str, float]:
    """Compute the largest deviation of a linear blend of the knee torque from the line between its ends.

    It is −Δk Δθ0 / 4 in the middle of the blend from middle to late stance, at any angle, because the torque
    is a product of k and θ0.
    """
    phases = load_experiment("treadmill_guided").experiment.table.phases
    old, new = (phases[name].joints[JointName.KNEE] for name in ("middle_stance", "late_stance"))
    change = (new.stiffness - old.stiffness) * (new.equilibrium_angle - old.equilibrium_angle)
    return {
        "stiffness_before_Nm_per_deg": float(np.radians(old.stiffness)),
        "stiffness_after_Nm_per_deg": float(np.radians(new.stiffness)),
        "equilibrium_before_deg": float(np.degrees(old.equilibrium_angle)),
        "equilibrium_after_deg": float(np.degrees(new.equilibrium_angle)),
        "torque_Nm": -0.25 * change,
    }


# %% [markdown]
# ## Robustness
# The same walk for 16 wearers, belt speeds and supports, once for each blending.


# %%
def robustness(blends: Sequence[Blend], points: Sequence[dict[str, float]], workers: int) -> pd.DataFrame:
    """Count the outcomes over the points of a grid, with one row per blending."""
    base = load_experiment("treadmill_guided").experiment
    overrides = [{**settings_of(blend), **point} for blend in blends for point in points]
    outcomes = simulate_batch(base, overrides, workers=workers)["outcome"].to_numpy()
    counted = [Counter(part) for part in np.split(outcomes, len(blends))]
    occurring = [outcome for outcome, _ in sum(counted, Counter()).most_common()]
    return pd.DataFrame(
        [
            {"law": name_to_words(law), "ms": duration, **{outcome: count[outcome] for outcome in occurring}}
            for (law, duration), count in zip(blends, counted, strict=True)
        ]
    )


# %%
if __name__ == "__main__":
    form = read_options("blending")
    blends = BLENDS[::3] if form.quick else BLENDS
    runs = {blend: walk(blend, 8.0 if form.quick else 20.0) for blend in blends}
    effects = {blend: switch_effects(run) for blend, run in runs.items()}
    names = [{"law": law, "duration_ms": duration} for law, duration in blends]
    table = pd.DataFrame([{**name, **measures(run)} for name, run in zip(names, runs.values(), strict=True)])
    save(draw(table, runs, effects), form.out / "blending.png", resolution=80)
    table.to_csv(form.out / "blending.csv", index=False)

    points = [dict(zip(VARIED, values, strict=True)) for values in itertools.product(*VARIED.values())]
    points = points[:: 160 if form.quick else 20]
    mapped = robustness(blends, points, form.workers)
    shipped = load_experiment("treadmill_guided").experiment.table.blending
    mine = (str(shipped.law), shipped.duration_ticks)
    form.write_results(
        {
            "cases": [cells(row) for row in table.to_dict("records")],
            "measures": {f"{row['law']}_{row['duration_ms']}": row for row in table.to_dict("records")},
            "comparisons": comparisons(table),
            "overshoot": overshoot(),
            "switches": switch_rows(effects[mine]) if mine in effects else [],
            "robustness": mapped.to_dict("records"),
            "walked": {f"{law}_{ms}": int(mapped["walked"][i]) for i, (law, ms) in enumerate(blends)},
            "points": len(points),
        }
    )
    print(pd.DataFrame([cells(row) for row in table.to_dict("records")]).to_string(index=False))
    print(mapped.to_string(index=False))

# %% [markdown]
# Homework: the law with the least jerk here is not the one called "minimum jerk". Why?
