"""``twin-gait clean``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from twin_gait.cli.terminal import DONE, FAILED


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "clean",
        help="remove what killed runs have left behind",
        description="List the incomplete, hidden folders of runs that were killed, ask, and remove them.",
    )
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs"), metavar="DIR", help="(runs)")
    parser.add_argument("--yes", action="store_true", help="remove them without asking")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """List, ask and remove."""
    from twin_gait.exceptions import RunDirectoryError
    from twin_gait.runs.folders import abandoned, remove_abandoned

    folder = arguments.folder.expanduser()
    if not folder.is_dir():
        raise RunDirectoryError(f"{folder}: no such folder")
    found = abandoned(folder)
    for path in found:
        size = sum(item.stat().st_size for item in path.rglob("*") if item.is_file())
        print(f"{path}  {size / 1e6:.1f} MB")
    if not found:
        print(f"nothing of killed runs in {folder}")
        return DONE
    if not arguments.yes and not _agreed():
        print("nothing was removed (--yes removes them)")
        return FAILED
    for path in found:
        remove_abandoned(path)
    return DONE


def _agreed() -> bool:
    return sys.stdin.isatty() and input("remove them? [y/N] ").strip().lower() in ("y", "yes")
