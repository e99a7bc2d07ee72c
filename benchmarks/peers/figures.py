"""Figures of the benchmarks: time per tick, accuracy beside speed, and how the cost grows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from peers.measuring import ERROR, HIGH, LOW, TIME

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import readable, style_panel

COLOURS = {
    "compiled": BLUE,
    "compiled, log": BLUE,
    "simulate()": SKY_BLUE,
    "batch": BLUISH_GREEN,
    "Pinocchio": REDDISH_PURPLE,
    "plain Python": GREY,
    "MuJoCo, bare": VERMILLION,
    "MuJoCo, native loop": VERMILLION,
    "MuJoCo, Python loop": ORANGE,
    "MuJoCo rollout": ORANGE,
    "mujoco.rollout": ORANGE,
}


def draw_speed(measured: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw a panel of times per case, and accuracy beside speed below them.

    Args:
        measured: Cases of ``speed.py``.
        path: The picture.
    """
    rows = (len(measured) + 1) // 2
    figure = Figure(figsize=(10.0, 2.4 * rows + 3.2), layout="constrained")
    grid = figure.add_gridspec(rows + 1, 2, height_ratios=[2.4] * rows + [3.2])
    for place, case in enumerate(measured):
        _draw_case(figure.add_subplot(grid[place // 2, place % 2]), case)
    _draw_accuracy(figure.add_subplot(grid[rows, :]), measured)
    figure.savefig(path, dpi=85)


def _draw_case(axes: Axes, case: Mapping[str, Any]) -> None:
    """A point per implementation, fastest on top, and its quartiles as a bar."""
    rows = sorted(case["rows"], key=lambda row: float(row[TIME]), reverse=True)
    for place, row in enumerate(rows):
        colour = COLOURS[row["implementation"]]
        axes.plot([row[LOW], row[HIGH]], [place, place], color=colour, linewidth=3.0, alpha=0.5)
        axes.plot(row[TIME], place, "o", color=colour)
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), [row["implementation"] for row in rows], fontsize="small")
    style_panel(axes, f"{readable(case['scenario'])}, {case['step']}", "")
    axes.set_xlabel("time per 1 ms tick [ns]")


def _draw_accuracy(axes: Axes, measured: Sequence[Mapping[str, Any]]) -> None:
    """Error over time: down and left is better."""
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
                color=COLOURS[name],
                fillstyle="none" if name.startswith("MuJoCo") else "full",
                label=None if name in labelled else name,
            )
            labelled.add(name)
    style_panel(axes, "accuracy beside speed (circle: Euler, square: RK4)", "largest error [rad]")
    axes.set_xlabel("time per 1 ms tick [ns]")
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))


def draw_scaling(batches: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw cost over episodes.

    Args:
        batches: Rows of ``scaling.py``.
        path: The picture.
    """
    figure = Figure(figsize=(7.5, 3.8), layout="constrained")
    legs = figure.subplots()
    for name in list(batches[0])[2:]:
        for threads, line in ((1, "o-"), (2, "s--")):
            chosen = [row for row in batches if row["threads"] == threads]
            label = f"{name.removesuffix(' [ns]')}, {threads} thread{'s' * (threads > 1)}"
            legs.loglog(
                [row["episodes"] for row in chosen],
                [row[name] for row in chosen],
                line,
                color=COLOURS[name.removesuffix(" [ns]")],
                label=label,
            )
    style_panel(legs, "batch of bench legs", "time per tick of an episode [ns]")
    legs.set_xlabel("episodes")
    legs.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=85)
