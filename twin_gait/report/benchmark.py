"""The picture of a benchmark: time per tick, accuracy beside speed, and how the cost grows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import readable, style_panel

COLOURS = {
    "compiled": BLUE,
    "compiled_log": BLUE,
    "simulate": SKY_BLUE,
    "batch": BLUISH_GREEN,
    "pinocchio": REDDISH_PURPLE,
    "plain_python": GREY,
    "mujoco_bare": VERMILLION,
    "mujoco_native": VERMILLION,
    "mujoco_python": ORANGE,
    "mujoco_rollout": ORANGE,
    "kernel": BLUE,
    "pin_aba": GREY,
    "mujoco_step": VERMILLION,
}
MARKERS = {"semi_implicit_euler": "o", "rk4": "s"}


def draw_benchmark_figure(document: Mapping[str, Any]) -> Figure:
    """Draw a benchmark.

    Args:
        document: From :func:`twin_gait.studies.benchmark.benchmark.benchmark`.

    Returns:
        A panel of bars per case, then accuracy and scaling where they were measured.
    """
    cases = document["cases"]
    rows = (len(cases) + 1) // 2
    room = ConstrainedLayoutEngine(w_pad=0.12)  # for the names beside the axes
    figure = Figure(figsize=(13.0, 3.2 * rows + 4.8), layout=room)
    before = document["machine_before"]
    figure.suptitle(
        f"twin_gait beside MuJoCo and plain Python\n{before['processor']}, {before['cores']} cores, "
        f"medians and quartiles of {document['rounds']} interleaved rounds",
        fontsize="large",
    )
    upper, lower = np.asarray(figure.subfigures(2, 1, height_ratios=[3.2 * rows, 4.0])).tolist()
    panels = upper.subplots(rows, 2, squeeze=False).flatten().tolist()
    for axes, case in zip(panels, cases, strict=False):
        _draw_case(axes, case)
    for axes in panels[len(cases) :]:
        axes.set_axis_off()
    scaled = "scaling" in document
    below = lower.subplots(1, 3 if scaled else 1, squeeze=False).flatten().tolist()
    _draw_accuracy(below[0], cases)
    if scaled:
        _draw_joints(below[1], document["scaling"]["joints"])
        _draw_batch(below[2], document["scaling"]["batch"])
    return figure


def _draw_case(axes: Axes, case: Mapping[str, Any]) -> None:
    """A point per contestant, fastest on top, with its quartiles."""
    rows = sorted(case["rows"], key=lambda row: float(row["ns_per_tick"]), reverse=True)
    for place, row in enumerate(rows):
        time, (low, high) = row["ns_per_tick"], row["ns_per_tick_quartiles"]
        colour = COLOURS[row["contestant"]]
        axes.plot([low, high], [place, place], color=colour, linewidth=3.0, alpha=0.5)
        axes.plot(time, place, "o", color=colour)
        factor = row["realtime_factor"]
        digits = f"{factor:,.0f}" if factor >= 10.0 else f"{factor:.2g}"
        axes.annotate(
            f"{time:,.0f} ns · {digits} x real time",
            (max(time, high), place),
            xytext=(8, 0),
            textcoords="offset points",
            va="center",
            fontsize="x-small",
        )
    times = [row["ns_per_tick"] for row in rows]
    axes.set_xscale("log")
    axes.set_xlim(0.5 * min(times), 60.0 * max(times))
    axes.set_yticks(range(len(rows)), [readable(row["contestant"]) for row in rows], fontsize="small")
    style_panel(axes, f"{readable(case['subject'])}, {case['stepping']}", "")
    axes.set_xlabel("time per 1 ms tick [ns]")


def _draw_accuracy(axes: Axes, cases: Sequence[Mapping[str, Any]]) -> None:
    """Error over time: down and left is better."""
    labelled: set[str] = set()
    for case in cases:
        for row in case["rows"]:
            error = row["largest_angle_error_rad"]
            if not error:
                continue
            name = row["contestant"]
            axes.loglog(
                row["ns_per_tick"],
                error,
                MARKERS[case["method"]],
                color=COLOURS[name],
                fillstyle="none" if name.startswith("mujoco") else "full",
                label=readable(name) if name not in labelled else None,
            )
            labelled.add(name)
    style_panel(axes, "accuracy beside speed (circle: Euler, square: RK4)", "largest error [rad]")
    axes.set_xlabel("time per 1 ms tick [ns]")
    _legend_below(axes, 3)


def _draw_joints(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    joints = [row["joints"] for row in rows]
    for name in rows[0]["ns_per_evaluation"]:
        times = [row["ns_per_evaluation"][name]["median"] for row in rows]
        axes.loglog(joints, times, "o-", color=COLOURS[name], label=readable(name))
    style_panel(axes, "forward dynamics of a chain", "time per evaluation [ns]")
    axes.set_xlabel("joints")
    axes.set_xticks(joints, [str(count) for count in joints])
    axes.minorticks_off()
    _legend_below(axes, 2)


def _draw_batch(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    for name in rows[0]["ns_per_tick"]:
        for workers in sorted({row["workers"] for row in rows}):
            chosen = [row for row in rows if row["workers"] == workers]
            axes.loglog(
                [row["episodes"] for row in chosen],
                [row["ns_per_tick"][name]["median"] for row in chosen],
                "o-" if workers == 1 else "s--",
                color=COLOURS[name],
                label=f"{readable(name)}, {workers} thread{'s' if workers > 1 else ''}",
            )
    style_panel(axes, "batch of bench legs", "time per tick of an episode [ns]")
    axes.set_xlabel("episodes")
    _legend_below(axes, 2)


def _legend_below(axes: Axes, columns: int) -> None:
    """Where it covers nothing."""
    axes.legend(fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=columns)
