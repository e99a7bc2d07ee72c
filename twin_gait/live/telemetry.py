"""Events of a live session, and the parent's interface to the process of its walk."""

import base64
import contextlib
import json
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.files import dump
from twin_gait.gait.table import TICK
from twin_gait.live.protocol import Event, Message, MessageRejected, Response, SetControl, SetControls
from twin_gait.live.session_records import SessionRecorder
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.simulation_setup import SimulationSetup

MOST_EVENTS = 1_000  # number of events that are stored for pages that are opened later
MOST_BLOCKS = 800  # number of blocks that are stored for pages: eight seconds, as much as a page shows
END_TIME = 30.0  # [s], timeout of the process for closing its journal
HANG_TIMEOUT = 0.5  # [s], time without a message after which the process counts as hung

Answer = Mapping[str, Any]


class EventLog:
    """Events of one session; its methods may be called from any thread.

    Attributes:
        serial: Number of the last event.
        tick: Last known tick of the walk.
        recorder: Record of the session, or None.
    """

    def __init__(self) -> None:
        """Begin without events."""
        self.serial = self.tick = 0
        self.recorder: SessionRecorder | None = None
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._lock = threading.Lock()

    def emit(self, response: Response, text: str, *, tick: int | None = None, **rest: Any) -> None:
        """Add an event. ``tick`` of the event; None is the last known tick."""
        with self._lock:
            self.serial += 1
            at = self.tick if tick is None else tick
            event = Event(serial=self.serial, response=response, text=text, tick=at, **rest)
            self._events.append(event)
        if self.recorder is not None:
            self.recorder.event(event)
            if failure := self.recorder.failure:
                self.recorder = None
                self.emit("note", f"the session is no longer recorded: {failure}")

    def answer(self, message: Message, response: Response, text: str, **rest: Any) -> None:
        """Add an event with the result of a message."""
        if isinstance(message, SetControls):
            subject = next(iter(message.changes)) if len(message.changes) == 1 else ""
        else:
            subject = message.control if isinstance(message, SetControl) else message.action
        about = {"id": message.id, "user": message.user, "subject": subject}
        self.emit(response, text, **(about | rest))

    def after(self, serial: int) -> list[Event]:
        """Return the stored events after one of them; 0 returns all."""
        with self._lock:
            return [item for item in self._events if item.serial > serial]


class Block(NamedTuple):
    """Consecutive ticks of the walk."""

    first: int  # first tick
    end: int  # tick after the last one
    columns: Mapping[str, np.ndarray]  # columns of the log by name, one row per tick; phases are names
    tripped: str  # board at which the monitor tripped, such as ``left_knee``; empty for none


_ENDINGS = ("held", "fell", "diverged")


class WalkProcess:
    """Process of the walk, and the state of its walks; one thread reads it, any thread may use it."""

    def __init__(
        self,
        event_log: EventLog,
        simulation_setup: SimulationSetup,
        *,
        on_compile: Callable[[], None],
        on_store_failure: Callable[[str], None],
    ) -> None:
        """Prepare the interface, without starting the process.

        ``on_compile`` as in :class:`~twin_gait.live.session.LiveSession`; ``on_store_failure``: called once
        if the process can no longer write its journal, with the reason.
        """
        # Newest telemetry of the walk.
        self.frame: Mapping[str, Any] = {"status": "starting", "tick": 0, "deadlines": {}, "events": []}
        self.exit_reason = ""  # description of the death of the process, or empty
        self.on_block: Callable[[Block], None] = lambda block: None  # receives the walk, block by block
        self.store_failure = ""  # reason why the walk is no longer stored, or empty
        self._event_log, self._on_compile, self._on_store_failure = event_log, on_compile, on_store_failure
        self._layout, self._phases = (
            log_layout(simulation_setup),
            np.array(simulation_setup.table.phase_names),
        )
        self._own_phases = np.array(simulation_setup.own_phase_names)
        self._blocks: deque[Block] = deque(maxlen=MOST_BLOCKS)
        self.process: subprocess.Popen[str] | None = None  # None before the start
        self._thread = threading.Thread(target=self._read, name="live reader", daemon=True)
        self._last_message = self._last_look = time.monotonic()
        self._hung_since: float | None = None  # time of the last message before a silence that was noted
        self._answers: SimpleQueue[Answer] = SimpleQueue()
        self._lock = threading.Lock()  # one command at a time

    def start(self, setup: Mapping[str, Any]) -> None:
        """Start the process and wait until it walks; raise MessageRejected if it cannot."""
        # -P: modules in the present folder must not be imported.
        command = [sys.executable, "-P", "-m", "twin_gait.live.process"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self._thread.start()
        self.send_command(setup)

    @property
    def status(self) -> str:
        """Status of the walk."""
        return str(self.frame["status"])

    @property
    def alive(self) -> bool:
        """Whether the process runs, or its end has not been processed yet."""
        return self._thread.is_alive()

    def time_since_message(self) -> float:
        """Return the time in [s] since the last message of the process; call it at least every ``SILENCE``.

        The loop of the process sends a message at least every 0.1 s in every state of the walk. An event is
        added when it hangs, and when it sends again. A late call adds none, because this program itself was
        suspended then, and messages may be waiting to be read.
        """
        now = time.monotonic()
        silent, late, self._last_look = now - self._last_message, now - self._last_look > HANG_TIMEOUT, now
        if late:
            return silent
        if self._hung_since is None and silent > HANG_TIMEOUT and self.alive:
            self._hung_since = self._last_message
            text = f"the process of the simulation has sent nothing for {HANG_TIMEOUT:g} s; it may hang"
            self._event_log.emit("note", text)
        elif self._hung_since is not None and silent <= HANG_TIMEOUT:
            hung, self._hung_since = self._last_message - self._hung_since, None
            self._event_log.emit("note", f"the process of the simulation sends again, after {hung:.1f} s")
        return silent

    def close(self) -> None:
        """End the process and wait until it has exited."""
        if self.process is None:
            return
        assert self.process.stdin is not None and self.process.stdout is not None  # start() opened them
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_TIME)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._thread.join()
        self.process.stdout.close()

    def send_command(self, command: Mapping[str, Any]) -> Answer:
        """Send a command and wait for its answer, which is sent within a block.

        Raises ParameterError if the process has ended or has not been started. Raises MessageRejected if it
        rejects the command.
        """
        if self.process is None or self.process.stdin is None:
            raise ParameterError("the walk has not started yet")
        with self._lock:
            try:
                self.process.stdin.write(dump(command) + "\n")
                self.process.stdin.flush()
            except (OSError, ValueError) as error:
                raise ParameterError("the walk has ended") from error
            answer = self._answers.get()
        if answer["refused"]:
            raise MessageRejected(answer["refused"])
        return answer

    # ------------------------------------------------------------------ messages of the process

    def _read(self) -> None:
        assert self.process is not None and self.process.stdout is not None  # start() opened them
        for line in self.process.stdout:
            self._last_message = time.monotonic()
            self._receive(json.loads(line))
        self._note_end(self.process.wait())
        self._answers.put({"refused": "the walk has ended"})  # for a caller that waits for an answer

    def _receive(self, message: Mapping[str, Any]) -> None:
        match message["kind"]:
            case "answer":
                self._answers.put(message)
            case "telemetry":
                self._store_telemetry(message)
            case "compiling":
                self._on_compile()
            case "not_stored":
                self.store_failure = message["text"]
                self._on_store_failure(self.store_failure)

    def _store_telemetry(self, telemetry: Mapping[str, Any]) -> None:
        """Store rows and state of the walk for the pages, and emit a note if the walk has ended."""
        names = self._layout.names
        rows = np.frombuffer(base64.b64decode(telemetry["rows"])).reshape(-1, len(names))
        if len(rows):
            columns = dict(zip(names, rows.T, strict=True))
            for name in (name for name in names if name.endswith("_phase")):
                phases = self._own_phases if name.endswith("_own_phase") else self._phases
                columns[name] = phases[columns[name].astype(int)]
            if telemetry["first"] == 0:
                self._blocks.clear()  # a new walk
            block = Block(telemetry["first"], telemetry["tick"], columns, telemetry["tripped"])
            self._blocks.append(block)
            self.on_block(block)
        before, self._event_log.tick = self.status, max(telemetry["tick"] - 1, 0)
        self.frame = {**telemetry, "tick": self._event_log.tick}
        if self.status != before and self.status in _ENDINGS:
            texts = [event["text"] for event in telemetry["events"]]
            self._event_log.emit("note", "; ".join([*texts, f"{self.status}: restart to walk"]))

    def _note_end(self, status: int) -> None:
        """Process the exit status of the process; a negative one is the signal that killed it."""
        if status != 0:
            cause = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
            end = self._event_log.tick * TICK
            self.exit_reason = f"the process of the walk ended unexpectedly at {end:.1f} s ({cause})"
            self.frame = {**self.frame, "status": "died"}
            self._event_log.emit("note", f"{self.exit_reason}; the walk was saved up to its last second")

    def blocks(self) -> list[Block]:
        """Return the blocks since the last call in their order, at most those of the last eight seconds."""
        return [self._blocks.popleft() for _ in range(len(self._blocks))]
