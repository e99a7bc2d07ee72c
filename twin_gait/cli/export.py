"""``twin-gait export``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import DONE

if TYPE_CHECKING:
    from twin_gait.conventions import Convention
    from twin_gait.runs.record import StoredRun

DEFAULT_CONVENTION = "opensim_gait2392"
MODELS = (DEFAULT_CONVENTION, "rajagopal")
CSV, FOLDER = "csv", "opensim"
FORMATS = (CSV, "mot", "sto", FOLDER)


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "export",
        help="write the log of a run in another format",
        description=(
            "Write the log of a run directory as CSV (every column), its joint angles as a motion of "
            "OpenSim (.mot in degrees, .sto in radians), or all that OpenSim's inverse dynamics needs: a "
            "folder with model, motion, external loads, set-up, and the joint moments to compare with."
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
    parser.add_argument(
        "--of",
        choices=["wearer", "device"],
        default="wearer",
        help="whose angles a motion has where braces let the two move apart (the wearer's)",
    )
    parser.add_argument("--out", type=Path, metavar="PATH", help="to write (RUN/log.FORMAT, or RUN/opensim)")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Export the log."""
    from twin_gait.conventions import find_convention
    from twin_gait.exceptions import ParameterError
    from twin_gait.runs.record import load_run

    kind = arguments.format or _format_of(arguments.out, arguments.convention)
    if kind == CSV and arguments.convention is not None:
        raise ParameterError("--convention: CSV keeps this package's own names and signs; leave it out")
    stored = load_run(arguments.directory)
    convention = find_convention(arguments.convention or DEFAULT_CONVENTION)
    device = arguments.of == "device"
    path = arguments.out or arguments.directory / (FOLDER if kind == FOLDER else f"log.{kind}")
    if kind == FOLDER:
        return _write_folder(stored, path, convention, device=device, force=arguments.force)
    check_file("--out", path, force=arguments.force)
    return _write_file(stored, path, kind, convention, device=device)


def _format_of(path: Path | None, convention: str | None) -> str:
    """The format that a file's name says; a convention asks for a motion, anything else is CSV."""
    suffix = "" if path is None else path.suffix.removeprefix(".").lower()
    return suffix if suffix in FORMATS else CSV if convention is None else "mot"


def _write_file(stored: StoredRun, path: Path, kind: str, convention: Convention, *, device: bool) -> int:
    from twin_gait.conventions import DEGREES, RADIANS
    from twin_gait.export import export_csv, export_motion

    columns = list(stored.log.columns)
    if kind == CSV:
        export_csv(stored.log, path)
    else:
        unit = DEGREES if kind == "mot" else RADIANS
        columns = export_motion(stored.log, path, convention, unit=unit, device=device)
    print(f"{len(stored.log)} rows, {len(columns)} columns: {path}")
    return DONE


def _write_folder(stored: StoredRun, path: Path, convention: Convention, *, device: bool, force: bool) -> int:
    from twin_gait.export import export_inverse_dynamics
    from twin_gait.export.inverse_dynamics import MODEL_FILE, SETUP_FILE
    from twin_gait.runs.folders import FolderKind, staged_directory

    kind = FolderKind("a folder of this command", MODEL_FILE)
    with staged_directory(path, kind, force=force) as staging:
        names = export_inverse_dynamics(stored.run, staging, convention, device=device)
    print(f"{len(stored.log)} rows, {', '.join(names)}: {path}")
    print(f"in that folder: opensim-cmd run-tool {SETUP_FILE}")
    return DONE
