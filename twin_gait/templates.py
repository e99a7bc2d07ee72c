"""Texts from templates, filled in one way everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def templates_in(folder: Path, **options: Any) -> Environment:
    """Templates of a folder; ``options`` as ``jinja2.Environment`` takes them.

    A number that a template asks for in vain is an error, not a gap; what stands alone on a line to steer it
    leaves no line.
    """
    return Environment(
        loader=FileSystemLoader(folder), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        **options,
    )  # fmt: skip
