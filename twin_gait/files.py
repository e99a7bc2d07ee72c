"""Write files so that a reader sees the old content or the new, never half of it, and JSON that is JSON."""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from twin_gait.exceptions import RunDirectoryError


def finite_or_none(value: float) -> float | None:
    """A number as JSON holds it, which has no word for infinite ones and for none at all.

    Args:
        value: The number.

    Returns:
        The number, or None if it is not finite.
    """
    return float(value) if math.isfinite(value) else None


def permitted(mode: int) -> int:
    """What a mode comes to under the mask of the user, which temporary files and folders do not ask.

    Args:
        mode: Of a file or a folder, such as ``0o644``.

    Returns:
        The mode without what the mask takes away.
    """
    mask = os.umask(0o077)
    os.umask(mask)
    return mode & ~mask


@contextlib.contextmanager
def private_files() -> Iterator[None]:
    """Make new files and folders, also those of processes started here, for the user alone."""
    mask = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(mask)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file through a temporary one beside it.

    Args:
        path: The file.
        content: Text (written as UTF-8) or bytes.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise RunDirectoryError(f"{path}: cannot be written ({error.strerror})") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        os.chmod(name, permitted(0o644))
        os.replace(name, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise RunDirectoryError(f"{path}: cannot be written ({error.strerror})") from error
