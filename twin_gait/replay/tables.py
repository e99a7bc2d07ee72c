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
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.conventions import DEGREES, RADIANS
from twin_gait.exceptions import ParameterFileError
from twin_gait.files import read_log_text, read_parquet, require_table_size

_SEPARATORS = ",;\t"
_LISTED = 12  # columns that a message names
END_OF_HEADER = "endheader"
_ROWS, _COLUMNS, _DEGREES = "nrows", "ncolumns", "indegrees"
_SIMM = {"datarows": _ROWS, "datacolumns": _COLUMNS}
_UNITS = {"yes": DEGREES, "no": RADIANS}


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
    names, frame = _words(path, text, separator)
    return LogTable(str(path), names, frame)


def _read_storage(path: Path) -> LogTable:
    lines = [line.strip() for line in read_log_text(path).splitlines()]
    end = next((number for number, line in enumerate(lines) if line.lower() == END_OF_HEADER), None)
    if end is None:
        raise ParameterFileError(path, END_OF_HEADER, "is missing; expected an OpenSim .mot or .sto file")
    header = _header(lines[:end])
    names, frame = _words(path, "\n".join(lines[end + 1 :]), r"\s+")
    short = np.flatnonzero((frame.fillna("") == "").any(axis=1))
    if len(short):
        text = f"expected {len(names)} numbers, one a column, and there are fewer"
        raise ParameterFileError(path, f"row {short[0] + 1}", text)
    for key, found in ((_ROWS, len(frame)), (_COLUMNS, len(names))):
        stated = header.get(key, str(found))
        if _number(stated) != found:
            text = f"the header says {stated[:40]}, the file has {found}; is it complete?"
            raise ParameterFileError(path, key, text)
    degrees = header.get(_DEGREES)
    if degrees is not None and degrees.lower() not in _UNITS:
        raise ParameterFileError(path, "inDegrees", f"expected yes or no, got {degrees[:40]!r}")
    unit = None if degrees is None else _UNITS[degrees.lower()]
    return LogTable(str(path), names, frame, unit, opensim=True)


def _header(lines: list[str]) -> dict[str, str]:
    header = {}
    for line in lines:
        key, _, value = line.partition("=") if "=" in line else line.partition(" ")
        name = key.strip().lower()
        header[_SIMM.get(name, name)] = value.strip()
    return header


def _words(path: Path, text: str, separator: str) -> tuple[tuple[str, ...], pd.DataFrame]:
    """Names of the columns, and their cells as they are written."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            frame = pd.read_csv(
                io.StringIO(text), sep=separator, header=None, index_col=False, comment="#",
                skipinitialspace=True, dtype=str, keep_default_na=False,
            )  # fmt: skip
    except (ValueError, TypeError, OverflowError, pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise ParameterFileError(path, "", f"is not a table ({_short(error)})") from error
    if frame.empty:
        raise ParameterFileError(path, "", "is empty; expected a line of column names and rows of numbers")
    names = tuple(str(name).strip() for name in frame.iloc[0])
    return names, frame.iloc[1:].reset_index(drop=True)


def _number(item: Any) -> float:
    """Value of a cell to the last digit; NaN if it holds no number."""
    try:
        return float(item)
    except (ValueError, TypeError, OverflowError):
        return math.nan


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:100]
