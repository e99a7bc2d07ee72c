"""``twin-gait faults``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.options import add_settings, add_wearer, check_file
from twin_gait.cli.runners import add_workers, workers_of
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

DURATION = 8.0  # [s] of each run: the gait is under way after one, and a fault shows within two


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "faults",
        help="strike a gait with seeded faults and print what came of them",
        description=(
            "Simulate an experiment once for each of many seeded faults of encoders, motors, controller, "
            "load sensors and supply, and print a table of the outcomes. Exits with 1 if a limit was broken, "
            "a value is empty, or a trip did not end in the hold in time."
        ),
    )
    parser.add_argument("experiment", nargs="?", default="treadmill", help="preset or YAML file")
    parser.add_argument("--count", type=int, default=100, metavar="N", help="faults (100)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the draws (0)")
    parser.add_argument("--duration", type=float, default=DURATION, metavar="S", help="of each run (8 s)")
    add_settings(parser)
    add_wearer(parser)
    add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write one row per fault as CSV")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the campaign and print the table of outcomes."""
    from twin_gait.configuration import load_experiment
    from twin_gait.files import write_atomically
    from twin_gait.simulation import RunStatus
    from twin_gait.studies.faults.faults import draw_faults, limit_lines, outcome_table, run_campaign

    workers = workers_of(arguments)
    if arguments.out is not None:
        check_file("--out", arguments.out, force=arguments.force)
    settings = [*arguments.settings, f"duration_s={arguments.duration}"]
    base = load_experiment(arguments.experiment, settings).experiment
    faults = draw_faults(base, arguments.count, arguments.seed)
    with stop_on_interrupt() as should_stop, progress_bar("faults", "fault") as progress:
        campaign = run_campaign(
            base,
            faults,
            workers=workers,
            progress=progress,
            should_stop=should_stop,
            on_compile=note_compilation,
        )
    print(f"{base.name}, {base.duration:g} s each, {len(campaign.table)} faults, seed {arguments.seed}")
    if len(campaign.table):
        print(outcome_table(campaign.table))
        print("\n".join(limit_lines(campaign)))
        if arguments.out is not None:
            text = campaign.table.to_csv(index=False, lineterminator="\n", float_format="%.6g")
            write_atomically(arguments.out, text)
    if campaign.status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    if len(campaign.violations):
        print(f"broken: {', '.join(campaign.violations['fault'].head(5))}")
        return FAILED
    return DONE
