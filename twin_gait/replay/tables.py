"""Read log files as columns of numbers and names, whatever their format."""

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

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import read_log_text, read_parquet, require_table_size
from twin_gait.replay.opensim import parse_storage

_SEPARATORS = ",;\t"
_LISTED = 12  # columns that a message names


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of a log file.

    Attributes:
        source: The file, for messages.
        names: Of the columns, in order; a name may occur twice.
        frame: The columns, in the same order.
        unit: Of angles, if the file states it: ``rad`` or ``deg``.
        opensim: Whether it is a motion file of OpenSim.
    """

    source: str
    names: tuple[str, ...]
    frame: pd.DataFrame
    unit: str | None = None
    opensim: bool = False

    def __contains__(self, name: str) -> bool:
        """Whether there is a column of that name."""
        return name in self.names

    def numbers(self, name: str) -> np.ndarray:
        """A column of finite numbers.

        Args:
            name: Of the column.

        Returns:
            Shape ``(n_rows,)``.

        Raises:
            ParameterFileError: If there is no such column, or more than one, or a value is not a number.
        """
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
        """A column of names.

        Args:
            name: Of the column.

        Returns:
            Shape ``(n_rows,)``, texts.

        Raises:
            ParameterFileError: If there is no such column, or more than one.
        """
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
    """Read a log file.

    Args:
        path: A .parquet, .csv, .mot or .sto file.

    Returns:
        Its columns.

    Raises:
        ParameterFileError: If it cannot be read or is not a table.
    """
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
                io.StringIO(text),
                sep=separator,
                header=None,
                index_col=False,
                comment="#",
                skipinitialspace=True,
                dtype=str,
                keep_default_na=False,
            )
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
