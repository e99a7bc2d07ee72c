"""What befell a run: faults that struck, the trip of the safety monitor, a fall, a divergence."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple, Protocol


class EventKind(StrEnum):
    """What happened."""

    FAULT = "fault"
    TRIP = "trip"
    FALL = "fall"
    DIVERGENCE = "divergence"


class RunEvent(NamedTuple):
    """One event.

    Attributes:
        kind: What happened.
        time: When, in [s]; of a fall or a divergence the last moment of the log.
        cause: Kind of the fault or cause of the trip in words; empty for the other two.
        place: Where in words, such as ``left knee``; empty where there is none.
    """

    kind: EventKind
    time: float
    cause: str = ""
    place: str = ""

    @property
    def text(self) -> str:
        """In words: ``trip: encoder frozen, left knee``."""
        details = ", ".join(part for part in (self.cause, self.place) if part)
        return f"{self.kind}: {details}" if details else str(self.kind)


class _Fault(Protocol):
    """What is read of a :class:`twin_gait.scenario.Fault`."""

    @property
    def kind(self) -> str: ...
    @property
    def time(self) -> float: ...
    @property
    def place(self) -> str: ...


class _Trip(Protocol):
    """What is read of a :class:`twin_gait.control.Trip`."""

    @property
    def cause(self) -> str: ...
    @property
    def time(self) -> float: ...
    @property
    def place(self) -> str: ...


# By the status of a run; the others end without an event.
_ENDINGS = {"fell": EventKind.FALL, "diverged": EventKind.DIVERGENCE}


def run_events(faults: Iterable[_Fault], trip: _Trip | None, status: str, end: float) -> tuple[RunEvent, ...]:
    """The events of a run in the order of time; of those at the same time the cause stands first.

    Args:
        faults: Of the experiment; those after the end did not strike.
        trip: What the safety monitor tripped on, or None.
        status: How the run ended.
        end: Last moment of the log in [s].

    Returns:
        The events.
    """
    found = [
        RunEvent(EventKind.FAULT, item.time, _words(item.kind), _words(item.place))
        for item in faults
        if item.time <= end
    ]
    if trip is not None:
        found.append(RunEvent(EventKind.TRIP, trip.time, _words(trip.cause), trip.place))
    if status in _ENDINGS:
        found.append(RunEvent(_ENDINGS[status], end))
    return tuple(sorted(found, key=lambda event: event.time))


def held_from(events: Iterable[RunEvent]) -> float | None:
    """From when on the phases of a run no longer say what the legs do.

    Args:
        events: Of the run.

    Returns:
        Time of the trip in [s]; None without one.
    """
    return next((event.time for event in events if event.kind is EventKind.TRIP), None)


def _words(name: str) -> str:
    return str(name).replace("_", " ")
