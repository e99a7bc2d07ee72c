"""``twin-gait simulate`` and ``twin-gait live``: one run, as a batch job or in real time."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import shlex
import signal
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal, view
from twin_gait.cli.terminal import DONE, FAILED, INTERRUPTED
from twin_gait.files import private_files
from twin_gait.runs.folders import staged_directory

if TYPE_CHECKING:
    from twin_gait.live.session import LiveSession


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    parser = options.add_command(commands, "simulate", simulate)
    add = parser.add_argument
    options.add_experiment(parser, seconds="duration of the experiment")
    options.add_shorthand(parser, "--seed", "N", "seed", options.SEED, int)
    options.add_out(parser, "DIR", "run directory (runs/<time>-<name>)")
    text = "compiled, or pinocchio for the reference implementation (compiled)"
    options.add_shorthand(parser, "--engine", "NAME", "engine", text, str)
    text = "fault and its time, such as encoder_freeze:left_knee@4.2s; may be repeated"
    add("--fault", action="append", default=[], metavar="KIND:SIDE_JOINT@TIMEs", dest="faults", help=text)
    add("--view", action="store_true", help="show the run in the browser afterwards")
    options.add(parser, "--no-pictures")
    add("--fail-on-fall", action="store_true", help="exit with 1 if the wearer falls")
    add("--accuracy", action="store_true", help="repeat the run at other steps, and print the error of each")
    options.add(parser, "--json")

    parser = options.add_command(commands, "live", walk_live)
    add = parser.add_argument
    options.add_experiment(parser, seconds="until Ctrl-C")
    options.add_shorthand(parser, "--seed", "N", "seed", options.SEED, int)
    options.add_out(parser, "DIR", "run directory (runs/<time>-<name>-live)")
    add("--user", default="", metavar="NAME", help="name of the user in the record of the session")
    options.add(parser, "--port", "--no-browser")
    text = "send the walk on a CAN bus, and execute a monitor's commands on it: udp_multicast:239.74.163.2, "
    add("--can", metavar="BUS", help=f"{text}socketcan:vcan0, …")
    options.add(parser, "--no-pictures")
    add("--no-record", action="store_true", help="do not record the session")


def simulate(arguments: argparse.Namespace) -> int:
    """Simulate a gait and keep the run.

    Simulate a preset or an experiment file and write a run directory.
    """
    from twin_gait.runs.record import RUN_DIRECTORY, write_run
    from twin_gait.runs.stored_run import StoredRun
    from twin_gait.simulation.run import RunStatus
    from twin_gait.simulation.simulator import simulate

    if arguments.faults:
        arguments.settings = [*arguments.settings, f"faults={json.dumps(arguments.faults)}"]
    loaded = options.load_experiment(arguments)
    out = arguments.out or default_folder(loaded.experiment.name)
    with (
        staged_directory(out, RUN_DIRECTORY, force=arguments.force) as staging,
        terminal.work_callbacks("simulating", "tick") as watch,
    ):
        result, accuracy = simulate(loaded.experiment, **watch), None
        if arguments.accuracy and result.status is RunStatus.COMPLETED:
            from twin_gait.studies.accuracy import step_error

            accuracy = step_error(result, **watch)
        terminal.note_line("writing the run directory")
        summary = write_run(
            result, staging, document=loaded.document, pictures=not arguments.no_pictures,
            accuracy=accuracy,
        )  # fmt: skip
    terminal.clear_line()
    lines = report(summary, out)
    if arguments.accuracy and accuracy is None:
        lines.append(f"  accuracy not computed, because the run is not completed ({result.status})")
    terminal.answer(arguments, lines, {**summary, "directory": out})
    if result.status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    if arguments.view:
        from twin_gait.runs.run_page import render_run_page

        with contextlib.redirect_stdout(sys.stderr) if arguments.json else contextlib.nullcontext():
            view.serve(render_run_page([StoredRun(result, summary)]))
    if result.status is RunStatus.DIVERGED:
        return FAILED
    return FAILED if result.status is RunStatus.FELL and arguments.fail_on_fall else DONE


def default_folder(name: str) -> Path:
    """Return the folder of a run without ``--out``; two runs of the same second get two folders."""
    first = Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}"
    others = (first.with_name(f"{first.name}-{number}") for number in itertools.count(2))
    return next(path for path in itertools.chain([first], others) if not path.exists())


def report(summary: Mapping[str, Any], *folders: Path) -> list[str]:
    """Return a few lines: the results of a run, its folders, and the command that draws more figures."""
    from twin_gait.report import formatting, pages

    drawn = [shlex.quote(str(folder)) for folder in folders if (folder / pages.FIGURES_FOLDER).is_dir()]
    content = {"summary": summary, "words": formatting, "degrees": math.degrees}
    more = {"folders": folders, "drawn": drawn}
    return pages.lines("run.txt", {**summary, **content, **more})


def walk_live(arguments: argparse.Namespace) -> int:
    """Simulate in real time, tuned in the browser.

    Simulate in real time with a page in the browser that shows the gait and changes gait table, belt,
    support, the thesis's three controls, pushes and faults. The page is served on this machine only. Ctrl-C
    ends the session and writes the run directory.
    """
    import asyncio

    from twin_gait.experiment.experiment import LONGEST_RUN
    from twin_gait.live.session import LiveSession
    from twin_gait.live.session_records import default_records

    options.check_port(arguments.port)
    loaded = options.load_experiment(arguments, f"duration_s={LONGEST_RUN:g}")
    # The signals of a terminal that closes and of a system that stops end the session in order, like Ctrl-C.
    with private_files(), terminal.stop_on_interrupt(signal.SIGTERM, signal.SIGHUP) as should_stop:
        session = LiveSession(
            loaded=loaded,
            folder=arguments.out or default_folder(f"{loaded.experiment.name}-live"),
            user=arguments.user,
            force=arguments.force,
            pictures=not arguments.no_pictures,
            records=None if arguments.no_record else default_records(),
            can=arguments.can,
            on_compile=terminal.note_compilation,
            on_store_failure=_warn,
        )
        asyncio.run(_serve(session, arguments, should_stop))
    return _finish(session, should_stop() and loaded.experiment.duration < LONGEST_RUN)


async def _serve(
    session: LiveSession, arguments: argparse.Namespace, should_stop: Callable[[], bool]
) -> None:
    """Serve the pages until the run ends or is ended."""
    import asyncio

    from twin_gait.live.can_link import leaves_machine
    from twin_gait.live.page import PERIOD, LivePageServer

    page = LivePageServer(session, port=arguments.port)
    try:
        await asyncio.to_thread(session.start)
        if arguments.can is not None and leaves_machine(arguments.can):
            warning = "setpoints are sent on this bus; no board or drive that executes them may be connected"
            print(f"{arguments.can}: {warning}", file=sys.stderr)
        view.announce(page.url, browser=not arguments.no_browser)
        while session.walk.alive and not should_stop():
            page.update()
            await asyncio.sleep(PERIOD)
        page.update()
        await asyncio.sleep(PERIOD)  # so that the pages receive the last state
    finally:
        await page.close()
        terminal.note_line("writing the run directory")
        await asyncio.to_thread(session.close)
        terminal.clear_line()


def _warn(text: str) -> None:
    print(f"twin-gait live: {text}", file=sys.stderr, flush=True)


def _finish(session: LiveSession, interrupted: bool) -> int:
    walk, summary = session.walk, session.summary
    if summary:
        print("\n".join(report(summary, *session.summaries)))
    if summary and session.number is not None:
        print(f"  report for print: twin-gait sessions report {session.number}")
    if walk.exit_reason:
        _warn(f"{walk.exit_reason}; the run was saved up to its last second")
    if session.failure:
        _warn(session.failure)
    elif walk.store_failure and summary:
        _warn(f"the run ends at the time of a failed write: {walk.store_failure}")
    if walk.exit_reason or walk.store_failure or session.failure or summary.get("status") == "diverged":
        return FAILED
    return INTERRUPTED if interrupted else DONE
