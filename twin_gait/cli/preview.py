"""What a run will come to, from the reference engine, while the compiled one is being compiled."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from twin_gait.cli.terminal import clear_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from twin_gait.experiment import Experiment


@contextlib.contextmanager
def preview(experiment: Experiment) -> Iterator[Callable[[], None]]:
    """Give what starts a run on the reference engine in another process; its result is told when it is there.

    That engine needs no compiling and agrees with the compiled one to rounding: it walks 20 s in some 6 s,
    and compiling takes 10 to 20 s. It ends with the context, told or not; nothing happens in a pipe or on
    one processor, which compiling needs for itself.
    """
    with contextlib.ExitStack() as started:

        def start() -> None:
            if sys.stderr.isatty() and (os.cpu_count() or 1) > 1:
                started.enter_context(_process(experiment))

        yield start


@contextlib.contextmanager
def _process(experiment: Experiment) -> Iterator[None]:
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(theirs, experiment), daemon=True)
    # It inherits what is blocked: Ctrl-C reaches every process of a terminal, and is not for this one.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    told = threading.Thread(target=_tell, args=(ours,), daemon=True)
    told.start()
    try:
        yield
    finally:
        process.terminate()
        process.join()
        told.join()
        ours.close()


def _run(line: Connection, experiment: Experiment) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Whatever is wrong with a run is said by the run itself.
    with contextlib.suppress(Exception):
        line.send(preview_lines(experiment))


def preview_lines(experiment: Experiment) -> list[str]:
    """How a run ends on the reference engine, and the figures that a reader wants first."""
    from twin_gait.cli.simulate import summary_lines
    from twin_gait.experiment import Engine
    from twin_gait.runs.summary import summarise
    from twin_gait.simulation import simulate

    run = simulate(replace(experiment, engine=Engine.PINOCCHIO))
    word = run.verdict.outcome or run.status
    return [
        f"meanwhile, by the reference engine: {word}, {run.duration:g} s in {run.wall_s:.1f} s",
        *(f"  {line}" for line in summary_lines(summarise(run))),
    ]


def _tell(line: Connection) -> None:
    try:
        lines = line.recv()
    except (EOFError, OSError):  # ended before it was there
        return
    clear_line()
    print("\n".join(lines), file=sys.stderr, flush=True)
