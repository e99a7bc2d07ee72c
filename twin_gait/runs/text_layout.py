"""Layout of a text table: encoding, separator, decimal mark, and the lines of the names and of the units.

The layout follows from the rows of numbers: the names are in the line above the first row, units may be in a
line between, and all lines above the names are skipped.
"""

import codecs
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

SEPARATORS, BLANKS = ",;\t", r"\s+"
PREAMBLE = 50  # largest number of lines before the names
_REMARKS = "#%"  # characters that begin a comment line
_MISSING = re.compile(r"|nan|na|n/a|null|none|-|[+-]?1\.#(?:ind|qnan|snan)\d*", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?|[+-]?inf|[+-]?1\.#inf\d*", re.IGNORECASE)
_DECIMAL = r"(?<![^\s;\"])[+-]?\d*{}\d+(?:[eE][+-]?\d+)?(?![^\s;\"])"
_DECIMAL_COMMA, _DECIMAL_POINT = re.compile(_DECIMAL.format(",")), re.compile(_DECIMAL.format(r"\."))
_UNIT = re.compile(
    r"[\[(]?(?:m?s|[uµ]s|min|hz|rad|deg|°|turn|(?:rad|deg|°|turn|rev)/s|rpm|m?nm|n[.*·]m|ncm|nmm|m?a|v|"
    r"k?n|m?m|kg|%|°?c|degc|frames?)[\])]?",
    re.IGNORECASE,
)
_SEPARATOR_LINE = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)  # first line of a table for Excel
_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def encoding_of(content: bytes) -> str:
    """Return the encoding that the byte order mark of a text states; UTF-8 without one."""
    return next((name for mark, name in _BYTE_ORDER_MARKS.items() if content.startswith(mark)), "utf-8")


def is_missing(cell: object) -> bool:
    """Return whether a cell states that there is no number."""
    return _MISSING.fullmatch(str(cell).strip()) is not None


def used_lines(lines: Sequence[str]) -> list[str]:
    """Return the lines that are neither a comment nor empty; separators alone are an empty line."""
    return [line for line in lines if line.strip(SEPARATORS + " ") and line.lstrip()[0] not in _REMARKS]


@dataclass(frozen=True)
class TextLayout:
    """Layout of a table of text."""

    separator: str  # separator of the cells; a regular expression
    decimal: str  # decimal mark, "." or ","
    named: bool  # whether the first row contains the names of the columns
    units: Sequence[str]  # units of the columns from the line of units; empty without such a line
    rows: Sequence[str]  # lines of the table, the names first


def find_layout(lines: Sequence[str], required: Collection[str] = ()) -> TextLayout:
    """Find the layout of a table of text.

    ``required``: names of columns; a line with all of them is the line of the names.
    """
    lines = used_lines(lines)
    stated = _SEPARATOR_LINE.fullmatch(lines[0].strip()) if lines else None
    del lines[: stated is not None]
    first, named = _first_line(lines, required)
    del lines[:first]
    separator = stated[1] if stated else _separator(lines[:named], lines[named:PREAMBLE])
    units = [cell.strip("[]()- ") for cell in _cells(lines[1], separator)] if named and len(lines) > 1 else []
    if _states_units(units):
        del lines[1]
    else:
        units = []
    text = "" if separator == "," else "\n".join(lines[named:])
    decimal = "," if _DECIMAL_COMMA.search(text) and not _DECIMAL_POINT.search(text) else "."
    rows = [line.rstrip(" ").removesuffix(separator) for line in lines]
    return TextLayout(separator, decimal, named, units, rows)


def _first_line(lines: Sequence[str], required: Collection[str]) -> tuple[int, bool]:
    """Return the line in which the table begins, and whether it contains the names."""
    for number, line in enumerate(lines[:PREAMBLE] if required else ()):
        rows = (_cells(line, separator) for separator in (*SEPARATORS, BLANKS))
        if any(set(required) <= {*row, *map(bare_name, row)} for row in rows):
            return number, True
    first = next((number for number, line in enumerate(lines[:PREAMBLE]) if _is_numeric(line)), None)
    if first is None or first == 0:
        return 0, first is None
    above = _cells(lines[first - 1], _separator_of_row(lines[first]))
    return max(first - 2 if _states_units(above) else first - 1, 0), True


def bare_name(column: str) -> str:
    """Return the name of a column without the unit or the index in brackets that follows it."""
    return re.split(r"[\[(]", column)[0].strip(' "')


def _separator(header: Sequence[str], body: Sequence[str]) -> str:
    """Return the separator of the cells from the rows of numbers, or from the names without such a row."""
    numeric = next(filter(_is_numeric, body), None)
    if numeric is not None:
        return _separator_of_row(numeric)
    line = (*header, *body, "")[0]
    best = max(SEPARATORS, key=line.count)
    return best if best in line else BLANKS


def _separator_of_row(line: str) -> str:
    """Return the separator of a row of numbers, in which a comma may be the decimal mark."""
    for separator in ";\t":
        if separator in line.strip():
            return separator
    apart = line.split()
    if "," in line and not (len(apart) > 1 and all(map(_NUMBER.fullmatch, apart))):
        return ","
    return BLANKS


def _cells(line: str, separator: str) -> list[str]:
    parts = line.split() if separator == BLANKS else line.split(separator)
    return [part.strip(' "') for part in parts]


def _is_numeric(line: str) -> bool:
    """Return whether a line is a row of numbers: more numbers than words, in at least two cells."""
    cells = _cells(line, _separator_of_row(line))
    numbers = sum(_NUMBER.fullmatch(cell) is not None for cell in cells)
    words = sum(not _NUMBER.fullmatch(cell) and not is_missing(cell) for cell in cells)
    return len(cells) > 1 and numbers > words


def _states_units(cells: Sequence[str]) -> bool:
    """Return whether all cells of a line are units or empty, and at least one is a unit."""
    stated = [cell for cell in cells if cell]
    return bool(stated) and all(map(_UNIT.fullmatch, stated))
