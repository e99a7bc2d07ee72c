"""``twin-gait benchmark``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.terminal import DONE, FAILED, progress_bar
from twin_gait.studies.benchmark.table import DOCUMENT, PICTURE


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "benchmark",
        help="time the engines beside MuJoCo and a plain Python script",
        description=(
            "Time the compiled engine, the Pinocchio engine, a plain script and MuJoCo in turn in one "
            "process, with the accuracy of each. Compiles for a minute or two the first time."
        ),
    )
    parser.add_argument("--only", metavar="SUBJECT", help="one subject, without the scaling")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds")
    parser.add_argument("--check", action="store_true", help="end with 1 if a ratio is missed")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"also write {DOCUMENT} and {PICTURE}")
    parser.add_argument("--force", action="store_true", help="replace existing files")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the benchmark and print the tables."""
    from twin_gait.studies.benchmark.benchmark import QUICK, Extent, benchmark
    from twin_gait.studies.benchmark.ratios import all_met, judge
    from twin_gait.studies.benchmark.table import draw_benchmark

    if arguments.out is not None:
        _check_folder(arguments.out, force=arguments.force)
    extent = QUICK if arguments.quick else Extent()
    with progress_bar("timing", "run") as progress:
        document = benchmark(arguments.only, extent, progress=progress)
    print(draw_benchmark(document))
    if arguments.out is not None:
        _write(document, arguments.out)
    return FAILED if arguments.check and not all_met(judge(document)) else DONE


def _check_folder(folder: Path, *, force: bool) -> None:
    from twin_gait.exceptions import RunDirectoryError

    if folder.exists() and not folder.is_dir():
        raise RunDirectoryError(f"{folder}: is a file; give a folder")
    for name in (DOCUMENT, PICTURE):
        if (folder / name).exists() and not force:
            raise RunDirectoryError(f"{folder / name}: exists; choose another, or replace it with --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"{folder}: cannot be made ({error.strerror})") from error


def _write(document: dict[str, Any], folder: Path) -> None:
    import json

    from twin_gait.files import write_atomically
    from twin_gait.report.benchmark import draw_benchmark_figure
    from twin_gait.report.canvas import picture_bytes

    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(folder / DOCUMENT, f"{text}\n")
    write_atomically(folder / PICTURE, picture_bytes(draw_benchmark_figure(document)))
