"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster.

Finished episodes are kept at once, so that a kill loses none of them. Each block becomes a small parquet
file in ``parts``, written atomically. At the end of every call parts are merged into ``table.parquet``.
A kill between the two leaves rows in both, of which one counts: they are equal.
"""

import contextlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import JobFailed, ParameterFileError, RunDirectoryError
from twin_gait.files import write_atomically, write_json, write_parquet
from twin_gait.report.canvas import FIGURES_FOLDER, write_pictures
from twin_gait.report.sweep import DEFAULT_MEASURES, WALKED, sweep_figures, values_of
from twin_gait.runs.folders import FolderKind, check_target, hold, staged_directory
from twin_gait.simulation import RunStatus
from twin_gait.studies import batch
from twin_gait.studies.jobs import Stop, Watch, run_jobs
from twin_gait.studies.sweep.spec import Sweep, check_episode, experiment_of_episode
from twin_gait.studies.workers import Workers

TABLE_SCHEMA_VERSION = 1
SPEC_FILE, TABLE_FILE, SUMMARY_FILE = "spec.yaml", "table.parquet", "summary.json"
PARTS_FOLDER = "parts"
SWEEP = FolderKind("a sweep", SPEC_FILE)
# Checking an episode takes a few milliseconds, starting workers a few seconds: more are checked by them.
CHECKED_HERE = 2000


class SweepStore:
    """An open folder of a sweep; ``done`` says which episodes are kept, shape ``(n,)``."""

    def __init__(self, directory: Path, sweep: Sweep) -> None:
        """Look at what is there; see :func:`open_store`, which also locks it."""
        self.done = np.zeros(len(sweep.design), dtype=bool)
        self._directory, self._parts, self._sweep = directory, directory / PARTS_FOLDER, sweep
        for path in self._files():
            self.done[read_table(path, ["episode"])["episode"]] = True

    def append(self, rows: Mapping[int, batch.Flat]) -> None:
        """Keep the summaries of some episodes in a part of their own."""
        if not rows:
            return
        episodes = sorted(rows)
        table = batch.summary_table([rows[index] for index in episodes])
        table.insert(0, "episode", episodes)
        self._parts.mkdir(exist_ok=True)
        write_parquet(self._parts / f"{episodes[0]:08d}-{episodes[-1]:08d}.parquet", table)
        self.done[episodes] = True

    def merge(self) -> None:
        """Bring everything that is kept into the table: sorted by episode, settings first."""
        parts = [pd.DataFrame({"episode": []}, dtype=int), *map(read_table, self._files())]
        rows = pd.concat(parts).drop_duplicates("episode").sort_values("episode", ignore_index=True)
        settings = self._sweep.design.apply(_typed).rename(columns=batch.setting_columns(self._sweep.design))
        settings = settings.iloc[rows["episode"]].reset_index(drop=True)
        # Columns in the order of a summary, whatever part came first; settings are those of the design.
        results = rows[[name for name in batch.SUMMARY_COLUMNS if name in rows.columns]]
        table = pd.concat([rows[["episode"]], settings, results], axis=1)
        write_parquet(
            self._directory / TABLE_FILE,
            table,
            schema_version=str(TABLE_SCHEMA_VERSION),
            sweep=json.dumps(self._sweep.document),
        )
        shutil.rmtree(self._parts, ignore_errors=True)

    def _files(self) -> list[Path]:
        return [*self._directory.glob(TABLE_FILE), *sorted(self._parts.glob("[!.]*"))]


@contextlib.contextmanager
def open_store(directory: Path, sweep: Sweep) -> Iterator[SweepStore]:
    """Open the folder of a sweep, or make it; no other process can open it meanwhile.

    Raises RunDirectoryError if the folder is in use or cannot be written.
    """
    if not (directory / SPEC_FILE).is_file():
        with staged_directory(directory, SWEEP, force=True) as staging:
            write_atomically(staging / SPEC_FILE, dump_yaml(dict(sweep.document)))
    held = hold(directory)
    if held is None:
        raise RunDirectoryError(f"{directory}: another process is at work on this sweep")
    try:
        yield SweepStore(directory, sweep)
    finally:
        os.close(held)


def check_directory(directory: Path, sweep: Sweep) -> None:
    """Refuse a folder that is not this sweep's."""
    check_target(directory, SWEEP, force=True)
    spec = directory / SPEC_FILE
    if spec.is_file() and spec.read_text(encoding="utf-8") != dump_yaml(dict(sweep.document)):
        raise RunDirectoryError(
            f"{directory}: holds another sweep, or was begun by other sources or versions of twin_gait or its"
            " libraries, whose rows would not be comparable; choose another --out"
        )


def read_table(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    """Read the table of a sweep, or a part of it."""
    try:
        return pd.read_parquet(path, columns=columns)
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise RunDirectoryError(
            f"{path}: cannot be read ({reason}); remove it, and its episodes run again"
        ) from error


def _typed(values: pd.Series) -> pd.Series:
    """A setting over the whole design, in a type that does not depend on how far the sweep has come.

    What has no type of its own is written as JSON.
    """
    typed = values.infer_objects()
    if typed.dtype != object:
        return typed
    return values.map(
        lambda value: value if isinstance(value, str) else json.dumps(value), na_action="ignore"
    )


@dataclass(frozen=True)
class SweepResult:
    """What a sweep gives back."""

    table: pd.DataFrame  # one row per finished episode, sorted by episode
    status: RunStatus  # COMPLETED, or INTERRUPTED if it was stopped; the same call goes on with it
    summary: dict[str, Any]  # content of ``summary.json``


def run_sweep(
    sweep: Sweep,
    directory: Path,
    *,
    workers: Workers | None = None,
    pictures: bool = True,
    **watch: Unpack[Watch],
) -> SweepResult:
    """Run a sweep, or go on with it where it was stopped or killed.

    All episodes are checked before anything runs. Their results are kept in the folder block by block;
    neither the table nor the rows depend on the workers, the blocks or the number of resumptions. The engine
    is compiled in the calling process, so that no worker has to.

    Raises ParameterError if an episode is wrong or cannot be run, naming it; what was done is kept.
    Raises RunDirectoryError if the folder holds something else or cannot be written. Raises WorkersLost if
    a worker dies; what was done is kept.
    """
    workers = workers or Workers()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, workers, watch.get("should_stop"))
    with open_store(directory, sweep) as store:
        resumed = int(store.done.sum())
        try:
            _run(sweep, store, workers, **watch)
        finally:
            store.merge()
        table = read_table(directory / TABLE_FILE)
        status = RunStatus.COMPLETED if store.done.all() else RunStatus.INTERRUPTED
        measured = {name: np.isfinite(values_of(table, name)).any() for name in sweep.document["measures"]}
        summary = {
            "name": sweep.document["name"],
            "status": str(status),
            "episodes": len(sweep.design),
            "finished": len(table),
            "outcomes": {str(name): int(count) for name, count in sorted(_outcomes(table).items())},
            # measures that were asked for and that no completed episode has
            "not_drawn": [name for name, found in measured.items() if not found],
            "last_call": {
                "resumed_with": resumed,
                "episodes": len(table) - resumed,
                "wall_s": time.perf_counter() - began,
            },
        }
        write_json(directory / SUMMARY_FILE, summary)
        if pictures and len(table) > 1:
            write_figures(sweep, table, directory)
    return SweepResult(table, status, summary)


def check_sweep(sweep: Sweep, workers: Workers, should_stop: Stop | None = None) -> None:
    """Check the overrides of every episode without running any; a wrong one is named with its key."""
    check, episodes = partial(check_episode, json.dumps(sweep.document)), range(len(sweep.design))
    hands = workers if len(episodes) > CHECKED_HERE else 1
    try:
        checked = run_jobs(check, episodes, workers=hands, should_stop=should_stop)
    except JobFailed as error:
        raise ParameterFileError(sweep.source, "", error.problem) from error
    if len(checked) < len(episodes):
        raise KeyboardInterrupt


def _run(sweep: Sweep, store: SweepStore, workers: Workers, **watch: Unpack[Watch]) -> None:
    """Run what is not done yet."""
    pending = np.flatnonzero(~store.done).tolist()
    total, there = len(store.done), len(store.done) - len(pending)
    tell = watch.get("progress") or (lambda done, total: None)
    tell(there, total)
    batch.run_episodes(
        partial(experiment_of_episode, json.dumps(sweep.document)),
        batch.flat_summary,
        pending,
        columns=batch.READ_IN_BRIEF,
        workers=workers,
        keep=lambda rows: store.append({pending[place]: flat for place, flat in rows.items()}),
        named=lambda place: f"{sweep.source}: episode {pending[place]}",
        **watch | {"progress": lambda done, _: tell(there + done, total)},
    )


def _outcomes(table: pd.DataFrame) -> pd.Series:
    """How many episodes had which outcome; of one that was not asked to walk its status counts."""
    if "outcome" not in table:
        return pd.Series(dtype=int)
    return table["outcome"].fillna(table["status"]).value_counts()


def write_figures(sweep: Sweep, table: pd.DataFrame, directory: Path) -> None:
    """Draw the table into ``figures/*.png``."""
    parameters = list(batch.setting_columns(sweep.design).values())
    title = sweep.document["name"].replace("_", " ")
    measures = (WALKED, *(sweep.document["measures"] or DEFAULT_MEASURES))
    write_pictures(sweep_figures(table, parameters, measures, title), directory / FIGURES_FOLDER)
