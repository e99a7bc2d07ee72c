"""Events of a live session, and the process of its walk as its parent holds it."""

import contextlib
import json
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from twin_gait.exceptions import ParameterError
from twin_gait.files import dump
from twin_gait.gait.table import TICK
from twin_gait.live.process import MOST_TRACES
from twin_gait.live.protocol import Event, Message, MessageRefused, Response, SetControl
from twin_gait.live.session_records import SessionRecorder
from twin_gait.viewer.live_figure import Trace

MOST_EVENTS = 1_000  # that are kept for pages that come late
ANSWER_TIME = 60.0  # [s]; answers come within a block, unless the machine has stopped working
END_TIME = 30.0  # [s] in which the process closes its journal

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
        subject = message.control if isinstance(message, SetControl) else message.action
        about = {"id": message.id, "user": message.user, "subject": subject}
        self.emit(response, text, **(about | rest))

    def after(self, serial: int) -> list[Event]:
        """Events since one of them; 0 gives all that are kept."""
        with self._lock:
            return [item for item in self._events if item.serial > serial]


_ENDINGS = ("held", "fell", "diverged")


class WalkNews:
    """The process of the walk and what is known of its walks; told by the thread that reads, asked by any."""

    def __init__(self, book: EventBook, *, on_compile: Callable[[], None]) -> None:
        """Prepare it. ``on_compile`` as in :class:`~twin_gait.live.session.LiveSession`."""
        self.ready = threading.Event()  # set when the process walks, or has said why it cannot
        self.frame: Mapping[str, Any] = {}  # the newest one; empty before the first
        self.status = "starting"  # what the walk does
        self.failure = self.death = ""  # why the process could not walk; how it died
        # Takes the rows of the log for a bus, block by block.
        self.on_rows: Callable[[Mapping[str, Any]], None] = lambda block: None
        self._book, self._on_compile = book, on_compile
        self._traces: deque[Trace] = deque(maxlen=MOST_TRACES)
        self.process: subprocess.Popen[str] | None = None  # None before the start
        self._thread = threading.Thread(target=self._read, name="live reader", daemon=True)
        self._pending: dict[int, Future[Answer]] = {}
        self._serial = 0
        self._lock = threading.Lock()

    def start(self, setup: Mapping[str, Any]) -> None:
        """Start the process."""
        # -P: what lies in the present folder is not ours to import.
        command = [sys.executable, "-P", "-m", "twin_gait.live.process"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self._send(setup)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the process is there, and how it ended has not been told yet."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End the process and wait until it is gone."""
        if self.process is None:
            return
        assert self.process.stdin is not None and self.process.stdout is not None  # start() opened them
        with self._lock, contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_TIME)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._thread.join()
        self.process.stdout.close()

    # ------------------------------------------------------------------ commands

    def command(self, command: Mapping[str, Any]) -> Future[Answer]:
        """Send a command; its answer is on the way.

        Raises ParameterError if the process is gone, or has not been started.
        """
        if self.process is None:
            raise ParameterError("the walk has not begun yet")
        with self._lock:
            self._serial += 1
            coming = self._pending[self._serial] = Future()
            try:
                self._send({**command, "serial": self._serial})
            except (OSError, ValueError) as error:
                self._pending.pop(self._serial, None)
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
        assert self.process is not None and self.process.stdin is not None  # start() opened them
        self.process.stdin.write(dump(data) + "\n")
        self.process.stdin.flush()

    # ------------------------------------------------------------------ what it says

    def _read(self) -> None:
        assert self.process is not None and self.process.stdout is not None  # start() opened them
        for line in self.process.stdout:
            self._hear(json.loads(line))
        self._note_end(self.process.wait())
        for coming in list(self._pending.values()):
            coming.set_exception(ParameterError("the walk has ended"))
        self._pending.clear()

    def _hear(self, message: Mapping[str, Any]) -> None:
        match message["kind"]:
            case "answer":
                if (coming := self._pending.pop(message["serial"], None)) is not None:
                    coming.set_result(message)
            case "frame":
                self._note_frame(message)
            case "trace":
                self._traces.append(message)
            case "rows":
                self.on_rows(message)
            case "compiling":
                self._on_compile()
            case "ready":
                self.ready.set()
            case "failed":
                self.failure = message["text"]
                self.ready.set()
            case "unkept":
                self._book.emit("note", f"the walk is no longer kept: {message['text']}")

    def _note_frame(self, frame: Mapping[str, Any]) -> None:
        """Tell what the walk does by itself; the rest is for the pages."""
        before, self.frame = self.status, frame
        self._book.tick, self.status = frame["tick"], frame["status"]
        if self.status != before and self.status in _ENDINGS and before not in ("starting", "ended"):
            told = [event["text"] for event in frame["events"]]
            self._book.emit("note", "; ".join([*told, f"{self.status}: start again to walk"]))

    def _note_end(self, status: int) -> None:
        """Take the exit status of the process, which is gone; negative: killed by that signal."""
        if not self.ready.is_set():
            self.failure = "the process of the walk has ended unexpectedly"
            self.ready.set()
        elif status != 0:
            how = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
            self.death = f"the process of the walk died at {self._book.tick * TICK:.1f} s ({how})"
            self.status = "died"
            self._book.emit("note", f"{self.death}; the walk is kept up to its last second")
            if self.frame:  # the last frame tells the pages too
                self.frame = {**self.frame, "status": self.status}

    def traces(self) -> list[Trace]:
        """What the curves did since the last call, in order; of a long time the last eight seconds."""
        return [self._traces.popleft() for _ in range(len(self._traces))]
