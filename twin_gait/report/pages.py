"""Pages and lines from the templates next to this module.

A page is one self-contained file: it includes all its content, and its security policy forbids to load any
other.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment

from twin_gait import __version__
from twin_gait.templates import templates_in

TEMPLATES = Path(__file__).with_name("templates")
FIGURES_FOLDER = "figures"  # name of the folder of pictures in a folder of results


@cache
def _environment() -> Environment:
    escaped = (".html", ".svg")
    environment = templates_in(TEMPLATES, autoescape=lambda name: name is None or name.endswith(escaped))
    environment.filters["address"] = address
    return environment


def render(template: str, content: Mapping[str, Any]) -> str:
    """Fill a template.

    ``template``: name of a file in ``TEMPLATES``; values are escaped in HTML and SVG. ``content``: values and
    functions by name, to which the ``version`` of this package is added. Returns the text.
    """
    return _environment().get_template(template).render(version=__version__, **content)


def lines(template: str, content: Mapping[str, Any]) -> list[str]:
    """Fill a template of text for a terminal and return its lines."""
    return render(template, content).splitlines()


def address(png: bytes) -> str:
    """Return a picture as a data URL, which contains its content."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
