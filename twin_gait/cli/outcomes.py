"""``twin-gait map``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.options import add_settings, check_file
from twin_gait.cli.runners import add_workers, workers_of
from twin_gait.cli.terminal import DONE, progress_bar


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "map",
        help="print who walks: outcomes over mass, height, speed and support",
        description=(
            "Simulate a treadmill experiment over 55-95 kg, 1.60-1.90 m, 0.30-0.42 m/s and 40-70 % support "
            "and print a map of the outcomes, failures included."
        ),
    )
    parser.add_argument("experiment", nargs="?", default="treadmill", help="preset or YAML file")
    add_settings(parser)
    add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the table as CSV")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate the grid and print the map."""
    from twin_gait.configuration import load_experiment
    from twin_gait.files import write_atomically
    from twin_gait.studies.people.outcome_map import draw_map, experiment_of, grid, map_outcomes
    from twin_gait.vocabulary import Outcome

    workers = workers_of(arguments)
    if arguments.out is not None:
        check_file("--out", arguments.out, force=arguments.force)
    base = load_experiment(arguments.experiment, arguments.settings).experiment
    cases = grid()
    experiment_of(base, cases[0])
    with progress_bar("walking", "case") as progress:
        table = map_outcomes(base, cases, workers=workers, progress=progress)
    walking = (table["outcome"] == Outcome.WALKED).mean()
    print(f"{base.name}, {base.duration:g} s each, {len(table)} cases: {walking:.0%} walked")
    print(draw_map(table))
    if arguments.out is not None:
        write_atomically(arguments.out, table.to_csv(index=False, lineterminator="\n"))
    return DONE
