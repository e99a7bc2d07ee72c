"""Events of a live session, and the process of its walk as its parent holds it."""

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
from twin_gait.live.protocol import Event, Message, MessageRefused, Response, SetControl, SetControls
from twin_gait.live.session_records import SessionRecorder
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.problem import Problem

MOST_EVENTS = 1_000  # that are kept for pages that come late
MOST_BLOCKS = 800  # that are kept for pages: eight seconds, which is what a page remembers
END_TIME = 30.0  # [s] in which the process closes its journal
SILENCE = 0.5  # [s] without a message of the process after which it counts as hung

Answer = Mapping[str, Any]


class EventBook:
    """The events of one session; its methods may be called from any thread.

    Attributes:
        serial: Number of the last event.
        tick: Last tick that is known of the walk.
        recorder: Record of the session, or None if there is none.
    """

    def __init__(self) -> None:
        """Begin with no events."""
        self.serial = self.tick = 0
        self.recorder: SessionRecorder | None = None
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._lock = threading.Lock()

    def emit(self, response: Response, text: str, *, tick: int | None = None, **rest: Any) -> None:
        """Add an event. ``tick`` of the event, if it is not the last that is known."""
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
        """Add an event that tells what became of a message."""
        if isinstance(message, SetControls):
            subject = next(iter(message.changes)) if len(message.changes) == 1 else ""
        else:
            subject = message.control if isinstance(message, SetControl) else message.action
        about = {"id": message.id, "user": message.user, "subject": subject}
        self.emit(response, text, **(about | rest))

    def after(self, serial: int) -> list[Event]:
        """Events since one of them; 0 gives all that are kept."""
        with self._lock:
            return [item for item in self._events if item.serial > serial]


class Block(NamedTuple):
    """Some ticks of the walk."""

    first: int  # of them
    end: int  # the one after the last
    columns: Mapping[str, np.ndarray]  # of the log by name, one row per tick; phases are names
    tripped: str  # board that the monitor tripped on, such as ``left_knee``; empty for none


_ENDINGS = ("held", "fell", "diverged")


class WalkNews:
    """The process of the walk and what is known of its walks; told by the thread that reads, asked by any."""

    def __init__(
        self,
        book: EventBook,
        problem: Problem,
        *,
        on_compile: Callable[[], None],
        on_unkept: Callable[[str], None],
    ) -> None:
        """Prepare it.

        ``on_compile`` as in :class:`~twin_gait.live.session.LiveSession`; ``on_unkept``: called once if the
        process can no longer write its journal, with the reason.
        """
        # The newest news.
        self.frame: Mapping[str, Any] = {"status": "starting", "tick": 0, "deadlines": {}, "events": []}
        self.death = ""  # how the process died
        self.on_block: Callable[[Block], None] = lambda block: None  # takes the walk, block by block
        self.unkept = ""  # why the walk is no longer kept
        self._book, self._on_compile, self._on_unkept = book, on_compile, on_unkept
        self._layout, self._phases = log_layout(problem), np.array(problem.table.phase_names)
        self._blocks: deque[Block] = deque(maxlen=MOST_BLOCKS)
        self.process: subprocess.Popen[str] | None = None  # None before the start
        self._thread = threading.Thread(target=self._read, name="live reader", daemon=True)
        self._last_message = self._last_look = time.monotonic()
        self._hung_since: float | None = None  # time of the last message before a silence that was noted
        self._answers: SimpleQueue[Answer] = SimpleQueue()
        self._lock = threading.Lock()  # one asks at a time

    def start(self, setup: Mapping[str, Any]) -> None:
        """Start the process and wait until it walks; MessageRefused if it cannot."""
        # -P: what lies in the present folder is not ours to import.
        command = [sys.executable, "-P", "-m", "twin_gait.live.process"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self._thread.start()
        self.ask(setup)

    @property
    def status(self) -> str:
        """What the walk does."""
        return str(self.frame["status"])

    @property
    def alive(self) -> bool:
        """Whether the process is there, and how it ended has not been told yet."""
        return self._thread.is_alive()

    def silence(self) -> float:
        """Return the time in [s] since the last message of the process; call it at least every ``SILENCE``.

        The loop of the process sends one at least every 0.1 s, whatever the walk does. An event notes when it
        has hung, and when it sends again. None is added by a call that comes late: then this program itself
        stood still, and messages may wait to be read.
        """
        now = time.monotonic()
        silent, late, self._last_look = now - self._last_message, now - self._last_look > SILENCE, now
        if late:
            return silent
        if self._hung_since is None and silent > SILENCE and self.alive:
            self._hung_since = self._last_message
            text = f"the process of the simulation has sent nothing for {SILENCE:g} s; it may hang"
            self._book.emit("note", text)
        elif self._hung_since is not None and silent <= SILENCE:
            hung, self._hung_since = self._last_message - self._hung_since, None
            self._book.emit("note", f"the process of the simulation sends again, after {hung:.1f} s")
        return silent

    def close(self) -> None:
        """End the process and wait until it is gone."""
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

    def ask(self, command: Mapping[str, Any]) -> Answer:
        """Send a command and wait for the answer, which comes within a block.

        Raises ParameterError if the process is gone, or has not been started. Raises MessageRefused if it
        refuses the command.
        """
        if self.process is None or self.process.stdin is None:
            raise ParameterError("the walk has not begun yet")
        with self._lock:
            try:
                self.process.stdin.write(dump(command) + "\n")
                self.process.stdin.flush()
            except (OSError, ValueError) as error:
                raise ParameterError("the walk has ended") from error
            answer = self._answers.get()
        if answer["refused"]:
            raise MessageRefused(answer["refused"])
        return answer

    # ------------------------------------------------------------------ what it says

    def _read(self) -> None:
        assert self.process is not None and self.process.stdout is not None  # start() opened them
        for line in self.process.stdout:
            self._last_message = time.monotonic()
            self._hear(json.loads(line))
        self._note_end(self.process.wait())
        self._answers.put({"refused": "the walk has ended"})  # for who waits for one

    def _hear(self, message: Mapping[str, Any]) -> None:
        match message["kind"]:
            case "answer":
                self._answers.put(message)
            case "news":
                self._note_news(message)
            case "compiling":
                self._on_compile()
            case "unkept":
                self.unkept = message["text"]
                self._on_unkept(self.unkept)

    def _note_news(self, news: Mapping[str, Any]) -> None:
        """Keep the rows, and tell what the walk does by itself; the rest is for the pages."""
        names = self._layout.names
        rows = np.frombuffer(base64.b64decode(news["rows"])).reshape(-1, len(names))
        if len(rows):
            columns = dict(zip(names, rows.T, strict=True))
            for name in (name for name in names if name.endswith("_phase")):
                columns[name] = self._phases[columns[name].astype(int)]
            if news["first"] == 0:
                self._blocks.clear()  # a new walk
            block = Block(news["first"], news["tick"], columns, news["tripped"])
            self._blocks.append(block)
            self.on_block(block)
        before, self._book.tick = self.status, max(news["tick"] - 1, 0)
        self.frame = {**news, "tick": self._book.tick}
        if self.status != before and self.status in _ENDINGS:
            told = [event["text"] for event in news["events"]]
            self._book.emit("note", "; ".join([*told, f"{self.status}: start again to walk"]))

    def _note_end(self, status: int) -> None:
        """Take the exit status of the process, which is gone; negative: killed by that signal."""
        if status != 0:
            how = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
            self.death = f"the process of the walk died at {self._book.tick * TICK:.1f} s ({how})"
            self.frame = {**self.frame, "status": "died"}
            self._book.emit("note", f"{self.death}; the walk is kept up to its last second")

    def blocks(self) -> list[Block]:
        """The walk since the last call, in order; of a long time the last eight seconds."""
        return [self._blocks.popleft() for _ in range(len(self._blocks))]
