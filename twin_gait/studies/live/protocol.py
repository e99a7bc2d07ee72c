"""What a page says to the simulation and what it hears back, as plain values.

Everything that comes from a page is JSON text and becomes one of two messages here, or a refusal: nothing
else is ever read from the network. Everything that goes to a page is a mapping with a ``kind``:

* ``state``: the panel: all controls and actions with ranges, units and present values;
* ``frame``: one moment of the walk, some thirty times a second; the newest is the one that counts;
* ``event``: what became of a message, or what the simulation did by itself; none of them is dropped.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, TypeGuard

from twin_gait.exceptions import TwinGaitError

PROTOCOL_VERSION = 1
LARGEST_MESSAGE = 4096  # [bytes]; the longest sensible message has some 300
LONGEST_NAME = 64  # characters of an id, a user, a control
LONGEST_TEXT = 200  # characters of any other text
MOST_VALUES = 8  # values of an action


class MessageRefused(TwinGaitError, ValueError):
    """A message of a page cannot be understood, or asks for something that is not allowed."""


class Action(StrEnum):
    """What a page can have done, beside setting a control."""

    WALK = "walk"
    PAUSE = "pause"
    STEP = "step"
    PUSH = "push"
    FAULT = "fault"
    REVERT = "revert"
    RESTART = "restart"
    SAVE = "save"
    STOP = "stop"


class ControlKind(StrEnum):
    """How a control is drawn."""

    NUMBER = "number"
    CHOICE = "choice"
    SWITCH = "switch"
    TEXT = "text"


class Outcome(StrEnum):
    """What an event tells."""

    APPLIED = "applied"
    REFUSED = "refused"
    NOTE = "note"


Value = float | str | bool


# ---------------------------------------------------------------------- from a page


@dataclass(frozen=True, kw_only=True)
class SetControl:
    """A page sets a control.

    Attributes:
        id: By which the page recognises the answer.
        user: Who.
        control: Name of the control.
        value: In the unit of the control.
    """

    id: str
    user: str
    control: str
    value: Value


@dataclass(frozen=True, kw_only=True)
class DoAction:
    """A page asks for an action.

    Attributes:
        id: By which the page recognises the answer.
        user: Who.
        action: What to do.
        values: Of the fields of the action; those left out take their defaults.
    """

    id: str
    user: str
    action: Action
    values: Mapping[str, Value] = field(default_factory=dict)


Message = SetControl | DoAction


def read_message(text: str | bytes) -> Message:
    """Read a message of a page.

    Args:
        text: JSON: ``{"kind": "set", "id", "user", "control", "value"}`` or ``{"kind": "do", "id", "user",
            "action", "values"}``.

    Returns:
        The message.

    Raises:
        MessageRefused: If it is anything else; the text says why.
    """
    size = len(text.encode("utf-8", "replace")) if isinstance(text, str) else len(text)
    if size > LARGEST_MESSAGE:
        raise MessageRefused(f"message: {size} bytes, at most {LARGEST_MESSAGE} are read")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        raise MessageRefused("message: expected JSON") from None
    return message_from(data)


def message_from(data: Any) -> Message:
    """Turn a parsed message into a :class:`SetControl` or :class:`DoAction`.

    Args:
        data: The parsed JSON.

    Returns:
        The message.

    Raises:
        MessageRefused: If something is missing, unknown or of the wrong type.
    """
    if not isinstance(data, dict):
        raise MessageRefused("message: expected an object with kind, id and user")
    kind = data.get("kind")
    if kind == "set":
        _only(data, ("kind", "id", "user", "control", "value"))
        return SetControl(
            id=_name(data, "id"),
            user=_user(data),
            control=_name(data, "control"),
            value=_value(data, "value"),
        )
    if kind == "do":
        _only(data, ("kind", "id", "user", "action", "values"))
        return DoAction(id=_name(data, "id"), user=_user(data), action=_action(data), values=_values(data))
    raise MessageRefused(f"kind: expected set or do, got {_short(kind)}")


def id_of(text: str | bytes) -> str:
    """Id of a message that was refused, so that the page can tell which; empty if it has none."""
    try:
        found = json.loads(text).get("id") if len(text) <= LARGEST_MESSAGE else None
    except (ValueError, AttributeError, RecursionError):
        return ""
    return found if _is_text(found, LONGEST_NAME) else ""


def _only(data: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in data:
        if key not in known:
            raise MessageRefused(f"{_short(key)}: unknown; a message of this kind has {', '.join(known)}")


def _is_text(value: Any, longest: int) -> TypeGuard[str]:
    return isinstance(value, str) and len(value) <= longest and value.isprintable()


def _name(data: Mapping[str, Any], key: str) -> str:
    value = data.get(key)
    if not _is_text(value, LONGEST_NAME) or not value:
        raise MessageRefused(f"{key}: expected a text of 1 to {LONGEST_NAME} characters, got {_short(value)}")
    return value


def _user(data: Mapping[str, Any]) -> str:
    user = data.get("user", "")
    if not _is_text(user, LONGEST_NAME):
        raise MessageRefused(f"user: expected at most {LONGEST_NAME} characters, got {_short(user)}")
    return user


def _value(data: Mapping[str, Any], key: str) -> Value:
    value = data.get(key)
    if isinstance(value, bool) or _is_text(value, LONGEST_TEXT):
        return value
    if isinstance(value, int | float) and abs(value) < 1e300 and math.isfinite(value):
        return float(value)
    raise MessageRefused(f"{key}: expected a number, a short text or true or false, got {_short(value)}")


def _action(data: Mapping[str, Any]) -> Action:
    action = data.get("action")
    if not isinstance(action, str) or action not in list(Action):
        raise MessageRefused(f"action: no {_short(action)}; there are {', '.join(Action)}")
    return Action(action)


def _values(data: Mapping[str, Any]) -> dict[str, Value]:
    values = data.get("values", {})
    if not isinstance(values, dict) or len(values) > MOST_VALUES:
        raise MessageRefused(f"values: expected an object with at most {MOST_VALUES} values")
    return {key: _value(values, key) for key in values}


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 else text[:37] + "…"


# ---------------------------------------------------------------------- to a page


@dataclass(frozen=True, kw_only=True)
class Control:
    """A control, or a field of an action, with all that is needed to draw it.

    Attributes:
        name: By which it is set, such as ``late_stance.hip.stiffness``.
        label: What a page writes beside it.
        group: Tab of the panel: ``walk``, ``table``, ``monitor``, or the action that it belongs to.
        kind: How it is drawn.
        value: Present value; for a field of an action the one that it begins with.
        default: Value of the preset.
        unit: Of the value; empty for a pure number or a word.
        least: Least number allowed.
        largest: Largest number allowed.
        step: From one number to the next.
        choices: Words of a choice.
        phase: Phase of gait of a table's control.
        joint: Joint of a control that has one.
        side: Leg of a control that has one.
        help: One sentence.
    """

    name: str
    label: str
    group: str
    kind: ControlKind
    value: Value
    default: Value
    unit: str = ""
    least: float | None = None
    largest: float | None = None
    step: float | None = None
    choices: tuple[str, ...] = ()
    phase: str | None = None
    joint: str | None = None
    side: str | None = None
    help: str = ""

    @property
    def changed(self) -> bool:
        """Whether the value differs from the preset's."""
        return self.value != self.default

    def to_dict(self) -> dict[str, Any]:
        """The control as JSON takes it, with ``changed``."""
        return {**asdict(self), "choices": list(self.choices), "changed": self.changed}


@dataclass(frozen=True, kw_only=True)
class ActionSpec:
    """An action with its fields.

    Attributes:
        action: Its name.
        label: What the button says.
        group: Tab of the panel.
        fields: What goes with it.
        help: One sentence.
    """

    action: Action
    label: str
    group: str
    fields: tuple[Control, ...] = ()
    help: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The action as JSON takes it."""
        return {**asdict(self), "fields": [item.to_dict() for item in self.fields]}


@dataclass(frozen=True, kw_only=True)
class DeadlineStatistics:
    """How well the blocks kept to the clock.

    Attributes:
        blocks: That were due.
        late: Of them, finished more than 10 ms after their time, or never.
        mean_ms: Mean lateness in [ms]; a block finished in time counts as 0.
        p99_ms: Lateness that 99 % of the blocks stay below, in [ms].
        worst_ms: Largest lateness in [ms].
        lost_s: Time in [s] that the simulation has given up after stalls.
    """

    blocks: int
    late: int
    mean_ms: float
    p99_ms: float
    worst_ms: float
    lost_s: float


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One moment of the walk.

    Attributes:
        tick: Of the last row of the log.
        time_s: Of that tick.
        status: ``walking``, ``paused``, ``waiting`` (for a step by hand), ``holding`` (after a stop or
            a trip), ``fell``, ``diverged`` or ``ended``.
        q: Coordinates of the rigid-body model in [rad] and [m], Pinocchio's order.
        log: The row of the log, by column; phases are names.
        deadlines: How well the blocks kept to the clock.
    """

    tick: int
    time_s: float
    status: str
    q: tuple[float, ...]
    log: Mapping[str, float | str]
    deadlines: DeadlineStatistics

    def to_dict(self) -> dict[str, Any]:
        """The frame as JSON takes it; numbers that are not finite become null."""
        return {
            "kind": "frame",
            "tick": self.tick,
            "time_s": self.time_s,
            "status": self.status,
            "q": [_finite(item) for item in self.q],
            "log": {key: _finite(value) for key, value in self.log.items()},
            "deadlines": asdict(self.deadlines),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Frame:
        """The frame of :meth:`to_dict`."""
        return cls(
            tick=data["tick"],
            time_s=data["time_s"],
            status=data["status"],
            q=tuple(math.nan if item is None else item for item in data["q"]),
            log={key: math.nan if item is None else item for key, item in data["log"].items()},
            deadlines=DeadlineStatistics(**data["deadlines"]),
        )


@dataclass(frozen=True, kw_only=True)
class Event:
    """What became of a message, or what the simulation did by itself.

    Attributes:
        serial: Number of the event, from 1 on.
        outcome: Applied, refused, or a note of the simulation.
        text: One sentence; of a refusal the reason.
        tick: First tick with the change; of a refusal the last one known.
        id: Of the message, or empty.
        user: Who, or empty.
        subject: Control or action that it is about, or empty.
        value: That was asked for.
        before: Value that the control had.
        warnings: Findings of the check that a change which was applied brings along.
        effect: What the log has from now on, by column; a table's control shows while its phase lasts.
    """

    serial: int
    outcome: Outcome
    text: str
    tick: int
    id: str = ""
    user: str = ""
    subject: str = ""
    value: Value | None = None
    before: Value | None = None
    warnings: tuple[str, ...] = ()
    effect: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The event as JSON takes it."""
        return {"kind": "event", **asdict(self), "warnings": list(self.warnings)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Event:
        """The event of :meth:`to_dict`."""
        rest = {key: item for key, item in data.items() if key not in ("kind", "outcome", "warnings")}
        return cls(outcome=Outcome(data["outcome"]), warnings=tuple(data["warnings"]), **rest)


@dataclass(frozen=True, kw_only=True)
class State:
    """The panel.

    Attributes:
        serial: Of the last event that it counts in; grows with every change.
        experiment: Name of the preset or file.
        phases: Of the gait table, in order.
        joints: Of a leg, in order.
        sides: Legs.
        controls: All controls.
        actions: All actions.
        saved: Tables saved so far: files, newest last.
        version: Of the protocol.
    """

    serial: int
    experiment: str
    phases: tuple[str, ...]
    joints: tuple[str, ...]
    sides: tuple[str, ...]
    controls: tuple[Control, ...]
    actions: tuple[ActionSpec, ...]
    saved: tuple[str, ...] = ()
    version: int = PROTOCOL_VERSION

    def to_dict(self) -> dict[str, Any]:
        """The state as JSON takes it, with the differences from the preset."""
        lists = {key: list(getattr(self, key)) for key in ("phases", "joints", "sides", "saved")}
        return {
            "kind": "state",
            "version": self.version,
            "serial": self.serial,
            "experiment": self.experiment,
            **lists,
            "controls": [item.to_dict() for item in self.controls],
            "actions": [item.to_dict() for item in self.actions],
            "differences": [item.name for item in self.controls if item.changed],
        }


def _finite(value: float | str) -> float | str | None:
    return value if isinstance(value, str) or math.isfinite(value) else None


def dump(data: Mapping[str, Any]) -> str:
    """A mapping as one line of JSON."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)
