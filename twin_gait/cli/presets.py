"""``twin-gait presets``."""

from __future__ import annotations

import argparse
from typing import Any

from twin_gait.cli.terminal import DONE


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "presets",
        help="list the presets and gait tables",
        description="List what ships, or print one preset with every value, ready to be edited.",
    )
    parser.add_argument("name", nargs="?", help="preset to print as YAML")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """List the presets, or print one in full."""
    from twin_gait.configuration import load_experiment, packaged_gait_tables, presets
    from twin_gait.configuration.documents import dump_yaml

    if arguments.name is not None:
        print(dump_yaml(load_experiment(arguments.name).document), end="")
        return DONE
    width = max(len(name) for name in presets())
    for name, description in presets().items():
        print(f"{name:<{width}}  {description}")
    print(f"gait tables: {', '.join(packaged_gait_tables())}")
    return DONE
