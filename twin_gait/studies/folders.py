"""Folders that appear when all in them is written, and replace only their own kind."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import permitted


class FolderKind(NamedTuple):
    """What a command leaves behind.

    Attributes:
        name: With its article, for messages.
        mark: File by which such a folder is known.
    """

    name: str
    mark: str

    def owns(self, folder: Path) -> bool:
        """Whether a folder is of this kind, or empty."""
        return folder.is_dir() and ((folder / self.mark).is_file() or not any(folder.iterdir()))


@contextlib.contextmanager
def staged_directory(target: Path, kind: FolderKind, *, force: bool = False) -> Iterator[Path]:
    """Give a hidden folder beside the target that takes its place when all is written.

    Whatever happens inside, the target is either as it was or complete.

    Args:
        target: The folder to make.
        kind: What it is.
        force: Whether an existing folder of this kind may be replaced.

    Yields:
        Folder to write into.

    Raises:
        RunDirectoryError: If the target exists, or cannot be written.
    """
    target = target.expanduser().absolute()
    check_target(target, kind, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent))
    except OSError as error:
        raise RunDirectoryError(
            f"{target}: cannot be written ({error.strerror}); choose another --out"
        ) from error
    try:
        yield staging
        os.chmod(staging, permitted(0o755))
        _put_in_place(staging, target)
    except OSError as error:
        raise RunDirectoryError(f"{target}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def check_target(target: Path, kind: FolderKind, *, force: bool) -> None:
    """Refuse a folder that exists, unless it is of its kind and may be replaced.

    Args:
        target: The folder to make.
        kind: What it is to be.
        force: Whether an existing folder of this kind may be replaced.

    Raises:
        RunDirectoryError: If it may not be used.
    """
    target = target.expanduser().absolute()
    if not target.exists():
        return
    if not force:
        raise RunDirectoryError(f"{target}: exists; choose another --out, or replace it with --force")
    if not kind.owns(target):
        raise RunDirectoryError(
            f"{target}: is not {kind.name}, so --force does not replace it; choose another --out"
        )


def _put_in_place(staging: Path, target: Path) -> None:
    if target.exists():
        old = staging.with_suffix(".old")
        os.rename(target, old)
        os.rename(staging, target)
        shutil.rmtree(old, ignore_errors=True)
    else:
        os.rename(staging, target)
