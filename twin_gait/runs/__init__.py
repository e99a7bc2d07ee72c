"""What a run leaves on the disk: its directory, its summary, and how it is read again."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.runs.public import load_run, plot_run, save_run
    from twin_gait.runs.summary import summarise, versions

__all__ = ["load_run", "plot_run", "save_run", "summarise", "versions"]

_HOMES = {
    "load_run": "public",
    "plot_run": "public",
    "save_run": "public",
    "summarise": "summary",
    "versions": "summary",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for: pictures and tables take longer than a walk to simulate."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
