"""Export a log as CSV."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from twin_gait.files import write_atomically


def export_csv(log: pd.DataFrame, path: Path) -> None:
    """Write a log as CSV: a header with units in the names, one row per tick, all digits.

    Args:
        log: One row per tick.
        path: The file.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    write_atomically(path, log.to_csv(index=False, lineterminator="\n"))
