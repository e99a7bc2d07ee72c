"""``twin-gait live``."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.simulate import default_folder, summary_lines

if TYPE_CHECKING:
    import asyncio

    from twin_gait.experiment import Experiment
    from twin_gait.live.session import LiveSession


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "live", run)
    add = parser.add_argument
    options.add_experiment(parser, seconds="until Ctrl-C")
    options.add_seed(parser, of_experiment=True)
    options.add_out(parser, "DIR", "run directory (runs/<time>-<name>-live)")
    add("--user", default="", metavar="NAME", help="whose session it is in the record")
    options.add_page(parser)
    add(
        "--can",
        default="",
        metavar="BUS",
        help="put the walk on a CAN bus, and take its monitor's commands: udp_multicast:239.74.163.2, "
        "socketcan:vcan0, …",
    )
    options.add_no_pictures(parser)
    add("--no-record", action="store_true", help="keep no record of the session")


def run(arguments: argparse.Namespace) -> int:
    """Simulate in real time, tuned in the browser.

    Simulate in real time, with a page in the browser that shows the gait and changes it: gait table, belt,
    support, the thesis's three controls, pushes and faults. On this machine only. Ctrl-C ends it and writes
    the run directory.
    """
    import asyncio

    from twin_gait.exceptions import ParameterError
    from twin_gait.experiment import LONGEST_RUN
    from twin_gait.files import private_files
    from twin_gait.live.can_link import leaves_machine
    from twin_gait.live.protocol import LONGEST_NAME
    from twin_gait.live.session import LiveSession
    from twin_gait.live.session_records import default_records

    options.check_port(arguments.port)
    if arguments.can and leaves_machine(arguments.can):
        print(f"{arguments.can}: set points go out; no board that obeys them may hang on it", file=sys.stderr)
    if len(arguments.user) > LONGEST_NAME or not arguments.user.isprintable():
        raise ParameterError(f"--user: expected at most {LONGEST_NAME} printable characters")
    loaded = options.experiment_of(arguments, f"duration_s={LONGEST_RUN:g}")
    with private_files():
        session = LiveSession(
            loaded,
            arguments.out or default_folder(f"{loaded.experiment.name}-live"),
            user=arguments.user,
            force=arguments.force,
            pictures=not arguments.no_pictures,
            records=None if arguments.no_record else default_records(),
            can=arguments.can,
            on_compile=terminal.note_compilation,
            on_step=terminal.note_step,
        )
        interrupted = asyncio.run(_serve(session, loaded.experiment, arguments))
    return _finish(session, interrupted and loaded.experiment.duration < LONGEST_RUN)


async def _serve(session: LiveSession, experiment: Experiment, arguments: argparse.Namespace) -> bool:
    """Serve the pages until the run ends or somebody ends it; True in the second case."""
    import asyncio

    from twin_gait.cli.view import announce
    from twin_gait.live.page import PERIOD, LivePage

    ended = asyncio.Event()
    with _ended_by_signals(ended):
        page = LivePage(session, experiment, port=arguments.port, user=arguments.user)
        try:
            await asyncio.to_thread(session.start)
            announce(page.url, browser=not arguments.no_browser)
            while session.alive and not ended.is_set():
                page.update()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(ended.wait(), PERIOD)
            page.update()
            await asyncio.sleep(PERIOD)  # so that the pages hear how it ended
        finally:
            await page.close()
            terminal.note_step("the run directory")
            await asyncio.to_thread(session.close)
            terminal.clear_line()
    return ended.is_set()


@contextlib.contextmanager
def _ended_by_signals(ended: asyncio.Event) -> Iterator[None]:
    """Turn Ctrl-C, and what a terminal that closes or a system that stops sends, into an orderly end.

    A second one ends the program at once.
    """
    import asyncio
    import signal

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
    news = session.news
    if news.failure:
        from twin_gait.exceptions import RunDirectoryError

        raise RunDirectoryError(news.failure)
    if news.summary:
        summary = news.summary
        print(f"{summary['outcome'] or summary['status']}: {summary['duration_s']:g} s")
        if summary["outcome_reason"]:
            print(f"  {summary['outcome_reason']}")
        for line in summary_lines(summary):
            print(f"  {line}")
    for folder in news.folders:
        print(f"  {folder}")
    if news.death:
        print(f"twin-gait live: {news.death}; the run is kept up to its last second", file=sys.stderr)
        return terminal.FAILED
    if news.summary.get("status") == "diverged":
        return terminal.FAILED
    return terminal.INTERRUPTED if interrupted else terminal.DONE
