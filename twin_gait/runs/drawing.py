"""Pictures of a run drawn by processes of their own, beside all else that a command does.

They are started before there is a run, so that matplotlib is imported while the run is simulated. Not
threads, because drawing holds the interpreter's lock.
"""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.simulation.run import Run

MOST_PROCESSES = 2  # a third would wait for the page
LARGEST_LOG = 2**28  # [bytes] that are handed over; each process holds it twice while it comes


class DrawingProcesses:
    """Draws the pictures of one run: by processes of its own, or here where it has none."""

    def __init__(self, processes: Sequence[subprocess.Popen[bytes]] = ()) -> None:
        """Draw by processes that wait for a run at their standard input."""
        self._processes = processes
        self._waiting: list[threading.Thread] = []

    def begin(self, run: Run, folder: Path) -> None:
        """Have the pictures of a run drawn into a folder; :meth:`finish` waits for them."""
        self._run, self._folder = run, folder
        if run.log.memory_usage().sum() > LARGEST_LOG:
            return
        packed = pickle.dumps((run, folder)) if self._processes else b""
        # In threads, because a process that is still importing does not take it yet.
        self._waiting = [
            threading.Thread(target=process.communicate, args=(packed,)) for process in self._processes
        ]
        for thread in self._waiting:
            thread.start()

    def finish(self) -> None:
        """Wait until the pictures are there; draw here what the processes could not."""
        for thread in self._waiting:
            thread.join()
        shares = max(1, len(self._waiting))
        for place in range(shares):
            if not self._waiting or self._processes[place].returncode != 0:
                from twin_gait.report.figures import write_figures

                # Here an error reaches whoever asked for the pictures.
                write_figures(self._run, self._folder, share=slice(place, None, shares))


@contextlib.contextmanager
def drawing_processes(*, wanted: bool = True) -> Iterator[DrawingProcesses]:
    """Somebody who draws beside this process; no process is started on a machine with one processor."""
    processes: list[subprocess.Popen[bytes]] = []
    shares = min(MOST_PROCESSES, (os.cpu_count() or 1) - 1) if wanted else 0
    try:
        for place in range(shares):
            # Modules are found where this process finds them. In a session of its own, because Ctrl-C reaches
            # every process of a terminal, and only this one knows what to do about it.
            work = f"from {__name__} import _draw; _draw({place}, {shares})"
            processes.append(
                subprocess.Popen(
                    [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {work}"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            )
        yield DrawingProcesses(processes)
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def _draw(place: int, shares: int) -> None:
    """Draw one share of the pictures of the run that comes; the exit status says whether they are there."""
    gc.disable()  # a few figures are little to keep, and much to look through again and again
    from twin_gait.report.figures import write_figures

    run, folder = pickle.load(sys.stdin.buffer)
    write_figures(run, folder, share=slice(place, None, shares))
