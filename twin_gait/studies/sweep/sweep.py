"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster."""

import json
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import write_atomically
from twin_gait.report.pages import Picture, figures_page, picture_of
from twin_gait.report.sweep import DEFAULT_MEASURES, WALKED, sweep_figures, values_of
from twin_gait.runs.summary import READ_IN_BRIEF
from twin_gait.simulation import RunStatus
from twin_gait.studies.batch import Flat, block_ahead, flat_summary, measured, setting_columns
from twin_gait.studies.jobs import Portion, Progress, Stop, Workers, one_by_one, portions, run_jobs
from twin_gait.studies.sweep.episode import Episode, check_episode, episodes_of
from twin_gait.studies.sweep.spec import Sweep
from twin_gait.studies.sweep.store import (
    FIGURES_FOLDER,
    REPORT_FILE,
    SPEC_FILE,
    SUMMARY_FILE,
    SweepStore,
    check_directory,
    open_store,
    read_table,
)

# Checking an episode takes a few milliseconds, starting workers a few seconds: more are checked by them.
CHECKED_HERE = 2000
_CHECKED_AT_ONCE = 200


@dataclass(frozen=True)
class SweepResult:
    """What a sweep gives back."""

    directory: Path  # where everything is
    table: pd.DataFrame  # one row per finished episode, sorted by episode
    status: RunStatus  # COMPLETED, or INTERRUPTED if it was stopped; the same call goes on with it
    resumed: int  # episodes that were there before
    summary: dict[str, Any]  # content of ``summary.json``
    not_drawn: tuple[str, ...] = ()  # measures that were asked for and that no completed episode has


def run_sweep(
    sweep: Sweep,
    directory: Path,
    *,
    workers: Workers | None = None,
    pictures: bool = True,
    checking: Progress | None = None,
    progress: Progress | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> SweepResult:
    """Run a sweep, or go on with it where it was stopped or killed.

    All episodes are checked before anything runs. Their results are kept in the folder block by block;
    neither the table nor the rows depend on the workers, the blocks or the number of resumptions. The engine
    is compiled in the calling process, so that no worker has to.

    Raises ParameterFileError if an episode is wrong or cannot be run, naming it; what was done is kept.
    Raises RunDirectoryError if the folder holds something else or cannot be written. Raises WorkersLost if
    workers die again and again; what was done is kept.
    """
    workers = workers or Workers()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, workers, checking, should_stop)
    last: dict[str, Any] = {"slots": workers.slots()}
    with open_store(directory, sweep) as store:
        last["resumed_with"] = int(store.done.sum())
        try:
            last["processors"] = _run(sweep, store, workers, progress, should_stop, on_compile)
        finally:
            store.merge()
        table = read_table(directory)
        last |= {"episodes": len(table) - last["resumed_with"], "wall_s": time.perf_counter() - began}
        summary = _summary(sweep, table, last)
        write_atomically(directory / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
        if pictures and len(table) > 1:
            write_pictures(sweep, table, directory, workers)
    without = tuple(name for name in sweep.measures if not np.isfinite(values_of(table, name)).any())
    status = RunStatus(summary["status"])
    return SweepResult(directory, table, status, last["resumed_with"], summary, without)


def check_sweep(
    sweep: Sweep,
    workers: Workers | None = None,
    progress: Progress | None = None,
    should_stop: Stop | None = None,
) -> None:
    """Check the overrides of every episode without running any; a wrong one is named with its key."""
    total, checked = len(sweep.design), 0
    if workers is None or total <= CHECKED_HERE:
        workers = Workers()
    episodes, check = episodes_of(sweep, range(total)), partial(one_by_one, check_episode)
    with closing(portions(check, episodes, total, workers, block=_CHECKED_AT_ONCE)) as coming:
        for portion in coming:
            checked += len(portion.results)
            if progress is not None:
                progress(checked, total)
            if portion.problem:
                raise ParameterFileError(sweep.source, "", portion.problem[1])
            if should_stop is not None and should_stop():
                raise KeyboardInterrupt


def _run(
    sweep: Sweep,
    store: SweepStore,
    workers: Workers,
    progress: Progress | None,
    should_stop: Stop | None,
    on_compile: Callable[[], None] | None,
) -> list[str]:
    """Run what is not done yet; types of the processors that did it."""
    pending = np.flatnonzero(~store.done).tolist()
    tell = progress or (lambda done, total: None)
    tell(int(store.done.sum()), len(store.done))
    if not pending:
        return []
    first, processors = next(episodes_of(sweep, pending)), set()
    coming: Any = portions(
        partial(measured, Episode.experiment, flat_summary, READ_IN_BRIEF),
        episodes_of(sweep, pending),
        len(pending),
        workers,
        block=block_ahead(first.experiment, len(pending), on_compile),
        should_stop=should_stop,
    )
    portion: Portion[Flat]
    with closing(coming):
        for portion in coming:
            store.append({pending[place]: flat for place, flat in portion.results.items()})
            processors.add(portion.processor)
            if portion.problem:
                place, text = portion.problem
                named = f"episode {pending[place]}: "
                raise ParameterFileError(sweep.source, "", named + text.removeprefix(named))
            tell(int(store.done.sum()), len(store.done))
    return sorted(processors)


def _summary(sweep: Sweep, table: pd.DataFrame, last_call: dict[str, Any]) -> dict[str, Any]:
    total, outcomes = len(sweep.design), table.get("outcome", pd.Series(dtype=str)).value_counts()
    return {
        "name": sweep.name,
        "sweep_sha256": sweep.sha256,
        "status": str(RunStatus.COMPLETED if len(table) == total else RunStatus.INTERRUPTED),
        "episodes": total,
        "finished": len(table),
        "outcomes": {str(name): int(count) for name, count in sorted(outcomes.items())},
        "last_call": last_call,
    }


def write_pictures(sweep: Sweep, table: pd.DataFrame, directory: Path, workers: Workers) -> None:
    """Draw the table, by workers of this machine: ``figures/*.png``, and ``report.html`` with all of them."""
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
