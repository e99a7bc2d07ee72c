"""Forces under the feet, their clearance, and the phases of both legs on one time axis."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.phases import phase_spells
from twin_gait.palette import LIMIT_COLOUR, SIDE_COLOURS
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    colour_of,
    new_figure,
    phase_handles,
    put_legend,
    style_panel,
)
from twin_gait.report.marks import mark_events, shown_phases
from twin_gait.report.window import Window, last_strides
from twin_gait.simulation.run import Run

BAR = 0.7  # height of a phase bar, in rows


def draw_feet(run: Run, *, width: float = SCREEN_WIDTH) -> Figure | None:
    """Draw foot forces and clearances with the phases under them.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure; None without ground.
    """
    records = run.leg_records()
    if any(record.contacts is None for record in records):
        return None
    window = last_strides(run, records)
    figure = new_figure(run, "Feet on the ground", height=8.5, width=width)
    force, clearance, phases = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1))
    lines = [*_draw_forces(force, run, records, window), *_draw_clearances(clearance, records, window)]
    lines += [line for axes in (force, clearance) for line in mark_events(axes, run, window)]
    _draw_phase_bars(phases, run, records, window)
    phases.set_xlabel("time [s]")
    phases.set_xlim(window.time[0], window.time[-1])
    shown = np.concatenate([shown_phases(run, record, window) for record in records])
    put_legend(figure, lines, phase_handles(run.table.phase_names, shown))
    return figure


def _draw_forces(axes: Axes, run: Run, records: list[LegRecord], window: Window) -> list[Artist]:
    lines: list[Artist] = []
    for record in records:
        assert record.normal_force is not None and record.contacts is not None  # checked by the caller
        colour = SIDE_COLOURS[record.side]
        lines += axes.plot(
            window.time,
            record.normal_force[window.rows],
            color=colour,
            linewidth=1.5,
            label=f"{record.side} foot",
        )
        strikes = record.contacts.heel_strikes
        strikes = strikes[(strikes >= window.rows.start) & (strikes < window.rows.stop)]
        lines += axes.plot(
            strikes * record.tick,
            np.full(len(strikes), CONTACT_FORCE),
            "^",
            color=colour,
            markersize=8,
            label=f"{record.side} heel strike",
        )
    lines.append(
        axes.axhline(
            run.body_weight,
            color=LIMIT_COLOUR,
            linestyle="--",
            linewidth=1.0,
            label="weight of wearer and device",
        )
    )
    axes.set_ylim(bottom=0.0)
    style_panel(axes, "normal force", "force [N]")
    return lines


def _draw_clearances(axes: Axes, records: list[LegRecord], window: Window) -> list[Artist]:
    lines: list[Artist] = []
    for record in records:
        assert record.clearance is not None  # checked by the caller
        lines += axes.plot(
            window.time,
            1e3 * record.clearance[window.rows],
            color=SIDE_COLOURS[record.side],
            linewidth=1.5,
            label=f"{record.side} foot",
        )
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    style_panel(
        axes, "clearance of the lowest point of the sole, negative while it is pressed in", "height [mm]"
    )
    return lines


def _draw_phase_bars(axes: Axes, run: Run, records: list[LegRecord], window: Window) -> None:
    names = run.table.phase_names
    for row, record in enumerate(records):
        for spell in phase_spells(shown_phases(run, record, window)):
            start, end = window.time[[spell.start, min(spell.end, len(window.time) - 1)]]
            colour = colour_of(spell.phase, names)
            axes.barh(-row, end - start, left=start, height=BAR, color=colour, alpha=0.9)
    style_panel(axes, "phase", "")
    axes.set_yticks([-row for row in range(len(records))], [str(record.side) for record in records])
    axes.grid(visible=False, axis="y")
