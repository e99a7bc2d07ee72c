"""Common part of the scripts of the gallery: folder of the results, and the option for a quick form.

``python examples/NAME.py`` writes into ``examples/results/NAME``; ``--out`` sets another folder. ``--quick``
runs the smallest work that shows that the script works, in seconds, and writes into a temporary folder by
default. Single cells in an editor or notebook run like the script without arguments.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

RESULTS = "results.json"


@dataclass(frozen=True)
class ScriptOptions:
    """Form in which a script runs.

    Attributes:
        out: Existing folder of the results.
        quick: Whether to run only the smallest work that shows that the script works.
        workers: Number of processes for long work.
        more: Values of further options, by the names in :func:`read_options`.
    """

    out: Path
    quick: bool
    workers: int
    more: Mapping[str, Any] = field(default_factory=dict)

    def write_results(self, results: Mapping[str, Any]) -> None:
        """Write the numbers that pages quote (docs/insert.py): plain numbers, texts, lists and mappings."""
        text = json.dumps({"quick": self.quick, **results}, indent=1, ensure_ascii=False, allow_nan=False)
        (self.out / RESULTS).write_text(text + "\n", encoding="utf-8")


def read_options(name: str, folder: Path | None = None, **more: Mapping[str, Any]) -> ScriptOptions:
    """Read the arguments of a script.

    Args:
        name: Name of the script without .py.
        folder: Folder that contains ``results``; None for that of the gallery.
        more: Further options by name, with their arguments for ``argparse``.

    Returns:
        The form of the command line; the full form in a notebook.
    """
    parser = argparse.ArgumentParser(prog=f"{name}.py")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for the results")
    parser.add_argument("--quick", action="store_true", help="as little as shows that it works, in seconds")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes for long work")
    for option, settings in more.items():
        parser.add_argument(f"--{option}", **settings)
    chosen = parser.parse_args([] if "ipykernel" in sys.modules else None)
    out = chosen.out
    if out is None and chosen.quick:
        out = Path(tempfile.mkdtemp(prefix=f"{name}_"))
    out = out or (folder or Path(__file__).parent) / "results" / name
    out.mkdir(parents=True, exist_ok=True)
    return ScriptOptions(
        out, chosen.quick, chosen.workers, {option: getattr(chosen, option) for option in more}
    )
