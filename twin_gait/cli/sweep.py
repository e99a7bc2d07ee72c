"""``twin-gait sweep``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED

if TYPE_CHECKING:
    from twin_gait.studies.sweep.sweep import SweepResult


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "sweep", run)
    add = parser.add_argument
    add("spec", type=Path, metavar="SPEC", help="YAML file, such as examples/sweep.yaml")
    add("--out", type=Path, metavar="DIR", required=True, help="folder of the sweep")
    options.add_settings(parser)
    options.add_unchecked(parser)
    options.add_runner(parser)
    options.add_no_pictures(parser)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate an experiment over any of its parameters.

    Simulate a grid, a Latin hypercube or a list of episodes, on this machine or a Dask cluster. The same
    command goes on with a sweep that was stopped or killed.
    """
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import WorkersLost
    from twin_gait.studies.sweep.spec import load_sweep
    from twin_gait.studies.sweep.sweep import run_sweep

    options.workers_of(arguments)
    sweep = load_sweep(arguments.spec, arguments.settings)
    if not arguments.unchecked:
        options.check_table(sweep.experiment)
    again = f"the same command goes on from there: {arguments.out}"
    try:
        with (
            options.runner_of(arguments) as workers,
            terminal.progress_bar("checking", "episode") as checking,
            terminal.watched("sweeping", "episode") as watch,
        ):
            result = run_sweep(
                sweep,
                arguments.out,
                workers=workers,
                pictures=not arguments.no_pictures,
                checking=checking,
                **watch,
            )
    except WorkersLost as error:
        print(f"twin-gait: {error}; what is done is kept, and {again}", file=sys.stderr)
        return FAILED
    document = {"status": str(result.status), **result.summary, "directory": result.directory}
    terminal.answer(arguments, report(result), lambda: document)
    return terminal.interrupted(again) if result.status is RunStatus.INTERRUPTED else DONE


def report(result: SweepResult) -> Iterator[str]:
    """Results in a few lines."""
    summary, last = result.summary, result.summary["last_call"]
    yield f"{result.status}: {summary['finished']} of {summary['episodes']} episodes"
    if result.resumed:
        yield f"  {result.resumed} were there already"
    yield "  " + ", ".join(f"{count} {name}" for name, count in summary["outcomes"].items())
    if last["episodes"]:
        yield f"  {last['wall_s']:.1f} s for {last['episodes']} of them"
    if result.not_drawn:
        yield f"  not drawn, because no completed episode has it: {', '.join(result.not_drawn)}"
    yield f"  {result.directory}"
