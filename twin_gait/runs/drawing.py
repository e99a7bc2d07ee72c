"""Pictures of a run drawn by a process of its own, beside all else that a command does.

It is started before there is a run, so that matplotlib is imported while the run is simulated. Not a thread,
because drawing holds the interpreter's lock.
"""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.simulation.run import Run

LARGEST_LOG = 2**28  # [bytes] that are handed over; the process holds it twice while it comes


class Drawing:
    """Draws the pictures of one run: by a process of its own, or here without one."""

    def __init__(self, process: subprocess.Popen[bytes] | None = None) -> None:
        """Draw by a process that waits for a run at its standard input."""
        self._process = process
        self._waiting: threading.Thread | None = None

    def begin(self, run: Run, folder: Path) -> None:
        """Have the pictures of a run drawn into a folder; :meth:`finish` waits for them."""
        self._run, self._folder = run, folder
        if self._process is None or run.log.memory_usage().sum() > LARGEST_LOG:
            return
        # In a thread, because a process that is still importing does not take it yet.
        packed = pickle.dumps((run, folder))
        self._waiting = threading.Thread(target=self._process.communicate, args=(packed,))
        self._waiting.start()

    def finish(self) -> None:
        """Wait until the pictures are there; draw here what the process could not."""
        if self._process is not None and self._waiting is not None:
            self._waiting.join()
            if self._process.returncode == 0:
                return
        from twin_gait.report.figures import write_figures

        write_figures(self._run, self._folder)  # here an error reaches whoever asked for the pictures


@contextlib.contextmanager
def drawing_beside(*, wanted: bool = True) -> Iterator[Drawing]:
    """Somebody who draws beside this process; no process is started on a machine with one processor."""
    process = None
    if wanted and (os.cpu_count() or 1) > 1:
        # Modules are found where this process finds them. In a session of its own, because Ctrl-C reaches
        # every process of a terminal, and only this one knows what to do about it.
        work = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import _draw; _draw()"
        process = subprocess.Popen(
            [sys.executable, "-c", work],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    try:
        yield Drawing(process)
    finally:
        if process is not None:
            process.kill()
            process.communicate()


def _draw() -> None:
    """Draw the pictures of the run that comes; the exit status says whether they are there."""
    gc.disable()  # a few figures are little to keep, and much to look through again and again
    from twin_gait.report.figures import write_figures

    write_figures(*pickle.load(sys.stdin.buffer))
