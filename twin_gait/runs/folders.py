"""Folders that appear only when they are complete, and that replace only folders of their own kind."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import apply_umask, check_replaceable, sync_folder

PARTIAL = ".partial"  # end of the name of a folder that is incomplete
SETTLED = 60.0  # [s] minimum age of an abandoned folder
JOURNAL_SUFFIX = ".unfinished.arrows"


def journal_path(folder: Path) -> Path:
    """Return the path of the journal of a live walk whose run folder is not complete yet."""
    return folder.with_name(folder.name + JOURNAL_SUFFIX)


class FolderKind(NamedTuple):
    """Kind of folder that a command writes."""

    name: str  # with its article, for messages
    mark: str  # name of the file that identifies such a folder

    def can_replace(self, folder: Path) -> bool:
        """Return whether a folder is of this kind, or empty."""
        return folder.is_dir() and ((folder / self.mark).is_file() or not any(folder.iterdir()))


@contextlib.contextmanager
def staged_directory(target: Path, kind: FolderKind, *, force: bool = False) -> Iterator[Path]:
    """Provide a hidden folder next to the target that replaces it when all files are written.

    The target is either unchanged or complete, even after an error. Raises RunDirectoryError if it exists and
    may not be replaced, or cannot be written.
    """
    target = target.expanduser().absolute()
    check_target(target, kind, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=PARTIAL, dir=target.parent))
        held = try_lock(staging)
        try:
            yield staging
            os.chmod(staging, apply_umask(0o755))
            _replace_target(staging, target)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
            if held is not None:
                os.close(held)
    except OSError as error:
        way_out = "choose another --out"
        raise RunDirectoryError(f"{target}: cannot be written ({error.strerror}); {way_out}") from error


def try_lock(folder: Path) -> int | None:
    """Lock a folder until the returned descriptor is closed or the process ends; None if it is locked."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # the folder is locked, or the file system has no locks
        os.close(descriptor)
        return None
    return descriptor


def find_abandoned_folders(parent: Path) -> list[Path]:
    """Return the incomplete folders of killed runs in a parent folder."""
    found = []
    with contextlib.suppress(OSError):
        for path in sorted(parent.glob(f".*{PARTIAL}")):
            # The process of a new folder may not have locked it yet.
            if path.is_symlink() or time.time() - path.stat().st_mtime < SETTLED:
                continue
            held = try_lock(path)
            if held is not None:
                os.close(held)
                found.append(path)
    return found


def check_target(target: Path, kind: FolderKind, *, force: bool) -> None:
    """Raise RunDirectoryError if a folder exists and may not be replaced, or is of another kind."""
    target = target.expanduser().absolute()
    check_replaceable(target)
    if not target.exists():
        return
    if not force:
        raise RunDirectoryError(f"{target}: exists; choose another --out, or replace it with --force")
    if not kind.can_replace(target):
        raise RunDirectoryError(f"{target}: exists and is not {kind.name}; choose another --out")


def _replace_target(staging: Path, target: Path) -> None:
    sync_folder(staging)
    old = staging.with_suffix(".old")
    if target.exists():
        os.rename(target, old)
    os.rename(staging, target)
    sync_folder(target.parent)
    shutil.rmtree(old, ignore_errors=True)
