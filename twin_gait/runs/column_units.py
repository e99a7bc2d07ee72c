"""Names of columns that state their unit: ``velocity [deg/s]``, ``velocity_deg_per_s`` or ``hip (rad)``."""

import math
import re
from collections.abc import Mapping

from twin_gait.conventions import DEGREES, RADIANS

# Factor to the SI unit by the spelling of a unit; the SI unit comes first.
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}
ANGLES = {RADIANS: 1.0, DEGREES: math.pi / 180.0, "°": math.pi / 180.0, "turn": 2.0 * math.pi}
FORCES = {"N": 1.0, "kN": 1e3}

_HEADING = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])]|_([^\W_]+(?:_per_[^\W_]+)?))?")
_SYNONYMS = {
    "N*m": "Nm", "N.m": "Nm", "1/min": "rpm", "sec": "s", "second": "s", "seconds": "s", "msec": "ms",
    "degree": DEGREES, "degrees": DEGREES, "radian": RADIANS, "radians": RADIANS,
}  # fmt: skip


def find_unit(text: str | None, units: Mapping[str, float]) -> str | None:
    """Return a unit in the spelling of ``units``, or None if it is not among them."""
    spelling = (text or "").strip().replace(" ", "").replace("·", "").replace("_per_", "/")
    spellings = (spelling, _SYNONYMS.get(spelling), spelling.lower(), _SYNONYMS.get(spelling.lower()))
    return next((item for item in spellings if item in units), None)


def split_heading(column: str, units: Mapping[str, float]) -> tuple[str, str | None]:
    """Split the name of a column into the name without its unit, and the unit as it is written, or None.

    A number in brackets is an index, as in ``dq[3]``, and no unit. The last word after an underscore is a
    unit if ``units`` contains it, or if it is a quotient such as ``deg_per_s``.
    """
    found = _HEADING.fullmatch(column.strip())
    name, bracketed, behind = found.groups() if found else (column.strip(), None, None)
    if bracketed is not None and bracketed.strip().isdigit():
        return name, None
    if behind and "_per_" not in behind and find_unit(behind, units) is None:
        return column.strip(), None
    return name, bracketed or behind


def plain_name(column: str, units: Mapping[str, float]) -> str:
    """Return the name of a column without its unit, in lower case and with underscores for blanks."""
    return split_heading(column, units)[0].strip(' "').lower().replace(" ", "_")
