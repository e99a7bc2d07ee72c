"""``twin-gait sweep``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import add_settings
from twin_gait.cli.runners import add_runner, check_runner, runner_of
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from twin_gait.studies.sweep.sweep import SweepResult


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "sweep",
        help="simulate an experiment over any of its parameters",
        description=(
            "Simulate a grid, a Latin hypercube or a list of episodes, on this machine or a Dask cluster. "
            "The same command goes on with a sweep that was stopped or killed."
        ),
    )
    parser.add_argument("spec", type=Path, metavar="SPEC", help="YAML file, such as examples/sweep.yaml")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder of the sweep")
    add_runner(parser)
    parser.add_argument(
        "--chunk-seconds", type=float, default=2.0, metavar="S", help="work handed over at a time (2)"
    )
    parser.add_argument("--no-pictures", action="store_true", help="leave out the figures")
    add_settings(parser, "change a value of every episode, for example duration_s=5")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the sweep, or go on with it."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import WorkersLost
    from twin_gait.studies.sweep.spec import load_sweep
    from twin_gait.studies.sweep.sweep import run_sweep

    check_runner(arguments)
    if not 0.0 < arguments.chunk_seconds < float("inf"):
        raise ParameterError(f"--chunk-seconds: expected a number above 0, got {arguments.chunk_seconds}")
    sweep = load_sweep(arguments.spec, arguments.settings)
    again = f"the same command goes on from there: {arguments.out}"
    try:
        with (
            runner_of(arguments) as workers,
            stop_on_interrupt() as should_stop,
            progress_bar("checking", "episode") as checking,
            progress_bar("sweeping", "episode") as progress,
        ):
            result = run_sweep(
                sweep,
                arguments.out,
                workers=workers,
                chunk_seconds=arguments.chunk_seconds,
                pictures=not arguments.no_pictures,
                checking=checking,
                progress=progress,
                should_stop=should_stop,
                on_compile=note_compilation,
            )
    except WorkersLost as error:
        print(f"twin-gait: {error}; what is done is kept, and {again}", file=sys.stderr)
        return FAILED
    report(result)
    if result.status is RunStatus.INTERRUPTED:
        print(f"twin-gait: interrupted; {again}", file=sys.stderr)
        return INTERRUPTED
    return DONE


def report(result: SweepResult) -> None:
    """Print what came out, in a few lines."""
    summary, last = result.summary, result.summary["last_call"]
    print(f"{result.status}: {summary['finished']} of {summary['episodes']} episodes")
    if result.resumed:
        print(f"  {result.resumed} were there already")
    print("  " + ", ".join(f"{count} {name}" for name, count in summary["outcomes"].items()))
    if last["episodes"]:
        pace = last["worker_s_per_episode"]
        print(f"  {last['wall_s']:.1f} s, {pace:.3g} s of a worker's time per episode")
    if result.not_drawn:
        print(f"  not drawn, because no completed episode has it: {', '.join(result.not_drawn)}")
    print(f"  {result.directory}")
