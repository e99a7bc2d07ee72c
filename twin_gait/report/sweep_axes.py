"""Columns of a sweep's table as axes: units, labels, and levels or bins."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from twin_gait.simulation.columns import unit_of

# More different values than this are cut into bins.
MOST_LEVELS = 12
EPISODES_PER_BIN = 6
MOST_BINS = 8

# Suffixes of settings that no log column has.
_UNITS = {
    "_kg": "kg",
    "_deg": "deg",
    "_Nm_per_deg": "N m/deg",
    "_Nms_per_deg": "N m s/deg",
    "_km_per_h": "km/h",
    "_ms": "ms",
    "_Hz": "Hz",
    "_Ohm": "Ohm",
    "_kgm2": "kg m²",
    "_N_per_m1p5": "N/m^1.5",
    "_Ns_per_m": "N s/m",
    "_s_per_m": "s/m",
    "_s_per_rad": "s/rad",
    "_m_per_s2": "m/s²",
    "_Nm_per_A": "N m/A",
}
# Rooms of an experiment that say nothing in a label.
_ROOMS = frozenset({"set", "table", "phases", "patient", "scenario", "plant", "control", "sensors"})


def unit_of_column(column: str) -> str:
    """Unit of a column of a sweep's table, from the suffix of its name.

    Returns:
        The unit, for example ``kg``; ``1`` for counts, shares and texts.
    """
    suffix = max((item for item in _UNITS if column.endswith(item)), key=len, default="")
    shared = unit_of(column)
    if shared == "name":  # a count by phase is none
        return "1"
    # Of both lists the longer suffix wins: "_m_per_s" is a speed, not seconds.
    known = 0 if shared == "1" else len(column) - _cut(column, shared, unit_of)
    return _UNITS[suffix] if len(suffix) > known else shared


def _cut(text: str, unit: str, unit_of_text: Callable[[str], str]) -> int:
    """Where the suffix that names a unit begins."""
    cuts = [match.start() for match in re.finditer("_", text)]
    return max(at for at in cuts if unit_of_text(text[at:]) == unit)


def label_of(column: str, *, unit: bool = True) -> str:
    """A column in words.

    Returns:
        For example ``early stance knee stiffness [N m/deg]``.
    """
    named = unit_of_column(column)
    words = [word for word in column.split(".") if word not in _ROOMS] or [column]
    text = " ".join(words)
    if named != "1":
        text = text[: _cut(text, named, unit_of_column)]
    text = text.replace("_", " ").strip()
    return f"{text} [{named}]" if unit and named != "1" else text


@dataclass(frozen=True)
class Axis:
    """A parameter with its levels, or with bins where it has too many.

    Attributes:
        column: Its name in the table.
        places: Level or bin of each episode, -1 where it has none, shape ``(n,)``.
        centres: Where each level or bin is drawn, shape ``(k,)``.
        names: What stands beside each.
        numbers: Value of each episode where the parameter is a number, shape ``(n,)``; None for names.
    """

    column: str
    places: np.ndarray
    centres: np.ndarray
    names: tuple[str, ...]
    numbers: np.ndarray | None

    @property
    def binned(self) -> bool:
        """Whether neighbouring values have been put together."""
        return self.numbers is not None and len(np.unique(self.numbers[self.places >= 0])) > len(self.names)


def axis_of(table: pd.DataFrame, column: str) -> Axis | None:
    """Lay a parameter out.

    Returns:
        The axis; None if it has but one value.
    """
    values = table[column]
    if values.nunique() < 2:
        return None
    if not pd.api.types.is_numeric_dtype(values) or pd.api.types.is_bool_dtype(values):
        codes, names = pd.factorize(values, sort=True)
        return Axis(column, codes, np.arange(len(names)), tuple(str(item) for item in names), None)
    numbers = values.to_numpy(dtype=float, na_value=np.nan)
    levels = np.unique(numbers[np.isfinite(numbers)])
    if len(levels) <= MOST_LEVELS:
        places = np.where(np.isfinite(numbers), np.searchsorted(levels, numbers), -1)
        return Axis(column, places, levels, tuple(f"{level:.4g}" for level in levels), numbers)
    return _binned(column, numbers, levels)


def _binned(column: str, numbers: np.ndarray, levels: np.ndarray) -> Axis:
    count = int(np.clip(len(numbers) / EPISODES_PER_BIN, 2, MOST_BINS))
    edges = np.linspace(levels[0], levels[-1], count + 1)
    if _spans_decades(levels):
        edges = np.geomspace(levels[0], levels[-1], count + 1)
    places = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, count - 1)
    centres = np.sqrt(edges[1:] * edges[:-1]) if _spans_decades(levels) else (edges[1:] + edges[:-1]) / 2
    names = tuple(f"{centre:.3g}" for centre in centres)
    return Axis(column, np.where(np.isfinite(numbers), places, -1), centres, names, numbers)


def _spans_decades(levels: np.ndarray) -> bool:
    return bool(levels[0] > 0.0 and levels[-1] / levels[0] > 20.0)


def is_logarithmic(axis: Axis) -> bool:
    """Whether its values are better drawn on a logarithmic scale."""
    return axis.numbers is not None and _spans_decades(axis.centres)
