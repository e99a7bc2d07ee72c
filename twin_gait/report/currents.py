"""Currents of the motors and power of the battery."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.core.actuator import torque_to_current
from twin_gait.palette import BLACK, LIMIT_COLOUR, ORANGE, VERMILLION
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    new_figure,
    phase_handles,
    put_legend,
    shade_phases,
    style_panel,
)
from twin_gait.report.marks import mark_events, shown_phases
from twin_gait.report.window import Window, last_strides
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side


def draw_currents(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw target and measured current of every motor, and the battery's power under them.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure.
    """
    records = run.leg_records()
    window = last_strides(run, records)
    joints = list(records[0].angles)
    figure = new_figure(run, "Motor currents and battery power", height=9.0, width=width)
    rows = len(joints) + 1
    grid = figure.add_gridspec(rows, len(records))
    lines: list[Artist] = []
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            axes = figure.add_subplot(grid[row, column])
            shade_phases(axes, window.time, shown_phases(run, record, window), run.table.phase_names)
            lines += _draw_motor(axes, run, record.side, joint, window)
            lines += mark_events(axes, run, window)
            style_panel(axes, f"{record.side} {joint}", "current [A]" if column == 0 else "")
    lines += _draw_battery(figure.add_subplot(grid[rows - 1, :]), run, window)
    shown = np.concatenate([shown_phases(run, record, window) for record in records])
    put_legend(figure, lines, phase_handles(run.table.phase_names, shown))
    return figure


def _draw_motor(axes: Axes, run: Run, side: Side, joint: JointName, window: Window) -> list[Artist]:
    name = f"{side}_{joint}"
    target = run.log[f"{name}_target_current_A"].to_numpy()[window.rows]
    measured = run.log[f"{name}_measured_current_A"].to_numpy()[window.rows]
    lines: list[Artist] = [
        *axes.plot(window.time, target, color=ORANGE, linewidth=2.4, label="target current"),
        *axes.plot(window.time, measured, color=BLACK, linewidth=1.2, label="measured current"),
    ]
    actuator, limits = run.experiment.plant.actuators[joint], run.experiment.control.limits
    at_torque_limit = torque_to_current(
        limits.torque, actuator.torque_constant, actuator.gear_ratio, actuator.gear_efficiency
    )
    for value, style, label in (
        (limits.current, "--", "current limit"),
        (at_torque_limit, ":", "current at the torque limit"),
    ):
        for sign in (1.0, -1.0):
            lines.append(
                axes.axhline(
                    sign * value, color=LIMIT_COLOUR, linestyle=style, linewidth=1.2, zorder=1, label=label
                )
            )
    return lines


def _draw_battery(axes: Axes, run: Run, window: Window) -> list[Artist]:
    power = run.log["battery_power_W"].to_numpy()[window.rows]
    continuous = run.experiment.plant.battery.continuous_power
    lines: list[Artist] = [
        *axes.plot(window.time, power, color=VERMILLION, linewidth=1.4, label="battery power"),
        axes.axhline(
            continuous, color=LIMIT_COLOUR, linestyle="-.", linewidth=1.2, label="continuous battery power"
        ),
    ]
    lines += mark_events(axes, run, window)
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.set_xlim(window.time[0], window.time[-1])
    axes.set_xlabel("time [s]")
    style_panel(axes, "battery, below 0 while the motors feed it", "power [W]")
    return lines
