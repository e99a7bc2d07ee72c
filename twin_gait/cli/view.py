"""``twin-gait view``, ``plot`` and ``export``: a run in the browser, as figures, and for other programs."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from pathlib import Path
from typing import Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE
from twin_gait.exceptions import ParameterError
from twin_gait.files import write_atomically

PRINT_RESOLUTION = 600  # [dots per inch], required by journals for pictures with lines and letters
COLUMN = 85.0  # [mm], width of one column of a paper
DEFAULT_CONVENTION = "opensim_gait2392"
MODELS = (DEFAULT_CONVENTION, "rajagopal")
# File name of each format in a run directory.
NAMES = {
    "csv": "log.csv", "mot": "log.mot", "sto": "log.sto", "opensim": "opensim", "candump": "can.log",
    "asc": "can.asc", "locohub": "strides.parquet", "mcap": "log.mcap",
}  # fmt: skip


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    parser = options.add_command(commands, "view", view)
    add = parser.add_argument
    add("targets", type=Path, nargs="+", metavar="RUN|URDF", help="one or two run directories, or a URDF")
    options.add_out(parser, "FILE.html", "write the page to a file and open no browser")
    add("--png", type=Path, metavar="FILE", help="write a picture, made with Chromium, and open no browser")
    add("--at", type=float, metavar="S", help="time in s of the picture, or at which the page opens")
    add("--up", choices=("x", "y", "z"), help="vertical axis of a URDF (z)")
    options.add(parser, "--port", "--no-browser")

    parser = options.add_command(commands, "plot", plot)
    add = parser.add_argument
    add("directory", type=Path, metavar="RUN", help="run directory")
    add("--figure", action="append", metavar="NAME", dest="figures", help="figure, such as gait_cycle (all)")
    add("--format", choices=("pdf", "svg", "png"), default="pdf", help="format of the files (pdf)")
    text = "width: 85 for one column of a paper, 174 for two (85; png: for a screen, as in a run directory)"
    add("--width", type=float, metavar="MM", help=text)
    options.add_out(parser, "DIR", "folder for the files NAME-WIDTHmm.FORMAT or NAME.png (RUN/figures)")

    parser = options.add_command(commands, "export", export)
    add = parser.add_argument
    add("directory", type=Path, metavar="RUN", help="run directory")
    add("--format", choices=tuple(NAMES), help="format (ending of --out; mot with --convention, else csv)")
    add("--convention", choices=MODELS, help=f"names and signs of a motion ({DEFAULT_CONVENTION})")
    add("--of", choices=("wearer", "device"), default="wearer", help="source of the angles (wearer)")
    options.add_out(
        parser,
        "PATH",
        "file or folder to write (RUN/log.FORMAT, RUN/strides.parquet, RUN/can.log, RUN/opensim)",
    )


def view(arguments: argparse.Namespace) -> int:
    """Show runs or a URDF in the browser, or draw a picture.

    Show a run directory, two of them next to each other, or any URDF with a slider for each joint in the
    browser until Ctrl-C; or write the page or a picture of it to a file.
    """
    from twin_gait.leg_model.urdf import PACKAGED_URDFS
    from twin_gait.runs.record import read_stored_run
    from twin_gait.runs.run_page import render_run_page
    from twin_gait.viewer.animation import urdf_page
    from twin_gait.viewer.picture import take_picture

    targets, at, out, png = arguments.targets, arguments.at, arguments.out, arguments.png
    if len(targets) > 2:
        raise ParameterError(f"expected one or two run directories, or one URDF, got {len(targets)}")
    options.check_port(arguments.port)
    for option, path, form in (("--out", out, "html"), ("--png", png, "png")):
        if path is not None:
            options.check_file(option, path.expanduser(), force=arguments.force, form=form)
    urdf = next((path for path in targets if path.is_file() or str(path) in PACKAGED_URDFS), None)
    if urdf is not None:
        if len(targets) > 1 or at is not None:
            raise ParameterError(f"{urdf}: is a URDF; a URDF must be the only argument, without --at")
        page = urdf_page(urdf, up_axis=arguments.up or "z")
    else:
        if arguments.up is not None:
            raise ParameterError("--up: applies to a URDF only; leave it out, because a run states its axis")
        shown = [read_stored_run(path) for path in targets]
        longest = max(one.run.duration for one in shown)
        if at is not None and not 0.0 <= at <= longest + 1e-9:
            raise ParameterError(f"--at: expected 0 to {longest:.3f} s, got {at:g}")
        page = render_run_page(shown, frame_times=[] if at is None else [at])
    if out is None and png is None:
        fragment = "" if at is None else f"#t={at:.3f}"
        return serve(page, arguments.port, fragment=fragment, browser=not arguments.no_browser)
    if out is not None:
        write_atomically(out.expanduser(), page)
        print(out)
    if png is not None:
        take_picture(page, png.expanduser(), time=at or 0.0)
        print(png)
    return DONE


def serve(page: str, port: int = options.FIRST_PORT, *, fragment: str = "", browser: bool = True) -> int:
    """Serve a page until Ctrl-C, and return the exit status."""
    import asyncio

    from twin_gait.viewer.server import SceneServer

    async def serving() -> None:
        server = SceneServer(page, first_port=port)
        try:
            announce(f"{server.url}{fragment}", browser=browser)
            await asyncio.Event().wait()
        finally:
            await server.close()

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serving())
    return DONE


def announce(url: str, *, browser: bool = True) -> None:
    """Print the address of a page, and open it in a browser if there is a screen."""
    print(f"open {url} in a browser; Ctrl-C ends", flush=True)
    # Without a screen, Python would start a text browser in this terminal.
    screen = sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if browser and screen:
        import webbrowser

        webbrowser.open(_write_redirect_page(url).as_uri())


def _write_redirect_page(url: str) -> Path:
    """Write a page that redirects to the address, readable by this user only; it is deleted at exit.

    Every user of the machine can read the arguments with which a browser is started, and the address contains
    the token.
    """
    import atexit
    import html
    import shutil
    import tempfile

    folder = tempfile.mkdtemp(prefix="twin_gait_")  # with mode 0700: readable by this user only
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder) / "open.html"
    path.write_text(f'<meta http-equiv="refresh" content="0;url={html.escape(url)}">', encoding="utf-8")
    return path


def plot(arguments: argparse.Namespace) -> int:
    """Draw figures of a run for a paper or a screen.

    Draw figures of a run directory for print, one or two columns wide, with letters on the panels and without
    titles; with --format png and no --width for a screen, with titles. A file that already has the same
    content is not written again.
    """
    from twin_gait.report.canvas import RESOLUTION, picture_bytes
    from twin_gait.report.figures import plot_run, screen_figures
    from twin_gait.report.pages import FIGURES_FOLDER
    from twin_gait.runs.record import load_run

    shown, width, form = load_run(arguments.directory), arguments.width, arguments.format
    if width is None and form != "png":
        width = COLUMN
    ending, resolution = ("", RESOLUTION) if width is None else (f"-{width:g}mm", PRINT_RESOLUTION)
    folder = arguments.out or arguments.directory / FIGURES_FOLDER
    names = arguments.figures or list(screen_figures(shown))
    figures = {name: plot_run(shown, name, width_mm=width) for name in names}
    drawn = {
        folder / f"{name}{ending}.{form}": picture_bytes(figure, form, resolution)
        for name, figure in figures.items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    changed = {path for path, content in drawn.items() if not path.is_file() or path.read_bytes() != content}
    for path in changed:  # before any file is written
        options.check_file("--out", path, force=arguments.force)
    for path, content in drawn.items():
        if path in changed:
            write_atomically(path, content)
        print(path)
    return DONE


def export(arguments: argparse.Namespace) -> int:
    """Export a run for other programs.

    Write the log of a run directory as CSV or MCAP (.mcap) with every column; its joint angles as a motion of
    OpenSim (.mot in degrees, .sto in radians); its strides in the format of LocoHub (.parquet); a folder for
    OpenSim's inverse dynamics with model, motion, external loads, set-up, and the joint moments to compare
    with; or the frames of its CAN network (candump's .log, Vector's .asc), which the file of 'twin-gait
    device NAME --dbc FILE --table TABLE' decodes.
    """
    from twin_gait.conventions import DEGREES, RADIANS, find_convention
    from twin_gait.export.can import export_can, network_messages, run_frames
    from twin_gait.export.inverse_dynamics import MODEL_FILE, export_inverse_dynamics
    from twin_gait.export.locohub import export_locohub
    from twin_gait.export.mcap import export_mcap
    from twin_gait.export.motion import export_csv, export_motion
    from twin_gait.runs.folders import FolderKind, staged_directory
    from twin_gait.runs.record import load_run

    out, named, force = arguments.out, arguments.convention, arguments.force
    endings = {Path(name).suffix: kind for kind, name in NAMES.items() if "." in name}
    suffix = "" if out is None else out.suffix.lower()
    kind = arguments.format or endings.get(suffix, "csv" if named is None else "mot")
    if kind not in ("mot", "sto", "opensim") and named is not None:
        problem = f"the format {kind} has this package's names and signs; leave it out"
        raise ParameterError(f"--convention: {problem}")
    run, device = load_run(arguments.directory), arguments.of == "device"
    convention = find_convention(named or DEFAULT_CONVENTION)
    path = out or arguments.directory / NAMES[kind]
    if kind != "opensim":
        options.check_file("--out", path, force=force, form=Path(NAMES[kind]).suffix[1:])
    if kind == "opensim":
        folder_kind = FolderKind("a folder that this command has written", MODEL_FILE)
        with staged_directory(path, folder_kind, force=force) as staging:
            export_inverse_dynamics(run, staging, convention, device=device)
    elif kind in ("csv", "mcap"):
        {"csv": export_csv, "mcap": export_mcap}[kind](run.log, path)
    elif kind == "locohub":
        export_locohub(run, path)
    elif kind in ("mot", "sto"):
        unit = DEGREES if kind == "mot" else RADIANS
        export_motion(run.log, path, convention, unit=unit, device=device)
    else:
        export_can(run_frames(run, network_messages(run.experiment)), path, kind)
    print(path)
    return DONE
