"""``twin-gait view``."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin_gait import viewer
from twin_gait.cli import options
from twin_gait.cli.terminal import DONE
from twin_gait.exceptions import ParameterError
from twin_gait.files import write_atomically


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "view", run)
    add = parser.add_argument
    text = "one or two run directories, or a URDF file"
    add("targets", type=Path, nargs="+", metavar="RUN|URDF", help=text)
    options.add_out(parser, "FILE.html", "write the page and open nothing")
    add("--png", type=Path, metavar="FILE", help="draw a picture with Chromium and open nothing")
    add("--at", type=float, metavar="S", help="moment of the picture, or to open at, in s")
    add("--up", choices=("x", "y", "z"), help="vertical of a URDF (z)")
    options.add(parser, "--port", "--no-browser")


def run(arguments: argparse.Namespace) -> int:
    """Show runs or a URDF in the browser, or draw a picture.

    Show a run directory, two of them side by side, or any URDF with a slider for each joint in the browser
    until Ctrl-C; or write the page or a picture of it.
    """
    from twin_gait.leg_model.urdf import PACKAGED_URDFS
    from twin_gait.runs.run_page import page_of, read_shown_run

    if len(arguments.targets) > 2:
        raise ParameterError(f"expected one run or two, got {len(arguments.targets)}")
    options.check_port(arguments.port)
    for option, path, form in (("--out", arguments.out, "html"), ("--png", arguments.png, "png")):
        if path is not None:
            options.check_file(option, path.expanduser(), force=arguments.force, form=form)
    urdf = next((path for path in arguments.targets if path.is_file() or str(path) in PACKAGED_URDFS), None)
    if urdf is not None:
        if len(arguments.targets) > 1:
            raise ParameterError(f"{urdf}: is a URDF, and only runs can be shown side by side")
        if arguments.at is not None:
            raise ParameterError(f"--at: needs a run directory, and {urdf} is a URDF")
        return _show(lambda: viewer.animation.urdf_page(urdf, up_axis=arguments.up or "z"), arguments)
    if arguments.up is not None:
        raise ParameterError("--up: is for a URDF; the experiment of a run says what its vertical is")
    runs = [read_shown_run(path) for path in arguments.targets]
    moments = [] if arguments.at is None else [arguments.at]
    longest = max(one.duration for one in runs)
    if not all(0.0 <= moment <= longest + 1e-9 for moment in moments):
        raise ParameterError(f"--at: expected 0 to {longest:.3f} s, got {arguments.at:g}")
    return _show(lambda: page_of(runs, moments=moments), arguments)


def _show(make: Callable[[], str], arguments: argparse.Namespace) -> int:
    """Write the page, the picture, or both; without either, serve the page until Ctrl-C."""
    at = arguments.at
    if arguments.out is None and arguments.png is None:
        fragment = "" if at is None else f"#t={at:.3f}"
        return serve(make(), arguments.port, fragment=fragment, browser=not arguments.no_browser)
    if arguments.png is not None:
        viewer.picture.find_browser()  # before the work, not after it
    page = make()
    if arguments.out is not None:
        write_atomically(arguments.out.expanduser(), page)
        print(arguments.out)
    if arguments.png is not None:
        viewer.picture.take_picture(page, arguments.png.expanduser(), time=at or 0.0)
        print(arguments.png)
    return DONE


def serve(page: str, port: int = options.FIRST_PORT, *, fragment: str = "", browser: bool = True) -> int:
    """Serve a page until Ctrl-C; gives the exit status."""
    import asyncio

    async def serving() -> None:
        server = viewer.server.SceneServer(page, first_port=port)
        try:
            announce(f"{server.url}{fragment}", browser=browser)
            await asyncio.Event().wait()
        finally:
            await server.close()

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serving())
    return DONE


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
