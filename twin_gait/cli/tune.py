"""``twin-gait tune``."""

from __future__ import annotations

import argparse
import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.runners import add_runner, check_runner, runner_of
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    clear_line,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from twin_gait.studies.tune.tuning import Progress

_REFERENCE = re.compile(r"koopman@(\d+(?:\.\d+)?)")


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "tune",
        help="find the numbers of a gait table for one person",
        description=(
            "Screen the numbers of a gait table, search over those that matter, try the best tables on a "
            "robust set, and write the table with a report. It can be stopped at any time and goes on with "
            "--resume."
        ),
    )
    parser.add_argument("--patient", metavar="NAME", help="person that ships, or YAML file")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder of the tuning")
    parser.add_argument(
        "--reference", metavar="koopman@SPEED", help="healthy walk at a speed in km/h (that of the belt)"
    )
    parser.add_argument(
        "--experiment", default="treadmill", metavar="FILE", help="preset or YAML file (treadmill)"
    )
    parser.add_argument("--minutes", type=float, default=10.0, metavar="M", help="time for everything (10)")
    parser.add_argument(
        "--generations", type=int, metavar="N", help="end the search after so many, whatever the time"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all draws (0)")
    add_runner(parser)
    parser.add_argument("--resume", action="store_true", help="go on with a tuning that was stopped")
    parser.add_argument("--force", action="store_true", help="replace an earlier tuning")
    parser.add_argument("--no-screening", action="store_true", help="search over all numbers")
    parser.add_argument("--keep-thresholds", action="store_true", help="leave the transitions as they are")
    parser.add_argument("--keep-blending", action="store_true", help="leave the blend as it is")
    parser.add_argument(
        "--per-side", action="store_true", help="give each leg numbers of its own (hemiparesis)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="settings",
        help="change a value of the experiment, for example table=my_table.yaml",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Tune, and write what came out."""
    import json

    from twin_gait.configuration import load_experiment
    from twin_gait.exceptions import ParameterError
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import WorkersLost
    from twin_gait.studies.tune.settings import Settings
    from twin_gait.studies.tune.tune import tune
    from twin_gait.studies.tune.writing import write_tuning

    check_runner(arguments)
    if arguments.resume and arguments.force:
        raise ParameterError("--resume: does not go with --force, which begins anew")
    assignments = list(arguments.settings)
    if arguments.patient is not None:
        assignments.insert(0, f"patient={json.dumps(arguments.patient)}")
    experiment = load_experiment(arguments.experiment, assignments).experiment
    settings = Settings(
        reference_speed=_reference_speed(arguments.reference),
        minutes=arguments.minutes,
        generations=arguments.generations,
        seed=arguments.seed,
        screening=not arguments.no_screening,
        thresholds=not arguments.keep_thresholds,
        blending=not arguments.keep_blending,
        per_side=arguments.per_side,
    )
    again = f"the same command with --resume goes on from there: {arguments.out}"
    folder = None
    try:
        with runner_of(arguments) as workers, stop_on_interrupt() as should_stop:
            tuning = tune(
                experiment,
                arguments.out,
                settings,
                workers=workers,
                resume=arguments.resume,
                force=arguments.force,
                progress=_note,
                should_stop=should_stop,
                on_compile=note_compilation,
            )
            clear_line()
            if tuning.status is RunStatus.COMPLETED:
                with progress_bar("departures", "walk") as progress:
                    folder = write_tuning(
                        tuning,
                        experiment,
                        settings,
                        arguments.out,
                        wearer=_wearer(arguments, experiment),
                        workers=workers,
                        progress=progress,
                        should_stop=should_stop,
                    )
    except WorkersLost as error:
        print(f"twin-gait: {error}; what is done is kept, and {again}", file=sys.stderr)
        return FAILED
    if folder is None:
        print(f"twin-gait: interrupted; {again}", file=sys.stderr)
        return INTERRUPTED
    report(folder.outcome, folder.directory)
    return DONE


def report(outcome: dict[str, Any], directory: Path) -> None:
    """Print what came out, in a few lines."""
    from twin_gait.report.tune_page import convergence_words, summary

    for text in (*summary(outcome), convergence_words(outcome)):
        print(text)
    print(f"  {directory}")


def _reference_speed(text: str | None) -> float | None:
    """Speed of the reference in [m] / [s]."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.measures.reference import KILOMETRES_PER_HOUR

    if text is None:
        return None
    found = _REFERENCE.fullmatch(text)
    if found is None:
        raise ParameterError(f"--reference {text!r}: expected koopman@SPEED in km/h, for example koopman@1.5")
    return float(found.group(1)) / KILOMETRES_PER_HOUR


def _wearer(arguments: argparse.Namespace, experiment: Any) -> str:
    patient = experiment.patient
    size = f"{patient.mass:g} kg, {patient.height:g} m, {patient.sex}"
    return size if arguments.patient is None else f"{Path(arguments.patient).stem} ({size})"


def _note(step: Progress) -> None:
    """One line on a terminal: the stage and the best gait so far."""
    if not sys.stderr.isatty():
        return
    total = "" if step.total is None else f" of {step.total}"
    line = f"{step.elapsed / 60.0:4.1f} min  {step.stage} {step.done}{total}"
    if math.isfinite(step.best_cost):
        line += f"  best: cost {step.best_cost:.2f} (from {step.start_cost:.2f})"
    hip, knee = (step.best_values.get(f"{joint}_error_deg") for joint in ("hip", "knee"))
    if hip is not None and knee is not None:
        line += f", hip {hip:.1f}°, knee {knee:.1f}°"
    print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
