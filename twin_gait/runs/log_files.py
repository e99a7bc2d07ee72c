"""Reader of log files as columns: parquet, C3D, motion files of OpenSim (.mot, .sto) and any table of text.

The header of a motion file states ``nRows``, ``nColumns`` and ``inDegrees`` as ``key=value``; files of the
older SIMM form state no unit. Several columns may have the same name.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.conventions import DEGREES, PLUG_IN_GAIT, RADIANS, Convention
from twin_gait.exceptions import ParameterFileError
from twin_gait.files import LONGEST_LINE, MOST_TEXT, read_bytes, read_parquet, require_table_size
from twin_gait.runs.c3d_files import INVERSE_KINEMATICS, Events, read_c3d
from twin_gait.runs.text_layout import (
    BLANKS,
    detect_encoding,
    find_layout,
    is_missing,
    strip_comments,
    strip_unit,
)

_LISTED = 12  # largest number of columns that a message names
_NEXUS_BLOCKS = frozenset({"Model Outputs", "Trajectories", "Devices", "Joints", "Segments"})
END_OF_HEADER = "endheader"
_UNITS = {"yes": DEGREES, "no": RADIANS, None: None}  # unit by the value of inDegrees
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of a log file."""

    source: str  # path of the file, for messages
    frame: pd.DataFrame  # table of the columns; a name may occur twice
    unit: str | None = None  # unit of angles, if the file states it: ``rad`` or ``deg``
    opensim: bool = False  # whether it is a motion file of OpenSim
    decimal: str = "."  # decimal mark
    notices: tuple[str, ...] = ()  # accepted deviations from the format, one line each
    convention: Convention | None = None  # names and signs of the angles, if the format has its own
    events: Events = field(default_factory=dict)  # foot strikes and foot offs, if the file has them
    without_angles: str = ""  # meaning of a file without joint angles, if the format often has none

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in order."""
        return tuple(map(str, self.frame.columns))

    def __contains__(self, name: str) -> bool:
        """Return whether there is a column of that name."""
        return name in self.names

    def numbers(self, name: str, *, gaps: bool = False) -> np.ndarray:
        """Return a column of finite numbers, with ``gaps`` NaN where a cell states that there is no number.

        Raises ParameterFileError with the first row that has no finite number.
        """
        cells = self._column(name)
        try:
            values = cells.to_numpy(dtype=float)
        except (ValueError, TypeError, OverflowError):  # a cell is no number: convert each cell alone
            values = np.array([parse_number(item, self.decimal) for item in cells])
        wrong = np.flatnonzero(~np.isfinite(values))
        if gaps:
            wrong = wrong[[not is_missing(item) for item in cells.iloc[wrong]]]
        if len(wrong):
            row = int(wrong[0])
            found = " ".join(str(cells.iloc[row]).split())[:40]
            text = f"expected a finite number in row {row + 1}, got {found!r}"
            raise ParameterFileError(self.source, name, text)
        return values

    def texts(self, name: str) -> np.ndarray:
        """Return a column of names, shape ``(n,)``."""
        return np.array([str(item).strip() for item in self._column(name)], dtype=object)

    def signed_name(self, name: str) -> tuple[str, float]:
        """Return the full name of a column, and -1 if a minus precedes the given name, otherwise 1."""
        if name.startswith("-") and name not in self:
            return self.full_name(name[1:].strip()), -1.0
        return self.full_name(name), 1.0

    def full_name(self, name: str) -> str:
        """Return the name of a column that is given with or without its unit in brackets."""
        known = [full for full in self.names if name in (full, strip_unit(full))]
        return name if name in self.names else self._require_single(known, name)

    def format_column_names(self) -> str:
        """Return the names of the columns for a message."""
        more = f" and {len(self.names) - _LISTED} more" if len(self.names) > _LISTED else ""
        return ", ".join(self.names[:_LISTED]) + more

    def _column(self, name: str) -> pd.Series:
        indices = [index for index, known in enumerate(self.names) if known == name]
        return self.frame.iloc[:, self._require_single(indices, name)]

    def _require_single(self, found: Sequence[T], name: str) -> T:
        if len(found) != 1:
            text = f"{len(found)} columns have this name"
            text = text if found else f"there is no such column; expected one of {self.format_column_names()}"
            raise ParameterFileError(self.source, name, text)
        return found[0]


def parse_number(cell: Any, decimal: str = ".") -> float:
    """Return the value of a cell with all its digits; NaN if it contains no number."""
    try:
        return float(cell.replace(decimal, ".") if isinstance(cell, str) else cell)
    except (ValueError, TypeError, OverflowError):
        return math.nan


def read_log_table(path: Path, subject: str | None = None) -> LogTable:
    """Read a log file in the format that the ending of its name states.

    ``subject``: person, if a C3D file has several. Raises ParameterFileError if there is no such file, the
    format is unknown or the file is not valid.
    """
    readers: dict[str, Callable[[Path], LogTable]] = {".parquet": _read_parquet}
    readers |= dict.fromkeys((".csv", ".tsv", ".txt"), read_text_table)
    readers |= dict.fromkeys((".mot", ".sto"), _read_storage)
    readers[".c3d"] = partial(_read_trial, subject=subject)
    reader = readers.get(path.suffix.lower())
    if not path.is_file():
        raise ParameterFileError(path, "", "there is no such log; expected a run directory or a file")
    if path.suffix.lower() == ".trc":
        raise ParameterFileError(path, "", INVERSE_KINEMATICS)
    if reader is None:
        raise ParameterFileError(path, "", f"unknown format; expected one of {', '.join(readers)}")
    return reader(path)


def _read_trial(path: Path, subject: str | None) -> LogTable:
    trial = read_c3d(path, subject)
    known: dict[str, Any] = {"convention": PLUG_IN_GAIT, "without_angles": INVERSE_KINEMATICS}
    return LogTable(str(path), trial.frame, trial.unit, events=trial.events, **known)


def _read_parquet(path: Path) -> LogTable:
    try:
        frame = read_parquet(path)
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise ParameterFileError(path, "", f"is not a parquet table ({_format_error(error)})") from error
    return LogTable(str(path), frame)


def read_text_table(path: Path, required: Collection[str] = ()) -> LogTable:
    """Read a table of text with commas, semicolons, tabs or blanks between its cells.

    Comments, and lines above the names of the columns, are skipped; ``required``: some of the names. A table
    without names has numbered columns. A line of units below the names is appended to the names in brackets.
    """
    layout = find_layout(_read_table_lines(path), required)
    frame = _split_cells(path, layout.rows, layout.separator)
    if layout.named:
        bare = frame.iloc[0].astype(str).str.strip()
        units = [*layout.units, *[""] * len(bare)]
        names = [f"{name} [{unit}]" if unit else name for name, unit in zip(bare, units, strict=False)]
        frame = frame.iloc[1:].set_axis(names, axis="columns")
    else:
        frame = frame.rename(columns=lambda index: str(index + 1))
    return LogTable(str(path), frame, decimal=layout.decimal)


def _read_table_lines(path: Path) -> list[str]:
    """Return the lines of a table of text, unless it is an export of Vicon Nexus."""
    lines = _read_lines(path)
    if (*lines, "")[0].strip(',; "\t') in _NEXUS_BLOCKS:
        text = (
            "is an export of Vicon Nexus, whose names are in three lines: delete all lines above the "
            "numbers, and add one with a name for each column, such as time_s and left_hip_angle_deg"
        )
        raise ParameterFileError(path, "line 1", text)
    return lines


def _read_storage(path: Path) -> LogTable:
    lines = [line.strip() for line in _read_lines(path)]
    end = next((number for number, line in enumerate(lines) if line.lower() == END_OF_HEADER), None)
    if end is None:
        raise ParameterFileError(path, END_OF_HEADER, "is missing; expected an OpenSim .mot or .sto file")
    stated = (re.split(r"\s*[=\s]\s*", line.lower(), maxsplit=1) for line in lines[:end])
    header = {pair[0]: pair[1] for pair in stated if len(pair) == 2}
    frame = _split_cells(path, strip_comments(lines[end + 1 :]), BLANKS)
    frame = frame.iloc[1:].set_axis([_coordinate(name) for name in frame.iloc[0]], axis="columns")
    short = np.flatnonzero((frame == "").any(axis=1))
    if len(short):
        text = f"expected {frame.shape[1]} numbers, one for each column, got fewer"
        raise ParameterFileError(path, f"row {short[0] + 1}", text)
    notices = tuple(
        f"the header says {key}={header[key.lower()][:40]}, but the file has {found}"
        for key, found in zip(("nRows", "nColumns"), frame.shape, strict=True)
        if key.lower() in header and parse_number(header[key.lower()]) != found
    )
    degrees = header.get("indegrees")
    if degrees not in _UNITS:
        raise ParameterFileError(path, "inDegrees", f"expected yes or no, got {str(degrees)[:40]!r}")
    return LogTable(str(path), frame, _UNITS[degrees], opensim=True, notices=notices)


def _coordinate(name: str) -> str:
    """Return the coordinate of a path of Moco, such as ``/jointset/knee_r/knee_angle_r/value``."""
    found = re.fullmatch(r"/.*/([^/]+)/value", name)
    return found[1] if found else name


def _read_lines(path: Path) -> list[str]:
    """Return the lines of a text file; raise ParameterFileError if it or one of its lines is too large."""
    try:
        content = read_bytes(path, MOST_TEXT)
        encoding = detect_encoding(content)
        text = content.decode(encoding)
    except OSError as error:
        raise ParameterFileError(path, "", f"cannot be read ({_format_error(error)})") from error
    except UnicodeDecodeError as error:
        text = f"cannot be read as {encoding.upper()} text ({_format_error(error)}); save it as UTF-8"
        raise ParameterFileError(path, "", text) from error
    if "\0" in text:
        raise ParameterFileError(path, "", "is not a text file, or UTF-16 without its mark: save it as UTF-8")
    lines = text.splitlines()
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            text = f"is too long: {len(line)} characters; a log has at most {LONGEST_LINE}"
            raise ParameterFileError(path, f"line {number}", text)
    return lines


def _split_cells(path: Path, lines: Sequence[str], separator: str) -> pd.DataFrame:
    """Return the cells as strings, the names in the first row."""
    if not lines:
        raise ParameterFileError(path, "", "is empty; expected a line of column names and rows of numbers")
    require_table_size(path, len(lines) - 1, lines[0].count(separator) + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # for rows longer than the header
            return pd.read_csv(
                io.StringIO("\n".join(lines)), sep=separator, header=None, index_col=False,
                skipinitialspace=True, dtype=str, keep_default_na=False,
            )  # fmt: skip
    except (ValueError, TypeError, OverflowError, pd.errors.ParserWarning) as error:
        raise ParameterFileError(path, "", f"is not a table ({_format_error(error)})") from error


def _format_error(error: Exception) -> str:
    return " ".join(str(error).split())[:100]
