"""Angles of a replayed walk over the phases that a table gives it, with the cause of every switch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from twin_gait.palette import BLACK, JOINT_COLOURS
from twin_gait.report.canvas import phase_handles, put_legend, readable, shade_phases, style_panel
from twin_gait.report.panels import draw_phase_bars, flexion
from twin_gait.vocabulary import JointName

SHOWN_TICKS = 6000
WIDTH, JOINT_HEIGHT, BAND_HEIGHT = 12.0, 1.9, 0.33  # [inches]
LETTER, LABEL_MARGIN = 4.2, 14.0  # [points] that a letter of a cause and its line take above the first panel
CLOSE = 0.012  # switches nearer than this share of the width share one place for their labels


class ReplayedLeg(NamedTuple):
    """What the picture shows of a leg.

    Attributes:
        angles: Of each joint in [rad], shape ``(n,)``.
        phases: Index of the phase at each tick, shape ``(n,)``.
        recorded: Index of the recorded phase, shape ``(n,)``; None without one.
        switches: Tick and cause of every switch.
    """

    angles: Mapping[str, np.ndarray]
    phases: np.ndarray
    recorded: np.ndarray | None
    switches: Sequence[tuple[int, str]]


def draw_replay(
    title: str, time: np.ndarray, names: Sequence[str], legs: Mapping[str, ReplayedLeg]
) -> Figure:
    """Draw the last seconds of a replay, one column of panels for each leg.

    Args:
        title: Whose walk it is and which table it went through.
        time: Of each tick in [s], shape ``(n,)``.
        names: Phases of the table, then further ones that were recorded.
        legs: By the name of the side.
    """
    first = next(iter(legs.values()))
    rows = slice(max(0, len(time) - SHOWN_TICKS), len(time))
    joints = list(first.angles)
    bands = 1 + any(leg.recorded is not None for leg in legs.values())
    heights = [JOINT_HEIGHT] * len(joints) + [BAND_HEIGHT * bands + 0.25]
    figure = Figure(figsize=(WIDTH, sum(heights) + 2.1), layout="constrained")
    figure.suptitle(title, fontsize="large")
    panels = figure.subplots(
        len(heights), len(legs), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    longest = max((len(cause) for leg in legs.values() for _, cause in leg.switches), default=0)
    label_height = LABEL_MARGIN + LETTER * longest
    lines: list[Artist] = []
    for column, (side, leg) in enumerate(legs.items()):
        for row, joint in enumerate(joints):
            lines += _draw_joint(panels[row, column], time[rows], names, leg, joint, rows)
            style_panel(panels[row, column], "", flexion(joint) if column == 0 else "")
        _draw_bands(panels[-1, column], time[rows], names, leg, rows)
        _label_causes(panels[0, column], time, leg, rows)
        panels[0, column].set_title(f"{side} leg", pad=label_height)
        panels[-1, column].set_xlabel("time [s]")
    occurring = np.concatenate(
        [item[rows] for leg in legs.values() for item in (leg.phases, leg.recorded) if item is not None]
    )
    put_legend(figure, lines, phase_handles(names, occurring))
    return figure


def _draw_joint(
    axes: Axes, time: np.ndarray, names: Sequence[str], leg: ReplayedLeg, joint: str, rows: slice
) -> list[Artist]:
    shade_phases(axes, time, leg.phases[rows], names)
    colour = JOINT_COLOURS[JointName(joint)] if joint in set(JointName) else BLACK
    for tick, _ in leg.switches:
        if rows.start <= tick < rows.stop:
            axes.axvline(time[tick - rows.start], color="0.45", linewidth=0.7, linestyle=(0, (2, 2)))
    return list(axes.plot(time, np.degrees(leg.angles[joint][rows]), color=colour, label=f"{joint} angle"))


def _draw_bands(axes: Axes, time: np.ndarray, names: Sequence[str], leg: ReplayedLeg, rows: slice) -> None:
    """Strips of the replayed and, below, the recorded phases in full colour."""
    strips = [("replayed", leg.phases[rows])]
    if leg.recorded is not None:
        strips.append(("recorded", leg.recorded[rows]))
    draw_phase_bars(axes, time, strips, names, height=0.8, linewidth=0)
    axes.set_ylim(0.5 - len(strips), 0.5)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _label_causes(axes: Axes, time: np.ndarray, leg: ReplayedLeg, rows: slice) -> None:
    """Write the causes upright above the first panel; close ones are pushed apart."""
    shown = [(time[tick], cause) for tick, cause in leg.switches if rows.start <= tick < rows.stop]
    span = time[rows.stop - 1] - time[rows.start]
    transform = blended_transform_factory(axes.transData, axes.transAxes)
    last = -np.inf
    for instant, cause in shown:
        place = max(instant, last + 2.0 * CLOSE * span)
        last = place
        axes.annotate(
            readable(cause),
            xy=(instant, 1.0),
            xytext=(place, 1.06),
            xycoords=transform,
            textcoords=transform,
            rotation=90,
            fontsize="x-small",
            ha="center",
            va="bottom",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0},
        )
