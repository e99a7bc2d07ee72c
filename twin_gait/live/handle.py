"""A process of a live session: as its parent holds it, with answers, frames and its end, and as it begins."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import IO, Any

from twin_gait.exceptions import ParameterError
from twin_gait.live.protocol import MessageRefused, dump

ANSWER_TIME = 60.0  # [s]; answers come within a block, unless the machine has stopped working
END_TIME = 300.0  # [s]; time to write the run folder of the longest session
FRAME = '{"kind":"frame"'  # how the line of a frame begins

Answer = Mapping[str, Any]


def _nobody(told: Any) -> None:
    """Nobody wants to know."""


class LoopProcess:
    """Starts ``python -m`` a module of this package, talks with it and ends it."""

    def __init__(
        self,
        module: str = "process",
        *,
        on_frame: Callable[[str], None] = _nobody,
        on_message: Callable[[Mapping[str, Any]], None] = _nobody,
        on_end: Callable[[int], None] = _nobody,
    ) -> None:
        """Keep whom to tell; all of them are called from the thread that reads.

        ``module``: the loop, or the one that looks ahead; ``on_end``: called when the process is gone, with
        its exit status; negative: killed by that signal.
        """
        self._module = f"{__package__}.{module}"
        self._on_frame, self._on_message, self._on_end = on_frame, on_message, on_end
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
        for stream in (process.stdin, process.stdout):
            assert stream is not None  # start() opened them
            with contextlib.suppress(OSError, ValueError):  # the reader of what is left has gone
                stream.close()

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
                self._on_frame(line.rstrip("\n"))
                continue
            message = json.loads(line)
            if message["kind"] != "answer":
                self._on_message(message)
            elif (coming := self._pending.pop(message["serial"], None)) is not None:
                coming.set_result(message)
        self._on_end(self._process.wait())
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
