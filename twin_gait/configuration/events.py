"""Conversion between the events of an experiment and the entries under ``events`` in its file.

An entry has a time and one of ``set``, ``push``, ``step``, ``stop``, ``request`` and ``fault``. The keys of
``set`` are those of ``--set``; keys that can change during a run are those that :func:`changeable_keys`
lists.
"""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import MISSING
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, model_validator

from twin_gait.configuration.sections import to_si
from twin_gait.configuration.validation import (
    Count,
    Number,
    Strict,
    convert_with_context,
    reject_duplicate_units,
    short,
)
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.device import ControlParameters
from twin_gait.experiment.events import FADE_TICKS, Change, Event, Push, Step, Stop
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.modes import TimedRequest
from twin_gait.gait.table import MAX_TICKS, TICK, JointImpedance, PhaseParameters
from twin_gait.parameters.quantities import Declaration, declarations, require
from twin_gait.simulation.settings import MODES, Settings, value_at_path
from twin_gait.worlds.faults import Fault, insert_time, parse_fault

_ACTIONS = ("set", "push", "step", "stop", "request", "fault")
_CHANGEABLE_KEYS_TEXT = (
    "table.phases.PHASE.JOINT.QUANTITY, table.phases.PHASE.gravity_compensation, the same under "
    "table.sides.SIDE, control.target_torque_Nm.JOINT, {adjustable}monitor.control, monitor.steps_by_hand "
    "and monitor.SIDE_JOINT.QUANTITY"
)
STRONGEST_PUSH = 1000.0  # [N·m]; a larger torque is a mistake of the unit, because it would break the leg


class PushEntry(Strict):
    """Torque on a joint from outside."""

    joint: str
    torque_Nm: Annotated[Number, Field(ge=-STRONGEST_PUSH, le=STRONGEST_PUSH)]
    duration_ms: Annotated[Count, Field(ge=1, le=MAX_TICKS)]


class EventEntry(Strict):
    """Entry under ``events``."""

    time_s: Annotated[Number, Field(ge=0.0, le=MAX_TICKS * TICK, description="Time of the event.")]
    set: dict[str, Any] | None = Field(None, description="New values of parameters by their keys.")
    fade_ms: Annotated[Count, Field(ge=0, le=MAX_TICKS)] = Field(
        FADE_TICKS, description="Time over which the new values are faded in."
    )
    push: PushEntry | None = Field(None, description="Torque on a joint from outside.")
    step: Literal[True] | None = Field(None, description="Release of a step by hand.")
    stop: Literal[True] | None = Field(None, description="Emergency stop.")
    request: str | None = Field(None, description="Request to the supervisor of the operating modes.")
    fault: str | None = Field(None, description="Fault in its notation without the time.")
    by: str = Field("", description="Originator of the event in a live session.")

    @model_validator(mode="after")
    def _one_action(self) -> "EventEntry":
        given = [name for name in _ACTIONS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"expected exactly one of {', '.join(_ACTIONS)}, got {' and '.join(given) or 'none'}"
            )
        if "fade_ms" in self.model_fields_set and self.set is None:
            raise ValueError("fade_ms: applies to set only; leave it out")
        return self

    @property
    def tick(self) -> int:
        """Tick of the event."""
        return round(self.time_s / TICK)

    @property
    def time(self) -> float:
        """Time of that tick in [s]."""
        return round(self.tick * TICK, 3)


class ChangeableValue(NamedTuple):
    """Number or choice that a key sets."""

    path: str  # Path in the settings.
    factor: float = 1.0  # SI value of one unit.
    item: Declaration | None = None  # Declaration of a number; None for a choice.
    choices: tuple[str | bool, ...] = ()  # Values of a choice.

    def value(self, key: str, given: Any) -> float | str | bool:
        """Convert a value of the key to SI; raise ParameterError if the key does not accept it."""
        if self.item is None:
            words = " or ".join(item if isinstance(item, str) else str(item).lower() for item in self.choices)
            require(given in self.choices and type(given) is type(self.choices[0]), key, words, given)
            return given  # type: ignore[no-any-return]
        number = isinstance(given, int | float) and not isinstance(given, bool)
        require(number, key, "a number", given)
        try:
            return float(to_si(self.item, self.factor, given))
        except ValueError as error:
            raise ParameterError(f"{key}: {error}") from error


def changeable_keys(experiment: Experiment) -> dict[str, ChangeableValue]:
    """Return all keys that can change during a run, with their places; the factor of SI units is 1."""
    table, found = experiment.table, dict[str, ChangeableValue]()
    sides = {f"sides.{side}": f"side_phases.{side}" for side in experiment.sides}
    for key, path in {"phases": "phases", **sides}.items():
        for phase in table.phases:
            name, at = f"table.{key}.{phase}", f"experiment.table.{path}.{phase}"
            found |= _declared(PhaseParameters, "gravity_compensation", name, at)
            for joint in table.joints:
                found |= _impedance(f"{name}.{joint}", f"{at}.joints.{joint}")
    ((torque, _),) = _declared(ControlParameters, "target_torque", "control", "experiment.control")
    item = _declaration(ControlParameters, "target_torque")
    for joint in experiment.joints:
        found[f"{torque}.{joint}"] = ChangeableValue(f"experiment.control.target_torque.{joint}", item=item)
    found |= _adjustable(experiment)
    found["monitor.control"] = ChangeableValue("mode", choices=tuple(MODES))
    if experiment.stepped_by_hand:
        found["monitor.steps_by_hand"] = ChangeableValue("manual", choices=(False, True))
    for side in experiment.sides:
        for joint in experiment.joints:
            name = f"monitor.{side}_{joint}"
            found |= _impedance(name, f"monitor.{side}.joints.{joint}")
            found[f"{name}.target_torque_Nm"] = ChangeableValue(f"torques.{side}_{joint}", item=item)
    return found


def _declaration(parameters: Any, name: str) -> Declaration:
    return next(item for item in declarations(parameters) if item.name == name)


def _declared(parameters: Any, name: str, key: str, path: str) -> Iterator[tuple[str, ChangeableValue]]:
    """Yield the keys of a declared field, one for each of its units."""
    item = _declaration(parameters, name)
    for unit_key, factor in item.keys.items():
        yield f"{key}.{unit_key}", ChangeableValue(f"{path}.{name}", factor, item)


def _impedance(key: str, path: str) -> Iterator[tuple[str, ChangeableValue]]:
    for item in declarations(JointImpedance):
        yield from _declared(JointImpedance, item.name, key, path)


def _adjustable(experiment: Experiment) -> Iterator[tuple[str, ChangeableValue]]:
    """Yield the keys of the world that can be adjusted."""
    for item in experiment.scenario.adjustments:
        *steps, name = item.path.split(".")
        record, key = experiment.scenario, "scenario"
        for step in steps:
            key, record = f"{key}.{_declaration(type(record), step).key}", getattr(record, step)
        yield from _declared(type(record), name, key, ".".join(["experiment.scenario", *steps]))


def _flat(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys of a nested mapping, and their values."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _changes(
    given: Mapping[str, Any], known: Mapping[str, ChangeableValue], experiment: Experiment
) -> dict[str, Any]:
    """Return the new values in SI by their paths."""
    values, found = dict(_flat(given)), {}
    reject_duplicate_units(values)
    for key, value in values.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.8)
            hint = f"did you mean {near[0]}? " if near else ""
            adjustable = "".join(f"{name}, " for name, _ in _adjustable(experiment))
            raise ParameterError(
                f"{short(key)}: cannot change during a run; {hint}allowed: "
                f"{_CHANGEABLE_KEYS_TEXT.format(adjustable=adjustable)}"
            )
        found[known[key].path] = known[key].value(key, value)
    return found


def events_of(entries: tuple[EventEntry, ...], experiment: Experiment, source: str) -> tuple[Event, ...]:
    """Return the events of an experiment without requests and faults, which are fields of the experiment."""
    known, found = changeable_keys(experiment), list[Event]()
    for number, entry in enumerate(entries):
        about: dict[str, Any] = {"tick": entry.tick, "by": entry.by}
        if entry.set is not None:
            read = partial(_changes, entry.set, known, experiment)
            changes = convert_with_context(source, f"events[{number}].set", read)
            found.append(Change(**about, changes=changes, fade_ticks=entry.fade_ms))
        elif entry.push is not None:
            push = entry.push
            found.append(
                Push(**about, joint=push.joint, torque=push.torque_Nm, duration_ticks=push.duration_ms)
            )
        elif entry.step or entry.stop:
            found.append((Step if entry.step else Stop)(**about))
    return tuple(found)


def faults_and_requests(
    entries: tuple[EventEntry, ...], source: str
) -> tuple[tuple[Fault, ...], tuple[TimedRequest, ...]]:
    """Return the faults and requests among the entries of events."""
    faults = tuple(
        convert_with_context(
            source, f"events[{number}]", partial(parse_fault, insert_time(entry.fault, entry.time))
        )
        for number, entry in enumerate(entries)
        if entry.fault is not None
    )
    return faults, tuple(
        TimedRequest(item.request, item.tick) for item in entries if item.request is not None
    )


def events_document(experiment: Experiment) -> list[dict[str, Any]]:
    """Convert the events of an experiment to its file, in SI; reading them gives equal events."""
    changeable = changeable_keys(experiment).items()
    keys = {value.path: key for key, value in changeable if value.factor == 1.0}
    found = []
    for event in experiment.events:
        entry: dict[str, Any] = {"time_s": round(event.tick * TICK, 3)}
        match event:
            case Change():
                changes = {keys[path]: value for path, value in event.changes.items()}
                entry |= {"set": changes, "fade_ms": event.fade_ticks}
            case Push(joint=joint, torque=torque, duration_ticks=ticks):
                entry["push"] = {"joint": joint, "torque_Nm": torque, "duration_ms": ticks}
            case _:
                entry[type(event).__name__.lower()] = True
        found.append({**entry, **({"by": event.by} if event.by else {})})
    return found


def changed_keys(before: Settings, after: Settings) -> dict[str, Any]:
    """Return the difference between two settings in the form of ``set`` of an event, in SI."""
    found = {}
    for key, value in changeable_keys(after.experiment).items():
        if value.factor == 1.0:
            old, new = _at(before, value.path), _at(after, value.path)
            if new != old and new not in (None, MISSING):
                found[key] = new
    return found


def _at(settings: Settings, path: str) -> Any:
    """Return the value at a path; MISSING for a phase that a side does not have of its own."""
    try:
        return value_at_path(settings, path)
    except KeyError:
        return MISSING
