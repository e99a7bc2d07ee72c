"""Resumable sweeps over any parameters of an experiment, on this machine or a cluster.

Finished episodes are stored at once, so that no kill of the process loses them. Each block becomes a small
parquet file in ``parts``, written atomically. At the end of every call the parts are merged into
``table.parquet`` and, with ``strides: true``, into ``strides.csv``. A kill between these two steps leaves
equal rows in both, and one of them is used.
"""

import contextlib
import json
import os
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import JobError, ParameterFileError, RunDirectoryError
from twin_gait.files import read_text, require_parquet, write_atomically, write_json, write_parquet
from twin_gait.report import sweep as sweep_report
from twin_gait.report.canvas import write_figures_page
from twin_gait.report.failures import failed_pictures
from twin_gait.runs.folders import FolderKind, check_target, staged_directory, try_lock
from twin_gait.runs.user_files import store_files
from twin_gait.simulation.run import RunStatus
from twin_gait.studies import batch
from twin_gait.studies.jobs import Stop, WorkCallbacks, run_jobs
from twin_gait.studies.sweep.spec import Sweep, check_episode
from twin_gait.studies.sweep.strides import LOG_COLUMNS, measure_with_strides, merge_strides, store_strides
from twin_gait.studies.workers import Workers

TABLE_SCHEMA_VERSION = 1
SPEC_FILE, TABLE_FILE, SUMMARY_FILE = "spec.yaml", "table.parquet", "summary.json"
REPORT_FILE = "report.html"
PARTS_FOLDER = "parts"
SWEEP = FolderKind("a sweep", SPEC_FILE)
# Checking an episode takes a few milliseconds, starting workers a few seconds: workers check more episodes.
CHECKED_HERE = 2000


def _read_finished_rows(directory: Path) -> pd.DataFrame:
    """Return the rows of all finished episodes by their numbers, from the table and from the parts."""
    files = [*directory.glob(TABLE_FILE), *sorted((directory / PARTS_FOLDER).glob("[!.]*"))]
    rows = pd.concat([pd.DataFrame({"episode": []}, dtype=int), *map(read_table, files)])
    return rows.drop_duplicates("episode").set_index("episode").sort_index()


def _store_rows(directory: Path, rows: Mapping[int, batch.FlatSummary]) -> None:
    """Write the summaries of some episodes to a part of their own."""
    if rows:
        episodes, parts = sorted(rows), directory / PARTS_FOLDER
        table = batch.summary_table([rows[index] for index in episodes])
        table.insert(0, "episode", episodes)
        parts.mkdir(exist_ok=True)
        write_parquet(parts / f"{episodes[0]:08d}-{episodes[-1]:08d}.parquet", table)


def _merge(directory: Path, sweep: Sweep) -> None:
    """Merge all stored rows into the table; the names and values of its settings come from the sweep."""
    rows = _read_finished_rows(directory)
    if sweep.has_strides:
        merge_strides(directory, sweep.overrides, rows.index)
    write_parquet(
        directory / TABLE_FILE,
        batch.results_table(sweep.overrides, rows),
        schema_version=str(TABLE_SCHEMA_VERSION),
        sweep=json.dumps(sweep.document),
    )
    shutil.rmtree(directory / PARTS_FOLDER, ignore_errors=True)


@contextlib.contextmanager
def _lock_sweep_folder(directory: Path, sweep: Sweep) -> Iterator[None]:
    """Open or create the folder of a sweep; no other process can open it meanwhile.

    Raises RunDirectoryError if the folder is in use or cannot be written.
    """
    if not (directory / SPEC_FILE).is_file():
        with staged_directory(directory, SWEEP, force=True) as staging:
            store_files(sweep.files, staging)
            write_atomically(staging / SPEC_FILE, dump_yaml(dict(sweep.document)))
    lock = try_lock(directory)
    if lock is None:
        raise RunDirectoryError(f"{directory}: another process is running this sweep")
    try:
        yield
    finally:
        os.close(lock)


def check_directory(directory: Path, sweep: Sweep) -> None:
    """Check that a folder belongs to this sweep or can be created; raise RunDirectoryError otherwise."""
    check_target(directory, SWEEP, force=True)
    spec = directory / SPEC_FILE
    if spec.is_file() and read_text(spec) != dump_yaml(dict(sweep.document)):
        raise RunDirectoryError(
            f"{directory}: holds another sweep, or was begun by other sources or versions of twin_gait or its"
            " libraries, whose rows would not be comparable; choose another --out"
        )
    for file in sweep.files if spec.is_file() else ():
        if not file.is_stored_in(directory):
            raise RunDirectoryError(
                f"{directory}: was begun with another {file.path.name} than {file.path}; choose another --out"
            )


def read_table(path: Path) -> pd.DataFrame:
    """Read the table of a sweep, or a part of it; raise RunDirectoryError if it cannot be read."""
    try:
        require_parquet(path)
        return pd.read_parquet(path)  # pandas restores the types of the columns
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise RunDirectoryError(
            f"{path}: cannot be read ({reason}); remove it, so that its episodes run again"
        ) from error


@dataclass(frozen=True)
class SweepResult:
    """Result of a sweep."""

    table: pd.DataFrame  # one row per finished episode, sorted by episode
    # content of ``summary.json``; ``status`` is INTERRUPTED if it was stopped; the same call resumes it
    summary: dict[str, Any]


def run_sweep(
    sweep: Sweep,
    directory: Path,
    *,
    workers: Workers | None = None,
    pictures: bool = True,
    **watch: Unpack[WorkCallbacks],
) -> SweepResult:
    """Run a sweep, or resume it after it was stopped or killed.

    All episodes are checked before anything runs. Their results are stored in the folder block by block;
    neither the table nor the rows depend on the workers, the blocks or the number of resumptions. The engine
    is compiled in the calling process, so that no worker has to compile it.

    Raises ParameterError if an episode is wrong or cannot be simulated, naming it; finished episodes are
    kept. Raises RunDirectoryError if the folder has other content or cannot be written. Raises WorkersLost if
    a worker dies; finished episodes are kept.
    """
    workers = workers or Workers()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, workers, watch.get("should_stop"))
    with _lock_sweep_folder(directory, sweep):
        done = set(_read_finished_rows(directory).index)
        try:
            _run(sweep, directory, done, workers, **watch)
        finally:
            _merge(directory, sweep)
        table = read_table(directory / TABLE_FILE)
        status = RunStatus.COMPLETED if len(table) == len(sweep.overrides) else RunStatus.INTERRUPTED
        measured = {
            name: np.isfinite(sweep_report.measure_values(table, name)).any()
            for name in sweep.document["measures"]
        }
        summary = {
            "name": sweep.document["name"],
            "status": status,
            "episodes": len(sweep.overrides),
            "finished": len(table),
            "outcomes": {str(name): int(count) for name, count in sorted(_outcomes(table).items())},
            # episodes whose energy balance shows that their step was too large
            "unstable_steps": _count_unstable_steps(table),
            # requested measures that no completed episode has
            "not_drawn": [name for name, found in measured.items() if not found],
            "last_call": {
                "resumed_with": len(done),
                "episodes": len(table) - len(done),
                "wall_s": time.perf_counter() - began,
            },
        }
        write_json(directory / SUMMARY_FILE, summary)
        if pictures and len(table) > 1:
            record = failed_pictures(write_report(sweep, table, directory))
            if record:
                summary |= record
                write_json(directory / SUMMARY_FILE, summary)
    return SweepResult(table, summary)


def check_sweep(sweep: Sweep, workers: Workers, should_stop: Stop | None = None) -> None:
    """Check the overrides of every episode without running any; an error names the episode and its key."""
    check, episodes = partial(check_episode, sweep.maker()), list(enumerate(sweep.overrides))
    check_workers = workers if len(episodes) > CHECKED_HERE else 1
    try:
        checked = run_jobs(check, episodes, workers=check_workers, should_stop=should_stop)
    except JobError as error:
        raise ParameterFileError(sweep.source, "", error.problem) from error
    if len(checked) < len(episodes):
        raise KeyboardInterrupt


def _run(
    sweep: Sweep, directory: Path, done: Collection[int], workers: Workers, **watch: Unpack[WorkCallbacks]
) -> None:
    """Run the episodes that are not finished yet."""
    pending = [episode for episode in enumerate(sweep.overrides) if episode[0] not in done]
    report = watch.get("progress") or (lambda number, total: None)

    def store(results: Mapping[int, Any]) -> None:
        numbered = {pending[index][0]: result for index, result in results.items()}
        if sweep.has_strides and numbered:
            store_strides(directory, {episode: table for episode, (_, table) in numbered.items()})
            numbered = {episode: flat for episode, (flat, _) in numbered.items()}
        _store_rows(directory, numbered)

    report(len(done), len(sweep.overrides))
    batch.run_episodes(
        sweep.maker(),
        measure_with_strides if sweep.has_strides else batch.flat_summary,
        pending,
        columns=LOG_COLUMNS if sweep.has_strides else batch.SUMMARY_LOG_COLUMNS,
        workers=workers,
        on_results=store,
        episode_name=lambda index: f"{sweep.source}: episode {pending[index][0]}",
        **watch | {"progress": lambda number, _: report(len(done) + number, len(sweep.overrides))},
    )


def _outcomes(table: pd.DataFrame) -> pd.Series:
    """Count the episodes by outcome; for an episode without a request to walk, by its status."""
    if "outcome" not in table:
        return pd.Series(dtype=int)
    return table["outcome"].fillna(table["status"]).value_counts()


def _count_unstable_steps(table: pd.DataFrame) -> int:
    """Count the episodes whose step was too large; a table without a finished episode has no columns."""
    return int(table["step_stable"].eq(False).sum()) if "step_stable" in table else 0


def write_report(sweep: Sweep, table: pd.DataFrame, directory: Path) -> dict[str, str]:
    """Draw the table: ``figures/*.png``, and ``report.html`` with all of them.

    Returns the reason of each figure that could not be drawn, by name.
    """
    parameters = [str(name) for name in batch.settings_table(sweep.overrides)]
    title = sweep.document["name"].replace("_", " ")
    measures = (sweep_report.WALKED, *(sweep.document["measures"] or sweep_report.DEFAULT_MEASURES))
    counts = _outcomes(table).items()
    rows = [("outcome", "episodes", "share [%]")]
    rows += [(str(outcome), str(count), f"{100.0 * count / len(table):.1f}") for outcome, count in counts]
    figures = sweep_report.sweep_figures(table, parameters, measures, title)
    subtitle = f"{len(table)} episodes, {len(parameters)} parameters"
    tables = {"main effects": sweep_report.main_effect_rows(table, parameters, measures)}
    content = (figures, f"Sweep: {title}", subtitle, rows, tables)
    return write_figures_page(directory / REPORT_FILE, *content, sweep_report.figure_heading)
