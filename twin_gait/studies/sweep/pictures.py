"""Pictures of a sweep, drawn by as many processes as have run it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from twin_gait.files import write_atomically
from twin_gait.report.pages import Picture, figures_page, picture_of
from twin_gait.report.sweep import DEFAULT_MEASURES, WALKED, sweep_figures
from twin_gait.studies.batch import setting_columns
from twin_gait.studies.jobs import Workers, run_jobs
from twin_gait.studies.sweep.spec import Sweep
from twin_gait.studies.sweep.store import FIGURES_FOLDER, REPORT_FILE


def write_pictures(sweep: Sweep, table: pd.DataFrame, directory: Path, workers: Workers) -> None:
    """Draw the table: ``figures/*.png``, and ``report.html`` with all of them.

    Args:
        workers: Who draws, if they are processes of this machine.
    """
    parameters = list(setting_columns(sweep.design.columns).values())
    title = sweep.name.replace("_", " ")
    measures = (WALKED, *(sweep.measures or DEFAULT_MEASURES))
    shown = table[[name for name in dict.fromkeys((*parameters, "outcome", *measures)) if name in table]]
    here = workers if workers.local else Workers()
    drawn = run_jobs(partial(_drawn, shown, parameters, title), measures, workers=here)
    pictures = {name: picture for part in drawn for name, picture in part.items()}
    folder = directory / FIGURES_FOLDER
    folder.mkdir(exist_ok=True)
    for name, picture in pictures.items():
        write_atomically(folder / f"{name}.png", picture.light)
    counts = table["outcome"].value_counts().items()
    rows = [(str(outcome), str(count), f"{100.0 * count / len(table):.1f}") for outcome, count in counts]
    named = {name.replace("_", " "): picture for name, picture in pictures.items()}
    subtitle = f"{len(table)} episodes, {len(parameters)} parameters"
    page = figures_page(f"Sweep: {title}", subtitle, named, ("outcome", "episodes", "share [%]"), rows)
    write_atomically(directory / REPORT_FILE, page)


def _drawn(table: pd.DataFrame, parameters: Sequence[str], title: str, measure: str) -> dict[str, Picture]:
    figures = sweep_figures(table, parameters, (measure,), title)
    return {name: picture_of(figure) for name, figure in figures.items()}
