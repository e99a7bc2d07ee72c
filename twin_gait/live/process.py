"""The process of the live loop: ``python -m twin_gait.live.process``.

It reads one JSON object per line from its standard input, commands of which the first is the set-up, and
writes news and answers likewise. The end of the input is the end of the process: however the parent dies, the
loop stops, closes its journal and is gone. Nothing that it is sent is ever executed or unpickled.
"""

import contextlib
import gc
import json
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import TwinGaitError
from twin_gait.files import dump
from twin_gait.live.journal import Journal
from twin_gait.live.loop import LiveLoop
from twin_gait.live.protocol import one_line
from twin_gait.live.stepping import SteppedRun
from twin_gait.simulation.problem import build_problem

SWITCH_INTERVAL = 1e-3  # [s], after which a thread must let another one go on
REAL_TIME_PRIORITY = 1  # the lowest real-time one is above all that is not real time


class Sender:
    """Writes messages in a thread of its own: the loop never waits for a pipe."""

    def __init__(self, stream: IO[str]) -> None:
        """Begin with nothing to write."""
        self._stream = stream
        self._thread = ThreadPoolExecutor(1, "sender")

    def send(self, message: Mapping[str, Any]) -> None:
        """Take a message; returns at once."""
        self._thread.submit(self._write, message).add_done_callback(
            Future.result
        )  # prints what is unexpected

    def close(self) -> None:
        """Write what is left, as far as anybody reads it."""
        self._thread.shutdown()

    def _write(self, message: Mapping[str, Any]) -> None:
        with contextlib.suppress(OSError, ValueError):  # the reader has gone
            self._stream.write(dump(message) + "\n")
            self._stream.flush()


def commands_from(stream: IO[str]) -> Callable[[], Mapping[str, Any] | None]:
    """Read commands in a thread; the end of the input, and SIGTERM, are commands to end.

    Returns a function that gives the next command that has come, or None.
    """
    waiting, end = deque[Mapping[str, Any]](), {"command": "end"}

    def read() -> None:
        for line in stream:
            waiting.append(json.loads(line))
        waiting.append(end)

    signal.signal(signal.SIGTERM, lambda *_: waiting.append(end))
    threading.Thread(target=read, name="inbox", daemon=True).start()
    return lambda: waiting.popleft() if waiting else None


def main() -> None:
    """Read the set-up and walk; the answer to the set-up says that the walk can begin, or why it cannot."""
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal sends them to the parent too, which ends us
        signal.signal(number, signal.SIG_IGN)
    sender = Sender(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)  # whatever else is printed must not run into the messages
    try:
        setup = json.loads(sys.stdin.readline())
        answer = {"kind": "answer", "refused": ""}
        try:
            loop, journal = _laid_out(setup, sender)
        except TwinGaitError as error:
            sender.send({**answer, "refused": one_line(error)})
            return
        sender.send(answer)
        go_before_others()
        loop.walk()
        journal.close()
    finally:
        sender.close()


def _laid_out(setup: Mapping[str, Any], sender: Sender) -> tuple[LiveLoop, Journal]:
    experiment = experiment_from_mapping(setup["document"], "experiment", Path())
    run = SteppedRun(build_problem(experiment), on_compile=lambda: sender.send({"kind": "compiling"}))
    journal = Journal(run.layout.names, setup, lambda text: sender.send({"kind": "unkept", "text": text}))
    loop = LiveLoop(
        run=run,
        now=time.monotonic,
        sleep=time.sleep,
        commands=commands_from(sys.stdin),
        send=sender.send,
        keep=journal.keep,
        longest=experiment.n_ticks,
    )
    return loop, journal


def go_before_others() -> None:
    """Keep garbage collection, other threads and other processes out of the way of this one."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.disable()
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # not for every user: see ulimit -r
            for thread in threading.enumerate():
                priority = os.sched_param(REAL_TIME_PRIORITY)
                os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, priority)


if __name__ == "__main__":
    main()
