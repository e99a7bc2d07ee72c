"""The last resort: an error that nobody foresaw becomes one line, and a report that can be sent."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence

from twin_gait import __version__


def describe_defect(error: Exception, arguments: Sequence[str]) -> str:
    """Keep a report of an unforeseen error, and say in one line what happened and where the report is.

    Args:
        error: What was raised.
        arguments: Of the command line.

    Returns:
        The line.
    """
    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="twin_gait_report_", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:  # 0600: arguments may name people
            file.write(f"twin_gait {__version__}, Python {sys.version}, {platform.platform()}\n")
            file.write(f"arguments: {list(arguments)!r}\n\n")
            file.writelines(traceback.format_exception(error))
        kept = f"the report is in {file.name}"
    except OSError as problem:
        kept = f"no report could be kept ({problem.strerror})"
    return f"this should not have happened ({cause}); {kept}; --debug shows all"
