"""What a page says: one of two messages, or a refusal; nothing else is ever read from the network."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeGuard

from twin_gait.exceptions import TwinGaitError

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
    REQUEST = "request"
    PUSH = "push"
    FAULT = "fault"
    REVERT = "revert"
    RESTART = "restart"
    SAVE = "save"
    STOP = "stop"


Value = float | str | bool


@dataclass(frozen=True, kw_only=True)
class SetControl:
    """A page sets a control."""

    id: str  # by which the page recognises the answer
    user: str  # who
    control: str  # name of the control
    value: Value  # in the unit of the control
    trying: bool = False  # whether only a forecast is wanted


@dataclass(frozen=True, kw_only=True)
class DoAction:
    """A page asks for an action."""

    id: str  # by which the page recognises the answer
    user: str  # who
    action: Action  # what to do
    # of the fields of the action; those left out take their defaults
    values: Mapping[str, Value] = field(default_factory=dict)


Message = SetControl | DoAction


def read_message(text: str | bytes) -> Message:
    """Read a message of a page.

    ``text``: JSON: ``{"kind": "set", "id", "user", "control", "value"}``, the same with ``try`` for a
    forecast of it, or ``{"kind": "do", "id", "user", "action", "values"}``. Raises MessageRefused if it is
    anything else; the text says why.
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

    Raises MessageRefused if something is missing, unknown or of the wrong type.
    """
    if not isinstance(data, dict):
        raise MessageRefused("message: expected an object with kind, id and user")
    kind = data.get("kind")
    if kind in ("set", "try"):
        _only(data, ("kind", "id", "user", "control", "value"))
        return SetControl(
            id=_name(data, "id"),
            user=_user(data),
            control=_name(data, "control"),
            value=_value(data, "value"),
            trying=kind == "try",
        )
    if kind == "do":
        _only(data, ("kind", "id", "user", "action", "values"))
        return DoAction(id=_name(data, "id"), user=_user(data), action=_action(data), values=_values(data))
    raise MessageRefused(f"kind: expected set, try or do, got {_short(kind)}")


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
