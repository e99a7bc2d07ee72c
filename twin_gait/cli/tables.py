"""``twin-gait presets`` and ``twin-gait diagram``: what ships, and how a gait table looks."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, answer
from twin_gait.exceptions import ParameterError, RunDirectoryError

if TYPE_CHECKING:
    from twin_gait.gait import StateTable

# What each format of a diagram is called in a folder.
_ENDINGS = {"svg": ".svg", "mermaid": ".mmd", "transitions": "_transitions.md", "truth": "_truth.md"}


def add_parser(commands: Any) -> None:
    """Add both commands to the parser."""
    parser = options.add_command(commands, "presets", show_presets)
    add = parser.add_argument
    add("name", nargs="?", help="preset, person or table to print as YAML")
    add("--as-table", action="store_true", help="print the gait table where a preset has its name")
    add(
        "--schema",
        choices=["experiment", "table", "modes"],
        help="print the JSON Schema of a kind of file, for editors",
    )
    options.add_json(parser)

    parser = options.add_command(commands, "diagram", draw_diagram)
    add = parser.add_argument
    add("table", metavar="TABLE", help="packaged table of gait or of modes, or YAML file")
    add("--format", choices=list(_ENDINGS), help="what to print or write (transitions; with --out all)")
    options.add_out(parser, "DIR", "folder to write into instead of printing")


def show_presets(arguments: argparse.Namespace) -> int:
    """List experiments, people and gait tables, or print one.

    List what ships, or print a preset with every value, a person or a table, ready to be edited.
    """
    from twin_gait.configuration import packaged_gait_tables, packaged_mode_tables, presets
    from twin_gait.configuration.people import people

    if arguments.schema is not None:
        from twin_gait.configuration.schema import json_schema

        print(json.dumps(json_schema(arguments.schema), indent=1, ensure_ascii=False))
        return DONE
    if arguments.name is None and not arguments.as_table:
        experiments, persons, tables = presets(), people(), packaged_gait_tables()
        modes = packaged_mode_tables()
        lines = [
            *_listed("experiments", experiments),
            *_listed("people (--patient NAME)", persons),
            f"gait tables: {', '.join(tables)}",
            f"operating modes: {', '.join(modes)}",
        ]
        known = {"experiments": experiments, "people": persons, "gait_tables": tables, "modes": modes}
        answer(arguments, lines, lambda: known)
        return DONE
    text = _text_of(arguments.name, as_table=arguments.as_table)

    def document() -> Any:
        import yaml

        return yaml.safe_load(text)

    answer(arguments, [text.removesuffix("\n")], document)
    return DONE


def _text_of(name: str | None, *, as_table: bool) -> str:
    from twin_gait.configuration import load_experiment, packaged_gait_tables, packaged_mode_tables, presets
    from twin_gait.configuration.documents import dump_yaml
    from twin_gait.configuration.mode_table_file import mode_table_path
    from twin_gait.configuration.people import people, person_text
    from twin_gait.configuration.schema import comment_for
    from twin_gait.configuration.table_inheritance import gait_table_path

    tables = packaged_gait_tables()
    if name in tables and (as_table or name not in presets()):
        return gait_table_path(name).read_text(encoding="utf-8")
    if name in packaged_mode_tables():
        return mode_table_path(name).read_text(encoding="utf-8")
    if name is None or as_table:
        raise ParameterError(f"--as-table: expected one of {', '.join(tables)}, got {name}")
    if name in people():
        return person_text(name)
    return f"{comment_for('experiment')}\n{dump_yaml(load_experiment(name).document)}"


def _listed(title: str, entries: Mapping[str, str]) -> Iterator[str]:
    yield f"{title}:"
    width = max(len(name) for name in entries)
    for name, description in entries.items():
        yield f"  {name:<{width}}  {description}"


def draw_diagram(arguments: argparse.Namespace) -> int:
    """Draw the state machine of a gait table.

    State diagram, state-transition table and truth table of a gait table.
    """
    from twin_gait.configuration import load_state_table

    table = load_state_table(arguments.table)
    if arguments.out is None:
        print(_writers()[arguments.format or "transitions"](table), end="")
        return DONE
    formats = list(_ENDINGS) if arguments.format is None else [arguments.format]
    for path in _write_diagrams(table, arguments.out, formats, force=arguments.force):
        print(path)
    return DONE


def _write_diagrams(table: StateTable, folder: Path, formats: list[str], *, force: bool) -> list[Path]:
    """Write formats of a table into a folder, all of them or none."""
    from twin_gait.files import write_atomically

    stem = "".join(char if char.isalnum() or char in "-_" else "_" for char in table.name)[:100] or "table"
    texts = {folder / f"{stem}{_ENDINGS[name]}": _writers()[name](table) for name in formats}
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


def _writers() -> dict[str, Callable[[StateTable], str]]:
    from twin_gait.gait.documents import transition_table, truth_table
    from twin_gait.report.state_diagram import state_diagram_mermaid, state_diagram_svg

    return {
        "svg": state_diagram_svg,
        "mermaid": state_diagram_mermaid,
        "transitions": transition_table,
        "truth": truth_table,
    }
