"""Pictures of a live session for its printed report: gait cycles of two conditions, and strides over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait.labels import label_of
from twin_gait.measures.strides import PERCENT
from twin_gait.palette import BLUE, GREY, LIMIT_COLOUR, REFERENCE_COLOUR, SIDE_COLOURS
from twin_gait.report.canvas import (
    draw_cycle_curve,
    picture_bytes,
    put_legend,
    standard_settings,
    style_panel,
)
from twin_gait.vocabulary import JointName, Side

WIDTH = 7.5  # [inches], width of the text of an A4 page
RESOLUTION = 200  # [dots per inch]
_PRINT: dict[Any, Any] = {"font.size": 6.5, "axes.linewidth": 0.5, "lines.linewidth": 1.0}
HEALTHY: dict[str, Any] = {"color": REFERENCE_COLOUR, "linestyle": ":", "linewidth": 1.0}
_CONDITION_COLOURS = (GREY, BLUE)
Curves = Mapping[tuple[Side, JointName], np.ndarray]  # angles in [rad] of strides, shape ``(n_strides, 101)``


class Mark(NamedTuple):
    """Time of a session that a picture marks."""

    time: float  # time walked since the start of the session in [s]
    label: str  # label above the panels
    restart: bool = False  # whether another walk begins here


def draw_cycles(conditions: Mapping[str, Curves], reference: Mapping[JointName, np.ndarray]) -> bytes:
    """Draw the mean stride of conditions with the standard deviation, with a panel for each joint of a leg.

    ``conditions``: curves of one or two conditions by their names; ``reference``: healthy angles in [rad] at
    ``PERCENT`` by joint. Returns a PNG.
    """
    with standard_settings(_PRINT):
        panels = list(next(iter(conditions.values())))
        figure = Figure(figsize=(WIDTH, 1.75), layout="constrained")
        grid = figure.subplots(1, len(panels), squeeze=False)[0]
        legend = []
        for name, colour in zip(conditions, _CONDITION_COLOURS, strict=False):
            legend.append(Line2D([], [], color=colour, label=f"condition {name}, mean ± SD"))
        if reference:
            legend.append(Line2D([], [], label="healthy, Koopman (2014)", **HEALTHY))
        for axes, (side, joint) in zip(grid, panels, strict=True):
            style_panel(axes, label_of(f"{side}_{joint}_angle_rad").title, "")
            for curves, colour in zip(conditions.values(), _CONDITION_COLOURS, strict=False):
                _draw_band(axes, np.degrees(curves[side, joint]), colour)
            if joint in reference:
                draw_cycle_curve(axes, np.degrees(reference[joint]), **HEALTHY)
        put_legend(figure, legend)
        return picture_bytes(figure, resolution=RESOLUTION)


def _draw_band(axes: Axes, cycles: np.ndarray, colour: str) -> None:
    mean = cycles.mean(axis=0)
    draw_cycle_curve(axes, mean, color=colour)
    if len(cycles) > 1:
        deviation = cycles.std(axis=0, ddof=1)
        axes.fill_between(PERCENT, mean - deviation, mean + deviation, color=colour, alpha=0.25, linewidth=0)


def draw_course(strides: pd.DataFrame, keys: Sequence[str], marks: Sequence[Mark], end: float) -> bytes:
    """Draw measures of each stride over the time of the session, with lines at the changes.

    ``strides``: a row for each stride with ``side``, ``time_s`` and the measures ``keys``; strides that have
    not settled are hollow. ``end``: end of the session in [s]. Returns a PNG.
    """
    with standard_settings(_PRINT):
        figure = Figure(figsize=(WIDTH, 1.9), layout="constrained")
        grid = figure.subplots(1, len(keys), squeeze=False)[0]
        for axes, key in zip(grid, keys, strict=True):
            label = label_of(key)
            style_panel(axes, label.title, "")
            for side, rows in strides.groupby("side"):
                colour = SIDE_COLOURS[Side(str(side))]
                for settled, of_kind in rows.groupby("settled"):
                    axes.plot(
                        of_kind["time_s"], label.factor * of_kind[key], "o", color=colour, markersize=2.5,
                        markeredgewidth=0.6, fillstyle="full" if settled else "none",
                    )  # fmt: skip
            for mark in marks:
                line = "-" if mark.restart else "--"
                axes.axvline(mark.time, color=LIMIT_COLOUR, linewidth=0.8, linestyle=line)
                axes.annotate(
                    mark.label, (mark.time, 1.0), xycoords=("data", "axes fraction"), xytext=(1.5, -6.5),
                    textcoords="offset points",
                )  # fmt: skip
            axes.set_xlim(0.0, end)
            axes.set_xlabel("time walked [s]")
        sides = [Side(str(side)) for side in strides["side"].unique()]
        style: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 3.0}
        legend = [Line2D([], [], color=SIDE_COLOURS[side], label=str(side), **style) for side in sides]
        legend.append(Line2D([], [], color=GREY, fillstyle="none", label="not settled", **style))
        legend.append(Line2D([], [], color=LIMIT_COLOUR, linestyle="--", label="change to condition"))
        put_legend(figure, legend)
        return picture_bytes(figure, resolution=RESOLUTION)
