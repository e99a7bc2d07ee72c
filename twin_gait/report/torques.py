"""Torques of the motors with their parts."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.measures.leg_record import LegRecord
from twin_gait.palette import BLACK, LIMIT_COLOUR, TORQUE_COLOURS
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    new_figure,
    phase_handles,
    put_legend,
    readable,
    shade_phases,
    style_panel,
)
from twin_gait.report.marks import mark_events, shown_phases
from twin_gait.report.window import Window, last_strides
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName


def draw_torques(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw what the controller asks for, part by part, and what the motor gives.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure.
    """
    records = run.leg_records()
    window = last_strides(run, records)
    joints = list(records[0].angles)
    figure = new_figure(run, "Motor torques and their parts", height=8.0, width=width)
    panels = figure.subplots(len(joints), len(records), sharex=True, sharey="row", squeeze=False)
    lines: list[Artist] = []
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            axes = panels[row, column]
            shade_phases(axes, window.time, shown_phases(run, record, window), run.table.phase_names)
            lines += _draw_parts(axes, run, record, joint, window)
            lines += mark_events(axes, run, window)
            style_panel(axes, f"{record.side} {joint}", "torque [N m]" if column == 0 else "")
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    shown = np.concatenate([shown_phases(run, record, window) for record in records])
    put_legend(figure, lines, phase_handles(run.table.phase_names, shown))
    return figure


def _draw_parts(axes: Axes, run: Run, record: LegRecord, joint: JointName, window: Window) -> list[Artist]:
    lines: list[Artist] = []
    for part, colour in TORQUE_COLOURS.items():
        values = run.log[f"{record.side}_{joint}_{part}_torque_Nm"].to_numpy()[window.rows]
        if np.any(values != 0.0):
            lines += axes.plot(window.time, values, color=colour, linewidth=1.3, label=readable(part))
    motor = run.log[f"{record.side}_{joint}_motor_torque_Nm"].to_numpy()[window.rows]
    lines += axes.plot(window.time, motor, color=BLACK, linewidth=2.0, label="motor torque")
    limit = run.experiment.control.limits.torque
    for value in (limit, -limit):
        lines.append(
            axes.axhline(
                value, color=LIMIT_COLOUR, linestyle="--", linewidth=1.0, zorder=1, label="torque limit"
            )
        )
    return lines
