"""An approved text of a gait table: whoever edits the table sees in a diff what has changed.

The tests of the kit follow the table, so they cannot notice that the table itself was edited; this text,
kept in git and approved by a person, can.
"""

from __future__ import annotations

import difflib
from pathlib import Path

from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.gait.documents import transition_table, truth_table
from twin_gait.gait.table import GaitTable


def approval_text(table: GaitTable) -> str:
    """Write everything that a gait table says as Markdown.

    Args:
        table: The gait table.

    Returns:
        Transitions in their order of priority, laws, parameters and truth table of each phase, as ``twin-gait
        diagram`` prints them; the same text for the same table.
    """
    return f"{transition_table(table)}\n{truth_table(table)}"


def check_approved(path: Path, present: str) -> str | None:
    """Compare a text with the one that was approved.

    Args:
        path: File with the approved text.
        present: The text of the table as it is.

    Returns:
        None if they are the same, else what is wrong: a unified diff, or that there is no such file.

    Raises:
        ParameterFileError: If the file cannot be read.
    """
    if not path.exists():
        return f"{path}: there is no approved text yet"
    try:
        approved = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterFileError(path, "", f"cannot be read as text ({error})") from error
    lines = difflib.unified_diff(
        approved.splitlines(), present.splitlines(), fromfile=str(path), tofile="the table", lineterm=""
    )
    return "\n".join(lines) or None


def write_approved(path: Path, text: str) -> None:
    """Approve a text: write it, whole or not at all; raises RunDirectoryError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"{path.parent}: cannot be made ({error.strerror})") from error
    write_atomically(path, text)
