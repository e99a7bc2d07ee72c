"""``twin-gait presets``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from twin_gait.cli.terminal import DONE


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "presets",
        help="list the presets, people and gait tables",
        description=(
            "List what ships, or print a preset with every value, a person or a table, ready to be edited."
        ),
    )
    parser.add_argument("name", nargs="?", help="preset, person or gait table to print as YAML")
    parser.add_argument(
        "--table", action="store_true", help="print the gait table where a preset has its name"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """List what ships, or print one preset, person or gait table in full."""
    from twin_gait.configuration import load_experiment, packaged_gait_tables, presets
    from twin_gait.configuration.documents import dump_yaml
    from twin_gait.configuration.people import people, person_text
    from twin_gait.configuration.table_inheritance import find_gait_table
    from twin_gait.exceptions import ParameterError

    if arguments.name in people():
        print(person_text(arguments.name), end="")
        return DONE
    tables = packaged_gait_tables() if arguments.table or arguments.name not in presets() else []
    if arguments.name in tables:
        print(find_gait_table(arguments.name).read_text(encoding="utf-8"), end="")
        return DONE
    if arguments.table:
        raise ParameterError(f"--table: expected one of {', '.join(tables)}, got {arguments.name}")
    if arguments.name is not None:
        print(dump_yaml(load_experiment(arguments.name).document), end="")
        return DONE
    _list("experiments", presets())
    _list("people (--set patient=NAME)", people())
    print(f"gait tables: {', '.join(packaged_gait_tables())}")
    return DONE


def _list(title: str, entries: Mapping[str, str]) -> None:
    print(f"{title}:")
    width = max(len(name) for name in entries)
    for name, description in entries.items():
        print(f"  {name:<{width}}  {description}")
