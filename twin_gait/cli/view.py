"""``twin-gait view``."""

from __future__ import annotations

import argparse
import atexit
import html
import math
import os
import re
import shutil
import sys
import tempfile
import time
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import DONE, stop_on_interrupt
from twin_gait.exceptions import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from twin_gait.runs.shown_run import ShownRun
    from twin_gait.simulation.run import Run
    from twin_gait.viewer.picture import PictureSize

_SIZE = re.compile(r"(\d{1,5})[xX×](\d{1,5})")


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "view",
        help="show one run, two beside each other, or a URDF in the browser; draw a picture",
        description="Show a run directory, two of them beside each other, or any URDF with a slider for each "
        "joint in the browser until Ctrl-C; or write the page or a picture of it.",
    )
    parser.add_argument(
        "targets", type=Path, nargs="+", metavar="RUN|URDF", help="one or two run directories, or a URDF file"
    )
    parser.add_argument("--out", type=Path, metavar="FILE.html", help="write the page and open nothing")
    parser.add_argument(
        "--png", type=Path, metavar="FILE", help="draw a picture with Chromium and open nothing"
    )
    parser.add_argument("--at", type=float, metavar="S", help="moment of the picture, or to open at, in s")
    parser.add_argument("--up", choices=("x", "y", "z"), help="vertical of a URDF (z)")
    parser.add_argument("--size", metavar="WxH", help="size of the picture in pixels (1600x1000)")
    parser.add_argument("--dark", action="store_true", help="draw the dark page")
    parser.add_argument("--force", action="store_true", help="replace an existing FILE")
    parser.add_argument("--speed", type=float, default=1.0, help="playing speed (1)")
    parser.add_argument("--port", type=int, default=7000, help="first port to try (7000)")
    parser.add_argument("--once", action="store_true", help="end when the run has been played once")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show or draw the targets."""
    from twin_gait.leg_model.urdf import PACKAGED_URDFS
    from twin_gait.runs.shown_run import page_of, read_shown_run

    _check(arguments)
    urdfs = [path for path in arguments.targets if path.is_file() or str(path) in PACKAGED_URDFS]
    if urdfs:
        _refuse_beside_a_urdf(arguments, urdfs[0])
        return _show_urdf(urdfs[0], arguments)
    if arguments.up is not None:
        raise ParameterError("--up: is for a URDF; the experiment of a run says what its vertical is")
    runs = [read_shown_run(path) for path in arguments.targets]
    longest = max(one.duration for one in runs)
    if arguments.at is not None and not 0.0 <= arguments.at <= longest + 1e-9:
        raise ParameterError(f"--at: expected 0 to {longest:.3f} s, got {arguments.at:g}")
    if arguments.out is None and arguments.png is None:
        return _serve(
            runs,
            at=arguments.at,
            speed=arguments.speed,
            port=arguments.port,
            repeat=not arguments.once,
            dark=arguments.dark,
        )
    moments = () if arguments.at is None else (arguments.at,)
    return _write(lambda: page_of(runs, moments=moments), arguments)


def _show_urdf(urdf: Path, arguments: argparse.Namespace) -> int:
    """Show a URDF until Ctrl-C, or draw it."""
    from twin_gait.viewer.page_server import PageServer
    from twin_gait.viewer.urdf_page import urdf_page

    def page() -> str:
        return urdf_page(urdf, up_axis=arguments.up or "z")

    if arguments.out is not None or arguments.png is not None:
        return _write(page, arguments)
    with stop_on_interrupt() as should_stop, PageServer(page(), port=arguments.port) as server:
        announce(f"{server.url}{_fragment(None, 1.0, arguments.dark)}")
        while not should_stop():
            time.sleep(0.1)
    return DONE


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what is wrong before anything is read."""
    if len(arguments.targets) > 2:
        raise ParameterError(f"expected one run or two, got {len(arguments.targets)}")
    if not 0 <= arguments.port <= 65535:
        raise ParameterError(f"--port: expected 0 to 65535, got {arguments.port}")
    if not 0.0 < arguments.speed <= 100.0:
        raise ParameterError(f"--speed: expected a number above 0 and at most 100, got {arguments.speed:g}")
    if arguments.at is not None and not math.isfinite(arguments.at):
        raise ParameterError(f"--at: expected a time in s, got {arguments.at:g}")
    if arguments.size is not None and arguments.png is None:
        raise ParameterError("--size: is the size of a picture; give --png FILE too")
    for option, path in (("--out", arguments.out), ("--png", arguments.png)):
        if path is not None:
            check_file(option, path.expanduser(), force=arguments.force)


def _refuse_beside_a_urdf(arguments: argparse.Namespace, urdf: Path) -> None:
    if len(arguments.targets) > 1:
        raise ParameterError(f"{urdf}: is a URDF, and only runs can be shown beside each other")
    if arguments.at is not None:
        raise ParameterError(f"--at: needs a run directory, and {urdf} is a URDF")


def picture_size(text: str | None) -> PictureSize:
    """Read a size such as ``1600x1000``.

    Args:
        text: Width and height in pixels, or None for the default.

    Returns:
        Width and height.

    Raises:
        ParameterError: If it is no such text or out of range.
    """
    from twin_gait.viewer.picture import DEFAULT_SIZE, LARGEST, SMALLEST, PictureSize

    if text is None:
        return DEFAULT_SIZE
    found = _SIZE.fullmatch(text.strip())
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


def _serve(
    runs: Sequence[ShownRun],
    *,
    at: float | None = None,
    speed: float = 1.0,
    port: int = 7000,
    repeat: bool = True,
    dark: bool = False,
) -> int:
    """Serve the page until Ctrl-C, or for as long as the run lasts."""
    from twin_gait.runs.shown_run import page_of
    from twin_gait.viewer.page_server import PageServer

    with stop_on_interrupt() as should_stop:
        page = page_of(runs, moments=() if at is None else (at,))
        with PageServer(page, port=port) as server:
            announce(f"{server.url}{_fragment(at, speed, dark)}")
            last = math.inf if repeat else time.monotonic() + max(one.duration for one in runs) / speed
            while not should_stop() and time.monotonic() < last:
                time.sleep(0.1)
    return DONE


def _fragment(at: float | None, speed: float, dark: bool) -> str:
    words = [
        *([] if at is None else [f"t={at:.3f}"]),
        *([] if speed == 1.0 else [f"speed={speed:g}"]),
        *(["theme=dark"] if dark else []),
    ]
    return f"#{'&'.join(words)}" if words else ""


def show_run(run: Run, *, speed: float = 1.0, repeat: bool = True, port: int = 7000) -> int:
    """Show a run in the browser until Ctrl-C, or for as long as it lasts.

    Args:
        run: The run.
        speed: Seconds of the run per second.
        repeat: Whether to go on after that.
        port: First port to try.

    Returns:
        Exit status.
    """
    from twin_gait.runs.shown_run import ShownRun

    name = f"twin_gait · {run.experiment.name}"
    shown = ShownRun(name, run.experiment, run.log, (), run.events, run.verdict.outcome or run.status)
    return _serve([shown], speed=speed, repeat=repeat, port=port)


def announce(url: str) -> None:
    """Say where the page is, and open it where there is a screen."""
    print(f"open {url} in a browser; Ctrl-C ends", flush=True)
    # Without a screen Python would start a text browser in this terminal.
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(_signpost(url).as_uri())


def _signpost(url: str) -> Path:
    """A page of the user's own that leads to the address, until the program ends.

    Every user of the machine can read what a browser is started with, and the address holds the token.
    """
    folder = tempfile.mkdtemp(prefix="twin_gait_")  # nobody else may look into it
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder) / "open.html"
    path.write_text(f'<meta http-equiv="refresh" content="0;url={html.escape(url)}">', encoding="utf-8")
    return path
