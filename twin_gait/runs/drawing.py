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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.simulation.run import Run

LARGEST_LOG = 2**28  # [bytes] that are handed over; the process holds it twice while it comes
# Has the pictures of a run drawn into a folder; what it gives back waits until they are there.
Draw = Callable[["Run", Path], Callable[[], None]]


def draw_here(run: Run, folder: Path) -> Callable[[], None]:
    """Draw in this process, when the pictures are waited for; an error reaches whoever waits."""

    def draw() -> None:
        from twin_gait.report.figures import write_figures

        write_figures(run, folder)

    return draw


@contextlib.contextmanager
def drawing_beside(*, wanted: bool = True) -> Iterator[Draw]:
    """What draws beside this process, and here what the process could not.

    No process is started where none is wanted, nor on a machine with one processor.
    """
    if not wanted or (os.cpu_count() or 1) == 1:
        yield draw_here
        return
    # Modules are found where this process finds them. In a session of its own, because Ctrl-C reaches every
    # process of a terminal, and only this one knows what to do about it.
    work = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import _draw; _draw()"
    process = subprocess.Popen(
        [sys.executable, "-c", work], start_new_session=True,
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip

    def draw(run: Run, folder: Path) -> Callable[[], None]:
        here = draw_here(run, folder)
        if run.log.memory_usage().sum() > LARGEST_LOG:
            return here
        # In a thread, because a process that is still importing does not take it yet.
        handing = threading.Thread(target=process.communicate, args=(pickle.dumps((run, folder)),))
        handing.start()

        def finish() -> None:
            handing.join()
            if process.returncode != 0:
                here()

        return finish

    try:
        yield draw
    finally:
        process.kill()
        process.communicate()


def _draw() -> None:
    """Draw the pictures of the run that comes; the exit status says whether they are there."""
    gc.disable()  # a few figures are little to keep, and much to look through again and again
    from twin_gait.report.figures import write_figures

    write_figures(*pickle.load(sys.stdin.buffer))
