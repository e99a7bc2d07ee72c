"""``twin-gait simulate``."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED, INTERRUPTED

if TYPE_CHECKING:
    from twin_gait.runs.drawing import DrawingProcesses
    from twin_gait.simulation import Run


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "simulate", run)
    add = parser.add_argument
    options.add_experiment(parser, seconds="that of the experiment")
    options.add_seed(parser, of_experiment=True)
    options.add_out(parser, "DIR", "run directory (runs/<time>-<name>)")
    add(
        "--engine",
        action="append",
        dest="settings",
        type=lambda name: f"engine={name}",
        metavar="NAME",
        help="compiled (the default), or pinocchio, the reference implementation in Python",
    )
    add(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:SIDE_JOINT@TIMEs",
        dest="faults",
        help="what fails, and when, such as encoder_freeze:left_knee@4.2s; may be repeated",
    )
    add("--view", action="store_true", help="play the run in the browser afterwards")
    options.add_no_pictures(parser)
    add("--fail-on-fall", action="store_true", help="exit with 1 if the wearer falls")
    add(
        "--accuracy",
        action="store_true",
        help="run again at a tenth of the step and report the difference (takes ten times as long)",
    )
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate a gait and keep the run.

    Simulate a preset or an experiment file and write a run directory.
    """
    from twin_gait.runs.drawing import drawing_processes

    with drawing_processes(wanted=not arguments.no_pictures) as drawing:
        return _simulate(arguments, drawing)


def _simulate(arguments: argparse.Namespace, drawing: DrawingProcesses) -> int:

    from twin_gait.runs.folders import staged_directory
    from twin_gait.runs.record import RUN_DIRECTORY, write_run
    from twin_gait.simulation import RunStatus, simulate

    if arguments.faults:
        arguments.settings = [*arguments.settings, f"faults={json.dumps(arguments.faults)}"]
    loaded = options.experiment_of(arguments)
    out = arguments.out or default_folder(loaded.experiment.name)
    with (
        terminal.stop_on_interrupt() as should_stop,
        staged_directory(out, RUN_DIRECTORY, force=arguments.force) as staging,
    ):
        with terminal.watched("simulating", "tick", should_stop) as watch:
            result = simulate(loaded.experiment, **watch)
        accuracy = None
        if arguments.accuracy and result.status is RunStatus.COMPLETED:
            from twin_gait.studies.accuracy import step_error

            with terminal.progress_bar("a tenth of the step", "tick") as progress:
                accuracy = step_error(result, progress=progress, should_stop=should_stop)
        summary = write_run(
            result,
            staging,
            document=loaded.document,
            pictures=not arguments.no_pictures,
            accuracy=accuracy,
            on_step=terminal.note_step,
            drawing_processes=drawing,
        )
    terminal.clear_line()
    lines = list(report(result, summary, out))
    if arguments.accuracy and accuracy is None:
        lines.append(f"  no accuracy: the run {result.status}, and only completed ones are run again")
    terminal.answer(arguments, lines, lambda: {**summary, "directory": out})
    if result.status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    if arguments.view:
        from twin_gait.cli.view import show_run

        with contextlib.redirect_stdout(sys.stderr) if arguments.json else contextlib.nullcontext():
            show_run(result)
    if result.status is RunStatus.DIVERGED:
        return FAILED
    return FAILED if result.status is RunStatus.FELL and arguments.fail_on_fall else DONE


def default_folder(name: str) -> Path:
    """Where a run goes without ``--out``."""
    return Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}"


def report(result: Run, summary: dict[str, Any], out: Path) -> Iterator[str]:
    """Results in a few lines."""
    from twin_gait.simulation import RunStatus

    pace = summary["realtime_factor"]
    ended = f"{result.status}, " if result.status is RunStatus.INTERRUPTED else ""
    word = result.verdict.outcome or result.status
    yield f"{ended}{word}: {result.duration:g} s in {result.wall_s:.1f} s ({pace:.1f} x real time)"
    if result.verdict.reason:
        yield f"  {result.verdict.reason}"
    for line in summary_lines(summary):
        yield f"  {line}"
    if "accuracy" in summary:
        yield f"  {accuracy_line(summary['accuracy'])}"
    yield f"  {out}"


def accuracy_line(accuracy: Mapping[str, Any]) -> str:
    """What a tenth of the step changes, of :func:`~twin_gait.studies.accuracy.step_error`, in one line."""
    names = ("largest_angle_error_rad", "largest_angle_error_before_first_slip_rad")
    whole, before = (f"{math.degrees(accuracy[name]):.2g}°" for name in names)
    line = f"a tenth of the step ({accuracy['reference_step_s']:g} s) moves the joints by up to {whole}"
    if accuracy["first_slip_s"] is not None:
        line += f", {before} before the first switch in another tick at {accuracy['first_slip_s']:.3f} s"
    return line if accuracy["same_phase_order"] else f"{line}; the phases come in another order"


def summary_lines(summary: dict[str, Any]) -> Iterator[str]:
    """The figures that a reader wants first."""
    from twin_gait.measures.strides import stride_count
    from twin_gait.report import walk_words
    from twin_gait.report.walk_words import table_of_network

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
        off = walk_words.off_the_reference(values, 1)
        yield f"{line}, off the Koopman reference by {off} RMS" if off else line
    yield from walk_words.lines_of(walk_words.table_of_walk(summary))
    yield from filter(None, (walk_words.who_drives(summary), walk_words.carried_by_belt(summary)))
    yield from walk_words.lines_of(table_of_network(summary))
    power, life = summary.get("battery_power_mean_W"), summary.get("battery_life_h")
    if life is not None:
        lasts = f"{summary['battery_capacity_Wh']:.0f} Wh last {life:.1f} h"
        yield f"battery: {power:.1f} W, {lasts} (stated: {summary['battery_life_stated_h']:g} h)"
