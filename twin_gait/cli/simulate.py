"""``twin-gait simulate``."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import add_settings, add_wearer
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    clear_line,
    note_compilation,
    note_step,
    progress_bar,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from twin_gait.experiment import Experiment
    from twin_gait.simulation import Run


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "simulate",
        help="simulate a gait and keep the run",
        description="Simulate a preset or an experiment file and write a run directory.",
    )
    parser.add_argument("experiment", nargs="?", default="treadmill", help="preset or YAML file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="run directory (runs/<time>-<name>)")
    parser.add_argument("--force", action="store_true", help="replace an existing run directory")
    parser.add_argument("--duration", type=float, metavar="S", help="simulated time in seconds")
    parser.add_argument("--engine", help="compiled (the default), or pinocchio, the witness in Python")
    add_settings(parser, "change any value, for example patient.mass_kg=80 or table.blending.duration_ms=40")
    add_wearer(parser)
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:SIDE_JOINT@TIMEs",
        dest="faults",
        help="what breaks, and when, for example encoder_freeze:left_knee@4.2s; may be repeated",
    )
    parser.add_argument("--view", action="store_true", help="play the run in the browser afterwards")
    parser.add_argument("--no-pictures", action="store_true", help="leave out figures and animation")
    parser.add_argument("--fail-on-fall", action="store_true", help="exit with 1 if the wearer falls")
    parser.add_argument(
        "--accuracy",
        action="store_true",
        help="run again at a tenth of the step and report the difference (takes ten times as long)",
    )
    parser.add_argument(
        "--unchecked", action="store_true", help="run a gait table in which the check finds errors"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and write the run directory."""
    from twin_gait.configuration import load_experiment
    from twin_gait.runs.folders import staged_directory
    from twin_gait.runs.record import RUN_DIRECTORY, write_run
    from twin_gait.simulation import RunStatus, simulate
    from twin_gait.studies.accuracy import step_error

    settings = list(arguments.settings)
    if arguments.duration is not None:
        settings.append(f"duration_s={arguments.duration}")
    if arguments.engine is not None:
        settings.append(f"engine={arguments.engine}")
    if arguments.faults:
        settings.append(f"faults={json.dumps(arguments.faults)}")
    loaded = load_experiment(arguments.experiment, settings)
    loaded.experiment.build_world()
    if not arguments.unchecked:
        check_table(loaded.experiment, arguments.experiment, arguments.settings)
    out = arguments.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{loaded.experiment.name}"
    with (
        stop_on_interrupt() as should_stop,
        staged_directory(out, RUN_DIRECTORY, force=arguments.force) as staging,
    ):
        with progress_bar("simulating", "tick") as progress:
            result = simulate(
                loaded.experiment, progress=progress, should_stop=should_stop, on_compile=note_compilation
            )
        accuracy = None
        if arguments.accuracy and result.status is RunStatus.COMPLETED:
            with progress_bar("a tenth of the step", "tick") as progress:
                accuracy = step_error(result, progress=progress, should_stop=should_stop)
        summary = write_run(
            result,
            staging,
            document=loaded.document,
            pictures=not arguments.no_pictures,
            accuracy=accuracy,
            on_step=note_step,
        )
    clear_line()
    report(result, summary, out)
    if arguments.accuracy and accuracy is None:
        print(f"  no accuracy: the run {result.status}, and only completed ones are run again")
    if result.status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    if arguments.view:
        from twin_gait.cli.view import show_run

        show_run(result)
    if result.status is RunStatus.DIVERGED:
        return FAILED
    return FAILED if result.status is RunStatus.FELL and arguments.fail_on_fall else DONE


def check_table(experiment: Experiment, source: str, settings: Sequence[str]) -> None:
    """Stop at errors of the gait table, and say on one line how many warnings there are.

    Args:
        experiment: What is going to run.
        source: How the user named it.
        settings: What they laid over it.

    Raises:
        GaitTableError: If there is an error.
    """
    from twin_gait.checking.check import check_before_run, counts
    from twin_gait.cli.check import counted, heading
    from twin_gait.exceptions import GaitTableError

    note_step("nothing yet: checking the gait table")
    note_step("the gait table", "checking")
    findings = check_before_run(experiment)
    clear_line()
    if not findings:
        return
    numbers = {name: number for name, number in counts(findings).items() if number}
    words = [word for text in settings for word in ("--set", text)]
    table = f"gait table {experiment.table.name}: {counted(numbers)}"
    see = f"see {shlex.join(['twin-gait', 'check', '--experiment', source, *words])}"
    if "errors" in numbers:
        worst = findings[0]
        raise GaitTableError(
            f"{table}; {heading(worst)}: {worst.reason}; {see}; --unchecked runs it as it is"
        )
    print(f"{table}; {see}", file=sys.stderr)


def report(result: Run, summary: dict[str, Any], out: Path) -> None:
    """Print what came out, in a few lines."""
    from twin_gait.simulation import RunStatus

    pace = summary["realtime_factor"]
    ended = f"{result.status}, " if result.status is RunStatus.INTERRUPTED else ""
    word = result.verdict.outcome or result.status
    print(f"{ended}{word}: {result.duration:g} s in {result.wall_s:.1f} s ({pace:.1f} x real time)")
    if result.verdict.reason:
        print(f"  {result.verdict.reason}")
    for line in summary_lines(summary):
        print(f"  {line}")
    if "accuracy" in summary:
        print(f"  {accuracy_line(summary['accuracy'])}")
    print(f"  {out}")


def accuracy_line(accuracy: Mapping[str, Any]) -> str:
    """What a tenth of the step changes, in one line.

    Args:
        accuracy: Of :func:`~twin_gait.studies.accuracy.step_error`.
    """
    names = ("largest_angle_error_rad", "largest_angle_error_before_first_slip_rad")
    whole, before = (f"{math.degrees(accuracy[name]):.2g}°" for name in names)
    line = f"a tenth of the step ({accuracy['reference_step_s']:g} s) moves hip and knee by up to {whole}"
    if accuracy["first_slip_s"] is not None:
        line += f", {before} before the first switch in another tick at {accuracy['first_slip_s']:.3f} s"
    return line if accuracy["same_phase_order"] else f"{line}; the phases come in another order"


def summary_lines(summary: dict[str, Any]) -> Iterator[str]:
    """The figures that a reader wants first."""
    from twin_gait.measures.strides import stride_count

    for side, values in summary["sides"].items():
        found, counted = values.get("strides"), values.get("strides_counted")
        if found is None:
            continue
        if not counted:
            yield f"{side}: {stride_count(0, found)}"
            continue
        line = f"{side}: {stride_count(counted, found)} of {values['stride_time_mean_s']:.2f} s"
        if values["swing_share"] is not None:
            line = f"{line}, swing {values['swing_share'] * 100:.0f} %"
        hip, knee = values["rmse_hip_by_contact_deg"], values["rmse_knee_by_contact_deg"]
        if hip is not None:
            line = f"{line}, off the Koopman reference by {hip:.1f}° (hip) and {knee:.1f}° (knee) RMS"
        yield line
