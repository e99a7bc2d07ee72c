"""Flags that many commands share: values to change, and files to write."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from twin_gait.exceptions import RunDirectoryError


def add_settings(parser: argparse.ArgumentParser, text: str | None = None) -> None:
    """Add ``--set``, which may be given many times; ``settings`` holds them.

    Args:
        parser: Of the command.
        text: For the help.
    """
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help=text)


_SHORTHANDS = {
    "--mass": ("KG", "patient.mass_kg", "mass of the wearer in kg"),
    "--height": ("M", "patient.height_m", "height of the wearer in m"),
    "--speed": ("KM_PER_H", "scenario.belt_speed_km_per_h", "speed of the belt in km/h"),
    "--support": ("SHARE", "scenario.support.share", "share of the weight that is carried: 0.6 or 60%%"),
}


def add_wearer(parser: argparse.ArgumentParser) -> None:
    """Add flags for what is changed most; each is a ``--set`` with a shorter name, and counts in its order.

    Args:
        parser: Of the command; it has ``--set``.
    """
    for flag, (unit, key, text) in _SHORTHANDS.items():
        parser.add_argument(
            flag, action="append", dest="settings", type=_assigning(key), metavar=unit, help=text
        )


def _assigning(key: str) -> Callable[[str], str]:
    def number(text: str) -> str:
        value = float(text.removesuffix("%"))
        return f"{key}={value / 100.0 if text.endswith('%') else value!r}"

    return number


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
