"""The folder of a study: figure, tables, paragraph, and one page that holds all of it."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from twin_gait import __version__
from twin_gait.files import write_atomically
from twin_gait.report.canvas import picture_bytes
from twin_gait.report.html_page import html_page, paragraphs, picture_source
from twin_gait.runs.folders import FolderKind, staged_directory

PAGE_FILE = "whatif.html"
STUDY = FolderKind("a study", PAGE_FILE)
PARAGRAPH_FILE = "paragraph.txt"


@dataclass(frozen=True, eq=False)
class Report:
    """What a study has to say.

    Attributes:
        name: Of the study, for the names of its files.
        title: A question.
        text: Paragraphs, computed from the tables.
        tables: By their names.
        figure: Drawn.
    """

    name: str
    title: str
    text: tuple[str, ...]
    tables: Mapping[str, pd.DataFrame]
    figure: Figure


def write_report(report: Report, target: Path, *, force: bool = False) -> None:
    """Write the folder of a study; it appears when all is written.

    Args:
        report: The study.
        target: The folder to make.
        force: Whether the folder of an earlier study may be replaced.

    Raises:
        RunDirectoryError: If it exists, or cannot be written.
    """
    with staged_directory(target, STUDY, force=force) as staging:
        picture = picture_bytes(report.figure)
        write_atomically(staging / f"{report.name}.png", picture)
        for name, table in report.tables.items():
            write_atomically(staging / f"{name}.csv", table.to_csv(index=False, lineterminator="\n"))
        write_atomically(staging / PARAGRAPH_FILE, "\n\n".join(report.text) + "\n")
        write_atomically(staging / PAGE_FILE, page(report, picture))


def page(report: Report, picture: bytes) -> str:
    """The page, which needs no other file.

    Args:
        report: The study.
        picture: Its figure as PNG.

    Returns:
        HTML.
    """
    body = [
        paragraphs(report.text),
        f'<img alt="{html.escape(report.title)}" src="{picture_source(picture)}">',
        *(_folded(name, table) for name, table in report.tables.items()),
    ]
    return html_page(report.title, "\n".join(body), version=__version__)


def _folded(name: str, table: pd.DataFrame) -> str:
    rows = table.to_html(index=False, border=0)
    return f"<details><summary>{html.escape(name)}: {len(table)} rows</summary>\n{rows}\n</details>"
