"""``twin-gait faults``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED, INTERRUPTED

if TYPE_CHECKING:
    from twin_gait.experiment import Experiment
    from twin_gait.studies import FaultCampaign

DURATION = 8.0  # [s] of each run: the gait is under way after one, and a fault shows within two


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "faults", run)
    add = parser.add_argument
    options.add_experiment(parser, seconds=f"{DURATION:g}")
    add("--count", type=int, default=100, metavar="N", help="faults (100)")
    options.add_seed(parser)
    options.add_workers(parser)
    options.add_out(parser, "FILE", "also write one row per fault as CSV")
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Inject seeded faults and tabulate the outcomes.

    Simulate an experiment once for each of many seeded faults of encoders, motors, controller, load sensors
    and supply, and print a table of the outcomes. Exits with 1 if a limit was broken, a value is empty, or a
    trip did not end in the hold.
    """
    from twin_gait.files import write_atomically
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import draw_faults, simulate_faults

    workers = options.workers_of(arguments)
    if arguments.out is not None:
        options.check_file("--out", arguments.out, force=arguments.force)
    base = options.experiment_of(arguments, f"duration_s={DURATION:g}").experiment
    faults = draw_faults(base, arguments.count, arguments.seed)
    with terminal.watched("faults", "fault") as watch:
        campaign = simulate_faults(base, faults, workers=workers, **watch)
    violations = list(campaign.violations["fault"]) if len(campaign.table) else []
    document = {
        "experiment": base.name,
        "duration_s": base.duration,
        "seed": arguments.seed,
        "status": str(campaign.status),
        "violations": violations,
        "faults": campaign.table.to_dict("records"),
    }
    terminal.answer(arguments, report(base, campaign, arguments.seed, violations), lambda: document)
    if len(campaign.table) and arguments.out is not None:
        text = campaign.table.to_csv(index=False, lineterminator="\n", float_format="%.6g")
        write_atomically(arguments.out, text)
    if campaign.status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    return FAILED if violations else DONE


def report(base: Experiment, campaign: FaultCampaign, seed: int, violations: list[str]) -> Iterator[str]:
    """Outcomes by kind of fault, and what must hold."""
    from twin_gait.studies.fault_campaign import limit_lines, outcome_table

    yield f"{base.name}, {base.duration:g} s each, {len(campaign.table)} faults, seed {seed}"
    if len(campaign.table):
        yield outcome_table(campaign.table).to_string(index=False)
        yield from limit_lines(campaign.table)
    if violations:
        yield f"broken: {', '.join(violations[:5])}"
