"""The process of the live loop: ``python -m twin_gait.live.process``.

It reads one JSON object per line from its standard input, first the set-up, then commands, and writes frames
and answers likewise. The end of the input is the end of the process: however the parent dies, the loop stops,
closes its journal and is gone. Nothing that it is sent is ever executed or unpickled.
"""

import contextlib
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
from twin_gait.live.realtime import go_before_others
from twin_gait.live.stepping import SteppedRun
from twin_gait.simulation.problem import build_problem

MOST_TRACES = 400  # kept for who does not read: eight seconds, which is what a page remembers


class Sender:
    """Writes messages in a thread of its own: the loop never waits for a pipe.

    All messages are kept in order, but for frames, of which only the newest is, and traces and rows, of which
    those of some seconds are.
    """

    def __init__(self, stream: IO[str]) -> None:
        """Begin with nothing to write."""
        self._stream, self._called = stream, False
        most = {"": None, "trace": MOST_TRACES, "rows": MOST_TRACES, "frame": 1}
        self._waiting = {kind: deque[Mapping[str, Any]](maxlen=length) for kind, length in most.items()}
        self._thread = ThreadPoolExecutor(1, "sender")

    def send(self, message: Mapping[str, Any]) -> None:
        """Take a message; returns at once."""
        self._waiting.get(message["kind"], self._waiting[""]).append(message)
        if not self._called:
            self._called = True
            self._thread.submit(self._write).add_done_callback(Future.result)  # prints what is not expected

    def close(self) -> None:
        """Write what is left, as far as anybody reads it."""
        self._thread.shutdown()

    def _write(self) -> None:
        self._called = False
        with contextlib.suppress(OSError, ValueError):  # the reader has gone
            for messages in self._waiting.values():
                while messages:
                    self._stream.write(dump(messages.popleft()) + "\n")
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


def main() -> int:
    """Read the set-up and walk.

    Returns exit status: 0, or 2 if the set-up cannot be used.
    """
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal sends them to the parent too, which ends us
        signal.signal(number, signal.SIG_IGN)
    sender = Sender(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)  # whatever else is printed must not run into the messages
    try:
        _walk(json.loads(sys.stdin.readline()), sender)
    except TwinGaitError as error:
        sender.send({"kind": "failed", "text": one_line(error)})
        return 2
    finally:
        sender.close()
    return 0


def _walk(setup: Mapping[str, Any], sender: Sender) -> None:
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
        paused=True,  # until the session is ready for it
        tells_rows=setup["can"] is not None,
    )
    sender.send({"kind": "ready"})
    go_before_others()
    loop.walk()
    journal.close()


if __name__ == "__main__":
    sys.exit(main())
