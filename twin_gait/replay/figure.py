"""Angles of a replayed walk over the phases that a table gives it, with the cause of every switch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from twin_gait.palette import BLACK, JOINT_COLOURS
from twin_gait.replay.machine import Replay
from twin_gait.report.canvas import (
    draw_phase_bars,
    flexion,
    phase_handles,
    put_legend,
    readable,
    shade_phases,
    style_panel,
)
from twin_gait.vocabulary import JointName, Side

SHOWN_TICKS = 6000
WIDTH, JOINT_HEIGHT, BAND_HEIGHT = 12.0, 1.9, 0.33  # [inches]
LETTER, LABEL_MARGIN = 4.2, 14.0  # [points] that a letter of a cause and its line take above the first panel
CLOSE = 0.012  # switches nearer than this share of the width share one place for their labels


def joints_of(result: Replay) -> list[str]:
    """Joints of the table that were recorded."""
    legs = result.recording.angles.values()
    return [joint for joint in result.table.joints if all(joint in angles for angles in legs)]


def replay_figure(result: Replay) -> Figure:
    """Draw the last seconds of a replay, one column of panels for each leg."""
    recording, joints = result.recording, joints_of(result)
    time = recording.time[-SHOWN_TICKS:]
    names = list(result.table.phase_names)
    names += sorted({str(name) for phases in recording.phases.values() for name in phases} - set(names))
    strips = {side: _strips(result, side, names) for side in recording.sides}
    heights = [JOINT_HEIGHT] * len(joints) + [BAND_HEIGHT * max(map(len, strips.values())) + 0.25]
    figure = Figure(figsize=(WIDTH, sum(heights) + 2.1), layout="constrained")
    figure.suptitle(
        f"{Path(recording.source).name} through the gait table {result.table.name}", fontsize="large"
    )
    panels = figure.subplots(
        len(heights), len(strips), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    longest = max((len(item.cause) for item in result.switches), default=0)
    first = recording.n_ticks - len(time)
    lines: list[Artist] = []
    for column, side in enumerate(recording.sides):
        mine = [item for item in result.switches if item.side is side and item.tick >= first]
        switches = [(float(time[item.tick - first]), item.cause) for item in mine]
        for axes, joint in zip(panels[:-1, column], joints, strict=True):
            shade_phases(axes, time, strips[side][0][1], names)
            for instant, _ in switches:
                axes.axvline(instant, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)))
            angle = np.degrees(recording.angles[side][joint][first:])
            colour = JOINT_COLOURS[JointName(joint)] if joint in set(JointName) else BLACK
            lines += axes.plot(time, angle, color=colour, label=f"{joint} angle")
            style_panel(axes, "", flexion(joint) if column == 0 else "")
        _draw_strips(panels[-1, column], time, strips[side], names)
        _label_causes(panels[0, column], switches, float(time[-1] - time[0]))
        panels[0, column].set_title(f"{side} leg", pad=LABEL_MARGIN + LETTER * longest)
        panels[-1, column].set_xlabel("time [s]")
    occurring = np.concatenate([phases for rows in strips.values() for _, phases in rows])
    put_legend(figure, lines, phase_handles(names, occurring))
    return figure


def _strips(result: Replay, side: Side, names: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Indices of the replayed and, if there are some, the recorded phases."""
    strips = [("replayed", result.phases[side][-SHOWN_TICKS:])]
    if side in result.recording.phases:
        recorded = result.recording.phases[side].tolist()[-SHOWN_TICKS:]
        strips.append(("recorded", np.array([names.index(name) for name in recorded])))
    return strips


def _draw_strips(
    axes: Axes, time: np.ndarray, strips: Sequence[tuple[str, np.ndarray]], names: Sequence[str]
) -> None:
    draw_phase_bars(axes, time, strips, names, height=0.8, linewidth=0)
    axes.set_ylim(0.5 - len(strips), 0.5)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _label_causes(axes: Axes, switches: Sequence[tuple[float, str]], span: float) -> None:
    """Write the causes upright above the first panel; close ones are pushed apart."""
    transform = blended_transform_factory(axes.transData, axes.transAxes)
    last = -np.inf
    for instant, cause in switches:
        last = max(instant, last + 2.0 * CLOSE * span)
        axes.annotate(
            readable(cause),
            xy=(instant, 1.0),
            xytext=(last, 1.06),
            xycoords=transform,
            textcoords=transform,
            rotation=90,
            fontsize="x-small",
            ha="center",
            va="bottom",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0},
        )
