"""``twin-gait reproduce``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.runners import add_workers, workers_of
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from twin_gait.studies.reproduction.claim import Claim
    from twin_gait.studies.reproduction.running import ReproductionResult

WORKERS = 2  # unless the user says otherwise


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "reproduce",
        help="make the thesis's figures and tables again on the simulated bench",
        description=(
            "Make the figures and tables of the thesis again, from simulated benches, and put its numbers "
            "beside ours: each predicted or calibrated, with the band that a predicted one has to be in. "
            "Written: reproduction.html (one file, no network), reproduction.json, figures. Exits with 1 if "
            "a predicted number leaves its band."
        ),
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="KEY", help="figures, such as fig-3.7 (all)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to make")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of everything that is drawn (1)")
    add_workers(parser, WORKERS)
    parser.add_argument("--force", action="store_true", help="replace the folder of an earlier reproduction")
    parser.add_argument("--list", action="store_true", help="list the keys and make nothing")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make, write and print."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.parameters import require
    from twin_gait.runs.folders import staged_directory
    from twin_gait.simulation import RunStatus
    from twin_gait.studies.reproduction.recipes import find_recipes
    from twin_gait.studies.reproduction.running import run_recipes
    from twin_gait.studies.reproduction.writing import REPRODUCTION, write_reproduction

    recipes = find_recipes(arguments.only)
    if arguments.list:
        print("\n".join(f"{recipe.key:<14} {recipe.title}" for recipe in recipes))
        return DONE
    if arguments.out is None:
        raise ParameterError("--out: expected a folder to make, got none; --list shows what there is to make")
    require(arguments.seed >= 0, "--seed", "a whole number of 0 or more", arguments.seed)
    workers = workers_of(arguments, WORKERS)
    with staged_directory(arguments.out, REPRODUCTION, force=arguments.force) as folder:
        with stop_on_interrupt() as should_stop, progress_bar("reproducing", "figure") as progress:
            result = run_recipes(
                arguments.only,
                arguments.seed,
                workers=workers,
                progress=progress,
                should_stop=should_stop,
                on_compile=note_compilation,
            )
        write_reproduction(result, folder)
    print("\n".join(summary_lines(result)))
    print(arguments.out)
    if result.status is RunStatus.INTERRUPTED:
        print("twin-gait: interrupted; the figures so far are kept", file=sys.stderr)
        return INTERRUPTED
    return FAILED if result.failed else DONE


def summary_lines(result: ReproductionResult) -> Iterator[str]:
    """A line for each figure, then what a reader has to know: contradictions and failures.

    Args:
        result: The reproduction.

    Yields:
        The lines.
    """
    for item in result.made:
        judged = [claim for claim in item.claims if claim.holds is not None]
        held = sum(claim.holds is True for claim in judged)
        calibrated = len(item.claims) - len(judged)
        others = f", {calibrated} calibrated" if calibrated else ""
        yield f"{item.key:<14} {held} of {len(judged)} predicted in band{others:<15} {item.title}"
    for item in result.made:
        for claim in item.claims:
            if claim.contradicts:
                yield f"thesis outside the band: {item.key}, {_numbers(claim)}"
    for key, claim in result.failed:
        yield f"out of band: {key}, {_numbers(claim)}, band {claim.low:.4g} to {claim.high:.4g}"


def _numbers(claim: Claim) -> str:
    unit = "" if claim.unit == "1" else f" {claim.unit}"
    thesis = "no number" if claim.thesis is None else f"{claim.thesis:.4g}{unit}"
    return f"{claim.name}: thesis {thesis}, ours {claim.ours:.4g}{unit}"
