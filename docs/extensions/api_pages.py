"""Write a page for every public package: the names that its ``__all__`` lists, with their docstrings."""

from __future__ import annotations

import importlib
from pathlib import Path

import twin_gait

PACKAGES = (
    "configuration", "experiment", "parameters", "worlds", "gait", "control", "leg_model", "simulation",
    "measures", "runs", "report", "checking", "testing", "replay", "identification", "studies", "export",
    "firmware", "core",
)  # fmt: skip


def summary_of(module: str) -> str:
    """First sentence of a module's docstring."""
    return (importlib.import_module(module).__doc__ or "").strip().splitlines()[0]


def page_of(module: str, hidden: frozenset[str]) -> str:
    """Page of a package in MyST; names in ``hidden`` stand on another page."""
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
    return "\n".join(lines)


def prepare(folder: Path) -> None:
    """Write the pages; what has not changed keeps its time."""
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
