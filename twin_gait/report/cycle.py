"""Hip and knee over the gait cycle against the reference, or over time where there are no strides."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.phases import usual_phases
from twin_gait.measures.strides import PERCENT, normalise_strides, root_mean_square_error, stride_count
from twin_gait.palette import BLACK, ORANGE, REFERENCE_COLOUR
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
from twin_gait.report.reference import reference_cycle
from twin_gait.report.window import end_or_events, shown_strides
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

SHOWN_SECONDS = 30.0  # on a screen; a narrower picture shows less


def draw_cycle(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw the mean cycle of every joint with its range over strides.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure; None for a run in which a leg made no stride.
    """
    records = run.leg_records()
    if any(len(shown_strides(record)) == 0 for record in records):
        return None
    beginning = f"entry into {readable(run.table.phase_names[0])}"
    if records[0].contacts is not None:
        beginning = "heel strike"
    figure = new_figure(run, f"Gait cycle from {beginning}", height=7.5, width=width)
    joints = list(records[0].angles)
    panels = figure.subplots(len(joints), len(records), sharex=True, sharey="row", squeeze=False)
    lines: list[Artist] = []
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            lines += _draw_joint(panels[row, column], run, record, joint)
            if column == 0:
                panels[row, column].set_ylabel(f"{joint} flexion [°]")
    for axes in panels[-1]:
        axes.set_xlabel("share of the gait cycle [%]")
    names = run.table.phase_names
    put_legend(figure, lines, phase_handles(names, np.concatenate([item.phases for item in records])))
    return figure


def _draw_joint(axes: Axes, run: Run, record: LegRecord, joint: JointName) -> list[Artist]:
    bounds = shown_strides(record)
    cycles = normalise_strides(record.angles[joint], bounds)
    angles = np.degrees(cycles)
    names = run.table.phase_names
    shade_phases(axes, PERCENT, usual_phases(record.phases, bounds, len(names)), names)
    spread = axes.fill_between(
        PERCENT,
        angles.min(axis=0),
        angles.max(axis=0),
        color=BLACK,
        alpha=0.25,
        linewidth=0,
        label="range over strides",
    )
    (mean,) = axes.plot(PERCENT, angles.mean(axis=0), color=BLACK, linewidth=1.8, label="mean over strides")
    title = f"{record.side} {joint}, {stride_count(len(bounds), len(record.strides(skip=0)))}"
    reference = reference_cycle(run.experiment, joint)
    handles: list[Artist] = [mean, spread]
    if reference is not None:
        handles += axes.plot(
            PERCENT,
            np.degrees(reference),
            color=REFERENCE_COLOUR,
            linestyle=(0, (4, 2)),
            linewidth=1.6,
            label="reference, Koopman et al. (2014)",
        )
        title += f", RMSE {math.degrees(root_mean_square_error(cycles, reference)):.1f}°"
    style_panel(axes, title, "")
    return handles


def draw_angles(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the joint angles of the last seconds with the equilibrium of the virtual spring.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure.
    """
    records = run.leg_records()
    window = end_or_events(run, SHOWN_SECONDS * width / SCREEN_WIDTH)
    joints = list(records[0].angles)
    figure = new_figure(run, "Joint angles", height=7.5, width=width)
    panels = figure.subplots(len(joints), len(records), sharex=True, sharey="row", squeeze=False)
    lines: list[Artist] = []
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            axes, name = panels[row, column], f"{record.side}_{joint}"
            shade_phases(axes, window.time, shown_phases(run, record, window), run.table.phase_names)
            shown = [
                (record.angles[joint], BLACK, "-", "angle"),
                (run.log[f"{name}_equilibrium_rad"].to_numpy(), REFERENCE_COLOUR, ":", "equilibrium angle"),
            ]
            if run.experiment.interface is not None:
                shown.append((run.log[f"{name}_angle_rad"].to_numpy(), ORANGE, "--", "angle of the device"))
            for values, colour, style, label in shown:
                lines += axes.plot(
                    window.time, np.degrees(values[window.rows]), color=colour, linestyle=style, label=label
                )
            lines += mark_events(axes, run, window)
            style_panel(axes, f"{record.side} {joint}", f"{joint} flexion [°]" if column == 0 else "")
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    phases = np.concatenate([shown_phases(run, record, window) for record in records])
    put_legend(figure, lines, phase_handles(run.table.phase_names, phases))
    return figure
