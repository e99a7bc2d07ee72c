"""Pages and paragraphs from the templates beside this module.

A page is one file that needs no other: what it shows stands in it, and its policy forbids to load anything.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.artist import Artist
from matplotlib.collections import Collection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.typing import ColorType

from twin_gait import __version__
from twin_gait.report.canvas import picture_bytes

TEMPLATES = Path(__file__).with_name("templates")
DARK_INK, DARK_GRID = "#dddddd", "#3a3d42"
# Ink with less luminance is mixed with white for a dark page, so much of itself being left.
LUMINANCE, DARKEST, MIXED = (0.2126, 0.7152, 0.0722), 0.25, 0.3


class Picture(NamedTuple):
    """A figure as PNG, for a file and a page."""

    light: bytes  # for a light page
    dark: bytes  # for a dark page


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=lambda name: name is None or name.endswith((".html", ".svg")),
        undefined=StrictUndefined,  # a number that a template asks for in vain is an error, not a gap
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["address"] = address
    return environment


def render(template: str, content: Mapping[str, Any]) -> str:
    """Fill a template.

    ``template``: name of a file in ``TEMPLATES``; of HTML and SVG all that is filled in is escaped;
    ``content``: what is filled in, by name, functions among it; ``version`` is this package's.
    """
    return _environment().get_template(template).render(version=__version__, **content)


def paragraphs(template: str, content: Mapping[str, Any]) -> list[str]:
    """Fill a template of prose, whose paragraphs are apart by blank lines; each becomes one line."""
    lines = (line.strip() for line in render(template, content).splitlines())
    texts = "\n".join(lines).split("\n\n")
    return [" ".join(text.split()) for text in texts if text.strip()]


def figures_page(
    title: str,
    subtitle: str,
    pictures: Mapping[str, Picture],
    heads: Sequence[str] = (),
    rows: Sequence[Sequence[str]] = (),
) -> str:
    """A page of figures, by their headings, under a table, if that has rows."""
    content = {"title": title, "subtitle": subtitle, "heads": heads, "rows": rows, "pictures": pictures}
    return render("figures.html", content)


def picture_of(figure: Figure) -> Picture:
    """A figure, light and dark; the figure itself is dark afterwards."""
    light = picture_bytes(figure)
    figure.set_layout_engine("none")  # what was found for one holds for the other
    for artist in figure.findobj():
        _brighten(artist)
    for axes in figure.axes:
        axes.patch.set_alpha(0.0)
        axes.tick_params(colors=DARK_INK, grid_color=DARK_GRID)
        axes.spines[:].set_color(DARK_INK)
    return Picture(light, picture_bytes(figure, "none"))


def _brighten(artist: Artist) -> None:
    """Give dark ink a lighter colour; letters upon an image stay."""
    axes = artist.axes
    if isinstance(artist, Text) and axes is not None and axes.images and artist in axes.texts:
        return
    if isinstance(artist, Text | Line2D):
        artist.set(color=_on_dark(artist.get_color()))
    elif isinstance(artist, Collection):
        for name in ("facecolor", "edgecolor"):
            colours = getattr(artist, f"get_{name}")()
            artist.set(**{name: [_on_dark(colour) for colour in np.atleast_2d(colours)]})


def _on_dark(colour: ColorType) -> tuple[float, ...]:
    *ink, opacity = to_rgba(colour)
    if np.dot(ink, LUMINANCE) > DARKEST:
        return (*ink, opacity)
    return (*(MIXED * share + 1.0 - MIXED for share in ink), opacity)


def address(png: bytes) -> str:
    """A picture as an address with the content in it."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
