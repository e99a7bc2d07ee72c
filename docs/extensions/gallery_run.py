"""Hooks with which the site runs a script of the gallery."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import gallery_pages


def arguments(_: Any, script: dict[str, Any]) -> list[str]:
    """Return the command line of a script, whose results go to a temporary folder."""
    name = Path(script["src_file"]).stem
    out = ["--out", tempfile.mkdtemp(prefix=f"{name}_"), "--workers", "1"]
    return out if name in gallery_pages.IN_FULL else ["--quick", *out]


def fresh(_: dict[str, Any], __: str) -> None:
    """Remove the modules of the scripts, so that each script imports its own."""
    for name in [name for name in sys.modules if name.split(".")[0] in ("gallery", "whatif", "thesis")]:
        del sys.modules[name]


class Order:
    """Scripts of a section in the order of its list."""

    def __init__(self, folder: str) -> None:
        """Store the names of the section of a folder."""
        section = Path(folder).name.partition("_")[2]
        self.names = gallery_pages.SECTIONS[section][1] if section in gallery_pages.SECTIONS else ()

    def __call__(self, filename: str) -> int:
        """Return the position of a script in its section."""
        return self.names.index(Path(filename).stem)
