"""Figure of the benchmark: time per tick, and accuracy over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from peers.measuring import ERROR, MEDIAN, TIME

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.report.state_diagram import name_to_words

COLOURS = {
    "compiled": BLUE,
    "simulate()": SKY_BLUE,
    "batch": BLUISH_GREEN,
    "Pinocchio": REDDISH_PURPLE,
    "plain Python": GREY,
    "MuJoCo": VERMILLION,
    "MuJoCo rollout": ORANGE,
    "MuJoCo batch": ORANGE,
}


def _colour(implementation: str) -> str:
    return COLOURS[implementation.split(",")[0]]


def draw_speed(measured: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw a panel of times for each case, and a panel of accuracy over speed below them.

    Args:
        measured: Cases of ``speed.py``.
        path: Path of the picture.
    """
    rows = (len(measured) + 1) // 2
    figure = Figure(figsize=(10.0, 2.4 * rows + 3.2), layout="constrained")
    grid = figure.add_gridspec(rows + 1, 2, height_ratios=[2.4] * rows + [3.2])
    for index, case in enumerate(measured):
        _draw_case(figure.add_subplot(grid[index // 2, index % 2]), case)
    _draw_accuracy(figure.add_subplot(grid[rows, :]), measured)
    figure.savefig(path, dpi=85)


def _draw_case(axes: Axes, case: Mapping[str, Any]) -> None:
    """Draw a point per implementation at its least time, the fastest at the top, and a bar to its median."""
    rows = sorted(case["rows"], key=lambda row: float(row[TIME]), reverse=True)
    for index, row in enumerate(rows):
        colour = _colour(row["implementation"])
        axes.plot([row[TIME], row[MEDIAN]], [index, index], color=colour, linewidth=3.0, alpha=0.5)
        axes.plot(row[TIME], index, "o", color=colour)
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), [row["implementation"] for row in rows], fontsize="small")
    style_panel(axes, f"{name_to_words(case['scenario'])}, {case['step']}", "")
    axes.set_xlabel("time per 1 ms tick [ns]")


def _draw_accuracy(axes: Axes, measured: Sequence[Mapping[str, Any]]) -> None:
    """Draw error over time; lower left is better."""
    labelled: set[str] = set()
    for case in measured:
        for row in case["rows"]:
            name = row["implementation"]
            if not row[ERROR]:
                continue
            axes.loglog(
                row[TIME],
                row[ERROR],
                "s" if case["step"].startswith("RK4") else "o",
                color=_colour(name),
                fillstyle="none" if name.startswith("MuJoCo") else "full",
                label=None if name in labelled else name,
            )
            labelled.add(name)
    style_panel(axes, "accuracy beside speed (circle: Euler, square: RK4)", "largest error [rad]")
    axes.set_xlabel("time per 1 ms tick [ns]")
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
