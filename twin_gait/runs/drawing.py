"""Pictures of a run drawn by processes of their own, beside all else that a command does.

They are started before there is a run, so that matplotlib is imported while the run is simulated.
Spawned, not forked, for the reasons in :mod:`twin_gait.studies.processes`; and not a thread, because drawing
holds the interpreter's lock.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.simulation.run import Run

LARGEST_LOG = 2**28  # [bytes] that are handed over; each process holds it twice while it comes
MOST_HANDS = 3
_PATIENCE = 5.0  # [s] until a process that is to end is ended


class Draughtsman:
    """Draws the pictures of one run: in processes of its own, or here where that is not worth while."""

    def __init__(self, lines: Sequence[Connection] = ()) -> None:
        """Draw at the other ends of some lines, or here."""
        self._lines = lines
        self._given: tuple[Run, Path] | None = None
        self._sending: list[threading.Thread] = []

    def begin(self, run: Run, folder: Path) -> None:
        """Have the pictures of a run drawn into a folder; :meth:`finish` waits for them."""
        self._given = run, folder
        if not self._lines or run.log.memory_usage().sum() > LARGEST_LOG:
            self._lines = ()
            return
        packed = bytes(ForkingPickler.dumps(self._given))
        # In threads, because a process that is still importing does not take it yet.
        self._sending = [threading.Thread(target=_send, args=(line, packed)) for line in self._lines]
        for thread in self._sending:
            thread.start()

    def finish(self) -> None:
        """Wait until the pictures are there; draw here what the processes could not."""
        if self._given is None:
            return
        for thread in self._sending:
            thread.join()
        hands = max(1, len(self._lines))
        done = [_receive(line) for line in self._lines] or [False]
        for hand in (hand for hand in range(hands) if not done[hand]):
            from twin_gait.report.figures import write_figures

            # Here an error reaches whoever asked for the pictures.
            write_figures(*self._given, share=slice(hand, None, hands))
        self._given = None


def _send(line: Connection, packed: bytes) -> None:
    with contextlib.suppress(OSError):  # the process is gone; it can be done without
        line.send_bytes(packed)


def _receive(line: Connection) -> bool:
    try:
        return bool(line.recv())
    except (EOFError, OSError):
        return False


@contextlib.contextmanager
def draughtsman(*, beside: bool = True) -> Iterator[Draughtsman]:
    """Somebody who draws.

    Args:
        beside: Whether processes of its own may do it; none is started on a machine with one processor.
    """
    processors = _processors() if beside else 1
    # Two on two processors as well: one starts up while the other waits for the run.
    hands = min(MOST_HANDS, max(2, processors - 1)) if processors > 1 else 0
    lines, processes = [], []
    context = get_context("spawn")
    # A process inherits what is blocked while it is started: Ctrl-C reaches every process of a terminal, and
    # only this one knows what to do about it.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        for hand in range(hands):
            ours, theirs = context.Pipe()
            process = context.Process(target=_draw, args=(theirs, slice(hand, None, hands)), daemon=True)
            process.start()
            theirs.close()
            lines.append(ours)
            processes.append(process)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield Draughtsman(lines)
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(_PATIENCE)
        for line in lines:
            line.close()


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _draw(line: Connection, share: slice) -> None:
    """Draw some pictures of the run that comes; say True when they are there, False if they are not."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # a few figures are little to keep, and much to look through again and again
    from twin_gait.report.figures import warm_up, write_figures

    warm_up()
    with contextlib.suppress(EOFError, OSError):  # nobody waits for them any more
        run, folder = line.recv()
        try:
            write_figures(run, folder, share=share)
            line.send(True)
        except Exception:  # drawn again where the error has a reader
            line.send(False)
