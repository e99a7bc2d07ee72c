"""What a page hears: the panel, frames of the walk, and events."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from twin_gait.files import finite_or_none
from twin_gait.live.protocol.from_page import Action, MessageRefused, Value

PROTOCOL_VERSION = 1


class ControlKind(StrEnum):
    """How a control is drawn."""

    NUMBER = "number"
    CHOICE = "choice"
    SWITCH = "switch"
    TEXT = "text"


class Response(StrEnum):
    """What an event tells."""

    APPLIED = "applied"
    REFUSED = "refused"
    NOTE = "note"
    FORECAST = "forecast"


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
        events: What befell the walk: kind, time in [s] and words each, see
            :func:`twin_gait.viewer.page.event_entries`.
        status: ``walking``, ``paused``, ``waiting`` (for a step by hand), ``held`` (after a stop or
            a trip), ``fell``, ``diverged``, ``ended`` or ``died`` (the process, not the wearer).
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
    events: tuple[Mapping[str, Any], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The frame as JSON takes it; numbers that are not finite become null."""
        return {
            "kind": "frame",
            "tick": self.tick,
            "time_s": self.time_s,
            "status": self.status,
            "events": list(self.events),
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
            events=tuple(data["events"]),
        )


@dataclass(frozen=True, kw_only=True)
class Event:
    """What became of a message, or what the simulation did by itself.

    Attributes:
        serial: Number of the event, from 1 on.
        response: Applied, refused, a note of the simulation, or what would come of a change that waits.
        text: One sentence; of a refusal the reason.
        tick: First tick with the change; of a refusal the last one known.
        id: Of the message, or empty.
        user: Who, or empty.
        subject: Control or action that it is about, or empty.
        value: That was asked for.
        before: Value that the control had.
        warnings: Findings of the check that a change which was applied brings along.
        effect: What the log has from now on, by column; a table's control shows while its phase lasts.
        forecast: Of a change that waits, see :class:`~twin_gait.live.forecast.Forecast`; else None.
    """

    serial: int
    response: Response
    text: str
    tick: int
    id: str = ""
    user: str = ""
    subject: str = ""
    value: Value | None = None
    before: Value | None = None
    warnings: tuple[str, ...] = ()
    effect: Mapping[str, float] = field(default_factory=dict)
    forecast: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The event as JSON takes it."""
        return {"kind": "event", **asdict(self), "warnings": list(self.warnings)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Event:
        """The event of :meth:`to_dict`."""
        rest = {key: item for key, item in data.items() if key not in ("kind", "response", "warnings")}
        return cls(response=Response(data["response"]), warnings=tuple(data["warnings"]), **rest)


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
    return value if isinstance(value, str) else finite_or_none(value)


def dump(data: Mapping[str, Any]) -> str:
    """A mapping as one line of JSON."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def checked(control: Control, value: Value) -> Value:
    """A value if the control can take it.

    Raises:
        MessageRefused: If it is of the wrong kind or out of range.
    """
    if control.kind is ControlKind.SWITCH:
        return _of(control, value, isinstance(value, bool), "true or false")
    if control.kind is ControlKind.CHOICE:
        return _of(control, value, value in control.choices, " or ".join(map(repr, control.choices)))
    if control.kind is ControlKind.TEXT:
        return _of(control, value, isinstance(value, str), "a text")
    assert control.least is not None and control.largest is not None  # numbers have ranges
    number = isinstance(value, int | float) and not isinstance(value, bool)
    slack = 1e-9 * (control.largest - control.least)
    inside = number and control.least - slack <= float(value) <= control.largest + slack
    unit = f" {control.unit}" if control.unit else ""
    wanted = f"{control.least:.6g} to {control.largest:.6g}{unit}"
    return min(max(float(_of(control, value, inside, wanted)), control.least), control.largest)


def _of(control: Control, value: Value, fits: bool, wanted: str) -> Value:
    if not fits:
        shown = f"{value:.6g}" if isinstance(value, float) else repr(value)
        raise MessageRefused(f"{control.name}: expected {wanted}, got {shown}")
    return value
