"""``twin-gait view``."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, stop_on_interrupt
from twin_gait.exceptions import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from twin_gait.runs.run_page import ShownRun
    from twin_gait.simulation.run import Run
    from twin_gait.viewer.picture import PictureSize


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "view", run)
    add = parser.add_argument
    add(
        "targets", type=Path, nargs="+", metavar="RUN|URDF", help="one or two run directories, or a URDF file"
    )
    options.add_out(parser, "FILE.html", "write the page and open nothing")
    add("--png", type=Path, metavar="FILE", help="draw a picture with Chromium and open nothing")
    add("--at", type=float, metavar="S", help="moment of the picture, or to open at, in s")
    add("--up", choices=("x", "y", "z"), help="vertical of a URDF (z)")
    add("--size", metavar="WxH", help="size of the picture in pixels (1600x1000)")
    add("--dark", action="store_true", help="draw the dark page")
    add("--play-speed", type=float, default=1.0, metavar="X", help="times real time (1)")
    add("--once", action="store_true", help="end when the run has been played once")
    options.add_page(parser)


def run(arguments: argparse.Namespace) -> int:
    """Show runs or a URDF in the browser, or draw a picture.

    Show a run directory, two of them side by side, or any URDF with a slider for each joint in the browser
    until Ctrl-C; or write the page or a picture of it.
    """
    from twin_gait.leg_model.urdf import PACKAGED_URDFS
    from twin_gait.runs.run_page import page_of, read_shown_run

    _check(arguments)
    urdfs = [path for path in arguments.targets if path.is_file() or str(path) in PACKAGED_URDFS]
    if urdfs:
        return _show_urdf(urdfs[0], arguments)
    if arguments.up is not None:
        raise ParameterError("--up: is for a URDF; the experiment of a run says what its vertical is")
    runs = [read_shown_run(path) for path in arguments.targets]
    longest = max(one.duration for one in runs)
    if arguments.at is not None and not 0.0 <= arguments.at <= longest + 1e-9:
        raise ParameterError(f"--at: expected 0 to {longest:.3f} s, got {arguments.at:g}")
    if arguments.out is None and arguments.png is None:
        return _serve_runs(runs, arguments)
    moments = () if arguments.at is None else (arguments.at,)
    return _write(lambda: page_of(runs, moments=moments), arguments)


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what is wrong before anything is read."""
    if len(arguments.targets) > 2:
        raise ParameterError(f"expected one run or two, got {len(arguments.targets)}")
    options.check_port(arguments.port)
    if not 0.0 < arguments.play_speed <= 100.0:
        raise ParameterError(
            f"--play-speed: expected a number above 0 and at most 100, got {arguments.play_speed:g}"
        )
    if arguments.at is not None and not math.isfinite(arguments.at):
        raise ParameterError(f"--at: expected a time in s, got {arguments.at:g}")
    if arguments.size is not None and arguments.png is None:
        raise ParameterError("--size: is the size of a picture; give --png FILE too")
    for option, path in (("--out", arguments.out), ("--png", arguments.png)):
        if path is not None:
            options.check_file(option, path.expanduser(), force=arguments.force)


def _show_urdf(urdf: Path, arguments: argparse.Namespace) -> int:
    """Show a URDF until Ctrl-C, or draw it."""
    from twin_gait.viewer.urdf_page import urdf_page

    if len(arguments.targets) > 1:
        raise ParameterError(f"{urdf}: is a URDF, and only runs can be shown side by side")
    if arguments.at is not None:
        raise ParameterError(f"--at: needs a run directory, and {urdf} is a URDF")

    def page() -> str:
        return urdf_page(urdf, up_axis=arguments.up or "z")

    if arguments.out is not None or arguments.png is not None:
        return _write(page, arguments)
    arguments.play_speed = 1.0
    return _serve(page(), math.inf, arguments)


def picture_size(text: str | None) -> PictureSize:
    """Read a size such as ``1600x1000``; None stands for the default."""
    from twin_gait.viewer.picture import DEFAULT_SIZE, LARGEST, SMALLEST, PictureSize

    if text is None:
        return DEFAULT_SIZE
    found = re.fullmatch(r"(\d{1,5})[xX×](\d{1,5})", text.strip())
    if found is None:
        raise ParameterError(f"--size: expected WIDTHxHEIGHT such as 1600x1000, got {text!r}")
    size = PictureSize(int(found[1]), int(found[2]))
    if not all(SMALLEST <= side <= LARGEST for side in size):
        raise ParameterError(f"--size: expected {SMALLEST} to {LARGEST} pixels each way, got {text}")
    return size


def _write(make: Callable[[], str], arguments: argparse.Namespace) -> int:
    """Write the page, the picture, or both."""
    from twin_gait.files import write_atomically
    from twin_gait.viewer.picture import find_browser, take_picture

    size = picture_size(arguments.size)
    if arguments.png is not None:
        find_browser()  # before the work, not after it
    page = make()
    if arguments.out is not None:
        write_atomically(arguments.out.expanduser(), page)
        print(arguments.out)
    if arguments.png is not None:
        at = arguments.at or 0.0
        take_picture(page, arguments.png.expanduser(), time=at, size=size, dark=arguments.dark)
        print(arguments.png)
    return DONE


def _serve_runs(runs: Sequence[ShownRun], arguments: argparse.Namespace) -> int:
    """Serve runs until Ctrl-C, or for as long as they last."""
    from twin_gait.runs.run_page import page_of

    moments = () if arguments.at is None else (arguments.at,)
    longest = max(one.duration for one in runs) / arguments.play_speed if arguments.once else math.inf
    return _serve(page_of(runs, moments=moments), longest, arguments)


def _serve(page: str, longest: float, arguments: argparse.Namespace) -> int:
    from twin_gait.viewer.page_server import PageServer

    with stop_on_interrupt() as should_stop, PageServer(page, port=arguments.port) as server:
        announce(f"{server.url}{_fragment(arguments)}", browser=not arguments.no_browser)
        last = time.monotonic() + longest
        while not should_stop() and time.monotonic() < last:
            time.sleep(0.1)
    return DONE


def _fragment(arguments: argparse.Namespace) -> str:
    words = [
        "" if arguments.at is None else f"t={arguments.at:.3f}",
        "" if arguments.play_speed == 1.0 else f"speed={arguments.play_speed:g}",
        "theme=dark" if arguments.dark else "",
    ]
    return f"#{'&'.join(filter(None, words))}" if any(words) else ""


def show_run(run: Run) -> int:
    """Show a run in the browser until Ctrl-C; gives the exit status."""
    from twin_gait.runs.run_page import shown_run
    from twin_gait.runs.summary import summarise

    defaults = {"at": None, "play_speed": 1.0, "once": False, "dark": False, "no_browser": False}
    return _serve_runs(
        [shown_run(run, summarise(run))], argparse.Namespace(port=options.FIRST_PORT, **defaults)
    )


def announce(url: str, *, browser: bool = True) -> None:
    """Say where the page is, and open it where there is a screen."""
    print(f"open {url} in a browser; Ctrl-C ends", flush=True)
    # Without a screen Python would start a text browser in this terminal.
    screen = sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if browser and screen:
        import webbrowser

        webbrowser.open(_signpost(url).as_uri())


def _signpost(url: str) -> Path:
    """A page of the user's own that leads to the address, until the program ends.

    Every user of the machine can read what a browser is started with, and the address holds the token.
    """
    import atexit
    import html
    import shutil
    import tempfile

    folder = tempfile.mkdtemp(prefix="twin_gait_")  # nobody else may look into it
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder) / "open.html"
    path.write_text(f'<meta http-equiv="refresh" content="0;url={html.escape(url)}">', encoding="utf-8")
    return path
