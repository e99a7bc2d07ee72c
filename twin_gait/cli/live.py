"""``twin-gait live``."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import add_settings, add_wearer
from twin_gait.cli.simulate import summary_lines
from twin_gait.cli.terminal import DONE, FAILED, INTERRUPTED, clear_line, note_compilation, note_step

if TYPE_CHECKING:
    from twin_gait.experiment import Experiment
    from twin_gait.live.session import LiveSession

FIRST_PORT = 7000


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "live",
        help="walk in real time and turn the knobs in the browser",
        description=(
            "Simulate in real time, with a page in the browser that shows the walk and changes it: gait "
            "table, belt, support, the thesis's three controls, pushes and faults. On this machine only. "
            "Ctrl-C ends it and writes the run directory."
        ),
    )
    parser.add_argument("experiment", nargs="?", default="treadmill", help="preset or YAML file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="run directory (runs/<time>-<name>-live)")
    parser.add_argument("--force", action="store_true", help="replace an existing run directory")
    parser.add_argument("--duration", type=float, metavar="S", help="end by itself after so many seconds")
    parser.add_argument("--user", default="", metavar="NAME", help="whose session it is in the record")
    add_settings(parser, "change any value to begin with, for example patient.mass_kg=80")
    add_wearer(parser)
    parser.add_argument(
        "--port", type=int, default=FIRST_PORT, help=f"first port to try ({FIRST_PORT}); 0: any"
    )
    parser.add_argument("--no-browser", action="store_true", help="only say where the page is")
    parser.add_argument("--no-pictures", action="store_true", help="leave out figures and animation")
    parser.add_argument("--no-record", action="store_true", help="keep no record of the session")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Walk until Ctrl-C or the end, and write the run directory."""
    from twin_gait.configuration import load_experiment
    from twin_gait.exceptions import ParameterError
    from twin_gait.experiment import LONGEST_RUN
    from twin_gait.files import private_files
    from twin_gait.live.protocol import LONGEST_NAME
    from twin_gait.live.session import LiveSession
    from twin_gait.live.session_records import default_records

    if not 0 <= arguments.port <= 65535:
        raise ParameterError(f"--port: expected 0 to 65535, got {arguments.port}")
    if len(arguments.user) > LONGEST_NAME or not arguments.user.isprintable():
        raise ParameterError(f"--user: expected at most {LONGEST_NAME} printable characters")
    duration = LONGEST_RUN if arguments.duration is None else arguments.duration
    loaded = load_experiment(arguments.experiment, [*arguments.settings, f"duration_s={duration:g}"])
    name = loaded.experiment.name
    with private_files():
        session = LiveSession(
            loaded,
            arguments.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}-live",
            user=arguments.user,
            force=arguments.force,
            pictures=not arguments.no_pictures,
            records=None if arguments.no_record else default_records(),
            on_compile=note_compilation,
            on_step=note_step,
        )
        interrupted = asyncio.run(_serve(session, loaded.experiment, arguments))
    return _finish(session, interrupted and arguments.duration is not None)


async def _serve(session: LiveSession, experiment: Experiment, arguments: argparse.Namespace) -> bool:
    """Serve the pages until the walk ends or somebody ends it; True in the second case."""
    from twin_gait.cli.view import announce
    from twin_gait.live.page import PERIOD, LivePage

    ended = asyncio.Event()
    with _ended_by_signals(ended):
        page = LivePage(session, experiment, port=arguments.port, user=arguments.user)
        try:
            await asyncio.to_thread(session.start)
            if arguments.no_browser:
                print(f"open {page.url} in a browser; Ctrl-C ends", flush=True)
            else:
                announce(page.url)
            while session.alive and not ended.is_set():
                page.update()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(ended.wait(), PERIOD)
            page.update()
            await asyncio.sleep(PERIOD)  # so that the pages hear how it ended
        finally:
            await page.close()
            note_step("the run directory")
            await asyncio.to_thread(session.close)
            clear_line()
    return ended.is_set()


@contextlib.contextmanager
def _ended_by_signals(ended: asyncio.Event) -> Any:
    """Turn Ctrl-C, and what a terminal that closes or a system that stops sends, into an orderly end.

    A second one ends the program at once.
    """
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def forget() -> None:
        for number in numbers:
            loop.remove_signal_handler(number)

    def end() -> None:
        ended.set()
        forget()

    for number in numbers:
        loop.add_signal_handler(number, end)
    try:
        yield
    finally:
        forget()


def _finish(session: LiveSession, interrupted: bool) -> int:
    if session.failure:
        from twin_gait.exceptions import RunDirectoryError

        raise RunDirectoryError(session.failure)
    if session.summary:
        summary = session.summary
        print(f"{summary['outcome'] or summary['status']}: {summary['duration_s']:g} s")
        if summary["outcome_reason"]:
            print(f"  {summary['outcome_reason']}")
        for line in summary_lines(summary):
            print(f"  {line}")
    for folder in session.folders:
        print(f"  {folder}")
    if session.death:
        print(f"twin-gait live: {session.death}; the walk is kept up to its last second", file=sys.stderr)
        return FAILED
    if session.summary.get("status") == "diverged":
        return FAILED
    return INTERRUPTED if interrupted else DONE
