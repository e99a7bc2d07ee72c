"""Pictures of a run, and the canvas for pictures of one's own; matplotlib is imported when one is drawn."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.report.canvas import put_legend, readable, save, style_panel

__all__ = [
    "put_legend",
    "readable",
    "save",
    "style_panel",
]

_HOMES = {
    "put_legend": "canvas",
    "readable": "canvas",
    "save": "canvas",
    "style_panel": "canvas",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
