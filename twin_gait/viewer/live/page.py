"""The live page: the viewer's page with the panel beside the scene."""

from __future__ import annotations

from pathlib import Path

from twin_gait.viewer.page import live_page

_FOLDER = Path(__file__).parent


def panel_page() -> str:
    """The page, complete."""
    return live_page(style=_text("panel.css"), panel=_text("panel.html"), script=_text("panel.js"))


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
