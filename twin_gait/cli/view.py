"""``twin-gait view``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    parser.add_argument("--once", action="store_true", help="play once and end")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show the target until Ctrl-C."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.studies.record import load_run

    if not 0.0 < arguments.speed <= 100.0:
        raise ParameterError(f"--speed: expected a number above 0 and at most 100, got {arguments.speed:g}")
    if arguments.target.suffix == ".urdf" or (arguments.target.is_file() and not arguments.target.is_dir()):
        return show_urdf(arguments.target)
    stored = load_run(arguments.target)
    return show_log(stored.experiment, stored.log, speed=arguments.speed, once=arguments.once)
