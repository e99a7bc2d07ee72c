"""Events of a live session: numbered, kept for pages that come late, and recorded."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

from twin_gait.live.protocol import Event, Response
from twin_gait.live.session_records import SessionRecorder

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
            event = Event(
                serial=self.serial,
                response=response,
                text=text,
                tick=self.tick if tick is None else tick,
                **rest,
            )
            self._events.append(event)
        if self.recorder is not None:
            self.recorder.event(event)
        return event

    def after(self, serial: int) -> list[Event]:
        """Events since one of them; 0 gives all that are kept."""
        with self._lock:
            return [item for item in self._events if item.serial > serial]
