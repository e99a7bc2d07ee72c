"""Outcomes and detection times of a fault campaign, one trip, and descents after a loss of the supply."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait import Run
from twin_gait.palette import BLACK, BLUE, GREY, ORANGE, SIDE_COLOURS, SKY_BLUE, VERMILLION, YELLOW

TICK = 1e-3  # [s]
SHOWN = (3.4, 6.4)  # [s]
COLOURS = {
    "walked": GREY,
    "held": BLUE,
    "stalled": SKY_BLUE,
    "hung": BLACK,
    "fell": ORANGE,
    "diverged": VERMILLION,
    "too short to judge": YELLOW,
}


def draw_campaign(table: pd.DataFrame, example: Run) -> Figure:
    """Draw outcomes and detection times by kind, and the knees of a run that trips."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=[2.2, 1.0, 1.0])
    kinds = list(table["kind"].unique())
    outcomes, detection = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _draw_outcomes(outcomes, table, kinds)
    _draw_detection(detection, table, kinds)
    knee = figure.add_subplot(grid[1, :])
    _draw_trip(knee, example, "angle_rad", float(np.degrees(1.0)), "knee [°]")
    torque = figure.add_subplot(grid[2, :], sharex=knee)
    _draw_trip(torque, example, "motor_torque_Nm", 1.0, "motor torque [N·m]")
    torque.set_xlabel("time [s]")
    knee.tick_params(labelbottom=False)
    knee.legend(loc="upper right", ncols=3, frameon=False)
    (fault,) = example.experiment.faults
    cause, late = example.trip.cause.replace("_", " "), 1e3 * (example.trip.time - fault.time)
    knee.set_title(f"{fault}: {cause} trips after {late:.0f} ms", loc="left")
    return figure


def draw_descents(descents: Mapping[tuple[str, str], tuple[float, pd.DataFrame]]) -> Figure:
    """Draw height and downward speed of the pelvis after a loss of the supply.

    ``descents``: time of the loss in [s] and log, by case and windings.
    """
    cases = list(dict.fromkeys(case for case, _ in descents))
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    grid = figure.subplots(2, len(cases), sharex="col", sharey="row", squeeze=False)
    styles = {"shorted": (BLUE, "-"), "shorted, with inductance": (SKY_BLUE, "--"), "open": (VERMILLION, "-")}
    for (case, windings), (start, log) in descents.items():
        after = log[log["time_s"] >= start]
        colour, line = styles[windings]
        heights, speeds = grid[:, cases.index(case)]
        times = after["time_s"] - start
        heights.plot(times, after["pelvis_height_m"], color=colour, linestyle=line, label=windings)
        speeds.plot(times, -after["pelvis_velocity_m_per_s"], color=colour, linestyle=line)
        heights.set_title(case, loc="left")
        speeds.set_xlabel("time after the loss [s]")
    grid[0, 0].set_ylabel("pelvis height [m]")
    grid[1, 0].set_ylabel("downward speed [m/s]")
    grid[0, 0].legend(frameon=False)
    return figure


def _draw_outcomes(axes: Axes, table: pd.DataFrame, kinds: Sequence[str]) -> None:
    shares = pd.crosstab(table["kind"], table["outcome"], normalize="index").loc[kinds]
    left = np.zeros(len(kinds))
    for outcome in [name for name in COLOURS if name in shares]:
        share = shares[outcome].to_numpy()
        axes.barh(range(len(kinds)), share, left=left, color=COLOURS[outcome], label=outcome, height=0.75)
        left += share
    _name_kinds(axes, kinds)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the runs")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)


def _draw_detection(axes: Axes, table: pd.DataFrame, kinds: Sequence[str]) -> None:
    generator = np.random.default_rng(0)
    for position, kind in enumerate(kinds):
        found = table.loc[(table["kind"] == kind) & (table["cause"] != ""), "detection_s"].to_numpy()
        spread = position + generator.uniform(-0.28, 0.28, len(found))
        # What is noticed in the very tick stands at one tick: the axis is logarithmic.
        axes.plot(np.maximum(found, TICK), spread, ".", color=BLUE, markersize=4, alpha=0.6)
    axes.set_xscale("log")
    _name_kinds(axes, kinds)
    axes.set_yticklabels([])
    axes.set_xlabel("time from fault to trip [s]")
    axes.grid(axis="x", color=GREY, alpha=0.3)


def _name_kinds(axes: Axes, kinds: Sequence[str]) -> None:
    axes.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axes.set_ylim(len(kinds) - 0.4, -0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_trip(axes: Axes, run: Run, column: str, factor: float, label: str) -> None:
    shown = run.log[(run.log["time_s"] >= SHOWN[0]) & (run.log["time_s"] <= SHOWN[1])]
    time = shown["time_s"].to_numpy()
    for side in run.sides:
        axes.plot(
            time, factor * shown[f"{side}_knee_{column}"], color=SIDE_COLOURS[side], label=f"{side} knee"
        )
    if column == "angle_rad":
        reading = factor * shown["left_knee_measured_angle_rad"]
        axes.plot(time, reading, color=BLACK, linestyle=":", label="left encoder")
    axes.axvspan(run.trip.time, SHOWN[1], color=GREY, alpha=0.15, linewidth=0)
    if column == "angle_rad":
        axes.text(run.trip.time, 0.85, " hold", transform=axes.get_xaxis_transform(), color=BLACK)
    axes.set_xlim(*SHOWN)
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)
