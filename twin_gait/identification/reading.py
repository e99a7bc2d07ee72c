"""Read logs and series of measurements: any text table, any column names, units declared or by name."""

import csv
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import MOST_ROWS, require_table_size
from twin_gait.identification.columns import (
    KINDS,
    LISTED,
    LogColumns,
    Quantity,
    known_unit,
    places_of,
)

_SEPARATORS = ",;\t"
_HEAD = 65_536  # [bytes] that are looked at for comments, header and separator
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-"}
_EMPTY_CELLS = [case(word) for word in _MISSING for case in (str.lower, str.upper, str.capitalize)]
_CHECKED_ROWS = 100
_EMPTY = "is empty; expected column names and rows of numbers"
_LONGEST_UNIT = 8
_REMARKS, _PREAMBLE = "#%", 50  # characters that begin a comment; lines before the column names
_MASS_IN_NAME = re.compile(r"(?<![\d.])(\d+(?:[.,p]\d+)?)[ _]?kg(?![a-z])", re.IGNORECASE)
_COMMENT = re.compile(r"#\s*([A-Za-z_ ]+?)\s*(?:\[[^\]]*\])?\s*[:=]\s*([-+.\deE]+)\s*$")


@dataclass(frozen=True, eq=False)
class Log:
    """A log in SI units, as it was recorded."""

    source: str  # the file
    # of each quantity that it holds, shape ``(n,)``; NaN where a cell is empty
    columns: Mapping[Quantity, np.ndarray]
    mass: float | None = None  # weight on the link in [kg], if comments or the file's name say so
    # columns that the user named; the others were found by their known names
    asked: frozenset[Quantity] = frozenset()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_log(path: Path, columns: LogColumns | None = None) -> Log:
    """Read a log.

    The separator may be a comma, a semicolon, a tab or blanks; lines that begin with # are comments, of which
    ``# mass_kg: 2.5`` states the weight. A file without column names has columns 1, 2 and so on. Columns
    with a known name are found without being named in ``columns``.

    Raises ParameterFileError if the file cannot be read as numbers; one line with file, column and row.
    """
    columns = columns or LogColumns()
    layout = _layout(path, set(columns.names.values()))
    places = places_of(path, layout.names, columns)
    values = _numbers(path, layout, sorted({place for place, _ in places.values()}))
    found = {quantity: values[place] * factor for quantity, (place, factor) in places.items()}
    if not found or len(values[next(iter(values))]) == 0:
        raise ParameterFileError(path, "", _EMPTY)
    mass = layout.mass if layout.mass is not None else _mass_in(path.name)
    return Log(str(path), found, mass, frozenset(columns.names))


@dataclass(frozen=True)
class _Layout:
    """What the first lines of a file say."""

    separator: str
    decimal: str
    names: tuple[str, ...]
    header_rows: int
    mass: float | None


def _layout(path: Path, asked: set[str]) -> _Layout:
    lines, whole = _first_lines(path)
    skipped = 0
    while skipped < len(lines) and (not lines[skipped].strip() or lines[skipped].lstrip()[0] in _REMARKS):
        skipped += 1
    skipped = _header_line(lines, skipped, {name.lstrip("-") for name in asked})
    if skipped == len(lines) - 1 and not whole:
        raise ParameterFileError(path, f"line {skipped + 1}", "is too long for the column names of a log")
    if skipped == len(lines):
        raise ParameterFileError(path, "", _EMPTY)
    first, following = lines[skipped], lines[skipped + 1] if skipped + 1 < len(lines) else ""
    separator = max(_SEPARATORS, key=first.count)
    separator = separator if separator in first else " "
    decimal = "," if separator != "," and "," in following and "." not in following else "."
    cells, units = _cells(first, separator), [cell.strip("[]() ") for cell in _cells(following, separator)]
    numeric = all(_is_number(cell, decimal) for cell in cells)
    names = tuple(str(number) for number in range(1, len(cells) + 1)) if numeric else tuple(cells)
    header = skipped + (0 if numeric else 1)
    if not numeric and len(units) == len(names) and _are_units(units, decimal):
        names = tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))
        header += 1
    for number, line in enumerate(lines[header : header + _CHECKED_ROWS], start=1):
        found = len(_cells(line.split("#")[0].rstrip().removesuffix(separator), separator))
        if found > len(names):  # longer than the header: columns would be mistaken for one another
            text = f"row {number} has {found} cells, but there are {len(names)} column names"
            raise ParameterFileError(path, "", text)
    return _Layout(separator, decimal, names, header, _mass_in_comments(lines[:skipped]))


def _first_lines(path: Path) -> tuple[list[str], bool]:
    """Lines of the beginning of a text file, and whether they are all."""
    if not path.is_file():
        raise ParameterFileError(path, "", "no such file")
    whole = path.stat().st_size <= _HEAD
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD).decode("utf-8-sig", errors="strict" if whole else "ignore")
    except OSError as error:
        raise ParameterFileError(path, "", f"cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ParameterFileError(path, "", "is not UTF-8 text") from error
    if "\0" in head:
        raise ParameterFileError(path, "", "is not a text file")
    return head.splitlines(), whole


def _header_line(lines: list[str], first: int, asked: set[str]) -> int:
    """The line with the column names that were asked for, if a preamble stands before it."""
    for number in range(first, min(first + _PREAMBLE, len(lines))):
        for separator in (*_SEPARATORS, " "):
            if asked and asked <= {cell.split("[")[0].strip() for cell in _cells(lines[number], separator)}:
                return number
    return first


def _are_units(cells: list[str], decimal: str) -> bool:
    """Whether the line under the names holds their units: short words, none of them a number."""
    words = [cell for cell in cells if cell and cell.lower() not in _MISSING]
    short = not any(_is_number(cell, decimal) or len(cell) > _LONGEST_UNIT for cell in words)
    return short and any(known_unit(cell, quantity) for cell in words for quantity in Quantity)


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except csv.Error:
        return [cell.strip() for cell in line.split(separator)]


def _is_number(text: str, decimal: str) -> bool:
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _mass_in_comments(lines: list[str]) -> float | None:
    for line in lines:
        match = _COMMENT.match(line.strip())
        if match and match[1].lower().split("_")[0].strip() in KINDS[Quantity.MASS].names:
            return float(match[2]) if _is_number(match[2], ".") else None
    return None


def _mass_in(name: str) -> float | None:
    match = _MASS_IN_NAME.search(name)
    return float(re.sub("[,p]", ".", match[1].lower())) if match else None


def _numbers(path: Path, layout: _Layout, places: list[int]) -> dict[int, np.ndarray]:
    if not places:
        raise ParameterFileError(
            path,
            "",
            f"no column is known among {', '.join(layout.names[:LISTED])}; name them with "
            "--columns velocity=NAME,friction_torque=NAME",
        )
    try:
        frame = _frame(path, layout, places, float)
    except (ValueError, OverflowError) as error:
        raise _wrong_cell(path, layout, places) from error
    require_table_size(path, len(frame), len(places))
    values = {place: frame[place].to_numpy(dtype=float) for place in places}
    for place, column in values.items():
        if np.isinf(column).any():
            row = int(np.argmax(np.isinf(column)))
            raise ParameterFileError(path, layout.names[place], f"is infinite in row {row + 1}")
    return values


def _frame(path: Path, layout: _Layout, places: list[int], dtype: type) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                path,
                compression=None,
                sep=r"\s+" if layout.separator == " " else layout.separator,
                header=None,
                names=list(range(len(layout.names))),
                usecols=places,
                skiprows=layout.header_rows,
                nrows=MOST_ROWS + 1,
                index_col=False,
                comment="#",
                skipinitialspace=True,
                decimal=layout.decimal,
                dtype=dtype,
                keep_default_na=dtype is float,
                na_values=_EMPTY_CELLS if dtype is float else None,
                engine="c",
                encoding="utf-8-sig",
                encoding_errors="replace",
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        reason = " ".join(str(error).split())[:100]
        raise ParameterFileError(path, "", f"is not a table of numbers ({reason})") from error


def _wrong_cell(path: Path, layout: _Layout, places: list[int]) -> ParameterFileError:
    """Which of the cells is no number."""
    texts = _frame(path, layout, places, str)
    for place in places:
        cells = texts[place].fillna("").str.strip()
        numbers = pd.to_numeric(cells.str.replace(layout.decimal, ".", regex=False), errors="coerce")
        wrong = np.flatnonzero(numbers.isna() & ~cells.str.lower().isin(_MISSING))
        if len(wrong):
            shown = " ".join(cells.iloc[wrong[0]].split())[:40]
            text = f"expected a number in row {wrong[0] + 1}, got {shown!r}"
            return ParameterFileError(path, layout.names[place], text)
    return ParameterFileError(path, "", "is not a table of numbers")
