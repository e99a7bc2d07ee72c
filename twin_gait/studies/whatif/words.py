"""Small things that the paragraphs of the studies share."""

from __future__ import annotations

import pandas as pd

from twin_gait.studies.loop_stability.loop_stability import Ending


def paragraph(template: str, **values: object) -> str:
    """Fill a text with numbers and join its lines.

    Args:
        template: With a place in braces for every value.
        values: By the names of the places.

    Returns:
        One line.
    """
    return " ".join(template.format(**values).split())


def count(rows: pd.DataFrame, ending: Ending) -> int:
    """How many rows end so."""
    return int((rows["ending"] == ending).sum())


def from_to(values: pd.Series) -> str:
    """Range of values in words, to three digits."""
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"


def cycles(rows: pd.DataFrame) -> str:
    """Number of limit cycles and their amplitudes, in words."""
    sizes = rows[rows["ending"] == Ending.LIMIT_CYCLE]["amplitude_deg"]
    return f"{len(sizes)} limit cycles" + (f" of {from_to(sizes)}°" if len(sizes) else "")
