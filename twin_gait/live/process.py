"""Process of the live loop: ``python -m twin_gait.live.process``.

It reads one JSON object per line from its standard input, the set-up and then commands, and writes telemetry
and answers in the same form. The process ends when its input ends: if the parent dies in any way, the loop
stops, closes its journal and exits. Received data are never executed or unpickled.
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

from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.exceptions import TwinGaitError
from twin_gait.files import dump
from twin_gait.live.journal import Journal
from twin_gait.live.loop import LiveLoop
from twin_gait.live.protocol import one_line
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun

SWITCH_INTERVAL = 1e-3  # [s], time after which a thread must yield to another one
REAL_TIME_PRIORITY = 1  # the lowest real-time priority is above all other priorities


def commands_from(stream: IO[str]) -> Callable[[], Mapping[str, Any] | None]:
    """Read commands in a thread; the end of the input and SIGTERM are commands to end.

    Returns a function that returns the next received command, or None.
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
    """Read the set-up and run the walk; a separate thread writes, so that the loop never waits for a pipe."""
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal also sends them to the parent, which ends us
        signal.signal(number, signal.SIG_IGN)
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # other printed text must not be mixed with the messages
    with ThreadPoolExecutor(1, "sender") as sender:

        def send(message: Mapping[str, Any]) -> None:
            # An unexpected error is printed.
            sender.submit(_write, stream, message).add_done_callback(Future.result)

        _walk(json.loads(sys.stdin.readline()), send)


def _write(stream: IO[str], message: Mapping[str, Any]) -> None:
    with contextlib.suppress(OSError, ValueError):  # the reader has ended
        stream.write(dump(message) + "\n")
        stream.flush()


def _walk(setup: Mapping[str, Any], send: Callable[[Mapping[str, Any]], None]) -> None:
    """Run the walk; the answer to the set-up states that the walk can begin, or why it cannot."""
    try:
        experiment = experiment_from_mapping(setup["document"], "experiment", Path())
        run = SteppedRun(build_setup(experiment), on_compile=lambda: send({"kind": "compiling"}))
        journal = Journal(run.layout.names, setup, lambda text: send({"kind": "not_stored", "text": text}))
    except TwinGaitError as error:
        send({"kind": "answer", "refused": one_line(error)})
        return
    commands = commands_from(sys.stdin)
    send({"kind": "answer", "refused": ""})
    raise_priority()
    LiveLoop(
        run=run, now=time.monotonic, sleep=time.sleep, commands=commands, send=send, store_chunk=journal.store
    ).walk()
    journal.close()


def raise_priority() -> None:
    """Prevent interruptions by garbage collection, other threads and other processes."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.disable()
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # not allowed for every user: see ulimit -r
            for thread in threading.enumerate():
                priority = os.sched_param(REAL_TIME_PRIORITY)
                os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, priority)


if __name__ == "__main__":
    main()
