"""The folder of a sweep: finished episodes are kept at once, so that a kill loses none of them.

Each chunk becomes a small parquet file in ``parts``, written atomically. Now and then, and at the end, parts
are merged into ``table.parquet``. A kill between the two leaves rows in both, of which one counts: they are
equal.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.report.sweep import unit_of_column
from twin_gait.studies.batch import SUMMARY_COLUMNS, Flat, setting_columns, summary_table
from twin_gait.studies.sweep.spec import Sweep

TABLE_SCHEMA_VERSION = 1
SPEC_FILE = "spec.yaml"
TABLE_FILE = "table.parquet"
SUMMARY_FILE = "summary.json"
FIGURES_FOLDER, REPORT_FILE = "figures", "report.html"
PARTS_FOLDER = "parts"
_LOCK_FILE = ".lock"
_PROVENANCE = "\nprovenance:\n"  # the last key of a specification

# Merging rewrites the table: only when the parts have become many, and a good share of it.
MOST_PARTS = 200
SHARE_IN_PARTS = 0.1


class SweepStore:
    """An open folder of a sweep.

    Attributes:
        directory: The folder.
        done: Which episodes are kept, shape ``(n,)``.
    """

    def __init__(self, directory: Path, sweep: Sweep) -> None:
        """Look at what is there; see :func:`open_store`, which also locks it."""
        self.directory = directory
        self.done = np.zeros(len(sweep.design), dtype=bool)
        self._sweep = sweep
        self._sha256 = sweep.sha256.encode()
        self._rows_in_table = 0
        if (directory / TABLE_FILE).is_file():
            self._rows_in_table = self._note(directory / TABLE_FILE)
        self._parts = self._part_files()
        self._rows_in_parts = sum(self._note(path) for path in self._parts)

    def append(self, rows: Mapping[int, Flat]) -> None:
        """Keep the summaries of some episodes.

        Raises:
            RunDirectoryError: If they cannot be written.
        """
        if not rows:
            return
        episodes = sorted(rows)
        path = self.directory / PARTS_FOLDER / f"{episodes[0]:08d}-{episodes[-1]:08d}.parquet"
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
        tables = [self._read(path) for path in self._everything()]
        rows = pd.concat(tables, ignore_index=True) if tables else summary_table([])
        if tables:
            rows = rows.drop_duplicates("episode").sort_values("episode", ignore_index=True)
        names = setting_columns(self._sweep.design.columns)
        found = rows["episode"].to_numpy() if tables else np.zeros(0, dtype=int)
        settings = {names[key]: _settings(self._sweep, key, found) for key in names}
        results = _in_order(rows)
        table = pd.concat(
            [pd.DataFrame({"episode": found, **settings}, index=results.index), results], axis=1
        )
        self._write(table, self.directory / TABLE_FILE)
        for path in self._parts:
            path.unlink(missing_ok=True)
        self._parts, self._rows_in_parts, self._rows_in_table = [], 0, len(table)

    def _everything(self) -> list[Path]:
        table = self.directory / TABLE_FILE
        return [*([table] if table.is_file() else []), *self._parts]

    def _part_files(self) -> list[Path]:
        return sorted((self.directory / PARTS_FOLDER).glob("*.parquet"))

    def _note(self, path: Path) -> int:
        """Mark the episodes of a file as done."""
        episodes = _reading(path, lambda: self._checked(path).read(["episode"])["episode"].to_numpy())
        self.done[episodes] = True
        return len(episodes)

    def _read(self, path: Path) -> pd.DataFrame:
        """Results of a file, without the settings, which the specification holds."""
        table: pd.DataFrame = _reading(path, lambda: self._checked(path).read().to_pandas())
        settings = set(setting_columns(self._sweep.design.columns).values())
        return table[[name for name in table.columns if name not in settings]]

    def _checked(self, path: Path) -> pq.ParquetFile:
        file = pq.ParquetFile(path)
        if (file.schema_arrow.metadata or {}).get(b"twin_gait.sweep_sha256") != self._sha256:
            raise RunDirectoryError(f"{path}: belongs to another sweep; remove it, or choose another --out")
        return file

    def _write(self, table: pd.DataFrame, path: Path) -> None:
        """Write a table with units, schema version and specification in the metadata."""
        arrow = pa.Table.from_pandas(table, preserve_index=False)
        metadata = {
            **(arrow.schema.metadata or {}),
            b"twin_gait.schema_version": str(TABLE_SCHEMA_VERSION).encode(),
            b"twin_gait.sweep_sha256": self._sha256,
        }
        if path.name == TABLE_FILE:
            units = {name: unit_of_column(name) for name in table.columns}
            metadata[b"twin_gait.units"] = json.dumps(units).encode()
            metadata[b"twin_gait.sweep"] = json.dumps(self._sweep.document).encode()
        buffer = io.BytesIO()
        pq.write_table(arrow.replace_schema_metadata(metadata), buffer, compression="zstd")
        write_atomically(path, buffer.getvalue())


@contextlib.contextmanager
def open_store(directory: Path, sweep: Sweep) -> Iterator[SweepStore]:
    """Open the folder of a sweep, or make it.

    Yields:
        The store; no other process can open it meanwhile.

    Raises:
        RunDirectoryError: If the folder holds something else, is in use or cannot be written.
    """
    check_directory(directory, sweep)
    try:
        (directory / PARTS_FOLDER).mkdir(parents=True, exist_ok=True)
        lock = os.open(directory / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise RunDirectoryError(
            f"{directory}: cannot be written ({error.strerror}); choose another --out"
        ) from error
    try:
        _lock(lock, directory)
        for left in (directory / PARTS_FOLDER).glob(".*"):
            left.unlink()  # of a write that was killed
        if not (directory / SPEC_FILE).is_file():
            write_atomically(directory / SPEC_FILE, dump_yaml(dict(sweep.document)))
        store = SweepStore(directory, sweep)
        yield store
        if store.done.all():
            with contextlib.suppress(OSError):
                (directory / PARTS_FOLDER).rmdir()
    finally:
        os.close(lock)


def _lock(descriptor: int, directory: Path) -> None:
    try:
        # The system releases it however this process ends.
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise RunDirectoryError(f"{directory}: another process is at work on this sweep") from error


def check_directory(directory: Path, sweep: Sweep) -> None:
    """Refuse a folder that is not this sweep's.

    Raises:
        RunDirectoryError: If it holds something else.
    """
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
    if directory.exists() and (not directory.is_dir() or _holds_something(directory)):
        raise RunDirectoryError(f"{directory}: exists and is not a sweep; choose another --out")


def _holds_something(directory: Path) -> bool:
    """Whether there is more than a sweep leaves that was killed while it made its folder."""
    begun = (PARTS_FOLDER, _LOCK_FILE)
    return any(
        path.name not in begun and not path.name.startswith(f".{SPEC_FILE}.") for path in directory.iterdir()
    )


def read_table(directory: Path) -> pd.DataFrame:
    """Read the table of a sweep.

    Raises:
        RunDirectoryError: If there is none.
    """
    path = directory / TABLE_FILE
    table: pd.DataFrame = _reading(path, lambda: pq.ParquetFile(path).read().to_pandas())
    return table


def _settings(sweep: Sweep, key: str, episodes: np.ndarray) -> pd.Series:
    """Values of a setting; what is neither a number, a truth nor a text is written as JSON."""
    values = sweep.design.column(key)
    kinds = {type(value) for value in values}
    if kinds <= {int, float} and max(map(abs, values)) < 2**63:
        # Chosen over the whole design: the type must not depend on how far the sweep has come.
        typed = pd.Series(values, dtype="int64" if kinds == {int} else "float64")
    elif kinds <= {int, float, type(None)}:
        typed = pd.Series(values, dtype="float64")
    elif kinds <= {bool, type(None)}:
        typed = pd.Series(values, dtype="boolean")
    else:
        plain = [value if isinstance(value, str | None) else json.dumps(value) for value in values]
        typed = pd.Series(plain, dtype="object")
    return typed.iloc[episodes].reset_index(drop=True)


def _in_order(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns in the order of a summary, whatever part came first."""
    return rows[[name for name in SUMMARY_COLUMNS if name in rows.columns]]


def _reading(path: Path, read: Any) -> Any:
    try:
        return read()
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise RunDirectoryError(
            f"{path}: cannot be read ({' '.join(str(error).split())}); remove it, and its episodes run again"
        ) from error
