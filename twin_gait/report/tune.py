"""Pictures and page of a tuning: gait before and after, trade-offs, convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from twin_gait.experiment.experiment import Experiment
from twin_gait.labels import label_of
from twin_gait.palette import BLACK, BLUE, GREY, VERMILLION
from twin_gait.report import canvas
from twin_gait.report.canvas import put_legend, style_panel
from twin_gait.report.formatting import amount
from twin_gait.report.pages import lines, render
from twin_gait.report.state_diagram import describe_signal, name_to_words
from twin_gait.simulation.run import Run

BEFORE_COLOUR, AFTER_COLOUR = GREY, BLUE
_COMPROMISES = "best compromises (Pareto front of the three)"
TuningResult = Mapping[str, Any]


def page(outcome: TuningResult, pictures: Mapping[str, bytes]) -> str:
    """Return the report as one self-contained page.

    ``outcome``: content of ``tune.json``; ``pictures``: PNG of the drawings of :func:`tuning_drawings`, by
    name.
    """
    title = f"A gait table tuned to {outcome['wearer']}"
    return render("tune.html", {**_content(outcome), "title": title, "pictures": pictures})


def summary(outcome: TuningResult) -> list[str]:
    """Return the result of a tuning and the cost of its search as lines for a terminal."""
    return lines("tune.txt", _content(outcome))


def _content(outcome: TuningResult) -> dict[str, Any]:
    errors = [f"{joint}_error_deg" for joint in outcome["joints"]]
    return {**outcome, "errors": errors, "amount": amount, "label_of": label_of, "parameter_title": _title}


def _title(name: str) -> str:
    """Return the title of a number of a gait table; a threshold has the name ``cause: signal operator``."""
    cause, _, threshold = name.rpartition(": ")
    if not cause:
        return label_of(name).axis
    words = [describe_signal(word)[0] if "." in word else word for word in threshold.split()]
    return f"{name_to_words(cause)}: {' '.join(words)} [°]"


def tuning_drawings(
    outcome: TuningResult, experiment: Experiment, runs: Mapping[str, Run]
) -> dict[str, canvas.Drawing]:
    """Return the figures of the content of ``tune.json`` and of walks ``before`` and ``after``."""
    colours = {"before": BEFORE_COLOUR, "after": AFTER_COLOUR}
    return {
        "gait": partial(canvas.draw_mean_cycles, experiment, runs, colours),
        "trade_offs": partial(draw_trade_offs, outcome["trade_offs"], outcome["joints"]),
        "convergence": partial(
            draw_convergence, outcome["convergence"], is_minimum=outcome["effort"]["evolved_generations"] == 0
        ),
    }


def non_dominated(points: np.ndarray) -> np.ndarray:
    """Return which points are Pareto-optimal: no other point is better in one coordinate and worse in none.

    ``points``: one row per point, lower values are better, shape ``(n, m)``. Returns mask of shape ``(n,)``.
    """
    no_worse = (points[:, None] <= points).all(axis=2)
    better = (points[:, None] < points).any(axis=2)
    return np.asarray(~(no_worse & better).any(axis=0))


def draw_trade_offs(trade_offs: Mapping[str, Any], joints: Sequence[str]) -> Figure:
    """Draw error over effort and over sensitivity, with the best compromises of the three marked.

    ``trade_offs``: ``candidates``, ``before`` and ``after``, see
    :func:`twin_gait.studies.tune.walks.table_performance`.
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
    labels = ("effort: RMS torque of the motors [N·m]", "sensitivity: mean cost in the other cases")
    for axes, column, label in zip(panels, (1, 2), labels, strict=True):
        for points, style in groups:
            axes.plot(points[:, column], points[:, 0], linestyle="none", **style)
        style_panel(axes, "", error if column == 1 else "")
        axes.set_xlabel(label)
    put_legend(figure, [Line2D([], [], linestyle="none", **style) for _, style in groups])
    return figure


def draw_convergence(best: Sequence[float], *, is_minimum: bool = True) -> Figure:
    """Draw the best cost after each generation; generation 0 is the start.

    ``is_minimum``: whether the costs of all generations are of the same walks, so that the best one so far
    is drawn.
    """
    figure = Figure(figsize=(canvas.SCREEN_WIDTH, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.step(range(len(best)), best, "o-", where="post", color=AFTER_COLOUR)
    axes.set_ylim(bottom=0.0)
    style_panel(axes, "", "best cost so far" if is_minimum else "cost of the best candidate")
    axes.set_xlabel("generation")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure
