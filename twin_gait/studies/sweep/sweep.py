"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster.

Finished episodes are kept at once, so that a kill loses none of them. Each block becomes a small parquet
file in ``parts``, written atomically. At the end of every call parts are merged into ``table.parquet``.
A kill between the two leaves rows in both, of which one counts: they are equal.
"""

import contextlib
import json
import os
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
from twin_gait.report.canvas import write_figures_page
from twin_gait.report.sweep import DEFAULT_MEASURES, WALKED, sweep_figures, unit_of_column, values_of
from twin_gait.runs.folders import hold
from twin_gait.simulation import RunStatus
from twin_gait.studies import batch
from twin_gait.studies.jobs import Progress, Watch, run_jobs
from twin_gait.studies.sweep.spec import Sweep, check_episode, experiment_of_episode
from twin_gait.studies.workers import Workers

TABLE_SCHEMA_VERSION = 1
SPEC_FILE, TABLE_FILE, SUMMARY_FILE = "spec.yaml", "table.parquet", "summary.json"
REPORT_FILE = "report.html"
PARTS_FOLDER = "parts"

# Checking an episode takes a few milliseconds, starting workers a few seconds: more are checked by them.
CHECKED_HERE = 2000


class SweepStore:
    """An open folder of a sweep; ``done`` says which episodes are kept, shape ``(n,)``."""

    def __init__(self, directory: Path, sweep: Sweep) -> None:
        """Look at what is there; see :func:`open_store`, which also locks it."""
        self.done = np.zeros(len(sweep.design), dtype=bool)
        self._directory, self._parts, self._sweep = directory, directory / PARTS_FOLDER, sweep
        for path in self._files():
            self.done[_read_parquet(path, ["episode"])["episode"]] = True

    def append(self, rows: Mapping[int, batch.Flat]) -> None:
        """Keep the summaries of some episodes in a part of their own."""
        if not rows:
            return
        episodes = sorted(rows)
        table = batch.summary_table([rows[index] for index in episodes])
        table.insert(0, "episode", episodes)
        write_parquet(self._parts / f"{episodes[0]:08d}-{episodes[-1]:08d}.parquet", table)
        self.done[episodes] = True

    def merge(self) -> None:
        """Bring everything that is kept into the table: sorted by episode, settings first."""
        files = self._files()
        rows = pd.concat([pd.DataFrame({"episode": []}, dtype=int), *map(_read_parquet, files)])
        rows = rows.drop_duplicates("episode").sort_values("episode", ignore_index=True)
        names = batch.setting_columns(self._sweep.design.keys)
        settings = {
            names[key]: _typed(self._sweep.design.column(key)).iloc[rows["episode"]].reset_index(drop=True)
            for key in names
        }
        # Columns in the order of a summary, whatever part came first; settings are those of the design.
        results = rows[[name for name in batch.SUMMARY_COLUMNS if name in rows.columns]]
        table = pd.concat([pd.DataFrame({"episode": rows["episode"], **settings}), results], axis=1)
        write_parquet(
            self._directory / TABLE_FILE,
            table,
            schema_version=str(TABLE_SCHEMA_VERSION),
            sweep_sha256=self._sweep.sha256,
            units=json.dumps({name: unit_of_column(name) for name in table.columns}),
            sweep=json.dumps(self._sweep.document),
        )
        for path in self._parts.glob("*.parquet"):
            path.unlink()

    def _files(self) -> list[Path]:
        return [*self._directory.glob(TABLE_FILE), *sorted(self._parts.glob("*.parquet"))]


@contextlib.contextmanager
def open_store(directory: Path, sweep: Sweep) -> Iterator[SweepStore]:
    """Open the folder of a sweep, or make it; no other process can open it meanwhile.

    Raises RunDirectoryError if the folder is in use or cannot be written.
    """
    parts = directory / PARTS_FOLDER
    try:
        parts.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = f"{directory}: cannot be written ({error.strerror}); choose another --out"
        raise RunDirectoryError(problem) from error
    held = hold(directory)
    if held is None:
        raise RunDirectoryError(f"{directory}: another process is at work on this sweep")
    try:
        for left in parts.glob(".*"):
            left.unlink()  # of a write that was killed
        if not (directory / SPEC_FILE).is_file():
            write_atomically(directory / SPEC_FILE, dump_yaml(dict(sweep.document)))
        store = SweepStore(directory, sweep)
        yield store
        if store.done.all():
            with contextlib.suppress(OSError):
                parts.rmdir()
    finally:
        os.close(held)


def check_directory(directory: Path, sweep: Sweep) -> None:
    """Refuse a folder that is not this sweep's."""
    spec = directory / SPEC_FILE
    if spec.is_file():
        if spec.read_text(encoding="utf-8") != dump_yaml(dict(sweep.document)):
            raise RunDirectoryError(
                f"{directory}: holds another sweep, or was begun by other sources or versions of twin_gait or"
                " its libraries, whose rows would not be comparable; choose another --out"
            )
    elif directory.exists():
        # More than a sweep leaves that was killed while it made its folder.
        names = {path.name for path in directory.iterdir()} if directory.is_dir() else {""}
        if any(name != PARTS_FOLDER and not name.startswith(f".{SPEC_FILE}.") for name in names):
            raise RunDirectoryError(f"{directory}: exists and is not a sweep; choose another --out")


def read_table(directory: Path) -> pd.DataFrame:
    """Read the table of a sweep."""
    return _read_parquet(directory / TABLE_FILE)


def _read_parquet(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    try:
        return pd.read_parquet(path, columns=columns)
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise RunDirectoryError(
            f"{path}: cannot be read ({reason}); remove it, and its episodes run again"
        ) from error


def _typed(values: list[Any]) -> pd.Series:
    """A setting over the whole design, whose type must not depend on how far the sweep has come.

    What is neither a number, a truth nor a text is written as JSON.
    """
    kinds = {type(value) for value in values}
    if kinds <= {int, float, type(None)}:
        whole = kinds == {int} and max(map(abs, values)) < 2**63
        return pd.Series(values, dtype="int64" if whole else "float64")
    if kinds <= {bool, type(None)}:
        return pd.Series(values, dtype="boolean")
    plain = [value if isinstance(value, str | None) else json.dumps(value) for value in values]
    return pd.Series(plain, dtype="object")


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
    **watch: Unpack[Watch],
) -> SweepResult:
    """Run a sweep, or go on with it where it was stopped or killed.

    All episodes are checked before anything runs. Their results are kept in the folder block by block;
    neither the table nor the rows depend on the workers, the blocks or the number of resumptions. The engine
    is compiled in the calling process, so that no worker has to.

    Raises ParameterFileError if an episode is wrong or cannot be run, naming it; what was done is kept.
    Raises RunDirectoryError if the folder holds something else or cannot be written. Raises WorkersLost if
    a worker dies; what was done is kept.
    """
    workers = workers or Workers()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, workers, progress=checking, should_stop=watch.get("should_stop"))
    last: dict[str, Any] = {"slots": workers.slots()}
    with open_store(directory, sweep) as store:
        last["resumed_with"] = int(store.done.sum())
        try:
            last["processors"] = _run(sweep, store, workers, **watch)
        finally:
            store.merge()
        table = read_table(directory)
        last |= {"episodes": len(table) - last["resumed_with"], "wall_s": time.perf_counter() - began}
        summary = _summary(sweep, table, last)
        write_json(directory / SUMMARY_FILE, summary)
        if pictures and len(table) > 1:
            write_report(sweep, table, directory)
    without = tuple(name for name in sweep.measures if not np.isfinite(values_of(table, name)).any())
    status = RunStatus(summary["status"])
    return SweepResult(directory, table, status, last["resumed_with"], summary, without)


def check_sweep(sweep: Sweep, workers: Workers | None = None, **watch: Unpack[Watch]) -> None:
    """Check the overrides of every episode without running any; a wrong one is named with its key."""
    episodes = range(len(sweep.design))
    hands = 1 if workers is None or len(episodes) <= CHECKED_HERE else workers
    try:
        checked = run_jobs(
            partial(check_episode, json.dumps(sweep.document)), episodes, workers=hands, **watch
        )
    except JobFailed as error:
        raise ParameterFileError(sweep.source, "", error.problem) from error
    if len(checked) < len(episodes):
        raise KeyboardInterrupt


def _run(sweep: Sweep, store: SweepStore, workers: Workers, **watch: Unpack[Watch]) -> list[str]:
    """Run what is not done yet; types of the processors that did it."""
    pending = np.flatnonzero(~store.done).tolist()
    total, there = len(store.done), len(store.done) - len(pending)
    tell, processors = watch.get("progress") or (lambda done, total: None), set[str]()

    def keep(rows: dict[int, batch.Flat], processor: str) -> None:
        store.append({pending[place]: flat for place, flat in rows.items()})
        processors.add(processor)

    tell(there, total)
    try:
        batch.run_episodes(
            partial(experiment_of_episode, json.dumps(sweep.document)),
            batch.flat_summary,
            pending,
            columns=batch.READ_IN_BRIEF,
            workers=workers,
            keep=keep,
            **watch | {"progress": lambda done, _: tell(there + done, total)},
        )
    except JobFailed as error:
        named = f"episode {pending[error.index]}: "
        raise ParameterFileError(sweep.source, "", named + error.problem.removeprefix(named)) from error
    return sorted(processors)


def _summary(sweep: Sweep, table: pd.DataFrame, last_call: dict[str, Any]) -> dict[str, Any]:
    total, outcomes = len(sweep.design), _outcomes(table)
    return {
        "name": sweep.name,
        "sweep_sha256": sweep.sha256,
        "status": str(RunStatus.COMPLETED if len(table) == total else RunStatus.INTERRUPTED),
        "episodes": total,
        "finished": len(table),
        "outcomes": {str(name): int(count) for name, count in sorted(outcomes.items())},
        "last_call": last_call,
    }


def _outcomes(table: pd.DataFrame) -> pd.Series:
    """How many episodes had which outcome; of one that was not asked to walk its status counts."""
    if "outcome" not in table:
        return pd.Series(dtype=int)
    return table["outcome"].fillna(table["status"]).value_counts()


def write_report(sweep: Sweep, table: pd.DataFrame, directory: Path) -> None:
    """Draw the table: ``figures/*.png``, and ``report.html`` with all of them."""
    parameters = scales_of(sweep)
    title = sweep.name.replace("_", " ")
    measures = (WALKED, *(sweep.measures or DEFAULT_MEASURES))
    counts = _outcomes(table).items()
    rows = [("outcome", "episodes", "share [%]")]
    rows += [(str(outcome), str(count), f"{100.0 * count / len(table):.1f}") for outcome, count in counts]
    figures = sweep_figures(table, parameters, measures, title)
    subtitle = f"{len(table)} episodes, {len(parameters)} parameters"
    write_figures_page(directory / REPORT_FILE, figures, f"Sweep: {title}", subtitle, rows)


def scales_of(sweep: Sweep) -> dict[str, bool | None]:
    """Whether the scale of a range is logarithmic, by its column; None for what is a list."""
    asked, columns = sweep.document.get("parameters", {}), batch.setting_columns(sweep.design.keys)
    items = {column: asked.get(key) for key, column in columns.items()}
    return {
        name: item.get("scale") == "log" if isinstance(item, dict) else None for name, item in items.items()
    }
