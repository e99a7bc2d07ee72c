"""``twin-gait whatif``."""

from __future__ import annotations

import argparse
import sys
import textwrap
from pathlib import Path
from typing import Any

from twin_gait.cli.runners import PROCESSORS, add_workers, workers_of
from twin_gait.cli.terminal import (
    DONE,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

STUDIES = {
    "friction-map": "G, true friction, filter delay and load: rest, limit cycle or runaway",
    "temperature": "friction that changes with temperature, age or load",
    "inertia": "inertia compensation from the encoder or an inertial unit",
}
FOLDER = Path("whatif")
_WIDTH = 100


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "whatif",
        help="studies of what the thesis leaves open: friction-map, temperature, inertia",
        description=(
            "Run a study on the simulated joint bench and write a folder with a figure, tables, a paragraph "
            "and one HTML page. All of it is simulated."
        ),
    )
    described = "; ".join(f"{name}: {what}" for name, what in STUDIES.items())
    parser.add_argument("study", choices=tuple(STUDIES), help=described)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to make (whatif/STUDY)")
    parser.add_argument("--quick", action="store_true", help="a small part of the grid, in a few seconds")
    parser.add_argument("--force", action="store_true", help="replace the folder of an earlier study")
    add_workers(parser, f"{PROCESSORS}; 1 with --quick")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the study, write its folder and print its paragraphs."""
    from twin_gait.runs.folders import check_target
    from twin_gait.studies.whatif.page import STUDY, write_report
    from twin_gait.studies.whatif.reports import report_on
    from twin_gait.studies.whatif.work import Interrupted, Means

    workers = workers_of(arguments, 1 if arguments.quick else PROCESSORS)
    out: Path = arguments.out if arguments.out is not None else FOLDER / arguments.study
    check_target(out, STUDY, force=arguments.force)
    try:
        with stop_on_interrupt() as should_stop, progress_bar(arguments.study, "row") as progress:
            means = Means(workers, progress, should_stop, note_compilation)
            report = report_on(arguments.study, means, quick=arguments.quick)
    except Interrupted as error:
        print(f"twin-gait: {error}", file=sys.stderr)
        return INTERRUPTED
    write_report(report, out, force=arguments.force)
    print("\n\n".join(textwrap.fill(text, _WIDTH) for text in report.text))
    print(f"\n{out}")
    return DONE
