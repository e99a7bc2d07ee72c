"""``twin-gait compare``."""

from __future__ import annotations

import argparse
import sys
import textwrap
from pathlib import Path
from typing import Any

from twin_gait.cli.options import add_settings, add_wearer
from twin_gait.cli.terminal import (
    DONE,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

# [s] of each run: help that adapts from stride to stride takes some twenty of them to settle.
DURATION = 60.0
FOLDER = Path("compare")
NAMES = "table, position, assist_as_needed, twincare, transparent, gravity, constant"
_WIDTH = 100


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "compare",
        help="the same wearer with several controllers: one report",
        description=(
            "Let a wearer walk on the treadmill with several controllers and write a folder with one HTML "
            "page, its figure, and the numbers as CSV and JSON. All of it is simulated."
        ),
    )
    parser.add_argument("experiment", nargs="?", default="treadmill", help="preset or YAML file (treadmill)")
    parser.add_argument("--patient", metavar="WHO", help="who walks: a person by name, or a file")
    parser.add_argument(
        "--controllers", metavar="NAMES", help=f"names with commas between them (all: {NAMES})"
    )
    parser.add_argument(
        "--duration", type=float, default=DURATION, metavar="S", help=f"of each run in seconds ({DURATION:g})"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="days that differ in weight, friction, belt and effort; from 2 on, means with intervals (1)",
    )
    add_settings(parser)
    add_wearer(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to make (compare/WHO)")
    parser.add_argument("--force", action="store_true", help="replace the folder of an earlier comparison")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare, write the folder and print what it says."""
    from twin_gait.configuration import load_experiment
    from twin_gait.runs.folders import check_target
    from twin_gait.studies.compare.comparing import (
        CONTROLLERS,
        ComparisonInterrupted,
        compare,
        find_controllers,
    )
    from twin_gait.studies.compare.writing import COMPARISON, PAGE_FILE, conclusions, write_comparison

    names = list(CONTROLLERS)
    if arguments.controllers is not None:
        names = [name.strip() for name in arguments.controllers.split(",") if name.strip()]
    controllers = find_controllers(names)
    who = Path(arguments.patient).stem if arguments.patient else "the wearer of the experiment"
    out: Path = arguments.out or FOLDER / (Path(arguments.patient).stem if arguments.patient else "wearer")
    check_target(out, COMPARISON, force=arguments.force)
    settings = [f"patient={arguments.patient}"] if arguments.patient else []
    settings += [f"duration_s={arguments.duration}", *arguments.settings]
    experiment = load_experiment(arguments.experiment, settings).experiment
    try:
        with stop_on_interrupt() as should_stop, progress_bar("compare", "run") as progress:
            comparison = compare(
                experiment,
                controllers,
                seeds=arguments.seeds,
                progress=progress,
                should_stop=should_stop,
                on_compile=note_compilation,
            )
    except ComparisonInterrupted as error:
        print(f"twin-gait: {error}", file=sys.stderr)
        return INTERRUPTED
    write_comparison(comparison, who, out, force=arguments.force)
    print("\n\n".join(textwrap.fill(text, _WIDTH) for text in conclusions(comparison)))
    print(f"\n{out / PAGE_FILE}")
    return DONE
