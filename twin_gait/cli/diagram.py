"""``twin-gait diagram``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.terminal import DONE

if TYPE_CHECKING:
    from twin_gait.gait import GaitTable

# What each format is called in a folder.
_ENDINGS = {"svg": ".svg", "mermaid": ".mmd", "transitions": "_transitions.md", "truth": "_truth.md"}


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "diagram",
        help="draw the state machine of a gait table",
        description="State diagram, state-transition table and truth table of a gait table.",
    )
    parser.add_argument("table", metavar="TABLE", help="packaged gait table or YAML file")
    parser.add_argument(
        "--format", choices=list(_ENDINGS), help="what to print or write (transitions; with --out all)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write into instead of printing")
    parser.add_argument("--force", action="store_true", help="replace existing files")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print one format, or write one or all into a folder."""
    from twin_gait.configuration import load_gait_table

    table = load_gait_table(arguments.table)
    if arguments.out is None:
        print(_writers()[arguments.format or "transitions"](table), end="")
        return DONE
    formats = list(_ENDINGS) if arguments.format is None else [arguments.format]
    for path in write_diagrams(table, arguments.out, formats, force=arguments.force):
        print(path)
    return DONE


def write_diagrams(table: GaitTable, folder: Path, formats: list[str], *, force: bool) -> list[Path]:
    """Write formats of a table into a folder, all of them or none.

    Args:
        table: The gait table.
        folder: Made if it is missing.
        formats: Names of the formats.
        force: Replace existing files.

    Returns:
        The files.

    Raises:
        RunDirectoryError: If one exists and may not be replaced, or cannot be written.
    """
    from twin_gait.exceptions import RunDirectoryError
    from twin_gait.files import write_atomically

    texts = {
        folder / f"{_file_name(table.name)}{_ENDINGS[name]}": _writers()[name](table) for name in formats
    }
    standing = [path for path in texts if path.exists()]
    if standing and not force:
        raise RunDirectoryError(f"{standing[0]}: exists; choose another --out, or replace it with --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(
            f"{folder}: cannot be made ({error.strerror}); choose another --out"
        ) from error
    for path, text in texts.items():
        write_atomically(path, text)
    return list(texts)


def _file_name(name: str) -> str:
    """Name of a table as the beginning of a file name."""
    return "".join(char if char.isalnum() or char in "-_" else "_" for char in name)[:100] or "table"


def _writers() -> dict[str, Callable[[GaitTable], str]]:
    from twin_gait.report.diagram_mermaid import state_diagram_mermaid
    from twin_gait.report.state_diagram import state_diagram_svg
    from twin_gait.report.state_tables import transition_table, truth_table

    return {
        "svg": state_diagram_svg,
        "mermaid": state_diagram_mermaid,
        "transitions": transition_table,
        "truth": truth_table,
    }
