"""Blending laws side by side: the torque through one switch, and what each law costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait.gait.table import BlendingLaw
from twin_gait.palette import BLACK, BLUISH_GREEN, GREY, JOINT_COLOURS, ORANGE, REDDISH_PURPLE, SKY_BLUE
from twin_gait.report.canvas import put_legend, readable, style_panel
from twin_gait.vocabulary import JointName

# Column after the joint's name, title and unit of the panels, and whether the axis is logarithmic.
PANELS = (
    ("torque_jump_Nm", "torque jump within a tick", "N m", True),
    ("jerk_rms_rad_per_s3", "RMS jerk", "rad/s³", False),
    ("switch_energy_J", "energy by switching, per stride", "J", False),
    ("rmse_deg", "RMSE to the reference", "°", False),
)
LAW_STYLES: dict[BlendingLaw, tuple[Literal["-", "--"], str]] = {
    BlendingLaw.LINEAR: ("--", "o"),
    BlendingLaw.MINIMUM_JERK: ("-", "s"),
}
_DURATION_COLOURS = (ORANGE, BLUISH_GREEN, REDDISH_PURPLE, SKY_BLUE, GREY)


class TorqueTrace(NamedTuple):
    """Commanded torque of a joint through one switch.

    Attributes:
        law: Of the blend.
        duration_ms: Of the blend.
        kind: Side, joint and phases of the switch, in words.
        time: Since the switch in [s], shape ``(n,)``.
        torque: In [N m], shape ``(n,)``.
    """

    law: str
    duration_ms: int
    kind: str
    time: np.ndarray
    torque: np.ndarray


def draw_blending(table: pd.DataFrame, traces: Sequence[TorqueTrace], shown: Sequence[str]) -> Figure:
    """Draw a comparison of blending laws.

    Args:
        table: From :func:`twin_gait.studies.blending.compare_blending`.
        traces: The torque through switches.
        shown: Kinds of switch that get a panel, each with a trace.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 7.8), layout="constrained")
    figure.suptitle("Ways to blend, on the same walk", fontsize="large")
    rows = figure.add_gridspec(2, 1, height_ratios=(1.15, 1.0))
    cases = list(dict.fromkeys((trace.law, trace.duration_ms) for trace in traces))
    styles = _styles(cases)
    above, below = rows[0].subgridspec(1, max(1, len(shown))), rows[1].subgridspec(1, len(PANELS))
    for number, kind in enumerate(shown):
        _draw_traces(
            figure.add_subplot(above[number]), [trace for trace in traces if trace.kind == kind], styles
        )
    for number, (column, title, unit, logarithmic) in enumerate(PANELS):
        axes = figure.add_subplot(below[number])
        _draw_measure(axes, table, column)
        style_panel(axes, title, unit)
        axes.set_xlabel("duration of the blend [ms]")
        axes.set_xticks(sorted(table["duration_ms"].unique()))
        if logarithmic and all(np.asarray(line.get_ydata()).max() > 0.0 for line in axes.lines):
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)
    put_legend(figure, _measure_handles(), [Line2D([], [], **style) for style in styles.values()])
    return figure


def _styles(cases: Sequence[tuple[str, int]]) -> dict[tuple[str, int], dict[str, Any]]:
    """Line style of every case: colour by duration, dashes by law."""
    durations = sorted({duration for law, duration in cases if law != BlendingLaw.NONE})
    colours = {value: _DURATION_COLOURS[i % len(_DURATION_COLOURS)] for i, value in enumerate(durations)}
    styles: dict[tuple[str, int], dict[str, Any]] = {}
    for law, duration in cases:
        style: dict[str, Any] = {"color": BLACK, "linestyle": "-", "label": "no blending"}
        if law != BlendingLaw.NONE:
            dashes, _ = LAW_STYLES[BlendingLaw(law)]
            label = f"{readable(law)}, {duration} ms"
            style = {"color": colours[duration], "linestyle": dashes, "label": label}
        styles[law, duration] = {**style, "linewidth": 1.4}
    return styles


def _draw_traces(
    axes: Axes, traces: Sequence[TorqueTrace], styles: Mapping[tuple[str, int], dict[str, Any]]
) -> None:
    for trace in traces:
        axes.plot(1e3 * trace.time, trace.torque, **styles[trace.law, trace.duration_ms])
    axes.set_xlim(1e3 * traces[0].time[0], 1e3 * traces[0].time[-1])
    style_panel(axes, f"commanded torque: {traces[0].kind}", "N m")
    axes.set_xlabel("time since the switch [ms]")


def _draw_measure(axes: Axes, table: pd.DataFrame, column: str) -> None:
    """One measure over the duration; the case without a blend is the start of both laws."""
    for joint in (JointName.HIP, JointName.KNEE):
        name = f"{joint}_{column}"
        for law, (line, marker) in LAW_STYLES.items():
            rows = table[table["law"].isin([law, BlendingLaw.NONE])].sort_values("duration_ms")
            axes.plot(
                rows["duration_ms"],
                rows[name],
                color=JOINT_COLOURS[joint],
                linestyle=line,
                marker=marker,
                markersize=4.5,
                linewidth=1.4,
            )


def _measure_handles() -> list[Artist]:
    joints = [
        Line2D([], [], color=JOINT_COLOURS[joint], linewidth=3, label=str(joint))
        for joint in (JointName.HIP, JointName.KNEE)
    ]
    laws = [
        Line2D([], [], color="0.4", linestyle=line, marker=marker, label=readable(law))
        for law, (line, marker) in LAW_STYLES.items()
    ]
    return [*joints, *laws]
