"""Picture of a page, rendered by a Chromium that is installed on this machine."""

import os
import re
import shutil
import struct
import subprocess
import tempfile
from pathlib import Path

from twin_gait.exceptions import ViewerError
from twin_gait.files import write_atomically

BROWSER_VARIABLE = "TWIN_GAIT_BROWSER"
BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)  # fmt: skip
_READY = "ready"
_SETTLING = 8000  # [ms], virtual time of the page before the picture is taken
_FLAGS = (
    "--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--force-device-scale-factor=1",
    # Software rendering is used if there is no graphics card.
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--enable-logging=stderr", f"--virtual-time-budget={_SETTLING}",
)  # fmt: skip
SIZE = (1600, 1000)  # width and height of a picture in pixels
BROWSER_TIMEOUT = 120.0  # [s], timeout of the browser


def find_browser() -> str:
    """Find a Chromium: the one named in ``TWIN_GAIT_BROWSER``, or the first on the search path.

    Raises ViewerError if there is none.
    """
    named = os.environ.get(BROWSER_VARIABLE)
    names = [named] if named else BROWSERS
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        way_out = f"install one, or name it in {BROWSER_VARIABLE}"
        raise ViewerError(f"a picture needs Chromium, but none of {', '.join(names)} is installed; {way_out}")
    return found


def take_picture(page: str, path: Path, *, time: float = 0.0) -> None:
    """Render a recorded page at one time and write it as PNG.

    ``page``: HTML of :func:`twin_gait.viewer.page.recorded_page`; ``path``: the PNG file; an existing file is
    replaced only by a complete one; ``time`` to show in [s]. Raises RunDirectoryError if the file cannot be
    written. Raises ViewerError if there is no Chromium, or if it does not render the page.
    """
    browser, (width, height) = find_browser(), SIZE
    # The browser may still be writing into its profile when it has ended.
    with tempfile.TemporaryDirectory(prefix="twin_gait_", ignore_cleanup_errors=True) as folder:
        source, drawn = Path(folder) / "page.html", Path(folder) / "picture.png"
        source.write_text(page, encoding="utf-8")
        address = f"{source.as_uri()}#t={time:.3f}&theme=light&picture=1"
        # Chromium does not start as root with its sandbox, which is not needed because the page is our own.
        sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        command = [
            browser, *_FLAGS, *sandbox, f"--user-data-dir={folder}/profile",
            f"--window-size={width},{height}", f"--screenshot={drawn}", address,
        ]  # fmt: skip
        log = Path(folder) / "stderr.txt"  # a file, because child processes of the browser may outlive it
        try:
            with log.open("wb") as stderr:
                subprocess.run(
                    command, stdout=subprocess.DEVNULL, stderr=stderr, timeout=BROWSER_TIMEOUT, check=False
                )
        except (OSError, subprocess.TimeoutExpired) as error:
            reason = f"it did not start, or was not ready within {BROWSER_TIMEOUT:g} s"
            raise ViewerError(f"{browser} cannot draw the page: {reason}") from error
        notes = re.findall(r"twin_gait: ([^\"\n]*)", log.read_text(encoding="utf-8", errors="replace"))
        content = drawn.read_bytes() if drawn.is_file() else b""
    if _READY not in notes:
        reason = notes[-1] if notes else "it did not finish the page"
        raise ViewerError(f"{browser} cannot draw the page: {reason}")
    if content[16:24] != struct.pack(">II", width, height):  # size in the header of the PNG
        raise ViewerError(f"{browser} wrote no picture of {width}x{height} pixels")
    write_atomically(path, content)
