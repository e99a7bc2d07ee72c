"""The process of the live loop: ``python -m twin_gait.studies.live.process``.

It reads one JSON object per line from its standard input, first the set-up, then commands, and writes frames
and answers likewise. The end of the input is the end of the process: however the parent dies, the loop stops,
writes its run folder and is gone. Nothing that it is sent is ever executed or unpickled.
"""

from __future__ import annotations

import contextlib
import csv
import gc
import io
import itertools
import json
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import TwinGaitError
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.simulation.engine import log_layout
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.simulation.run import Run, log_table
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.studies.folders import staged_directory
from twin_gait.studies.live.loop import MOST_TRACES, AppliedChange, LiveLoop, Take
from twin_gait.studies.live.protocol import dump
from twin_gait.studies.record import RUN_DIRECTORY, write_run

CHANGES_FILE = "live_changes.csv"
TABLE_FILE = "live_table.yaml"
CHANGE_COLUMNS = ("tick", "time_s", "user", "subject", "before", "value", "text")
# Drawing takes about a tenth of the walk; nobody waits minutes for the pictures of an hour.
LONGEST_PICTURES = 120.0  # [s]
SWITCH_INTERVAL = 1e-3  # [s], after which a thread of this process must let the loop go on
REAL_TIME_PRIORITY = 1  # the lowest real-time one is above all that is not real time


class Sender:
    """Writes messages in a thread of its own: the loop never waits for a pipe.

    All messages are kept in order, but for frames, of which only the newest is, and traces, of which those of
    some seconds are.
    """

    def __init__(self, stream: IO[str]) -> None:
        """Start the thread."""
        self._stream = stream
        self._messages: deque[Mapping[str, Any]] = deque()
        self._traces: deque[Mapping[str, Any]] = deque(maxlen=MOST_TRACES)
        self._frame: Mapping[str, Any] | None = None
        self._awake, self._closed = threading.Event(), False
        self._thread = threading.Thread(target=self._write, name="sender", daemon=True)
        self._thread.start()

    def send(self, message: Mapping[str, Any]) -> None:
        """Take a message; returns at once."""
        if message["kind"] == "frame":
            self._frame = message
        elif message["kind"] == "trace":
            self._traces.append(message)
        else:
            self._messages.append(message)
        self._awake.set()

    def close(self, timeout: float = 5.0) -> None:
        """Write what is left, as far as anybody reads it."""
        self._closed = True
        self._awake.set()
        self._thread.join(timeout)

    def _write(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # the reader has gone
            while True:
                self._awake.wait()
                self._awake.clear()
                closing = self._closed
                while self._messages:
                    self._stream.write(dump(self._messages.popleft()) + "\n")
                while self._traces:
                    self._stream.write(dump(self._traces.popleft()) + "\n")
                frame, self._frame = self._frame, None
                if frame is not None:
                    self._stream.write(dump(frame) + "\n")
                self._stream.flush()
                if closing:
                    return


class Inbox:
    """Commands as they come in; the end of the input is a command to end."""

    def __init__(self, stream: IO[str]) -> None:
        """Start the thread that reads."""
        self._commands: deque[Mapping[str, Any]] = deque()
        self.orphaned = False
        threading.Thread(target=self._read, args=(stream,), name="inbox", daemon=True).start()

    def next(self) -> Mapping[str, Any] | None:
        """The next command, or None."""
        return self._commands.popleft() if self._commands else None

    def end(self, *signal: object) -> None:
        """Put a command to end in."""
        self._commands.append({"command": "end"})

    def _read(self, stream: IO[str]) -> None:
        for line in stream:
            self._commands.append(json.loads(line))
        self.orphaned = True
        self.end()


class RunFolders:
    """Writes the run folders of all walks of a session after the last one: ``folder``, ``folder-2`` …."""

    def __init__(self, problem: Problem, setup: Mapping[str, Any], sender: Sender, inbox: Inbox) -> None:
        """Keep what all walks have in common."""
        self._problem, self._setup = problem, setup
        self._sender, self._inbox = sender, inbox
        self._takes: list[Take] = []

    def keep(self, take: Take) -> None:
        """Take a walk that is over; writing it would keep the next one waiting."""
        self._takes.append(take)

    def write_all(self) -> None:
        """Write all folders and say where they are."""
        folder = Path(self._setup["folder"])
        for number, take in enumerate(self._takes, start=1):
            self._write_one(number, take, folder)
            folder = self._next_free(number + 1)

    def _next_free(self, number: int) -> Path:
        """Folder of a later walk: the first name that nothing has yet."""
        first = Path(self._setup["folder"])
        names = (first.with_name(f"{first.name}-{count}") for count in itertools.count(number))
        return next(path for path in names if not path.exists())

    def _write_one(self, number: int, take: Take, folder: Path) -> None:
        message: dict[str, Any] = {"kind": "folder", "take": number, "folder": str(folder)}
        try:
            self._sender.send({**message, "summary": self._write(take, folder), "failed": ""})
        except TwinGaitError as error:
            self._sender.send({**message, "summary": {}, "failed": " ".join(str(error).split())})

    def _write(self, take: Take, folder: Path) -> dict[str, Any]:
        run = self._run(take)
        short = run.duration <= LONGEST_PICTURES and not self._inbox.orphaned
        with staged_directory(folder, RUN_DIRECTORY, force=self._setup["force"]) as staging:
            write_atomically(staging / CHANGES_FILE, changes_csv(take.changes))
            if take.table is not None:
                write_atomically(staging / TABLE_FILE, dump_yaml(dict(take.table)))
            document = {**self._setup["document"], "duration_s": run.duration}
            return write_run(
                run, staging, document=document, pictures=short and bool(self._setup["pictures"])
            )

    def _run(self, take: Take) -> Run:
        problem, result = self._problem, take.result
        return Run(
            experiment=replace(problem.experiment, duration=round(len(result.rows) * TICK, 3)),
            table=problem.table,
            log=log_table(result.rows, log_layout(problem), problem.table),
            switches=result.switches,
            status=result.status,
            reason=result.reason,
            wall_s=take.wall_s,
            body_weight=problem.world.body_weight,
            trip=result.trip,
        )


def changes_csv(changes: list[AppliedChange]) -> str:
    """The changes of a walk as CSV.

    Args:
        changes: In order.

    Returns:
        One line per change: its first tick, who, what, and the values before and after.
    """
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, CHANGE_COLUMNS, lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for change in changes:
        writer.writerow({**change.note, "tick": change.tick, "time_s": f"{change.tick * TICK:.3f}"})
    return buffer.getvalue()


def main() -> int:
    """Read the set-up, walk, write the run folder.

    Returns:
        Exit status: 0, or 2 if the set-up cannot be used.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(
            number, signal.SIG_IGN
        )  # a terminal sends them to the parent too, which ends us in order
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else is printed must not run into the messages
    setup = json.loads(sys.stdin.readline() or "null")
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
    folders = RunFolders(problem, setup, sender, inbox)
    loop = LiveLoop(
        run,
        now=time.monotonic,
        sleep=time.sleep,
        commands=inbox.next,
        send=sender.send,
        finish=folders.keep,
        longest=experiment.n_ticks,
        paused=True,  # until the session is ready for it
    )
    sender.send({"kind": "ready"})
    with _undisturbed():
        loop.run()
    folders.write_all()


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Keep garbage collection, other threads and other processes out of the loop's way."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    gc.disable()
    _real_time(True)
    try:
        yield
    finally:
        _real_time(False)
        gc.enable()


def _real_time(wanted: bool) -> None:
    """Let all threads of this process go before those of others, where the system allows it.

    All of them, because the loop waits for the one that holds the interpreter's lock. They sleep most of the
    time; the system keeps a share for the rest in any case.
    """
    if sys.platform != "linux":
        return
    policy, priority = (os.SCHED_RR, REAL_TIME_PRIORITY) if wanted else (os.SCHED_OTHER, 0)
    with contextlib.suppress(OSError):  # not for every user: see ulimit -r
        for thread in threading.enumerate():
            os.sched_setscheduler(thread.native_id or 0, policy, os.sched_param(priority))


if __name__ == "__main__":
    sys.exit(main())
