"""``twin-gait tune``."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED

if TYPE_CHECKING:
    from twin_gait.experiment import Experiment
    from twin_gait.studies.tune.state import Progress


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "tune", run)
    add = parser.add_argument
    options.add_experiment(parser, seconds=None)
    options.add_out(parser, "DIR", "folder of the tuning", required=True)
    add("--resume", action="store_true", help="go on with a tuning that was stopped")
    add("--reference", metavar="koopman@SPEED", help="healthy gait at a speed in km/h (that of the belt)")
    add("--minutes", type=float, default=3.0, metavar="M", help="time for everything (3)")
    add("--generations", type=int, metavar="N", help="end the search after so many, whatever the time")
    add("--keep-thresholds", action="store_true", help="leave the transitions as they are")
    add("--keep-blending", action="store_true", help="leave the blend as it is")
    add("--per-side", action="store_true", help="give each leg numbers of its own (hemiparesis)")
    add("--everyone", action="store_true", help="a table for other wearers, supports and belts too")
    options.add_seed(parser)
    options.add_runner(parser)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Tune a gait table to one person.

    Search for the numbers of a gait table, try the best tables on a robust set, and write the best with a
    report. It can be stopped at any time and goes on with --resume.
    """
    from twin_gait.exceptions import ParameterError
    from twin_gait.report.tune import summary
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import WorkersLost
    from twin_gait.studies.tune.outcome import write_tuning
    from twin_gait.studies.tune.state import Settings
    from twin_gait.studies.tune.tune import tune

    options.workers_of(arguments)
    if arguments.resume and arguments.force:
        raise ParameterError("--resume: does not go with --force, which begins anew")
    experiment = options.experiment_of(arguments).experiment
    settings = Settings(
        reference_speed=_reference_speed(arguments.reference),
        minutes=arguments.minutes,
        generations=arguments.generations,
        seed=arguments.seed,
        thresholds=not arguments.keep_thresholds,
        blending=not arguments.keep_blending,
        per_side=arguments.per_side,
        everyone=arguments.everyone,
    )
    again = f"the same command with --resume goes on from there: {arguments.out}"
    outcome = None
    try:
        with options.runner_of(arguments) as workers, terminal.stop_on_interrupt() as should_stop:
            tuning = tune(
                experiment,
                arguments.out,
                settings,
                workers=workers,
                resume=arguments.resume,
                force=arguments.force,
                progress=partial(_note, experiment.joints),
                should_stop=should_stop,
                on_compile=terminal.note_compilation,
            )
            terminal.clear_line()
            if tuning.status is RunStatus.COMPLETED:
                with terminal.progress_bar("departures", "walk") as progress:
                    outcome = write_tuning(
                        tuning,
                        experiment,
                        settings,
                        arguments.out,
                        wearer=_wearer(options.person_of(arguments.settings), experiment),
                        workers=workers,
                        progress=progress,
                        should_stop=should_stop,
                    )
    except WorkersLost as error:
        print(f"twin-gait: {error}; what is done is kept, and {again}", file=sys.stderr)
        return FAILED
    if outcome is None:
        return terminal.interrupted(again)
    lines = [*summary(outcome), f"  {arguments.out}"]
    terminal.answer(arguments, lines, lambda: {**outcome, "directory": arguments.out})
    return DONE


def _reference_speed(text: str | None) -> float | None:
    """Speed of the reference in [m] / [s]."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.measures.reference import KILOMETRES_PER_HOUR

    if text is None:
        return None
    found = re.fullmatch(r"koopman@(\d+(?:\.\d+)?)", text)
    if found is None:
        raise ParameterError(f"--reference {text!r}: expected koopman@SPEED in km/h, for example koopman@1.5")
    return float(found.group(1)) / KILOMETRES_PER_HOUR


def _wearer(person: str | None, experiment: Experiment) -> str:
    patient = experiment.patient
    size = "" if patient is None else f"{patient.mass:g} kg, {patient.height:g} m, {patient.sex}"
    return size if person is None else f"{person} ({size})"


def _note(joints: Sequence[str], step: Progress) -> None:
    """One line on a terminal: the stage and the best gait so far."""
    total = "" if step.total is None else f" of {step.total}"
    line = f"{step.elapsed / 60.0:4.1f} min  {step.stage} {step.done}{total}"
    if step.best_cost < float("inf"):
        line += f"  best: cost {step.best_cost:.2f} (from {step.start_cost:.2f})"
    errors = {joint: step.best_values.get(f"{joint}_error_deg") for joint in joints}
    line += "".join(f", {joint} {error:.1f}°" for joint, error in errors.items() if error is not None)
    terminal.note_line(line)
