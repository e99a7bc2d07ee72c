"""``twin-gait export``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.terminal import DONE


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "export",
        help="write the log of a run in another format",
        description="Write the log of a run directory in another format.",
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="run directory")
    parser.add_argument("--to", choices=["csv"], required=True, help="format")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (RUN/log.csv)")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Export the log."""
    from twin_gait.exceptions import RunDirectoryError
    from twin_gait.export import export_csv
    from twin_gait.studies.record import load_run

    stored = load_run(arguments.directory)
    path = arguments.out or arguments.directory / f"log.{arguments.to}"
    if path.exists() and not arguments.force:
        raise RunDirectoryError(f"{path}: exists; choose another --out, or replace it with --force")
    export_csv(stored.log, path)
    print(f"{len(stored.log)} rows, {len(stored.log.columns)} columns: {path}")
    return DONE
