"""Writer of a page for every public package with the names in its ``__all__`` and their docstrings."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import twin_gait

PACKAGES = (
    "configuration", "experiment", "parameters", "worlds", "gait", "control", "leg_model", "simulation",
    "measures", "runs", "report", "checking", "testing", "replay", "identification", "studies", "export",
    "firmware", "core",
)  # fmt: skip


def summary_of(module: str) -> str:
    """Return the first line of the docstring of a module."""
    return (importlib.import_module(module).__doc__ or "").strip().splitlines()[0]


def constants(module: str) -> list[str]:
    """Return the public names of a package that are neither classes nor functions."""
    found = importlib.import_module(module)
    values = {name: getattr(found, name) for name in found.__all__ if not name.startswith("__")}
    return [
        name for name, value in values.items() if not (inspect.isclass(value) or inspect.isroutine(value))
    ]


def _assignments(module: str) -> Iterator[tuple[str, list[str], int, int]]:
    """Yield the names assigned in a package, the lines of the file, and first and last line of each."""
    for path in sorted(Path(importlib.import_module(module).__file__ or "").parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.parse(text).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for name in (item for target in targets if target for item in ast.walk(target)):
                if isinstance(name, ast.Name):
                    yield name.id, text.splitlines(), node.lineno, node.end_lineno or node.lineno


def meanings(module: str) -> dict[str, str]:
    """Return the comment next to or above the assignment of each constant of a package, by name."""
    wanted, found = set(constants(module)), {}
    for name, lines, first, last in _assignments(module):
        if name not in wanted:
            continue
        above: list[str] = []
        while (line := lines[first - 2 - len(above)]).startswith("#"):
            above.insert(0, line.lstrip("# "))
        beside = [part for line in lines[first - 1 : last] for part in re.findall(r"  # (.*)", line)][:1]
        found[name] = " ".join([*above, *beside])
    return found


def constants_of(module: str) -> list[str]:
    """Return the table of the constants of a package as lines."""
    said, values = meanings(module), importlib.import_module(module)
    rows = []
    for name in constants(module):
        value = repr(getattr(values, name))
        value = f"``{value}``" if len(value) <= 40 else ""
        rows.append([f"``{module}.{name}``", value, said.get(name, "").replace("`", "")])
    if not rows:
        return []
    cells = ["   * - " + "\n     - ".join(row) for row in (["name", "value", "meaning"], *rows)]
    head = ["## Constants", "", "```{eval-rst}", ".. list-table::", "   :header-rows: 1", ""]
    return [*head, *cells, "```", ""]


def page_of(module: str, hidden: frozenset[str]) -> str:
    """Return the page of a package in MyST; names in ``hidden`` are on another page."""
    names = [name for name in importlib.import_module(module).__all__ if name not in hidden]
    others = sorted(set(importlib.import_module(module).__all__) & hidden)
    lines = [f"# `{module}`", "", "```{eval-rst}", f".. automodule:: {module}"]
    if names:
        lines += ["   :members:", "   :imported-members:"]
        if others:
            lines.append(f"   :exclude-members: {', '.join(others)}")
    lines += ["```", ""]
    if others:
        lines += [
            "Also here, described in [twin_gait](twin_gait.md): " + ", ".join(f"`{o}`" for o in others) + ".",
            "",
        ]
    return "\n".join([*lines, *constants_of(module)])


def prepare(folder: Path) -> None:
    """Write the pages; unchanged files keep their time of modification."""
    folder.mkdir(parents=True, exist_ok=True)
    top = frozenset(twin_gait.__all__)
    pages = {"twin_gait.md": page_of("twin_gait", frozenset({"__version__"}))}
    rows = [
        "| package | what is in it |",
        "|---|---|",
        f"| [twin_gait](twin_gait.md) | {summary_of('twin_gait')} |",
    ]
    for name in PACKAGES:
        module = f"twin_gait.{name}"
        pages[f"{name}.md"] = page_of(module, top)
        rows.append(f"| [{module}]({name}.md) | {summary_of(module)} |")
    tree = "\n".join(["```{toctree}", ":hidden:", "", "twin_gait", *PACKAGES, "```"])
    pages["index.md"] = "\n".join(
        [
            "# API",
            "",
            "Public is what `__all__` lists of `twin_gait` and its direct packages.",
            "",
            *rows,
            "",
            tree,
            "",
        ]
    )
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
