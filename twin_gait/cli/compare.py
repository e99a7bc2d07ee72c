"""``twin-gait compare``."""

import argparse
import json
import sys
import textwrap
from pathlib import Path
from typing import Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, INTERRUPTED

# [s] of each run: assistance that adapts from stride to stride takes some twenty of them to settle.
DURATION = 60.0
FOLDER = Path("compare")
NAMES = "table, position, assist_as_needed, twincare, transparent, gravity, constant"
_WIDTH = 100


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "compare", run)
    add = parser.add_argument
    options.add_experiment(parser, seconds=f"{DURATION:g}")
    add("--controllers", metavar="NAME,…", help=f"names with commas between them (all that suit: {NAMES})")
    add(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="days that differ in weight, friction, belt and effort; from 2 on, means with intervals (1)",
    )
    options.add_out(parser, "DIR", f"folder to make ({FOLDER}/NAME)")
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Compare controllers on one wearer: one report.

    Simulate one wearer on the ground with several controllers and write a folder with one HTML page, its
    figure, and the numbers as CSV and JSON.
    """
    from twin_gait.runs.folders import check_target
    from twin_gait.studies.compare import comparing, writing

    names = list(comparing.CONTROLLERS)
    if arguments.controllers is not None:
        names = [name.strip() for name in arguments.controllers.split(",") if name.strip()]
    controllers = list(comparing.find_controllers(names))
    person = options.person_of(arguments.settings)
    who = person or "the wearer of the experiment"
    out: Path = arguments.out or FOLDER / (person or "wearer")
    check_target(out, writing.COMPARISON, force=arguments.force)
    experiment = options.experiment_of(arguments, f"duration_s={DURATION:g}").experiment
    if arguments.controllers is None:
        controllers = [item for item in controllers if item.suits(experiment)]
    try:
        with terminal.watched("compare", "run") as watch:
            comparison = comparing.compare(experiment, controllers, seeds=arguments.seeds, **watch)
    except comparing.ComparisonInterrupted as error:
        print(f"twin-gait: {error}", file=sys.stderr)
        return INTERRUPTED
    writing.write_comparison(comparison, who, out, force=arguments.force)
    text = "\n\n".join(textwrap.fill(text, _WIDTH) for text in writing.conclusions(comparison))
    terminal.answer(
        arguments,
        [text, "", str(out / writing.PAGE_FILE)],
        lambda: {**json.loads(writing.summary_text(comparison, who)), "directory": out},
    )
    return DONE
