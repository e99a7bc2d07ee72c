"""Report of pictures that could not be drawn; their failure does not affect the numbers of a run.

This module does not import matplotlib, so that a broken installation of it is also a failed picture.
"""

import warnings
from collections.abc import Mapping


class PictureWarning(UserWarning):
    """Warning that a picture could not be drawn, while everything else is written."""


def reason_of(error: Exception) -> str:
    """Describe the error of a picture on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def failed_pictures(failed: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Warn once of pictures that could not be drawn, and return the entry of the summary about them.

    ``failed``: reason by name; without an entry there is no warning, and the result is empty.
    """
    if not failed:
        return {}
    listed = ", ".join(f"{name} ({reason})" for name, reason in failed.items())
    warnings.warn(f"not drawn: {listed}; all else is written", PictureWarning, stacklevel=3)
    return {"pictures_failed": {**failed}}
