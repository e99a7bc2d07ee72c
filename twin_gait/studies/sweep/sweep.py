"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster.

Finished episodes are kept at once, so that a kill loses none of them. Each block becomes a small parquet
file in ``parts``, written atomically. Now and then, and at the end, parts are merged into ``table.parquet``.
A kill between the two leaves rows in both, of which one counts: they are equal.
"""

import contextlib
import fcntl
import io
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.report.canvas import picture_bytes
from twin_gait.report.pages import figures_page
from twin_gait.report.sweep import DEFAULT_MEASURES, WALKED, sweep_figures, unit_of_column, values_of
from twin_gait.runs.summary import READ_IN_BRIEF
from twin_gait.simulation import RunStatus
from twin_gait.studies.batch import (
    SUMMARY_COLUMNS,
    Flat,
    block_ahead,
    flat_summary,
    measured,
    setting_columns,
    summary_table,
)
from twin_gait.studies.jobs import Portion, Progress, Stop, Workers, one_by_one, portions, run_jobs
from twin_gait.studies.sweep.episode import Episode, check_episode, episodes_of
from twin_gait.studies.sweep.spec import Sweep

TABLE_SCHEMA_VERSION = 1
SPEC_FILE, TABLE_FILE, SUMMARY_FILE = "spec.yaml", "table.parquet", "summary.json"
FIGURES_FOLDER, REPORT_FILE = "figures", "report.html"
PARTS_FOLDER = "parts"
_LOCK_FILE = ".lock"
_PROVENANCE = "\nprovenance:\n"  # the last key of a specification

# Merging rewrites the table: only when the parts have become many, and a good share of it.
MOST_PARTS = 200
SHARE_IN_PARTS = 0.1
# Checking an episode takes a few milliseconds, starting workers a few seconds: more are checked by them.
CHECKED_HERE = 2000
_CHECKED_AT_ONCE = 200


class SweepStore:
    """An open folder of a sweep; ``done`` says which episodes are kept, shape ``(n,)``."""

    def __init__(self, directory: Path, sweep: Sweep) -> None:
        """Look at what is there; see :func:`open_store`, which also locks it."""
        self.done = np.zeros(len(sweep.design), dtype=bool)
        self._table, self._parts_folder = directory / TABLE_FILE, directory / PARTS_FOLDER
        self._sweep, self._sha256 = sweep, sweep.sha256.encode()
        self._rows_in_table = self._note(self._table) if self._table.is_file() else 0
        self._parts = sorted(self._parts_folder.glob("*.parquet"))
        self._rows_in_parts = sum(self._note(path) for path in self._parts)

    def append(self, rows: Mapping[int, Flat]) -> None:
        """Keep the summaries of some episodes, at least in a part of their own."""
        if not rows:
            return
        episodes = sorted(rows)
        path = self._parts_folder / f"{episodes[0]:08d}-{episodes[-1]:08d}.parquet"
        table = summary_table([rows[index] for index in episodes])
        table.insert(0, "episode", episodes)
        self._write(table, path)
        self._parts.append(path)
        self._rows_in_parts += len(rows)
        self.done[episodes] = True
        if len(self._parts) >= MOST_PARTS and self._rows_in_parts >= SHARE_IN_PARTS * self._rows_in_table:
            self.merge()

    def merge(self) -> None:
        """Bring everything that is kept into the table: sorted by episode, settings first."""
        known = [self._table] if self._table.is_file() else []
        tables = [self._read(path).to_pandas() for path in (*known, *self._parts)]
        rows = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame({"episode": []}, dtype=int)
        rows = rows.drop_duplicates("episode").sort_values("episode", ignore_index=True)
        names = setting_columns(self._sweep.design.columns)
        settings = {
            names[key]: _typed(self._sweep.design.column(key)).iloc[rows["episode"]].reset_index(drop=True)
            for key in names
        }
        # Columns in the order of a summary, whatever part came first; settings are those of the design.
        results = rows[[name for name in SUMMARY_COLUMNS if name in rows.columns]]
        table = pd.concat([pd.DataFrame({"episode": rows["episode"], **settings}), results], axis=1)
        self._write(table, self._table)
        for path in self._parts:
            path.unlink(missing_ok=True)
        self._parts, self._rows_in_parts, self._rows_in_table = [], 0, len(table)

    def _note(self, path: Path) -> int:
        """Mark the episodes of a file as done."""
        episodes = self._read(path, ["episode"])["episode"].to_numpy()
        self.done[episodes] = True
        return len(episodes)

    def _read(self, path: Path, columns: list[str] | None = None) -> Any:
        table = _read_parquet(path, columns)
        if (table.schema.metadata or {}).get(b"twin_gait.sweep_sha256") != self._sha256:
            raise RunDirectoryError(f"{path}: belongs to another sweep; remove it, or choose another --out")
        return table

    def _write(self, table: pd.DataFrame, path: Path) -> None:
        """Write a table with units, schema version and specification in the metadata."""
        arrow = pa.Table.from_pandas(table, preserve_index=False)
        metadata = {
            **(arrow.schema.metadata or {}),
            b"twin_gait.schema_version": str(TABLE_SCHEMA_VERSION).encode(),
            b"twin_gait.sweep_sha256": self._sha256,
        }
        if path == self._table:
            units = {name: unit_of_column(name) for name in table.columns}
            metadata[b"twin_gait.units"] = json.dumps(units).encode()
            metadata[b"twin_gait.sweep"] = json.dumps(self._sweep.document).encode()
        buffer = io.BytesIO()
        pq.write_table(arrow.replace_schema_metadata(metadata), buffer, compression="zstd")
        write_atomically(path, buffer.getvalue())


@contextlib.contextmanager
def open_store(directory: Path, sweep: Sweep) -> Iterator[SweepStore]:
    """Open the folder of a sweep, or make it; no other process can open it meanwhile.

    Raises RunDirectoryError if the folder holds something else, is in use or cannot be written.
    """
    check_directory(directory, sweep)
    parts = directory / PARTS_FOLDER
    try:
        parts.mkdir(parents=True, exist_ok=True)
        lock = os.open(directory / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        problem = f"{directory}: cannot be written ({error.strerror}); choose another --out"
        raise RunDirectoryError(problem) from error
    try:
        try:  # the system releases it however this process ends
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RunDirectoryError(f"{directory}: another process is at work on this sweep") from error
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
        os.close(lock)


def check_directory(directory: Path, sweep: Sweep) -> None:
    """Refuse a folder that is not this sweep's."""
    if (directory / SPEC_FILE).is_file():
        ours, found = dump_yaml(dict(sweep.document)), (directory / SPEC_FILE).read_text(encoding="utf-8")
        if found == ours:
            return
        if found.rpartition(_PROVENANCE)[0] == ours.rpartition(_PROVENANCE)[0]:
            raise RunDirectoryError(
                f"{directory}: was begun by other sources or versions of twin_gait or its libraries, whose "
                "rows would not be comparable; go back to them, or choose another --out"
            )
        raise RunDirectoryError(f"{directory}: holds another sweep; choose another --out")
    if directory.exists():
        # More than a sweep leaves that was killed while it made its folder.
        names = {path.name for path in directory.iterdir()} if directory.is_dir() else {""}
        names -= {PARTS_FOLDER, _LOCK_FILE}
        if any(not name.startswith(f".{SPEC_FILE}.") for name in names):
            raise RunDirectoryError(f"{directory}: exists and is not a sweep; choose another --out")


def read_table(directory: Path) -> pd.DataFrame:
    """Read the table of a sweep."""
    table: pd.DataFrame = _read_parquet(directory / TABLE_FILE).to_pandas()
    return table


def _read_parquet(path: Path, columns: list[str] | None = None) -> Any:
    try:
        return pq.ParquetFile(path).read(columns)
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
        write_atomically(folder / f"{name}.png", picture)
    counts = table["outcome"].value_counts().items()
    rows = [(str(outcome), str(count), f"{100.0 * count / len(table):.1f}") for outcome, count in counts]
    named = {name.replace("_", " "): picture for name, picture in pictures.items()}
    subtitle = f"{len(table)} episodes, {len(parameters)} parameters"
    page = figures_page(f"Sweep: {title}", subtitle, named, ("outcome", "episodes", "share [%]"), rows)
    write_atomically(directory / REPORT_FILE, page)


def _drawn(table: pd.DataFrame, parameters: Sequence[str], title: str, measure: str) -> dict[str, bytes]:
    figures = sweep_figures(table, parameters, (measure,), title)
    return {name: picture_bytes(figure) for name, figure in figures.items()}
