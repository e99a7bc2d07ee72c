"""Read log files as columns of numbers and names: parquet, CSV, and motion files of OpenSim (.mot, .sto).

The header of a motion file states ``nRows``, ``nColumns`` and ``inDegrees`` as ``key=value``; files of the
older SIMM form state ``datarows`` and ``datacolumns`` and no unit. A name may stand over several columns.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.conventions import DEGREES, RADIANS
from twin_gait.exceptions import ParameterFileError
from twin_gait.files import read_log_text, read_parquet, require_table_size

_SEPARATORS = ",;\t"
_LISTED = 12  # columns that a message names


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of a log file."""

    source: str  # the file, for messages
    names: tuple[str, ...]  # of the columns, in order; a name may occur twice
    frame: pd.DataFrame  # the columns, in the same order
    unit: str | None = None  # of angles, if the file states it: ``rad`` or ``deg``
    opensim: bool = False  # whether it is a motion file of OpenSim

    def __contains__(self, name: str) -> bool:
        """Whether there is a column of that name."""
        return name in self.names

    def numbers(self, name: str) -> np.ndarray:
        """A column of finite numbers."""
        column = self._column(name)
        values = np.array([_number(item) for item in column])
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            row = int(wrong[0])
            found = " ".join(str(column.iloc[row]).split())[:40]
            raise ParameterFileError(
                self.source, name, f"expected a finite number in row {row + 1}, got {found!r}"
            )
        return values

    def words(self, name: str) -> np.ndarray:
        """A column of names."""
        return np.array([str(item).strip() for item in self._column(name)], dtype=object)

    def _column(self, name: str) -> pd.Series:
        places = [place for place, known in enumerate(self.names) if known == name]
        if not places:
            raise ParameterFileError(self.source, name, f"no such column; there are {self._listed()}")
        if len(places) > 1:
            raise ParameterFileError(self.source, name, f"{len(places)} columns have this name")
        return self.frame.iloc[:, places[0]]

    def _listed(self) -> str:
        shown = ", ".join(self.names[:_LISTED])
        return shown if len(self.names) <= _LISTED else f"{shown} and {len(self.names) - _LISTED} more"


def read_table(path: Path) -> LogTable:
    """Read a log file."""
    readers: dict[str, Callable[[Path], LogTable]] = {
        ".parquet": _read_parquet,
        ".csv": _read_csv,
        ".mot": _read_storage,
        ".sto": _read_storage,
    }
    reader = readers.get(path.suffix.lower())
    if not path.is_file():
        raise ParameterFileError(path, "", "no such log; expected a run directory or a file")
    if reader is None:
        raise ParameterFileError(path, "", f"unknown format; expected one of {', '.join(readers)}")
    try:
        return reader(path)
    except OSError as error:
        raise ParameterFileError(path, "", f"cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise ParameterFileError(path, "", "is not UTF-8 text") from error


def _read_parquet(path: Path) -> LogTable:
    try:
        frame = read_parquet(path)
    except (pa.ArrowException, ValueError, TypeError, KeyError, OverflowError) as error:
        raise ParameterFileError(path, "", f"is not a parquet table ({_short(error)})") from error
    return LogTable(str(path), tuple(str(name) for name in frame.columns), frame)


def _read_csv(path: Path) -> LogTable:
    text = read_log_text(path)
    lines = text.splitlines()
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    separator = max(_SEPARATORS, key=first.count)
    require_table_size(path, len(lines), first.count(separator) + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            frame = pd.read_csv(
                io.StringIO(text), sep=separator, header=None, index_col=False, comment="#",
                skipinitialspace=True, dtype=str, keep_default_na=False,
            )  # fmt: skip
    except (ValueError, TypeError, OverflowError, pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise ParameterFileError(path, "", f"is not a CSV table ({_short(error)})") from error
    if frame.empty:
        raise ParameterFileError(path, "", "is empty; expected a line of column names and rows of numbers")
    names = tuple(str(name).strip() for name in frame.iloc[0])
    return LogTable(str(path), names, frame.iloc[1:].reset_index(drop=True))


def _read_storage(path: Path) -> LogTable:
    storage = parse_storage(read_log_text(path), str(path))
    frame = pd.DataFrame(storage.values)
    return LogTable(str(path), storage.names, frame, storage.unit, opensim=True)


def _number(item: Any) -> float:
    """Value of a cell to the last digit; NaN if it holds no number."""
    try:
        return float(item)
    except (ValueError, TypeError, OverflowError):
        return math.nan


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:100]


END_OF_HEADER = "endheader"
_ROWS, _COLUMNS, _DEGREES = "nrows", "ncolumns", "indegrees"
_SIMM = {"datarows": _ROWS, "datacolumns": _COLUMNS}
_UNITS = {"yes": DEGREES, "no": RADIANS}


class Storage(NamedTuple):
    """Content of a motion file."""

    names: tuple[str, ...]  # of the columns, in order
    values: np.ndarray  # shape ``(n_rows, n_columns)``
    unit: str | None  # of the angles, ``deg`` or ``rad``; None if the header does not say


def parse_storage(text: str, source: str) -> Storage:
    """Parse a motion file."""
    lines = [line.strip() for line in text.splitlines()]
    end = next((number for number, line in enumerate(lines) if line.lower() == END_OF_HEADER), None)
    if end is None:
        raise ParameterFileError(source, END_OF_HEADER, "is missing; expected an OpenSim .mot or .sto file")
    header = _header(lines[:end])
    body = [(number, line) for number, line in enumerate(lines[end + 1 :], start=end + 2) if line]
    if not body:
        raise ParameterFileError(source, "", "has no line of column names below endheader")
    names = tuple(body[0][1].split())
    rows = [_row(line, number, len(names), source) for number, line in body[1:]]
    _check_size(source, header, _ROWS, len(rows))
    _check_size(source, header, _COLUMNS, len(names))
    values = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return Storage(names, values, _unit(header, source))


def _header(lines: list[str]) -> dict[str, str]:
    header = {}
    for line in lines:
        key, _, value = line.partition("=") if "=" in line else line.partition(" ")
        name = key.strip().lower()
        header[_SIMM.get(name, name)] = value.strip()
    return header


def _row(line: str, number: int, width: int, source: str) -> list[float]:
    words = line.split()
    if len(words) != width:
        raise ParameterFileError(
            source, f"line {number}", f"expected {width} numbers, one a column, got {len(words)}"
        )
    try:
        return [float(word) for word in words]
    except ValueError as error:
        wrong = next(word for word in words if not _is_number(word))
        raise ParameterFileError(source, f"line {number}", f"expected numbers, got {wrong[:40]!r}") from error


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _check_size(source: str, header: dict[str, str], key: str, found: int) -> None:
    stated = header.get(key)
    if stated is None:
        return
    if not _is_number(stated) or not math.isfinite(float(stated)) or float(stated) != found:
        raise ParameterFileError(
            source, key, f"the header says {stated[:40]}, the file has {found}; is it complete?"
        )


def _unit(header: dict[str, str], source: str) -> str | None:
    stated = header.get(_DEGREES)
    if stated is None:
        return None
    if stated.lower() not in _UNITS:
        raise ParameterFileError(source, "inDegrees", f"expected yes or no, got {stated[:40]!r}")
    return _UNITS[stated.lower()]
