"""Tables as OpenSim stores them: a header, ``endheader``, names, rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin_gait.files import write_atomically


def write_storage(path: Path, columns: Mapping[str, np.ndarray], *, in_degrees: bool) -> None:
    """Write a .mot or .sto file, with all digits.

    Args:
        path: The file.
        columns: By name, ``time`` first, shape ``(n,)`` each.
        in_degrees: Whether its angles are in degrees.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    rows = np.column_stack(list(columns.values()))
    header = [
        path.stem,
        "version=1",
        f"nRows={len(rows)}",
        f"nColumns={len(columns)}",
        f"inDegrees={'yes' if in_degrees else 'no'}",
        "endheader",
        "\t".join(columns),
    ]
    lines = ["\t".join(map(repr, row)) for row in rows.tolist()]
    write_atomically(path, "\n".join([*header, *lines]) + "\n")
