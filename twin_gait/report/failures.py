"""Pictures that could not be drawn: they never cost the numbers that they show.

This module imports no matplotlib, so that a broken installation of it is a failed picture too.
"""

import warnings
from collections.abc import Mapping


class PictureWarning(UserWarning):
    """A picture could not be drawn; everything else is written."""


def format_error(error: Exception) -> str:
    """Describe the error of a picture on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def failed_pictures(failed: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Warn once of pictures that could not be drawn, and return the entry that records them.

    ``failed``: reason by name; nothing is warned of or returned if it is empty.
    """
    if not failed:
        return {}
    listed = ", ".join(f"{name} ({reason})" for name, reason in failed.items())
    warnings.warn(f"not drawn: {listed}; all else is written", PictureWarning, stacklevel=3)
    return {"pictures_failed": {**failed}}
