"""The actions of a live session as data, and what the values of their fields mean."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from twin_gait.live.protocol import Action, ActionSpec, Control, ControlKind, DoAction, MessageRefused, Value
from twin_gait.live.protocol.to_page import checked
from twin_gait.simulation.problem import Problem
from twin_gait.worlds.faults import FOOT, Fault, FaultKind, parse_fault

LONGEST_PUSH = 2.0  # [s]
EVERYTHING = "all"


class Actions:
    """What can be done in one experiment, beside setting controls."""

    def __init__(self, problem: Problem) -> None:
        """Keep what the fields depend on."""
        self._problem = problem

    def specs(self) -> tuple[ActionSpec, ...]:
        """All actions with their fields."""
        plain = {
            Action.WALK: ("walk", "Go on."),
            Action.PAUSE: ("pause", "Let the time stand still."),
            Action.STEP: ("step", "In manual mode: let the leg at the end of stance swing."),
            Action.RESTART: ("start again", "Begin a new walk from the start with the present settings."),
            Action.SAVE: ("save the table", "Write the table as YAML that twin-gait simulate runs."),
            Action.STOP: ("stop", "Hold the legs with damping and lower them; only a restart ends it."),
        }
        modes = self._problem.experiment.modes
        if modes is not None:  # steps and walking are theirs
            plain[Action.WALK] = ("go on", "Let the time go on.")
            del plain[Action.STEP]
        found = [
            ActionSpec(action=action, label=label, group="walk", help=text)
            for action, (label, text) in plain.items()
        ]
        if modes is not None and modes.requests:
            asked = _choice("request", "request", Action.REQUEST, modes.requests)
            text = "Ask the device for another mode, as the therapist does; it answers in the next tick."
            found.append(
                ActionSpec(action=Action.REQUEST, label="ask", group="walk", fields=(asked,), help=text)
            )
        revert = ActionSpec(
            action=Action.REVERT,
            label="as it began",
            group="table",
            fields=(_text("control", "control", Action.REVERT, EVERYTHING, "One control, or all."),),
            help="Set a control, or all of them, back to the preset.",
        )
        return (*found, revert, self._push_spec(), self._fault_spec())

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints in the order of the arrays, such as ``left_knee``."""
        return tuple(f"{item.side}_{item.joint}" for item in self._problem.joints)

    def _push_spec(self) -> ActionSpec:
        limit = self._problem.experiment.control.limits.torque
        fields = (
            _choice("joint", "joint", Action.PUSH, self.joint_names),
            _number("torque", "torque", Action.PUSH, 10.0, "Nm", (-limit, limit), 1.0),
            _number("duration", "duration", Action.PUSH, 0.2, "s", (0.01, LONGEST_PUSH), 0.01),
        )
        return ActionSpec(
            action=Action.PUSH,
            label="push",
            group="push",
            fields=fields,
            help="Push a joint from outside, as a hand does; positive towards flexion.",
        )

    def _fault_spec(self) -> ActionSpec:
        feet = tuple(f"{side}_{FOOT}" for side in self._problem.sides if self._has_feet)
        places = ("", *self.joint_names, *feet)
        fields = (
            _choice("kind", "kind", Action.FAULT, tuple(str(item) for item in FaultKind)),
            _choice("place", "place", Action.FAULT, places),
            _text("size", "size with unit", Action.FAULT, "", "Such as 20deg/s; empty for the usual one."),
        )
        return ActionSpec(
            action=Action.FAULT,
            label="break it",
            group="push",
            fields=fields,
            help="Something breaks now and stays broken until a restart.",
        )

    @property
    def _has_feet(self) -> bool:
        return self._problem.experiment.scenario.grounded

    def values_of(self, message: DoAction) -> dict[str, Value]:
        """Values of an action's fields, those left out as they begin.

        Raises MessageRefused if a value is unknown or out of its range.
        """
        spec = next((item for item in self.specs() if item.action is message.action), None)
        if spec is None:
            raise MessageRefused(f"{message.action}: there is nothing like it in this experiment")
        known = {item.name: item for item in spec.fields}
        for name in message.values:
            if name not in known:
                has = f"has {', '.join(known)}" if known else "has no values"
                raise MessageRefused(f"{message.action}: no value {name!r}; it {has}")
        return {name: checked(item, message.values.get(name, item.value)) for name, item in known.items()}

    def fault_of(self, values: dict[str, Value]) -> Fault:
        """The fault that the fields of the action ask for.

        Raises ParameterError if kind, place and size do not fit together.
        """
        place, size = (str(values[name]).strip() for name in ("place", "size"))
        written = f"{values['kind']}{f':{place}' if place else ''}@0s{f'={size}' if size else ''}"
        fault = parse_fault(written)
        # The experiment knows which faults it can have.
        replace(self._problem.experiment, faults=(fault,))
        return fault


def _choice(name: str, label: str, action: Action, choices: tuple[str, ...]) -> Control:
    return _field(name, label, action, ControlKind.CHOICE, choices[0], choices=choices)


def _text(name: str, label: str, action: Action, value: str, text: str) -> Control:
    return _field(name, label, action, ControlKind.TEXT, value, help=text)


def _number(
    name: str, label: str, action: Action, value: float, unit: str, bounds: tuple[float, float], step: float
) -> Control:
    least, largest = bounds
    return _field(
        name, label, action, ControlKind.NUMBER, value, unit=unit, least=least, largest=largest, step=step
    )


def _field(name: str, label: str, action: Action, kind: ControlKind, value: Value, **rest: Any) -> Control:
    """A field of an action; it begins with its default."""
    return Control(name=name, label=label, group=str(action), kind=kind, value=value, default=value, **rest)
