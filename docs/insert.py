"""Insertion of numbers and tables of results into the pages in this folder and the README.

A page quotes the number ``fit.gain`` of ``examples/results/NAME/results.json`` (or ``benchmarks/results``) as

    <!-- value NAME fit.gain .2f -->0.58<!-- / -->

with a format as in Python, or none; ``NAME+OTHER`` is the sum of the numbers of several scripts. A list of
mappings with the same keys is quoted as

    <!-- table NAME rows -->
    | k [Nm/deg] | outcome |
    ...
    <!-- / -->

``<!-- columns energy+monitor -->`` is a table of columns that ``twin_gait/simulation/log.yaml`` declares,
``<!-- names treadmill,interface=brace+overground -->`` a list of the full names of the columns in the logs of
some experiments,
``<!-- strides joint+motor -->`` a table of columns of ``strides.csv`` from their declarations,
``<!-- labels duration_s+wall_s -->`` a table of the labels of keys of a summary,
``<!-- signals battery -->`` a table of the signals of a message in ``urdf/twin.dbc``,
``<!-- keys plant.battery -->`` a table of the keys of a section of an experiment file or a gait table,
``<!-- fields twin_gait.live.protocol.Frame -->`` a table of the fields of a record with their comments,
``<!-- rules all -->`` a table of the rules of the check, ``<!-- assumptions all -->`` a table of the keys
with assumed defaults,
``<!-- commands all -->`` all commands with their options,
``<!-- licences package -->`` (or an extra) a table of the licences of the requirements.

``python docs/insert.py`` updates all pages, ``--check`` only lists the pages that are out of date.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, get_args

from twin_gait.parameters.quantities import Parameters, declarations

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))
import declared  # noqa: E402 -- beside this file

_WORD = r"(?: ((?!-->)\S+))?"
_KINDS = "value|table|columns|strides|names|labels|signals|keys|fields|assumptions|rules|commands|licences"
QUOTED = re.compile(rf"<!-- ({_KINDS}) (\S+){_WORD}{_WORD} -->(.*?)<!-- / -->", re.DOTALL)


@cache
def read_results(name: str) -> Any:
    """Return the stored results of the full form of a script."""
    paths = [
        DOCS.parent / folder / "results" / name / "results.json" for folder in ("examples", "benchmarks")
    ]
    present = [path for path in paths if path.is_file()]
    if not present:
        raise ValueError(f"{name}: no results are kept; run the script")
    found = json.loads(present[0].read_text(encoding="utf-8"))
    if found["quick"]:
        raise ValueError(f"{name}: its results are of the quick form; run the script without --quick")
    return found


def find_entry(name: str, key: str) -> Any:
    """Return the entry of a result by its dotted key; the sum of several if their names are joined by +."""
    if "+" in name:
        return sum(find_entry(one, key) for one in name.split("+"))
    entry = read_results(name)
    for part in key.split("."):
        entry = entry[int(part)] if isinstance(entry, list) else entry[part]
    return entry


def format_markdown_table(rows: list[dict[str, Any]]) -> str:
    """Return rows as a table in Markdown, with the keys of the first row as the heading."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *(list(row.values()) for row in rows)]
    return "\n".join(
        "| " + " | ".join("" if cell is None else str(cell) for cell in line) + " |" for line in lines
    )


def columns(kinds: str) -> list[dict[str, Any]]:
    """Return the columns of the log in some declared groups, such as ``energy+monitor``."""
    from twin_gait.labels import label_of
    from twin_gait.simulation import log

    return [
        {
            "column": f"`{name}`",
            "name": label_of(name).name,
            "symbol": label_of(name).symbol,
            "unit": log.unit_of(name),
            "meaning": meaning,
        }
        for kind in kinds.split("+")
        for name, (_, meaning) in log.GROUPS[kind].columns.items()
    ]


def strides(groups: str) -> list[dict[str, Any]]:
    """Return the columns of ``strides.csv`` in some declared groups, such as ``joint+motor``."""
    from twin_gait.labels import label_of
    from twin_gait.runs.stride_table import column_meanings

    found = [
        (name, label_of(name), text)
        for group in groups.split("+")
        for name, text in column_meanings()[group].items()
    ]
    return [
        {
            "column": f"`{name}`",
            "name": label.name,
            "unit": label.unit,
            "shown in": label.display_unit,
            "meaning": text,
        }
        for name, label, text in found
    ]


def labels(keys: str) -> list[dict[str, Any]]:
    """Return the labels of keys of a summary, joined by ``+``."""
    from twin_gait.labels import label_of

    found = [(key, label_of(key)) for key in keys.split("+")]
    return [
        {
            "key": f"`{key.rpartition('.')[2]}`",
            "name": label.name,
            "symbol": label.symbol,
            "unit": label.unit,
            "shown in": label.display_unit,
        }
        for key, label in found
    ]


def signals(message: str) -> list[dict[str, Any]]:
    """Return the signals of a message of the DBC file."""
    import cantools

    database = cantools.database.load_file(Path(__file__).parents[1] / "urdf" / "twin.dbc")
    found = []
    for item in database.get_message_by_name(message).signals:
        words = ", ".join(f"{code} {name}" for code, name in (item.choices or {}).items())
        found.append(
            {
                "signal": f"`{item.name}`",
                "bits": f"{item.start} to {item.start + item.length - 1}",
                "step": f"{item.scale:g} {item.unit or ''}".strip(),
                "range": words or f"{item.minimum:g} to {item.maximum:g}",
                "meaning": item.comment,
            }
        )
    return found


def keys(section: str) -> list[dict[str, Any]]:
    """Return the keys of a section of an experiment file or gait table that its class declares."""
    found = []
    for item in declarations(_section(section)):
        first, *others = item.keys
        units = "".join(f", `…{key.removeprefix(item.key)}`" for key in others)
        number = item.range is not None and item.kind in (int, float)
        found.append(
            {
                "key": f"`{first}`{units}",
                "default": _value_of_twin(section, item.name)
                if item.default is dataclasses.MISSING
                else _default(item.default),
                "range": re.sub("^a (whole )?number (of |from )?", "", item.range.expected)
                if number and item.range
                else "",
                "meaning": item.meaning.replace("|", "or"),
            }
        )
    return found


def _default(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return "never" if math.isinf(value) else f"{value:.6g}"
    plain = isinstance(value, (int, str)) and value is not dataclasses.MISSING
    return str(value) if plain else ""


def _value_of_twin(section: str, name: str) -> str:
    """Return the value of the device ``twin`` for a field without a default; empty if its joints differ."""
    from twin_gait.configuration.device_file import SECTIONS, load_device

    path = section.split(".")
    if path[0] not in SECTIONS or ":" in section:
        return ""
    found: list[Any] = [load_device("twin").parameters()[path[0]]]
    for step in (*path[1:], name):
        found = [getattr(item, step, None) for item in found]
        found = [one for item in found for one in (item.values() if isinstance(item, Mapping) else (item,))]
    value = _default(found[0]) if found and all(item == found[0] for item in found) else ""
    return f"{value} in `twin`" if value else ""


def _section(path: str) -> Any:
    """Return the class of the parameters of a section of a file."""
    from twin_gait.experiment.experiment import Experiment
    from twin_gait.gait import table
    from twin_gait.worlds.registry import find_world

    in_table = {
        "joint": table.JointImpedance,
        "phase": table.PhaseParameters,
        "scaling": table.Scaling,
        "blending": table.Blending,
    }
    if path in in_table:
        return in_table[path]
    kind: Any = Experiment
    for step in path.split(".") if path != "experiment" else []:
        name, _, choice = step.partition(":")
        item = next(item for item in declarations(kind) if item.key == name)
        if name == "scenario":
            kind = find_world(choice)
        else:
            kind = next(one for one in _classes(item.kind) if not choice or one.kind == choice)
    return kind


def _classes(hint: Any) -> Iterator[Any]:
    """Yield the classes of parameters inside a type."""
    if isinstance(hint, type) and issubclass(hint, Parameters):
        yield hint
    for inner in get_args(hint):
        yield from _classes(inner)


def names(experiments: str) -> str:
    """Return the full names of the columns in the logs of some experiments, each a preset with settings."""
    from twin_gait import load_experiment
    from twin_gait.simulation.log import log_layout
    from twin_gait.simulation.simulation_setup import build_setup

    found: dict[str, None] = {}
    for preset, *settings in (item.split(",") for item in experiments.split("+")):
        setup = build_setup(load_experiment(preset, settings).experiment)
        found |= dict.fromkeys(("time_s", *log_layout(setup).names))
    return ", ".join(f"`{name}`" for name in found)


MAKERS: dict[str, Callable[[str], list[dict[str, Any]] | str]] = {
    "columns": columns,
    "strides": strides,
    "names": names,
    "labels": labels,
    "signals": signals,
    "keys": keys,
    "fields": declared.fields,
    "assumptions": declared.assumptions,
    "rules": declared.rules,
    "commands": declared.commands,
    "licences": declared.licences,
}


def insert_results(page: str, *, licences: bool = True) -> str:
    """Return a page with every quoted number and table updated from the results.

    Args:
        page: Text of the page.
        licences: Whether to update the licences of installed distributions, which depend on their versions.
    """

    def current(match: re.Match[str]) -> str:
        kind, name, key, spec, old = match.groups()
        if kind == "licences" and not licences:
            return match.group()
        if kind == "value":
            text = format(find_entry(name, key), spec or "")
        else:
            try:
                content = MAKERS[kind](name) if kind in MAKERS else find_entry(name, key)
            except declared.NotInstalled as error:  # an extra that is not installed
                print(f"the licences of {name} stay as they are: {error}", file=sys.stderr)
                return match.group()
            text = f"\n{content if isinstance(content, str) else format_markdown_table(content)}\n"
        return match.group().replace(f"-->{old}<!-- / -->", f"-->{text}<!-- / -->")

    return QUOTED.sub(current, page)


def pages() -> list[Path]:
    """Return the paths of the README and of all pages."""
    written = (path for path in DOCS.glob("**/*.md") if not {"_build", "gallery", "api"} & set(path.parts))
    return [DOCS.parent / "README.md", *sorted(written)]


def main() -> int:
    """Update the pages, or list those that are out of date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit 1 if a page is out of date"
    )
    check = parser.parse_args().check
    stale = []
    for path in pages():
        page = path.read_text(encoding="utf-8")
        current = insert_results(page, licences=not check)
        if current != page:
            stale.append(str(path.relative_to(DOCS.parent)))
            if not check:
                path.write_text(current, encoding="utf-8")
    print(f"{'out of date' if check else 'brought up to date'}: {', '.join(stale) or 'none'}")
    return int(check and bool(stale))


if __name__ == "__main__":
    sys.exit(main())
