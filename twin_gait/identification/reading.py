"""Read logs and series of measurements: any text table, any column names, units declared or by name."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification.columns import KINDS, LogColumns, Quantity, columns_of, known_unit
from twin_gait.runs.log_files import LogTable, is_missing, is_number, read_text_table

_LONGEST_UNIT = 8
_MASS_IN_NAME = re.compile(r"(?<![\d.])(\d+(?:[.,p]\d+)?)[ _]?kg(?![a-z])", re.IGNORECASE)
_COMMENT = re.compile(r"#\s*([A-Za-z_ ]+?)\s*(?:\[[^\]]*\])?\s*[:=]\s*(\d*\.?\d+(?:[eE][-+]?\d+)?)\s*$")


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
    table = _with_units(read_text_table(path, {name.lstrip("-") for name in columns.names.values()}))
    found = columns_of(table, columns)
    if not found:
        advice = "name them with --columns velocity=NAME,friction_torque=NAME"
        raise ParameterFileError(path, "", f"no column is known among {table.listed()}; {advice}")
    if table.frame.empty:
        raise ParameterFileError(path, "", "is empty; expected column names and rows of numbers")
    values = {quantity: table.numbers(name, gaps=True) * factor for quantity, (name, factor) in found.items()}
    return Log(str(path), values, _mass(path.name, table.remarks), frozenset(columns.names))


def _with_units(table: LogTable) -> LogTable:
    """The table with the units behind its names that stand under them: short words, none of them a number."""
    if table.frame.empty:
        return table
    units = [cell.strip("[]() ") for cell in table.frame.iloc[0]]
    words = [unit for unit in units if not is_missing(unit)]
    if any(len(word) > _LONGEST_UNIT or is_number(word, table.decimal) for word in words):
        return table
    if not any(known_unit(word, quantity) for word in words for quantity in Quantity):
        return table
    names = tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(table.names, units, strict=True))
    return replace(table, names=names, frame=table.frame.iloc[1:])


def _mass(name: str, remarks: tuple[str, ...]) -> float | None:
    """The weight in [kg] that a comment states, or else the name of the file."""
    for match in filter(None, map(_COMMENT.match, map(str.strip, remarks))):
        if match[1].lower().split("_")[0].strip() in KINDS[Quantity.MASS].names:
            return float(match[2])
    found = _MASS_IN_NAME.search(name)
    return float(re.sub("[,p]", ".", found[1].lower())) if found else None
