"""``twin-gait device``: a device on one page."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, answer

if TYPE_CHECKING:
    from twin_gait.configuration.device_file import Device


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "device", show_device)
    parser.add_argument("name", metavar="NAME", help="packaged device, or YAML file of a device")
    text = "write the layout of its CAN frames as a DBC file, and print no page"
    parser.add_argument("--dbc", type=Path, metavar="FILE", help=text)
    text = "gait table whose phases the DBC file names: packaged name or YAML file"
    parser.add_argument("--table", metavar="TABLE", help=text)
    options.add(parser, "--force", "--json")


def show_device(arguments: argparse.Namespace) -> int:
    """Print a device on one page, or write its DBC file.

    Print joints, drives with torque over speed, limits, masses, and the source of every number of a device.
    The layout of the frames is generated for its boards and limits, as for an experiment without network.dbc,
    with the phases of a gait table (--table).
    """
    from twin_gait.configuration.device_file import load_device
    from twin_gait.parameters.quantities import require
    from twin_gait.report.device_page import describe_device
    from twin_gait.report.pages import lines

    device = load_device(arguments.name)
    if arguments.dbc is not None:
        return _write_dbc(arguments, device)
    require(arguments.table is None, "--table", "--dbc FILE, whose phases it names", arguments.table)
    found = describe_device(device)
    answer(arguments, lines("device.txt", {**found, "degrees": math.degrees}), found)
    return DONE


def _write_dbc(arguments: argparse.Namespace, device: Device) -> int:
    """Write the generated DBC file of a device, and print the signals whose range was widened."""
    from twin_gait.configuration.gait_table_file import load_gait_table
    from twin_gait.configuration.validation import convert_with_context
    from twin_gait.experiment.bus import device_messages
    from twin_gait.files import write_atomically
    from twin_gait.network.dbc import DBC_ENCODING
    from twin_gait.network.layout import widened_signals, write_dbc

    target = arguments.dbc.expanduser()
    options.check_file("--dbc", target, force=arguments.force)
    found = device.parameters()
    sections = found["leg"], found["plant"], found["control"]
    phases = load_gait_table(arguments.table).phase_names if arguments.table else ()
    messages = convert_with_context(str(device.path), "", lambda: device_messages(*sections, phases))
    write_atomically(target, write_dbc(device.name, messages).encode(DBC_ENCODING, errors="replace"))
    wider, shown = list[dict[str, Any]](), [f"{target}: {len(messages)} messages"]
    for name, signal in widened_signals(messages).items():
        step, unit = float(signal.step), signal.unit
        low, high = (float(bound) for bound in signal.bounds)
        wider.append({"signal": name, "unit": unit, "step": step, "lowest": low, "highest": high})
        shown.append(f"  {name}: widened to {low:g} to {high:g} {unit}, in steps of {step:g} {unit}")
    answer(arguments, shown, {"path": target, "messages": list(messages), "widened": wider})
    return DONE
