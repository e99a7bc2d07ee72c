"""Pictures of a run drawn by a process of its own, beside all else that a command does.

It is started before anything else, so that both processes import their modules at the same time. Not a
thread, because drawing holds the interpreter's lock.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from functools import partial
from importlib import import_module
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING

from twin_gait.report.failures import reason_of

if TYPE_CHECKING:
    from twin_gait.simulation.run import Run

LARGEST_LOG = 2**28  # [bytes] that are handed over; the process holds it twice while it comes


@contextlib.contextmanager
def drawing_beside(*, wanted: bool = True) -> Iterator[Executor | None]:
    """Start a process that can draw; None where none is wanted, and on a machine with one processor.

    It is killed if the command fails, so that nobody waits for its imports after a mistake in an argument.
    """
    if not wanted or (os.cpu_count() or 1) == 1:
        yield None
        return
    # A few figures are little to keep, and much to look through for cycles again and again.
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=gc.disable) as pool:
        # Ctrl-C reaches every process of a terminal, and only this one knows what to do about it.
        heeded = signal.signal(signal.SIGINT, signal.SIG_IGN)
        before = active_children()
        pool.submit(import_module, "twin_gait.report.figures")
        signal.signal(signal.SIGINT, heeded)
        try:
            yield pool
        except BaseException:
            for process in set(active_children()).difference(before):
                process.kill()
            raise


def draw(run: Run, folder: Path) -> dict[str, str]:
    """Draw the first figures of a run into a folder.

    Returns the reason of each picture that could not be drawn, by name; that of all of them under
    ``figures``.
    """
    try:
        from twin_gait.report.figures import first_figures, write_figures

        return write_figures(run, folder, first_figures(run))
    except Exception as error:  # matplotlib cannot be imported, for example
        return {folder.name: reason_of(error)}


def begin_drawing(run: Run, folder: Path, beside: Executor | None) -> Callable[[], dict[str, str]]:
    """Begin to draw the pictures of a run; the result waits for them and returns what :func:`draw` does."""
    here = partial(draw, run, folder)
    if beside is None or run.log.memory_usage().sum() > LARGEST_LOG:
        return here
    try:
        drawing = beside.submit(draw, run, folder)
    except BrokenExecutor:
        return here

    def finish() -> dict[str, str]:
        try:
            return drawing.result()
        except BrokenExecutor:  # the system has ended the process
            return here()

    return finish
