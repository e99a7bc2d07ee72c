"""Messages between a page and the simulation, as plain values.

A message from a page is JSON text, which is parsed to one of three types or rejected; nothing else is ever
read from the network. A message to a page is a mapping with a ``kind``:

* ``state``: the panel: all controls and actions with ranges, units and present values;
* ``frame``: state of the walk at one time, about thirty times a second; a newer frame replaces an older one;
* ``heartbeat``: time since the last message of the simulation, ten times a second, also without frames;
* ``event``: result of a message, or an action of the simulation itself; no event is dropped.
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
from twin_gait.files import to_json_value

LARGEST_MESSAGE = 4096  # characters of a message; the longest reasonable one has about 300
LONGEST_NAME = 64  # characters of an id, a user, a control
LONGEST_TEXT = 200  # characters of any other text
LONGEST_REASON = 400  # characters of an error that is sent to a page; the longest of the check has about 350


class MessageRejected(TwinGaitError, ValueError):
    """Error: a message of a page is invalid, or requests something that is not allowed."""


def one_line(error: Exception) -> str:
    """Return the text of an error on one line of at most ``LONGEST_REASON`` characters."""
    text = " ".join(str(error).split())
    return text if len(text) <= LONGEST_REASON else f"{text[: LONGEST_REASON - 1]}…"


class RateLimiter:
    """Token bucket: it limits the rate of an operation, and counts the operations beyond the limit."""

    def __init__(self, rate: float, burst: int) -> None:
        """Start with a full bucket; ``rate``: operations per second; ``burst``: operations at once."""
        self.dropped = 0  # number of operations beyond the limit since the last one within it
        self._rate, self._burst = rate, burst
        self._left, self._last = float(burst), -math.inf

    def allows(self, now: float) -> bool:
        """Return whether one more operation is within the limit; ``now``: present time in [s]."""
        self._left = min(self._burst, self._left + self._rate * (now - self._last))
        self._last = now
        if self._left < 1.0:
            self.dropped += 1
            return False
        self._left -= 1.0
        return True


ControlKind = Literal["number", "choice", "switch", "text"]  # types of input for a control
Response = Literal["applied", "refused", "note", "forecast"]  # types of an event
Value = float | str | bool


def _text(value: Any, max_length: int = LONGEST_NAME, min_length: int = 0) -> str:
    if isinstance(value, str) and min_length <= len(value) <= max_length and value.isprintable():
        return value
    raise ValueError(
        f"expected a text of {min_length} to {max_length} printable characters, got {short(value)}"
    )


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return _text(value, LONGEST_TEXT)
    if isinstance(value, int | float) and abs(value) < 1e300:
        return value if isinstance(value, bool) else float(value)
    raise ValueError(f"expected a number, a short text or true or false, got {short(value)}")


Name = Annotated[str, BeforeValidator(partial(_text, min_length=1))]
User = Annotated[str, BeforeValidator(_text)]
ReceivedValue = Annotated[Value, BeforeValidator(_value)]


def user_name(name: str) -> str:
    """Return the name of a user if it is valid in a message; raise MessageRejected otherwise."""
    try:
        return _text(name)
    except ValueError as error:
        raise MessageRejected(f"user: {error}") from None


class SetControl(Strict):
    """Message of a page that sets a control."""

    kind: Literal["set", "try"] = "set"  # ``try`` for a forecast only
    id: Name  # id of the message, which its answer repeats
    user: User = ""  # name of the user
    control: Name  # name of the control
    value: ReceivedValue  # new value in the unit of the control


class SetControls(Strict):
    """Message of a page that sets several controls in one tick, or none of them."""

    kind: Literal["set", "try"] = "set"  # ``try`` for a forecast only
    id: Name  # id of the message, which its answer repeats
    user: User = ""  # name of the user
    # new values by control in the units of the controls; null reverts a control to the preset
    changes: Mapping[Name, ReceivedValue | None]


class DoAction(Strict):
    """Message of a page that requests an action."""

    kind: Literal["do"] = "do"  # only value
    id: Name  # id of the message, which its answer repeats
    user: User = ""  # name of the user
    action: Name  # name of an action in the state
    # values of the fields of the action; missing fields have their defaults
    values: Mapping[Name, ReceivedValue] = {}


Message = SetControl | SetControls | DoAction


def read_message(text: str | bytes) -> Message:
    """Parse a message of a page.

    ``text``: JSON of :class:`SetControl`, :class:`SetControls` or :class:`DoAction`. Raises MessageRejected
    with the reason for any other text.
    """
    if len(text) > LARGEST_MESSAGE:
        raise MessageRejected(f"message: expected at most {LARGEST_MESSAGE} characters, got {len(text)}")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageRejected("message: expected JSON") from None
    schema: type[Message] = SetControl
    if isinstance(data, dict):
        several = SetControls if "changes" in data else SetControl
        schema = DoAction if data.get("kind") == "do" else several
    try:
        return validate(schema, data, "message")
    except ParameterFileError as error:
        raise MessageRejected(one_line(error)) from None


@dataclass(frozen=True, kw_only=True)
class Control:
    """A control or a field of an action, with all data that are needed to draw it."""

    name: str  # unique name of the control, such as ``late_stance.hip.stiffness``
    kind: ControlKind  # type of the input
    label: str = ""  # label on the page; empty to use the name
    group: str = ""  # tab of the panel: ``walk``, ``table``, ``monitor``; empty for a field of an action
    value: Value = 0.0  # present value; initial value for a field of an action
    default: Value = 0.0  # value of the preset
    unit: str = ""  # unit of the value; empty for a pure number or a word
    minimum: float | None = None  # smallest allowed number
    maximum: float | None = None  # largest allowed number
    step: float | None = None  # increment of the number
    choices: tuple[str, ...] = ()  # options of a choice
    # options that are valid for each value of another field of the action, which ``depends_on`` names
    choices_by_value: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    depends_on: str = ""  # name of that field, such as ``kind``; empty if all options are always valid
    phase: str | None = None  # phase of gait of a table's control
    joint: str | None = None  # joint of the control, or null
    side: str | None = None  # leg of the control, or null
    help: str = ""  # explanation in one sentence
    changed: bool = False  # whether the control has been set


@dataclass(frozen=True)
class ActionSpec:
    """An action with its fields."""

    action: str  # name of the action
    group: str  # tab of the panel
    label: str  # label of the button
    help: str  # explanation in one sentence
    fields: tuple[Control, ...] = ()  # inputs of the action


class PageMessage:
    """Message to a page: a dataclass, which is in JSON a mapping with the name of its class as ``kind``."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as values for JSON; numbers that are not finite become null."""
        fields: Any = self
        return dict(to_json_value({"kind": type(self).__name__.lower(), **asdict(fields)}))


@dataclass
class DeadlineStatistics:
    """Statistics of the deadlines of the blocks."""

    blocks: int = 0  # number of blocks that were due
    late: int = 0  # number of blocks that were finished more than 10 ms after their time, or never
    worst_ms: float = 0.0  # largest lateness in [ms]
    lost_s: float = 0.0  # time in [s] that the simulation skipped after stalls


@dataclass(frozen=True, kw_only=True)
class Frame(PageMessage):
    """State of the walk at one time."""

    tick: int  # tick of the last row of the log
    time_s: float  # time of that tick in [s]
    # ``walking``, ``paused``, ``waiting`` (for a manual step), ``held`` (after a stop or a trip), ``fell``,
    # ``diverged``, ``ended`` or ``died`` (the process of the simulation)
    status: str
    phases: Mapping[str, str | None]  # phase by leg of the device; null in a hold and before the first tick
    mode: str | None  # mode of operation; null in a walk without modes
    deadlines: DeadlineStatistics  # statistics of the deadlines of the blocks
    events: tuple[Mapping[str, Any], ...] = ()  # faults, trips and falls of the walk: kind, time in [s], text


@dataclass(frozen=True, kw_only=True)
class Heartbeat(PageMessage):
    """Heartbeat with the time since the last message of the process of the simulation."""

    # time in [s] since the last message of that process, which sends at least every 0.1 s
    time_since_message_s: float


@dataclass(frozen=True, kw_only=True)
class Event(PageMessage):
    """Result of a message, or an action of the simulation itself."""

    serial: int  # number of the event, starting at 1
    response: Response  # applied, refused, a note of the simulation, or the forecast of a pending change
    text: str  # one sentence; for a rejection the reason
    tick: int  # first tick with the change; for a rejection the last known tick
    id: str = ""  # id of the message, or empty
    user: str = ""  # name of the user, or empty
    subject: str = ""  # control or action of the message, or empty
    value: Value | None = None  # requested value
    before: Value | None = None  # previous value of the control
    forecast: Mapping[str, Any] | None = None  # forecast of a pending change, see Forecast; otherwise null


@dataclass(frozen=True, kw_only=True)
class State(PageMessage):
    """State of the panel."""

    experiment: str  # name of the preset or file
    phases: tuple[str, ...]  # phases of the gait table in their order
    joints: tuple[str, ...]  # joints of a leg in their order
    controls: tuple[Control, ...]  # all controls
    actions: tuple[ActionSpec, ...]  # all actions


def check_value(control: Control, value: Value) -> Value:
    """Return a value if it is valid for a control.

    Raises MessageRejected if it has the wrong type or is out of range.
    """
    if control.kind == "switch":
        fits, expected = isinstance(value, bool), "true or false"
    elif control.kind == "choice":
        fits, expected = value in control.choices, " or ".join(map(repr, control.choices))
    elif control.kind == "text":
        fits, expected = isinstance(value, str), "a text"
    else:
        assert control.minimum is not None and control.maximum is not None  # numbers have ranges
        fits = isinstance(value, float) and control.minimum <= value <= control.maximum
        expected = f"{control.minimum:.6g} to {control.maximum:.6g} {control.unit}".rstrip()
    if not fits:
        shown = f"{value:.6g}" if isinstance(value, float) else short(value)
        raise MessageRejected(f"{control.name}: expected {expected}, got {shown}")
    return value
