"""What the scripts of the gallery share: where their results go, and whether a quick form is wanted.

``python examples/NAME.py`` writes into ``examples/results/NAME``; ``--out`` takes another folder. ``--quick``
does as little as shows that the script works, in seconds, and writes into a temporary folder unless told
otherwise. Cells run one by one in an editor or notebook do as the script does without arguments.
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
    """How a script is run.

    Attributes:
        out: Folder of its results; it exists.
        quick: Whether to do as little as shows that it works.
        workers: Processes for long work.
        more: What else its command line says, by the names of :func:`form_of`.
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
        name: Of the script, without .py.
        folder: The folder that holds ``results``; the gallery's if None.
        more: Options of its own, by name, with what ``argparse`` is to know of them.

    Returns:
        What it is asked for; the full form in a notebook.
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
