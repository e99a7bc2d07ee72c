"""Read motion files of OpenSim (.mot, .sto): a header, ``endheader``, then columns by name.

The header states ``nRows``, ``nColumns`` and ``inDegrees`` as ``key=value``; files of the older SIMM form
state ``datarows`` and ``datacolumns`` and no unit. A name may stand over several columns.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin_gait.conventions import DEGREES, RADIANS
from twin_gait.exceptions import ParameterFileError

END_OF_HEADER = "endheader"
_ROWS, _COLUMNS, _DEGREES = "nrows", "ncolumns", "indegrees"
_SIMM = {"datarows": _ROWS, "datacolumns": _COLUMNS}
_UNITS = {"yes": DEGREES, "no": RADIANS}


class Storage(NamedTuple):
    """Content of a motion file.

    Attributes:
        names: Of the columns, in order.
        values: Shape ``(n_rows, n_columns)``.
        unit: Of the angles, ``deg`` or ``rad``; None if the header does not say.
    """

    names: tuple[str, ...]
    values: np.ndarray
    unit: str | None


def parse_storage(text: str, source: str) -> Storage:
    """Parse a motion file.

    Args:
        text: Its content.
        source: File name for messages.

    Returns:
        Names, numbers and unit.

    Raises:
        ParameterFileError: If it is not such a file, or contradicts its own header.
    """
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
