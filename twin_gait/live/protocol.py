"""What a page says to the simulation and what it hears back, as plain values.

Everything that comes from a page is JSON text and becomes one of three messages, or a refusal; nothing else
is ever read from the network. Everything that goes to a page is a mapping with a ``kind``:

* ``state``: the panel: all controls and actions with ranges, units and present values;
* ``frame``: one moment of the walk, some thirty times a second; the newest is the one that counts;
* ``beat``: the heartbeat, ten times a second, also while no frame comes;
* ``event``: what became of a message, or what the simulation did by itself; none of them is dropped.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from twin_gait.configuration.validation import Strict, short, validate
from twin_gait.exceptions import ParameterFileError, TwinGaitError
from twin_gait.files import plain

LARGEST_MESSAGE = 4096  # characters; the longest sensible message has some 300
LONGEST_NAME = 64  # characters of an id, a user, a control
LONGEST_TEXT = 200  # characters of any other text
LONGEST_REASON = 400  # characters of an error that is sent to a page; the longest of the check has some 350


class MessageRefused(TwinGaitError, ValueError):
    """A message of a page cannot be understood, or asks for something that is not allowed."""


def one_line(error: Exception) -> str:
    """Return the text of an error on one line of at most ``LONGEST_REASON`` characters."""
    text = " ".join(str(error).split())
    return text if len(text) <= LONGEST_REASON else f"{text[: LONGEST_REASON - 1]}…"


class RateLimit:
    """Token bucket: limits how often something is done, and counts the times beyond the limit."""

    def __init__(self, rate: float, burst: int) -> None:
        """Start with a full bucket. ``rate``: times per second; ``burst``: times at once."""
        self.dropped = 0  # times beyond the limit since the last one within it
        self._rate, self._burst = rate, burst
        self._left, self._last = float(burst), -math.inf

    def allows(self, now: float) -> bool:
        """Return whether one more time is within the limit. ``now``: present time in [s]."""
        self._left = min(self._burst, self._left + self._rate * (now - self._last))
        self._last = now
        if self._left < 1.0:
            self.dropped += 1
            return False
        self._left -= 1.0
        return True


ControlKind = Literal["number", "choice", "switch", "text"]  # how a control is drawn
Response = Literal["applied", "refused", "note", "forecast"]  # what an event tells
Value = float | str | bool


def _text(value: Any, longest: int = LONGEST_NAME, least: int = 0) -> str:
    if isinstance(value, str) and least <= len(value) <= longest and value.isprintable():
        return value
    raise ValueError(f"expected a text of {least} to {longest} printable characters, got {short(value)}")


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return _text(value, LONGEST_TEXT)
    if isinstance(value, int | float) and abs(value) < 1e300:
        return value if isinstance(value, bool) else float(value)
    raise ValueError(f"expected a number, a short text or true or false, got {short(value)}")


Name = Annotated[str, BeforeValidator(partial(_text, least=1))]
User = Annotated[str, BeforeValidator(_text)]
Said = Annotated[Value, BeforeValidator(_value)]


def user_name(name: str) -> str:
    """Return the name of a user if a message could have it; MessageRefused otherwise."""
    try:
        return _text(name)
    except ValueError as error:
        raise MessageRefused(f"user: {error}") from None


class SetControl(Strict):
    """A page sets a control."""

    kind: Literal["set", "try"] = "set"  # ``try`` if only a forecast is wanted
    id: Name  # by which the page recognises the answer
    user: User = ""  # who
    control: Name  # name of the control
    value: Said  # in the unit of the control


class SetControls(Strict):
    """A page sets several controls in one tick, or none of them."""

    kind: Literal["set", "try"] = "set"  # ``try`` if only a forecast is wanted
    id: Name  # by which the page recognises the answer
    user: User = ""  # who
    # values by control, in the units of the controls; null sets a control back to the preset
    changes: Mapping[Name, Said | None]


class DoAction(Strict):
    """A page asks for an action."""

    kind: Literal["do"] = "do"  # there is no other
    id: Name  # by which the page recognises the answer
    user: User = ""  # who
    action: Name  # what to do, of those of the state
    # of the fields of the action; those left out take their defaults
    values: Mapping[Name, Said] = {}


Message = SetControl | SetControls | DoAction


def read_message(text: str | bytes) -> Message:
    """Read a message of a page.

    ``text``: JSON of :class:`SetControl`, :class:`SetControls` or :class:`DoAction`. Raises MessageRefused if
    it is anything else; the text says why.
    """
    if len(text) > LARGEST_MESSAGE:
        raise MessageRefused(f"message: {len(text)} characters, at most {LARGEST_MESSAGE} are read")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageRefused("message: expected JSON") from None
    schema: type[Message] = SetControl
    if isinstance(data, dict):
        several = SetControls if "changes" in data else SetControl
        schema = DoAction if data.get("kind") == "do" else several
    try:
        return validate(schema, data, "message")
    except ParameterFileError as error:
        raise MessageRefused(one_line(error)) from None


@dataclass(frozen=True, kw_only=True)
class Control:
    """A control, or a field of an action, with all that is needed to draw it."""

    name: str  # by which it is set, such as ``late_stance.hip.stiffness``
    kind: ControlKind  # how it is drawn
    label: str = ""  # what a page writes beside it, if not the name
    group: str = ""  # tab of the panel: ``walk``, ``table``, ``monitor``; of no field of an action
    value: Value = 0.0  # present value; for a field of an action the one that it begins with
    default: Value = 0.0  # value of the preset
    unit: str = ""  # of the value; empty for a pure number or a word
    least: float | None = None  # least number allowed
    largest: float | None = None  # largest number allowed
    step: float | None = None  # from one number to the next
    choices: tuple[str, ...] = ()  # words of a choice
    # words that fit, by the word of another field of the action, which ``choices_by`` names
    choices_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    choices_by: str = ""  # that field, such as ``kind``; empty if all words always fit
    phase: str | None = None  # phase of gait of a table's control
    joint: str | None = None  # joint of a control that has one
    side: str | None = None  # leg of a control that has one
    help: str = ""  # one sentence
    changed: bool = False  # whether it has been set


@dataclass(frozen=True)
class ActionSpec:
    """An action with its fields."""

    action: str  # its name
    group: str  # tab of the panel
    label: str  # what the button says
    help: str  # one sentence
    fields: tuple[Control, ...] = ()  # what goes with it


class ToPage:
    """What a page is told: a dataclass, as JSON a mapping with the name of its class as ``kind``."""

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON takes them; numbers that are not finite become null."""
        fields: Any = self
        return dict(plain({"kind": type(self).__name__.lower(), **asdict(fields)}))


@dataclass
class DeadlineStatistics:
    """How well the blocks kept to the clock."""

    blocks: int = 0  # that were due
    late: int = 0  # of them, finished more than 10 ms after their time, or never
    worst_ms: float = 0.0  # largest lateness in [ms]
    lost_s: float = 0.0  # time in [s] that the simulation has given up after stalls


@dataclass(frozen=True, kw_only=True)
class Frame(ToPage):
    """One moment of the walk."""

    tick: int  # of the last row of the log
    time_s: float  # of that tick
    # ``walking``, ``paused``, ``waiting`` (for a step by hand), ``held`` (after a stop or a trip), ``fell``,
    # ``diverged``, ``ended`` or ``died`` (the process, not the wearer)
    status: str
    phases: Mapping[str, str | None]  # of gait, by leg; null in a hold and before the first tick
    mode: str | None  # operating mode; null in a walk without modes
    deadlines: DeadlineStatistics  # how well the blocks kept to the clock
    events: tuple[Mapping[str, Any], ...] = ()  # what befell the walk: kind, time in [s] and words each


@dataclass(frozen=True, kw_only=True)
class Beat(ToPage):
    """The heartbeat: how long ago the process of the simulation sent something."""

    silence_s: float  # time in [s] since the last message of that process, sent at least every 0.1 s


@dataclass(frozen=True, kw_only=True)
class Event(ToPage):
    """What became of a message, or what the simulation did by itself."""

    serial: int  # number of the event, from 1 on
    response: Response  # applied, refused, a note of the simulation, or the forecast of a change that waits
    text: str  # one sentence; of a refusal the reason
    tick: int  # first tick with the change; of a refusal the last one known
    id: str = ""  # of the message, or empty
    user: str = ""  # who, or empty
    subject: str = ""  # control or action that it is about, or empty
    value: Value | None = None  # that was asked for
    before: Value | None = None  # value that the control had
    forecast: Mapping[str, Any] | None = None  # of a change that waits, see Forecast; else None


@dataclass(frozen=True, kw_only=True)
class State(ToPage):
    """The panel."""

    experiment: str  # name of the preset or file
    phases: tuple[str, ...]  # of the gait table, in order
    joints: tuple[str, ...]  # of a leg, in order
    controls: tuple[Control, ...]  # all controls
    actions: tuple[ActionSpec, ...]  # all actions


def checked(control: Control, value: Value) -> Value:
    """A value if the control can take it.

    Raises MessageRefused if it is of the wrong kind or out of range.
    """
    if control.kind == "switch":
        fits, wanted = isinstance(value, bool), "true or false"
    elif control.kind == "choice":
        fits, wanted = value in control.choices, " or ".join(map(repr, control.choices))
    elif control.kind == "text":
        fits, wanted = isinstance(value, str), "a text"
    else:
        assert control.least is not None and control.largest is not None  # numbers have ranges
        fits = isinstance(value, float) and control.least <= value <= control.largest
        wanted = f"{control.least:.6g} to {control.largest:.6g} {control.unit}".rstrip()
    if not fits:
        shown = f"{value:.6g}" if isinstance(value, float) else short(value)
        raise MessageRefused(f"{control.name}: expected {wanted}, got {shown}")
    return value
