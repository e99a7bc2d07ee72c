"""``twin-gait export``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import DONE

DEFAULT_CONVENTION = "opensim_gait2392"
FORMATS = ("csv", "mot", "sto")
MODELS = (DEFAULT_CONVENTION, "rajagopal")


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "export",
        help="write the log of a run in another format",
        description=(
            "Write the log of a run directory as CSV (every column), or its joint angles as a motion of "
            "OpenSim: .mot in degrees, .sto in radians."
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="run directory")
    parser.add_argument(
        "--format",
        "--to",
        choices=FORMATS,
        dest="format",
        help="format; without it that of --out's ending, mot with --convention, else csv",
    )
    parser.add_argument(
        "--convention",
        choices=MODELS,
        help=f"model whose names and signs a motion has ({DEFAULT_CONVENTION})",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (RUN/log.FORMAT)")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Export the log."""
    from twin_gait.conventions import DEGREES, RADIANS, find_convention
    from twin_gait.exceptions import ParameterError
    from twin_gait.export import export_csv, export_motion
    from twin_gait.studies.record import load_run

    if arguments.format is None:
        ending = "" if arguments.out is None else arguments.out.suffix.removeprefix(".").lower()
        default = FORMATS[0] if arguments.convention is None else "mot"
        arguments.format = ending if ending in FORMATS else default
    if arguments.format == "csv" and arguments.convention is not None:
        raise ParameterError("--convention: CSV keeps this package's own names and signs; leave it out")
    stored = load_run(arguments.directory)
    path = arguments.out or arguments.directory / f"log.{arguments.format}"
    check_file("--out", path, force=arguments.force)
    columns = list(stored.log.columns)
    if arguments.format == "csv":
        export_csv(stored.log, path)
    else:
        unit = DEGREES if arguments.format == "mot" else RADIANS
        convention = find_convention(arguments.convention or DEFAULT_CONVENTION)
        columns = export_motion(stored.log, path, convention, unit=unit)
    print(f"{len(stored.log)} rows, {len(columns)} columns: {path}")
    return DONE
