"""Fixed margins: nothing is cut off, nothing lies on anything, and little room is wasted."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from synthetic_run import synthetic_run

from twin_gait.report.canvas import SCREEN_WIDTH
from twin_gait.report.figures import FIGURES, WIDTHS, draw_figure, draw_for_paper
from twin_gait.report.margins import POINTS, FixedMargins
from twin_gait.simulation.run import Run

LEAST_SHARE = 0.42  # of a figure that its panels take, whatever stands around them
SLACK = 1.5  # [pt] that the frame of a text is larger than its ink


@pytest.fixture(scope="module")
def walk() -> Run:
    return synthetic_run()


def laid_out(figure: Figure) -> tuple[list[Bbox], list[Bbox]]:
    """Panels with all that belongs to them, and what stands around, as matplotlib itself measures them."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    panels = [axes.get_tightbbox(renderer) for axes in figure.axes]
    around = [item.get_window_extent(renderer) for item in (*figure.texts, *figure.legends)]
    return [box for box in panels if box is not None], around


def overlap(first: Bbox, second: Bbox, slack: float) -> bool:
    common = Bbox.intersection(first, second)
    return common is not None and min(common.width, common.height) > slack


def check(figure: Figure) -> None:
    panels, around = laid_out(figure)
    slack = SLACK * figure.dpi / POINTS
    page = figure.bbox
    for box in [*panels, *around]:
        assert box.x0 >= page.x0 - slack and box.x1 <= page.x1 + slack
        assert box.y0 >= page.y0 - slack and box.y1 <= page.y1 + slack
    for first, second in combinations([*panels, *around], 2):
        assert not overlap(first, second, slack)
    share = sum(axes.bbox.width * axes.bbox.height for axes in figure.axes) / (page.width * page.height)
    assert share > LEAST_SHARE


@pytest.mark.parametrize("name", FIGURES)
def test_on_a_screen_nothing_is_cut_off_or_covered(walk: Run, name: str) -> None:
    check(draw_figure(walk, name, width=SCREEN_WIDTH))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", FIGURES)
def test_in_print_nothing_is_cut_off_or_covered(walk: Run, name: str, width: float) -> None:
    check(draw_for_paper(walk, name, width)[0])


def test_wide_labels_get_the_room_that_they_take(walk: Run) -> None:
    """Forces of a million newtons: the labels are longer, the panels narrower."""
    log = walk.log.copy()
    for side in walk.sides:
        log[f"{side}_foot_normal_force_N"] *= 1e3
    usual, heavy = (draw_figure(run, "feet") for run in (walk, replace(walk, log=log)))
    check(usual)
    check(heavy)
    assert heavy.axes[0].bbox.x0 > usual.axes[0].bbox.x0


def test_what_needs_more_than_the_figure_leaves_the_panels_a_fifth() -> None:
    figure = Figure(figsize=(1.0, 1.0), layout=FixedMargins())
    axes = figure.add_subplot()
    axes.set_ylabel("height", fontsize=80)
    laid_out(figure)
    assert axes.bbox.width == pytest.approx(0.2 * figure.bbox.width)


def test_a_second_drawing_changes_nothing(walk: Run) -> None:
    figure = draw_figure(walk, "currents")
    first, second = (np.array([box.extents for box in laid_out(figure)[0]]) for _ in range(2))
    np.testing.assert_allclose(first, second, atol=0.5)  # [px]
