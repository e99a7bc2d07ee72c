"""The folder of a sweep: finished episodes are kept at once, so that a kill loses none of them.

Each block becomes a small parquet file in ``parts``, written atomically. Now and then, and at the end, parts
are merged into ``table.parquet``. A kill between the two leaves rows in both, of which one counts: they are
equal.
"""

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
SPEC_FILE, TABLE_FILE, SUMMARY_FILE = "spec.yaml", "table.parquet", "summary.json"
FIGURES_FOLDER, REPORT_FILE = "figures", "report.html"
PARTS_FOLDER = "parts"
_LOCK_FILE = ".lock"
_PROVENANCE = "\nprovenance:\n"  # the last key of a specification

# Merging rewrites the table: only when the parts have become many, and a good share of it.
MOST_PARTS = 200
SHARE_IN_PARTS = 0.1


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
