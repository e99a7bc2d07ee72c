"""Picture of a comparison of controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from twin_gait.palette import (
    BLUE,
    BLUISH_GREEN,
    GREY,
    ORANGE,
    REDDISH_PURPLE,
    REFERENCE_COLOUR,
    SKY_BLUE,
    VERMILLION,
)
from twin_gait.report.canvas import put_legend, style_panel
from twin_gait.report.panels import draw_cycle_curve

COLOURS = (BLUE, VERMILLION, BLUISH_GREEN, ORANGE, REDDISH_PURPLE, SKY_BLUE, GREY)


class Drawn(NamedTuple):
    """One controller in the picture.

    Attributes:
        title: Its name.
        place: Its place among all controllers, which gives its colour.
        cycles: Mean angle in [deg] over the cycle by panel, shape ``(101,)`` each.
        bars: Numbers by label.
    """

    title: str
    place: int
    cycles: Mapping[str, np.ndarray]
    bars: Mapping[str, float]


def draw_comparison(controllers: Sequence[Drawn], reference: Mapping[str, np.ndarray]) -> Figure:
    """Draw joint angles over the cycle, and bars.

    Args:
        controllers: Those that walked.
        reference: Healthy angles in [deg] by panel.

    Returns:
        The figure.
    """
    labels = list(controllers[0].bars) if controllers else []
    figure = Figure(figsize=(13.0, 3.3), layout="constrained")
    panels = figure.subplots(1, max(1, len(reference) + len(labels)), squeeze=False)[0]
    lines = []
    for axes, (name, healthy) in zip(panels, reference.items(), strict=False):
        for item in controllers:
            style = {"color": COLOURS[item.place], "linewidth": 1.5, "label": item.title}
            lines += draw_cycle_curve(axes, item.cycles[name], **style)
        style = {"color": REFERENCE_COLOUR, "linestyle": ":", "linewidth": 1.5}
        lines += draw_cycle_curve(axes, healthy, **style, label="healthy, same speed")
        style_panel(axes, f"{name} [°]", "")
        axes.set_xlabel("stride [%]")
    for axes, label in zip(panels[len(reference) :], labels, strict=True):
        colours = [COLOURS[item.place] for item in controllers]
        axes.bar(range(len(controllers)), [item.bars[label] for item in controllers], color=colours)
        axes.set_xticks([])
        style_panel(axes, label, "")
    if lines:
        put_legend(figure, lines)
    return figure
