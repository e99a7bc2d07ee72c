"""The process of the live loop: ``python -m twin_gait.live.process``.

It reads one JSON object per line from its standard input, first the set-up, then commands, and writes frames
and answers likewise. The end of the input is the end of the process: however the parent dies, the loop stops,
writes its run folder and is gone. Nothing that it is sent is ever executed or unpickled.
"""

import contextlib
import json
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import TwinGaitError
from twin_gait.live.finishing import complete_all
from twin_gait.live.handle import begin
from twin_gait.live.journal import Journals
from twin_gait.live.loop import MOST_TRACES, LiveLoop
from twin_gait.live.protocol import dump
from twin_gait.live.realtime import undisturbed
from twin_gait.live.stepping import SteppedRun
from twin_gait.simulation.problem import build_problem


class Sender:
    """Writes messages in a thread of its own: the loop never waits for a pipe.

    All messages are kept in order, but for frames, of which only the newest is, and traces and rows, of which
    those of some seconds are.
    """

    def __init__(self, stream: IO[str]) -> None:
        """Begin with nothing to write."""
        self._stream, self._called = stream, False
        self._messages: deque[Mapping[str, Any]] = deque()
        self._passing = {
            kind: deque[Mapping[str, Any]](maxlen=most)
            for kind, most in (("trace", MOST_TRACES), ("rows", MOST_TRACES), ("frame", 1))
        }
        self._thread = ThreadPoolExecutor(1, "sender")

    def send(self, message: Mapping[str, Any]) -> None:
        """Take a message; returns at once."""
        self._passing.get(message["kind"], self._messages).append(message)
        if not self._called:
            self._called = True
            self._thread.submit(self._write).add_done_callback(Future.result)  # prints what is not expected

    def close(self) -> None:
        """Write what is left, as far as anybody reads it."""
        self._thread.shutdown()

    def _write(self) -> None:
        self._called = False
        with contextlib.suppress(OSError, ValueError):  # the reader has gone
            for messages in (self._messages, *self._passing.values()):
                while messages:
                    self._stream.write(dump(messages.popleft()) + "\n")
            self._stream.flush()


class Inbox:
    """Commands as they come in; the end of the input is a command to end."""

    def __init__(self, stream: IO[str]) -> None:
        """Start the thread that reads."""
        self.commands: deque[Mapping[str, Any]] = deque()
        self.orphaned = False
        threading.Thread(target=self._read, args=(stream,), name="inbox", daemon=True).start()

    def end(self, *signal: object) -> None:
        """Put a command to end in."""
        self.commands.append({"command": "end"})

    def _read(self, stream: IO[str]) -> None:
        for line in stream:
            self.commands.append(json.loads(line))
        self.orphaned = True
        self.end()


def main() -> int:
    """Read the set-up, walk, write the run folder.

    Returns exit status: 0, or 2 if the set-up cannot be used.
    """
    setup, output = begin(signal.SIGINT, signal.SIGHUP)
    if setup is None:
        return 0
    sender = Sender(output)
    try:
        _walk(setup, sender)
    except TwinGaitError as error:
        sender.send({"kind": "failed", "text": " ".join(str(error).split())})
        return 2
    finally:
        sender.close()
    return 0


def _walk(setup: Mapping[str, Any], sender: Sender) -> None:
    experiment = experiment_from_mapping(setup["document"], "experiment", Path())
    problem = build_problem(experiment)
    run = SteppedRun(problem, on_compile=lambda: sender.send({"kind": "compiling"}))
    inbox = Inbox(sys.stdin)
    signal.signal(signal.SIGTERM, inbox.end)
    journals = Journals(run.layout.names, setup, sender.send)
    loop = LiveLoop(
        run,
        now=time.monotonic,
        sleep=time.sleep,
        commands=lambda: inbox.commands.popleft() if inbox.commands else None,
        send=sender.send,
        keep=journals.keep,
        longest=experiment.n_ticks,
        paused=True,  # until the session is ready for it
        tells_rows=bool(setup.get("can")),
    )
    sender.send({"kind": "ready"})
    with undisturbed():
        loop.run()
    journals.close()
    complete_all(journals.paths, sender.send, pictures=not inbox.orphaned)


if __name__ == "__main__":
    sys.exit(main())
