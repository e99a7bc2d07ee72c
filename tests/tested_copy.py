"""Check that the tested copy of the package is that of this checkout, or equal to it."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
_WHERE = "import importlib.util as u; s = u.find_spec('twin_gait'); print(s.origin if s else '')"


def copies_in_use() -> list[Path | None]:
    """Return the folders of the package in this process and in one in another folder; None if missing."""
    import twin_gait

    with tempfile.TemporaryDirectory() as elsewhere:
        origin = subprocess.check_output([sys.executable, "-c", _WHERE], text=True, cwd=elsewhere).strip()
    return [Path(twin_gait.__file__).resolve().parent, Path(origin).resolve().parent if origin else None]


def complaint(copy: Path | None, checkout: Path = CHECKOUT) -> str | None:
    """Return the reason why a copy differs from a checkout.

    Args:
        copy: Folder of the package that is imported.
        checkout: Folder that contains the folder of the package.

    Returns:
        One line, or None if the copy is that of the checkout or equal to it.
    """
    way_out = "run: python -m pip install -e '.[test]'"
    if copy is None:
        return f"twin_gait is not installed, which tests need that start it elsewhere; {way_out}"
    package = checkout / "twin_gait"
    if copy == package:
        return None
    ours, theirs = _files(package) | _files(checkout / "urdf", "urdf"), _files(copy)
    for name in sorted(ours.keys() | theirs.keys()):
        if name not in ours or name not in theirs or ours[name].read_bytes() != theirs[name].read_bytes():
            return f"{copy} would be tested, whose {name} is not that of {package}; {way_out}"
    return None


def _files(folder: Path, prefix: str = "") -> dict[str, Path]:
    return {
        (Path(prefix) / path.relative_to(folder)).as_posix(): path
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")
    }
