"""``twin-gait device``: a device on one page."""

from __future__ import annotations

import argparse
import math
from typing import Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, answer


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "device", show_device)
    parser.add_argument("name", metavar="NAME", help="packaged device, or YAML file of a device")
    options.add(parser, "--json")


def show_device(arguments: argparse.Namespace) -> int:
    """Print a device on one page.

    Print joints, drives with torque over speed, limits, masses, and the source of every number of a device.
    """
    from twin_gait.configuration.device_file import load_device
    from twin_gait.report.device_page import describe_device
    from twin_gait.report.pages import lines

    found = describe_device(load_device(arguments.name))
    answer(arguments, lines("device.txt", {**found, "degrees": math.degrees}), found)
    return DONE
