"""Angle against velocity of every joint, coloured by phase."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.phases import phase_spells
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    colour_of,
    new_figure,
    phase_handles,
    put_legend,
    style_panel,
)
from twin_gait.report.marks import shown_phases
from twin_gait.report.window import Window, shown_strides
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

MOST_STRIDES = 10


def draw_portrait(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw the phase portrait of every joint, over the last settled strides or else over the whole run.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure.
    """
    records = run.leg_records()
    joints = list(records[0].angles)
    figure = new_figure(run, "Phase portraits; a dot marks each change of phase", height=8.5, width=width)
    panels = figure.subplots(len(joints), len(records), sharex="row", sharey="row", squeeze=False)
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            axes = panels[row, column]
            _draw_joint(axes, run, record, joint)
            style_panel(axes, f"{record.side} {joint}", f"{joint} velocity [°/s]" if column == 0 else "")
            axes.set_xlabel(f"{joint} flexion [°]")
    phases = np.concatenate([_shown_phases(run, record) for record in records])
    put_legend(figure, [], phase_handles(run.table.phase_names, phases))
    return figure


def _shown_rows(record: LegRecord) -> slice:
    bounds = shown_strides(record)[-MOST_STRIDES:]
    if len(bounds) == 0:
        return slice(0, len(record.phases))
    return slice(int(bounds[0, 0]), int(bounds[-1, 1]))


def _shown_phases(run: Run, record: LegRecord) -> np.ndarray:
    rows = _shown_rows(record)
    return shown_phases(run, record, Window(rows, run.log["time_s"].to_numpy()[rows]))


def _draw_joint(axes: Axes, run: Run, record: LegRecord, joint: JointName) -> None:
    rows = _shown_rows(record)
    angle = np.degrees(record.angles[joint][rows])
    velocity = np.degrees(
        run.log[wearer_column(run.log, record.side, joint, "velocity_rad_per_s")].to_numpy()[rows]
    )
    names = run.table.phase_names
    for spell in phase_spells(_shown_phases(run, record)):
        colour = colour_of(spell.phase, names)
        span = slice(spell.start, spell.end + 1)
        axes.plot(angle[span], velocity[span], color=colour, linewidth=1.3)
        if spell.start > 0:
            axes.plot(angle[spell.start], velocity[spell.start], "o", color=colour, markersize=4)
    axes.axhline(0.0, color="0.6", linewidth=0.8)
