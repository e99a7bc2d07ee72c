"""Parts of pages from declarations in the program: commands, rules, fields of records, licences.

Each function returns rows of a table or a part of Markdown for ``docs/insert.py``.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, get_args


class NotInstalled(Exception):
    """Error for a distribution whose metadata is needed and that is not installed."""


def fields(path: str) -> list[dict[str, Any]]:
    """Return the fields of a dataclass or named tuple with their comments.

    Raises:
        ValueError: If a field has no comment.
    """
    module, _, name = path.rpartition(".")
    found = list(fields_of(getattr(importlib.import_module(module), name)))
    bare = [field for field, _kind, meaning in found if not meaning]
    if bare:
        raise ValueError(f"{path}: no comment next to or above {', '.join(bare)}")
    return [
        {
            "field": f"`{field}`",
            "type": f"`{kind}`".replace("|", "\\|"),
            "meaning": meaning.replace("|", "or"),
        }
        for field, kind, meaning in found
    ]


def fields_of(kind: type) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and meaning of every field of a class from its source."""
    source = inspect.cleandoc("\n" + inspect.getsource(kind))
    comments = {
        token.start[0]: (token.string.lstrip("# "), token.line.strip().startswith("#"))
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    for item in body.body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            above: list[str] = []
            line = item.lineno - 1
            while line in comments and comments[line][1]:
                above.insert(0, comments[line][0])
                line -= 1
            last = item.end_lineno or item.lineno
            beside = comments.get(last, comments.get(item.lineno, ("", False)))[0]
            yield item.target.id, ast.unparse(item.annotation), beside or " ".join(above)


def assumptions(_: str) -> list[dict[str, Any]]:
    """Return the keys of experiment files and gait tables with a default that is an assumption."""
    from twin_gait.experiment.experiment import Experiment
    from twin_gait.parameters.quantities import Parameters, declarations
    from twin_gait.worlds.registry import find_world, world_kinds

    rows: list[dict[str, Any]] = []
    seen: set[type] = set()

    def classes(hint: Any) -> Iterator[type]:
        if isinstance(hint, type) and issubclass(hint, Parameters):
            yield hint
        for inner in get_args(hint):
            yield from classes(inner)

    def walk(kind: type, path: str, world: str = "") -> None:
        if kind in seen:
            return
        seen.add(kind)
        for item in declarations(kind):
            key = f"{path}{next(iter(item.keys))}"
            if re.search(r"\bassumption", item.meaning):
                rows.append({"key": f"`{key}`{world}", "meaning": item.meaning.replace("|", "or")})
            for inner in classes(item.kind):
                walk(inner, f"{path}{item.key}.", world)

    walk(Experiment, "")
    for name in sorted(world_kinds()):
        walk(find_world(name), "scenario.", f", {name}")
    return rows


def rules(_: str) -> list[dict[str, Any]]:
    """Return the rules of the check."""
    from twin_gait.checking import check

    notes = {rule.__name__ for rule in check.NOTES}
    modes = {rule.__name__ for rule in check.MODE_RULES}
    legs = {rule.__name__ for rule in check.RULES}
    return [
        {
            "rule": f"`{name}`",
            "of": ", ".join(
                word for word, names in (("gait tables", legs), ("tables of modes", modes)) if name in names
            )
            or "waivers",
            "finds": meaning + (" A note." if name in notes else ""),
        }
        for name, meaning in check.rules().items()
    ]


def commands(_: str) -> str:
    """Return every command with its options, by the groups of ``--help``."""
    from twin_gait.cli.program import build_parser

    parser = build_parser()
    pieces = []
    for title, group in parser.groups.items():
        pieces.append(f"## {title[:1].upper()}{title[1:]}")
        for name in group:
            pieces += _command(f"twin-gait {name}", _choices(parser)[name], "###")
    return "\n\n".join(pieces)


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _command(name: str, parser: argparse.ArgumentParser, level: str) -> Iterator[str]:
    yield f"{level} {name}"
    summary = parser.description or ""
    if summary:
        yield _markdown(summary)
    rows = [
        {"": _usage(action), "meaning": _markdown(_help(action, parser)).replace("|", "\\|")}
        for action in parser._actions
        if not isinstance(action, (argparse._HelpAction, argparse._SubParsersAction))
        and action.help is not argparse.SUPPRESS
        and "--debug" not in action.option_strings
    ]
    if rows:
        yield "\n".join(
            ["| | meaning |", "| --- | --- |", *(f"| {row['']} | {row['meaning']} |" for row in rows)]
        )
    for inner, choice in _choices(parser).items():
        yield from _command(f"{name} {inner}", choice, f"{level}#")


def _usage(action: argparse.Action) -> str:
    values = action.metavar or ("" if action.nargs == 0 else (action.dest if action.option_strings else ""))
    if isinstance(values, tuple):
        values = " ".join(values)
    if action.choices is not None and action.metavar is None:
        values = "{" + ",".join(map(str, action.choices)) + "}"
    elif not action.option_strings:
        values = str(action.metavar or action.dest)
    name = ", ".join(action.option_strings)
    text = f"{name} {values}".strip()
    return f"`{text}`".replace("|", "\\|")


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    values = {**vars(action), "prog": parser.prog}
    return (action.help or "") % values if "%" in (action.help or "") else action.help or ""


def _markdown(text: str) -> str:
    """Return a help text as Markdown, in which only options and code have markup."""
    text = re.sub(r"``?([^`]+)``?", r"`\1`", text).replace("<", "&lt;")
    return re.sub(r"(?<![\w`-])(--[a-z][\w-]*)(?![\w`])", r"`\1`", text)


def licences(extra: str) -> list[dict[str, Any]]:
    """Return the licences of requirements of the package by the metadata of the installed distributions.

    Args:
        extra: ``package``, an extra, or ``closure`` for the indirect requirements of the package.
    """
    direct = {_name(text) for text in _requirements("package" if extra == "closure" else extra)}
    names = _closure(direct) - direct if extra == "closure" else direct
    rows = []
    for name in sorted(names):
        try:
            rows.append({"package": f"`{name}`", "licence": licence_of(metadata.metadata(name))})
        except metadata.PackageNotFoundError:
            raise NotInstalled(f"{name} is not installed, so its licence is not known here") from None
    return rows


def _name(requirement: str) -> str:
    return re.split(r"[<>=!~\[; (]", requirement, maxsplit=1)[0].lower().replace("_", "-")


def _closure(names: set[str]) -> set[str]:
    """Return the installed distributions that some distributions require, including these."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        try:
            required = metadata.requires(name) or []
        except metadata.PackageNotFoundError:  # for another platform or Python version
            continue
        found.add(name)
        waiting += [_name(text) for text in required if "extra ==" not in text]
    return found


def _requirements(extra: str) -> list[str]:
    import tomllib

    with (Path(__file__).parents[1] / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    every = project["dependencies"] if extra == "package" else project["optional-dependencies"][extra]
    return [text for text in every if not text.startswith("twin-gait")]


def licence_of(found: Any) -> str:
    """Return the licence in the metadata: an expression, classifiers, a short text, or its file's title."""
    if found["License-Expression"]:
        return str(found["License-Expression"])
    classified = [
        text.rpartition(" :: ")[2]
        for text in found.get_all("Classifier", [])
        if text.startswith("License ::") and not text.endswith("OSI Approved")
    ]
    if classified:
        return ", ".join(classified)
    text = str(found["License"] or "").strip().splitlines()
    if text and len(text[0]) < 60:
        return text[0]
    if found["Name"].startswith("cmeel-"):
        return f"that of {found['Name'].removeprefix('cmeel-')}, which it packs"
    for file in found.get_all("License-File", []):
        licence = metadata.distribution(found["Name"]).read_text(f"licenses/{file}") or ""
        title = licence.strip().partition("\n")[0]
        if title == found["Name"]:  # a heading, before a sentence that names the licence
            title = next((line.rstrip(":") for line in licence.splitlines() if "license" in line), title)
        if 0 < len(title) < 60:
            return title
    return "not named in its metadata"
