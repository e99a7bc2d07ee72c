"""See a run or a URDF: one page to keep, or a live page in the browser.

What is offered here is imported when it is first asked for: a finished page needs neither Pinocchio nor
pandas.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.viewer.animation import write_animation
    from twin_gait.viewer.session import LiveViewer, show_run, view_urdf

__all__ = ["LiveViewer", "show_run", "view_urdf", "write_animation"]

_HOMES = {
    "LiveViewer": "session",
    "show_run": "session",
    "view_urdf": "session",
    "write_animation": "animation",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
