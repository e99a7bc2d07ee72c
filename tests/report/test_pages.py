"""Pages: what is filled in is escaped, nothing is loaded, and figures can be read on a dark ground."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from jinja2 import UndefinedError
from matplotlib.figure import Figure
from matplotlib.image import imread

from twin_gait.palette import BLACK, JOINT_COLOURS, REFERENCE_COLOUR
from twin_gait.report.pages import TEMPLATES, figures_page, paragraphs, picture_of, render
from twin_gait.vocabulary import JointName


def line(colour: str) -> Figure:
    """One thick line and nothing else."""
    figure = Figure(figsize=(1.0, 1.0))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.plot([0.0, 1.0], [0.5, 0.5], color=colour, linewidth=30)
    return figure


def pixels(png: bytes) -> np.ndarray:
    return imread(io.BytesIO(png))


def test_what_is_filled_in_is_escaped_and_nothing_is_loaded() -> None:
    page = figures_page("<b>&", "'\"<i>", {"<u>": picture_of(line(BLACK))}, ("<th>",), [("<td>",)])
    assert "&lt;b&gt;&amp;" in page and "&lt;th&gt;" in page
    assert not any(text in page for text in ("<b>", "<i>", "<u>", "<th><th>", "<td><td>"))
    assert "default-src 'none'" in page
    addresses = re.findall(r'(?:src|srcset|href)="([^"]*)"', page)
    assert len(addresses) == 2 and all(item.startswith("data:image/png;base64,") for item in addresses)


@pytest.mark.parametrize("colour", [BLACK, REFERENCE_COLOUR, JOINT_COLOURS[JointName.HIP]])
def test_dark_ink_is_light_on_a_dark_ground(colour: str) -> None:
    light, dark = (pixels(item)[64, 64] for item in picture_of(line(colour)))
    assert light[:3].max() < 0.5
    assert dark[:3].min() > 0.6
    assert pixels(picture_of(line(colour)).dark)[0, 0, 3] == 0.0  # the page shows through


def test_a_number_that_a_template_misses_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="found_better"):
        render("tune.txt", {})


def test_paragraphs_are_apart_by_blank_lines() -> None:
    effort = {"candidates": 12, "generations": 1, "elapsed_s": 60.0}
    content = {"effort": effort, "convergence": {"best": [2.0, 1.0]}}
    (text,) = paragraphs("tune_search.txt", content)
    assert text == (
        "Damped least squares: 12 candidates in 1 generations; the best cost went from 2.00 to 1.00. "
        "It took 1.0 minutes."
    )


def test_every_page_has_the_one_layout() -> None:
    pages = {path.name for path in TEMPLATES.glob("*.html")} - {"layout.html", "parts.html"}
    assert pages == {"compare.html", "tune.html", "figures.html"}
    for name in pages:
        assert (TEMPLATES / name).read_text(encoding="utf-8").startswith('{% extends "layout.html" %}')
