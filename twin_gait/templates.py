"""Texts from Jinja templates, with the same options everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def make_template_environment(folder: Path, **options: Any) -> Environment:
    """Return the environment of the templates in a folder; ``options`` are those of ``jinja2.Environment``.

    An undefined variable in a template is an error, not a gap; a line with only a block tag gives no line in
    the text.
    """
    return Environment(
        loader=FileSystemLoader(folder), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        **options,
    )  # fmt: skip
