"""The process of the live loop, as its parent holds it and as it is: ``python -m twin_gait.live.process``.

It reads one JSON object per line from its standard input, first the set-up, then commands, and writes frames
and answers likewise. The end of the input is the end of the process: however the parent dies, the loop stops,
writes its run folder and is gone. Nothing that it is sent is ever executed or unpickled.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.files import dump
from twin_gait.live.journal import Journals, complete_all
from twin_gait.live.loop import MOST_TRACES, LiveLoop
from twin_gait.live.protocol import MessageRefused
from twin_gait.live.realtime import undisturbed
from twin_gait.live.stepping import SteppedRun
from twin_gait.simulation.problem import build_problem

ANSWER_TIME = 60.0  # [s]; answers come within a block, unless the machine has stopped working
END_TIME = 300.0  # [s]; time to write the run folder of the longest session
FRAME = '{"kind":"frame"'  # how the line of a frame begins

Answer = Mapping[str, Any]


class LoopProcess:
    """Starts ``python -m`` a module of this package, talks with it and ends it.

    Who wants to know what it says by itself overrides the methods that hear it, in the thread that reads.
    """

    def __init__(self, module: str = "process") -> None:
        """Prepare it. ``module``: the loop, or the one that looks ahead."""
        self._module = f"{__package__}.{module}"
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None
        self._pending: dict[int, Future[Answer]] = {}
        self._serial = 0
        self._lock = threading.Lock()

    def start(self, setup: Mapping[str, Any]) -> None:
        """Start the process."""
        # -P: what lies in the present folder is not ours to import.
        command = [sys.executable, "-P", "-m", self._module]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self._send(setup)
        self._thread = threading.Thread(target=self._read, name="live reader", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int | None:
        """Number of the process, or None before the start."""
        return None if self._process is None else self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process is there, and how it ended has not been told yet."""
        return self._thread is not None and self._thread.is_alive()

    def close(self) -> None:
        """Tell the process to end and wait until it has written its folders."""
        process = self._process
        if process is None:
            return
        with contextlib.suppress(OSError, ValueError):
            self._send({"command": "end"})
        try:
            process.wait(END_TIME)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if self._thread is not None:
            self._thread.join()
        with contextlib.suppress(OSError, ValueError), process:  # the reader of what is left has gone
            pass

    # ------------------------------------------------------------------ what it says by itself

    def note_frame(self, line: str) -> None:
        """Take a frame, as JSON."""

    def hear(self, message: Mapping[str, Any]) -> None:
        """Take a message that is neither a frame nor an answer."""

    def note_end(self, status: int) -> None:
        """Take the exit status of the process, which is gone; negative: killed by that signal."""

    # ------------------------------------------------------------------ commands

    def command(self, command: Mapping[str, Any]) -> Future[Answer]:
        """Send a command; its answer is on the way.

        Raises ParameterError if the process is gone, or has not been started.
        """
        if self._process is None:
            raise ParameterError("the walk has not begun yet")
        with self._lock:
            self._serial += 1
            serial = self._serial
            coming = self._pending[serial] = Future()
        try:
            self._send({**command, "serial": serial})
        except (OSError, ValueError) as error:
            self._pending.pop(serial, None)
            raise ParameterError("the walk has ended") from error
        return coming

    def ask(self, command: Mapping[str, Any]) -> Answer:
        """Send a command and wait for the answer, with the errors of :meth:`answer`."""
        return self.answer(self.command(command))

    def answer(self, coming: Future[Answer]) -> Answer:
        """Wait for the answer to a command.

        Raises ParameterError if the process is gone. Raises MessageRefused if it refuses the command.
        """
        try:
            answer = coming.result(ANSWER_TIME)
        except TimeoutError:
            raise ParameterError(f"the walk has not answered for {ANSWER_TIME:g} s") from None
        if answer["refused"]:
            raise MessageRefused(answer["refused"])
        return answer

    def _send(self, data: Mapping[str, Any]) -> None:
        assert self._process is not None and self._process.stdin is not None  # start() opened them
        with self._lock:
            self._process.stdin.write(dump(data) + "\n")
            self._process.stdin.flush()

    def _read(self) -> None:
        assert self._process is not None and self._process.stdout is not None  # start() opened them
        for line in self._process.stdout:
            if line.startswith(FRAME):
                self.note_frame(line.rstrip("\n"))
                continue
            message = json.loads(line)
            if message["kind"] != "answer":
                self.hear(message)
            elif (coming := self._pending.pop(message["serial"], None)) is not None:
                coming.set_result(message)
        self.note_end(self._process.wait())
        for coming in list(self._pending.values()):
            coming.set_exception(ParameterError("the walk has ended"))
        self._pending.clear()


def begin(*ignored: signal.Signals) -> tuple[Any, IO[str]]:
    """Begin as such a process: what it is set up with, None if nobody wants it, and where it answers.

    ``ignored``: signals that a terminal sends to the parent too, which ends the process in order.
    """
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else is printed must not run into the messages
    return json.loads(sys.stdin.readline() or "null"), output


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
        run=run,
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
        loop.walk()
    journals.close()
    complete_all(journals.paths, sender.send, pictures=not inbox.orphaned)


if __name__ == "__main__":
    sys.exit(main())
