"""``twin-gait view``."""

from __future__ import annotations

import argparse
import os
import sys
import time
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.terminal import DONE, stop_on_interrupt

if TYPE_CHECKING:
    import pandas as pd

    from twin_gait.experiment import Experiment


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "view",
        help="show a run or a URDF in the browser",
        description="Play a run directory in the live viewer, or show any URDF. Ctrl-C ends it.",
    )
    parser.add_argument("target", type=Path, metavar="RUN|URDF", help="run directory or URDF file")
    parser.add_argument("--speed", type=float, default=1.0, help="playing speed (1)")
    parser.add_argument("--port", type=int, default=7000, help="first port to try (7000)")
    parser.add_argument("--once", action="store_true", help="play once and end")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show the target until Ctrl-C."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.leg_model.urdf import PACKAGED_URDFS
    from twin_gait.studies.record import load_run

    if not 0 <= arguments.port <= 65535:
        raise ParameterError(f"--port: expected 0 to 65535, got {arguments.port}")
    if not 0.0 < arguments.speed <= 100.0:
        raise ParameterError(f"--speed: expected a number above 0 and at most 100, got {arguments.speed:g}")
    target = arguments.target
    if target.is_file() or str(target) in PACKAGED_URDFS:
        return show_urdf(target, port=arguments.port)
    stored = load_run(target)
    return show_log(
        stored.experiment,
        stored.log,
        speed=arguments.speed,
        repeat=not arguments.once,
        port=arguments.port,
    )


def show_log(
    experiment: Experiment, log: pd.DataFrame, *, speed: float = 1.0, repeat: bool = True, port: int = 7000
) -> int:
    """Play a log in the live viewer until it ends or Ctrl-C.

    Args:
        experiment: What was run.
        log: One row per tick.
        speed: Seconds of the log per second.
        repeat: Whether to start over at the end.
        port: First port to try.

    Returns:
        Exit status.
    """
    from twin_gait.studies.record import belt_speed_of, describe
    from twin_gait.viewer import show_run

    belt_speed = belt_speed_of(experiment)
    with stop_on_interrupt() as should_stop:
        show_run(
            log,
            experiment.build_world().model,
            title=f"twin_gait · {experiment.name}",
            subtitle=describe(experiment.patient, belt_speed),
            patient=experiment.patient,
            belt_speed=belt_speed,
            speed=speed,
            repeat=repeat,
            port=port,
            should_stop=should_stop,
            announce=announce,
        )
    return DONE


def show_urdf(path: Path, *, port: int = 7000) -> int:
    """Show a URDF until Ctrl-C.

    Args:
        path: The file, or the name of a packaged one.
        port: First port to try.

    Returns:
        Exit status.
    """
    from twin_gait.viewer import view_urdf

    with stop_on_interrupt() as should_stop, view_urdf(path, port=port) as viewer:
        announce(viewer.url)
        while not should_stop():
            time.sleep(0.1)
    return DONE


def announce(url: str) -> None:
    """Say where the page is, and open it where there is a screen."""
    print(f"open {url} in a browser; Ctrl-C ends", flush=True)
    # Without a screen Python would start a text browser in this terminal.
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
