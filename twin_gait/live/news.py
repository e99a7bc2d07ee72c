"""Events of a live session, and what its process says: frames, traces, run folders, and how it ended."""

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from twin_gait.files import dump
from twin_gait.gait.table import TICK
from twin_gait.live.loop import MOST_TRACES
from twin_gait.live.process import LoopProcess
from twin_gait.live.protocol import Event, Message, Response
from twin_gait.live.session_records import SessionRecorder
from twin_gait.runs.folders import journal_of
from twin_gait.viewer.live_figure import Trace

MOST_EVENTS = 10_000  # that are kept for pages that come late


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
        self._lock = threading.RLock()

    def emit(self, response: Response, text: str, *, tick: int | None = None, **rest: Any) -> Event:
        """Add an event. ``tick`` of the event, if it is not the last that is known."""
        with self._lock:
            self.serial += 1
            at = self.tick if tick is None else tick
            event = Event(serial=self.serial, response=response, text=text, tick=at, **rest)
            self._events.append(event)
        if self.recorder is not None:
            self.recorder.event(event)
        return event

    def answer(self, message: Message, response: Response, text: str, **rest: Any) -> None:
        """Add an event that tells what became of a message."""
        self.emit(
            response, text, **{"id": message.id, "user": message.user, "subject": message.subject, **rest}
        )

    def after(self, serial: int) -> list[Event]:
        """Events since one of them; 0 gives all that are kept."""
        with self._lock:
            return [item for item in self._events if item.serial > serial]


_ENDINGS = {
    "held": "the legs are held; start again to walk",
    "fell": "the wearer fell; start again to walk",
    "diverged": "the simulation diverged; start again to walk",
}


class WalkNews(LoopProcess):
    """The process of the walk and what is known of its walks; told by the thread that reads, asked by any."""

    def __init__(
        self, book: EventBook, *, on_compile: Callable[[], None], on_step: Callable[[str], None]
    ) -> None:
        """Begin with no news; the arguments are those of :class:`~twin_gait.live.session.LiveSession`."""
        super().__init__()
        self.ready = threading.Event()  # set when the process walks, or has said why it cannot
        self.frame, self.status = "", "starting"  # the newest one as JSON; what the walk does
        self.walks, self.folders = list[Path](), list[Path]()  # run folders to come, and written
        self.summary: dict[str, Any] = {}  # of the last walk; empty before the end
        self.failure = self.death = ""  # why the process could not walk or write; how it died
        self._book, self._on_compile, self._on_step = book, on_compile, on_step
        # Takes the rows of the log for a bus, block by block.
        self.on_rows: Callable[[Mapping[str, Any]], None] = lambda block: None
        self._traces: deque[Trace] = deque(maxlen=MOST_TRACES)

    def traces(self) -> list[Trace]:
        """What the curves did since the last call, in order; of a long time the last eight seconds."""
        return [self._traces.popleft() for _ in range(len(self._traces))]

    def note_frame(self, line: str) -> None:
        """Notice by the head of a frame what the walk does by itself; the rest is for the pages."""
        self.frame = line
        head = json.loads(line.partition(',"q":')[0] + "}")
        self._book.tick, status = head["tick"], head["status"]
        if status != self.status:
            before, self.status = self.status, status
            if status in _ENDINGS and before not in ("starting", "ended"):
                told = "; ".join([*(event["text"] for event in json.loads(line)["events"]), _ENDINGS[status]])
                self._book.emit(Response.NOTE, told)
        recorder = self._book.recorder
        if recorder is not None and recorder.failure:
            self._book.recorder = None
            self._book.emit(Response.NOTE, f"the session is no longer recorded: {recorder.failure}")

    def hear(self, message: Mapping[str, Any]) -> None:
        """Take a message that is neither a frame nor an answer."""
        match message["kind"]:
            case "compiling":
                self._on_compile()
            case "ready":
                self.ready.set()
            case "failed":
                self.failure = message["text"]
                self.ready.set()
            case "journal":
                self.walks.append(Path(message["folder"]))
                self.record_folders()
            case "unkept":
                self._book.emit(Response.NOTE, f"the walk is no longer kept: {message['text']}")
            case "writing":
                self._on_step(message["step"])
            case "folder":
                self._note_folder(message)
            case "trace":
                self._traces.append(message)
            case "rows":
                self.on_rows(message)

    def _note_folder(self, message: Mapping[str, Any]) -> None:
        if message["failed"]:
            self.failure = message["failed"]
            self._book.emit(Response.NOTE, f"the run folder could not be written: {self.failure}")
            return
        self.folders.append(Path(message["folder"]))
        self.summary = dict(message["summary"])
        self._book.emit(Response.NOTE, f"the run is in {message['folder']}")
        self.record_folders()

    def record_folders(self) -> None:
        """Record where the runs are, and where those to come will be: somebody may have to complete them."""
        if self._book.recorder is not None:
            written = [str(item) for item in self.folders]
            coming = [str(item) for item in self.walks if journal_of(item).exists()]
            self._book.recorder.folders([*written, *(item for item in coming if item not in written)])

    def note_end(self, status: int) -> None:
        """Take the exit status of the process, which is gone."""
        if not self.ready.is_set():
            self.failure = self.failure or "the process of the walk has ended unexpectedly"
            self.ready.set()
        elif status != 0:
            how = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
            self.death = f"the process of the walk died at {self._book.tick * TICK:.1f} s ({how})"
            self.status = "died"
            self._book.emit(Response.NOTE, f"{self.death}; the walk is kept up to its last second")
            if self.frame:  # the last frame tells the pages too
                self.frame = dump({**json.loads(self.frame), "status": self.status})
