"""Pictures and page of a tuning: gait before and after, trade-offs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait.palette import BLACK, BLUE, GREY, REFERENCE_COLOUR, VERMILLION
from twin_gait.report import canvas
from twin_gait.report.canvas import Curves, put_legend, style_panel
from twin_gait.report.pages import lines, render
from twin_gait.report.walk_words import amount
from twin_gait.vocabulary import Side

BEFORE_COLOUR, AFTER_COLOUR = GREY, BLUE
_SIDE_LINES = {Side.LEFT: "-", Side.RIGHT: "--"}
_COMPROMISES = "best compromises (Pareto front of the three)"
Outcome = Mapping[str, Any]


def page(outcome: Outcome, pictures: Mapping[str, bytes]) -> str:
    """The report as one page that needs no other file.

    ``outcome``: content of ``tune.json``; ``pictures``: PNG of what :func:`draw_figures` draws, by its names.
    """
    title = f"A gait table tuned to {outcome['wearer']}"
    return render("tune.html", {**_content(outcome), "title": title, "pictures": pictures})


def summary(outcome: Outcome) -> list[str]:
    """What the tuning found and what the search took, for a terminal."""
    return lines("tune.txt", _content(outcome))


def _content(outcome: Outcome) -> dict[str, Any]:
    known = {name: value for name, value in outcome.items() if name != "version"}
    errors = [f"{joint}_error_deg" for joint in outcome["joints"]]
    return {**known, "errors": errors, "amount": amount}


def draw_figures(outcome: Outcome, curves: Curves) -> dict[str, Figure]:
    """Draw all figures.

    ``outcome``: content of ``tune.json``; ``curves``: mean cycles in [deg] by joint; see :func:`draw_gait`.
    """
    trade_offs = draw_trade_offs(outcome["trade_offs"], outcome["joints"])
    return {"gait": draw_gait(curves), "trade_offs": trade_offs}


def draw_gait(curves: Curves) -> Figure:
    """Draw mean cycles before and after.

    ``curves`` by joint: ``reference`` and such as ``before left``, in [deg] at ``PERCENT``.
    """
    styles: dict[str, dict[str, Any]] = {"reference": {"color": REFERENCE_COLOUR, "linewidth": 2.2}}
    for which, colour in (("before", BEFORE_COLOUR), ("after", AFTER_COLOUR)):
        for side, line in _SIDE_LINES.items():
            styles[f"{which} {side}"] = {"color": colour, "linewidth": 1.5, "linestyle": line}
    return canvas.draw_mean_cycles(curves, styles, (canvas.SCREEN_WIDTH, 4.2))


def non_dominated(points: np.ndarray) -> np.ndarray:
    """Which points no other one betters in one coordinate without being worse in another (V. Pareto).

    ``points``: a row each, less being better, shape ``(n, m)``. Returns mask of shape ``(n,)``.
    """
    no_worse = (points[:, None] <= points).all(axis=2)
    better = (points[:, None] < points).any(axis=2)
    return np.asarray(~(no_worse & better).any(axis=0))


def draw_trade_offs(trade_offs: Mapping[str, Any], joints: Sequence[str]) -> Figure:
    """Draw error over effort and over sensitivity, the best compromises of the three marked.

    ``trade_offs``: ``candidates``, ``before`` and ``after``, see
    :func:`twin_gait.studies.tune.walks.standing`.
    """
    figure = Figure(figsize=(canvas.SCREEN_WIDTH, 5.0), layout="constrained")
    panels = figure.subplots(1, 2)
    tried, before, after = (
        np.array(trade_offs[name], dtype=float).reshape(-1, 3) for name in ("candidates", "before", "after")
    )
    whole = tried[~np.isnan(tried).any(axis=1)]
    groups: list[tuple[np.ndarray, dict[str, Any]]] = [
        (tried, {"marker": "o", "markersize": 3.5, "color": GREY, "label": "tried"}),
        (whole[non_dominated(whole)], {"marker": "o", "color": AFTER_COLOUR, "label": _COMPROMISES}),
        (before, {"marker": "s", "markersize": 8, "color": BLACK, "label": "before"}),
        (after, {"marker": "*", "markersize": 16, "color": VERMILLION, "label": "chosen"}),
    ]
    error = f"error: RMS of {' and '.join(', '.join(joints).rsplit(', ', 1))} [°]"
    labels = ("effort: RMS torque of the motors [N m]", "sensitivity: mean cost in the other cases")
    for axes, column, label in zip(panels, (1, 2), labels, strict=True):
        for points, style in groups:
            axes.plot(points[:, column], points[:, 0], linestyle="none", **style)
        style_panel(axes, "", error if column == 1 else "")
        axes.set_xlabel(label)
    put_legend(figure, [Line2D([], [], linestyle="none", **style) for _, style in groups])
    return figure
