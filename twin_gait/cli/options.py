"""Flags that many commands share: values to change, and files to write."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin_gait.exceptions import RunDirectoryError


def add_settings(parser: argparse.ArgumentParser, text: str | None = None) -> None:
    """Add ``--set``, which may be given many times; ``settings`` holds them.

    Args:
        parser: Of the command.
        text: For the help.
    """
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help=text)


def check_file(flag: str, path: Path, *, force: bool) -> None:
    """Refuse a file that cannot be written, before any work is done for it.

    Args:
        flag: By which the user named it.
        path: The file.
        force: Whether an existing file may be replaced.

    Raises:
        RunDirectoryError: If it exists, is a directory, or would lie in none.
    """
    if path.is_dir():
        raise RunDirectoryError(f"{flag} {path}: is a directory; name a file")
    if path.exists() and not force:
        raise RunDirectoryError(f"{path}: exists; choose another {flag}, or replace it with --force")
    if not path.absolute().parent.is_dir():
        raise RunDirectoryError(f"{flag} {path}: there is no directory {path.absolute().parent}")
