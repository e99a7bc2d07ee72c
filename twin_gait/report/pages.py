"""Pages and lines from the templates beside this module.

A page is one file that needs no other: what it shows stands in it, and its policy forbids to load anything.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment

from twin_gait import __version__
from twin_gait.templates import make_template_environment

TEMPLATES = Path(__file__).with_name("templates")
FIGURES_FOLDER = "figures"  # folder of the pictures inside of a folder of results


@cache
def _environment() -> Environment:
    escaped = (".html", ".svg")
    environment = make_template_environment(
        TEMPLATES, autoescape=lambda name: name is None or name.endswith(escaped)
    )
    environment.filters["address"] = address
    return environment


def render(template: str, content: Mapping[str, Any]) -> str:
    """Fill a template.

    ``template``: name of a file in ``TEMPLATES``; of HTML and SVG all that is filled in is escaped;
    ``content``: what is filled in, by name, functions among it; ``version`` is this package's.
    """
    return _environment().get_template(template).render(version=__version__, **content)


def lines(template: str, content: Mapping[str, Any]) -> list[str]:
    """Fill a template of what a terminal shows."""
    return render(template, content).splitlines()


def address(png: bytes) -> str:
    """A picture as an address with the content in it."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
