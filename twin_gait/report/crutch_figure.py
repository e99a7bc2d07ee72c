"""The picture of a walk on crutches: how the trunk leans, what the crutches carry, what the arms do."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from twin_gait.gait.table import TICK
from twin_gait.measures.crutches import TRUNK_PITCH
from twin_gait.palette import BLACK, SIDE_COLOURS
from twin_gait.report.canvas import SCREEN_WIDTH, new_figure, put_legend, style_panel
from twin_gait.report.panels import mark_events, whole_run
from twin_gait.simulation.run import Run


def draw_crutches(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw lean of the trunk, forces on the crutches and work of the arms; None without crutches."""
    if any(f"{side}_arm_power_W" not in run.log for side in run.sides):
        return None
    window = whole_run(run)
    figure = new_figure(run, "Trunk, crutches and arms", height=8.0, width=width)
    lean, force, work = figure.subplots(3, 1, sharex=True)
    degrees = np.degrees(run.log[TRUNK_PITCH].to_numpy()[window.rows])
    lines: list[Artist] = [*lean.plot(window.time, degrees, color=BLACK, linewidth=1.5, label="trunk")]
    for side in run.sides:
        load = run.log[f"{side}_crutch_normal_force_N"].to_numpy()
        done = TICK * np.cumsum(run.log[f"{side}_arm_power_W"].to_numpy())
        for axes, values in ((force, load), (work, done)):
            label = f"{side} arm and crutch"
            lines += axes.plot(
                window.time, values[window.rows], color=SIDE_COLOURS[side], linewidth=1.5, label=label
            )
    style_panel(lean, "lean of the trunk, forwards positive", "angle [°]")
    style_panel(force, "force of the ground on the crutch, upwards", "force [N]")
    style_panel(work, "work of the arm since the start", "work [J]")
    for axes in (lean, force, work):
        lines += mark_events(axes, run, window)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
    work.set_xlim(window.time[0], window.time[-1])
    work.set_xlabel("time [s]")
    put_legend(figure, lines)
    return figure
