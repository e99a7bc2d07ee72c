"""The controls and actions of a live session as data: names, units, ranges, and what setting one does.

Ranges are those that other parts of the program go by: angles end at the stops of the URDF, stiffness at the
published ranges of the check or what the table itself has, torque at the limit of the motors, gain and shares
at 0 and 1. Whether a value within its range is safe is for :mod:`twin_gait.live.tuning` to say.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.check import build_case
from twin_gait.checking.sense import STIFFNESS_RANGES
from twin_gait.experiment import Experiment
from twin_gait.live.protocol import (
    Action,
    ActionSpec,
    Control,
    ControlKind,
    DoAction,
    MessageRefused,
    Value,
    checked,
)
from twin_gait.live.settings import (
    HELD_PHASE,
    Mode,
    Place,
    Settings,
    first_settings,
    places,
    resolved_damping,
)
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.vocabulary import JointName
from twin_gait.worlds.faults import FOOT, Fault, FaultKind, parse_fault

LONGEST_PUSH = 2.0  # [s]
EVERYTHING = "all"
_DEGREE = math.pi / 180.0
TORQUE_STEP = 0.05  # [N m], the step of the thesis's monitor
# Label and help of what needs no value.
_PLAIN = {
    Action.WALK: ("walk", "Go on."),
    Action.PAUSE: ("pause", "Let the time stand still."),
    Action.STEP: ("step", "In manual mode: let the leg at the end of stance swing."),
    Action.RESTART: ("start again", "Begin a new walk from the start with the present settings."),
    Action.SAVE: ("save the table", "Write the table as YAML that twin-gait simulate runs."),
    Action.STOP: ("stop", "Hold the legs with damping and lower them; only a restart ends it."),
}
_ASK = "Ask the device for another mode, as the therapist does; it answers in the next tick."


@dataclass(frozen=True)
class Actions:
    """What can be done in one experiment, beside setting controls."""

    problem: Problem  # what their fields depend on

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints in the order of the arrays, such as ``left_knee``."""
        return tuple(f"{item.side}_{item.joint}" for item in self.problem.joints)

    def specs(self) -> tuple[ActionSpec, ...]:
        """All actions with their fields."""
        experiment, plain = self.problem.experiment, dict(_PLAIN)
        modes, limit = experiment.modes, experiment.control.limits.torque
        if modes is not None:  # steps and walking are theirs
            plain[Action.WALK] = ("go on", "Let the time go on.")
            del plain[Action.STEP]
        found = [_spec(action, label, "walk", text) for action, (label, text) in plain.items()]
        if modes is not None and modes.requests:
            found.append(_spec(Action.REQUEST, "ask", "walk", _ASK, request=modes.requests))
        text = "Set a control, or all of them, back to the preset."
        found.append(_spec(Action.REVERT, "as it began", "table", text, control=EVERYTHING))
        torque = {"value": 10.0, "unit": "Nm", "least": -limit, "largest": limit, "step": 1.0}
        duration = {"value": 0.2, "unit": "s", "least": 0.01, "largest": LONGEST_PUSH, "step": 0.01}
        text = "Push a joint from outside, as a hand does; positive towards flexion."
        joints = self.joint_names
        found.append(_spec(Action.PUSH, "push", "push", text, joint=joints, torque=torque, duration=duration))
        feet = tuple(f"{side}_{FOOT}" for side in self.problem.sides if experiment.scenario.grounded)
        kinds, places = tuple(str(item) for item in FaultKind), ("", *joints, *feet)
        text = "Something breaks now and stays broken until a restart."
        found.append(_spec(Action.FAULT, "break it", "push", text, kind=kinds, place=places, size=""))
        return tuple(found)

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
        place, size = ("".join(str(values[name]).split()) for name in ("place", "size"))
        written = f"{values['kind']}{f':{place}' if place else ''}@0s{f'={size}' if size else ''}"
        fault = parse_fault(written)
        # The experiment knows which faults it can have.
        replace(self.problem.experiment, faults=(fault,))
        return fault


# What a page writes beside a text that is typed, and its help.
_TYPED = {
    "control": ("control", "One control, or all."),
    "size": ("size with unit", "Such as 20deg/s; empty for the usual one."),
}


def _spec(action: Action, label: str, group: str, text: str, **fields: Any) -> ActionSpec:
    """An action; fields are words to choose from, a text to begin with, or a number with unit and range."""
    made = []
    for name, given in fields.items():
        if isinstance(given, tuple):
            rest = {"kind": ControlKind.CHOICE, "label": name, "value": given[0], "choices": given}
        elif isinstance(given, str):
            typed, words = _TYPED[name]
            rest = {"kind": ControlKind.TEXT, "label": typed, "value": given, "help": words}
        else:
            rest = {"kind": ControlKind.NUMBER, "label": name, **given}
        made.append(Control(name=name, group=str(action), default=rest["value"], **rest))
    return ActionSpec(action=action, label=label, group=group, fields=tuple(made), help=text)


class Quantity(NamedTuple):
    """A parameter of an impedance as a control shows it."""

    label: str  # in words, with its letter
    unit: str  # of the control
    scale: float  # SI value of one unit
    step: float  # of the control, in its unit
    field: str  # of an impedance and of a joint of the monitor
    help: str  # one sentence


QUANTITIES = {
    "stiffness": Quantity("stiffness k", "Nm/deg", 1.0 / _DEGREE, 0.05, "stiffness",
                          "How hard the spring pulls to θ0."),
    "damping": Quantity("damping b", "Nms/rad", 1.0, 0.5, "damping",
                        "How much the spring's motion is braked."),
    "equilibrium": Quantity("equilibrium θ0", "deg", _DEGREE, 0.5, "equilibrium_angle",
                            "Angle that the spring pulls to."),
    "gain": Quantity("friction gain G", "", 1.0, 0.01, "friction_compensation_gain",
                     "Share of the modelled friction that is compensated."),
    "torque": Quantity("target torque", "Nm", 1.0, TORQUE_STEP, "target_torque",
                       "Added to the command in torque control."),
}  # fmt: skip
_DRIVES = "The gait table, or one of the monitor's three controls, for which the belt stands still."
_WAITS = "A leg at the end of stance waits for the step button, and the belt waits with it."

Fields = Mapping[str, Any]  # numbers in SI, or words


class Binding(NamedTuple):
    """A control and what it sets: the fields of a part of the settings."""

    control: Control  # as the session begins
    read: Callable[[Settings], Fields]  # the field that it shows, and others that follow from it
    write: Callable[[Settings, Fields], Settings]  # settings with other fields
    scale: float = 1.0  # SI value of one unit of the control

    def shown(self, settings: Settings) -> Value:
        """Value of the control."""
        value: Value = next(iter(self.read(settings).values()))
        return float(value) / self.scale if self.control.kind is ControlKind.NUMBER else value

    def turned(self, settings: Settings, value: Value) -> Settings:
        """Settings with another value of the control, which leaves nothing of the other fields."""
        fields: dict[str, Any] = dict.fromkeys(self.read(settings))
        name = next(iter(fields))
        number = self.control.kind is ControlKind.NUMBER
        return self.write(settings, fields | {name: float(value) * self.scale if number else value})


class Panel:
    """The controls and actions of one experiment.

    Attributes:
        preset: Settings that the session began with.
        problem: The experiment as arrays, as it began.
    """

    def __init__(self, experiment: Experiment) -> None:
        """Find the ranges of all controls."""
        self.preset: Settings = first_settings(experiment)
        self.problem: Problem = build_problem(experiment)
        case = build_case(experiment.table, experiment)
        self._angles = {joint: case.limits[joint] for joint in experiment.joints}
        self._places = tuple(places(experiment.table, self.problem.sides))
        self._torque = experiment.control.limits.torque
        model = self.problem.control_model
        self._inertias = {  # of the leg about every joint, all at zero, in [kg m²], armature included
            item.joint: model.effective_inertia(np.zeros(model.nv), item.control_coordinate)
            for item in self.problem.joints
        }
        monitored = [Place("", joint, side) for side, joint in self.preset.monitor]
        bindings = list(self._own_bindings())
        for group, there in (("table", self._places), ("monitor", monitored)):
            bindings += [binding for place in there for binding in self._joint_bindings(place, group)]
        self._bindings = {binding.control.name: binding for binding in bindings}
        # The last ones asked for.
        self._shown: tuple[Settings, tuple[Control, ...]] | None = None

    # ------------------------------------------------------------------ drawing

    def controls(self, settings: Settings) -> tuple[Control, ...]:
        """All controls with the values of some settings, in the order in which a page shows them."""
        if self._shown is None or self._shown[0] is not settings:
            now = self._dampings(build_problem(settings.experiment))
            # A damping ratio follows the stiffness: the preset's b is the one that its ratio gives now.
            as_preset = reduce(self.revert, now, settings)
            begun = self._dampings(build_problem(as_preset.experiment))
            found = [
                replace(binding.control, value=now[name], default=begun[name])
                if name in now
                else replace(binding.control, value=binding.shown(settings))
                for name, binding in self._bindings.items()
            ]
            self._shown = (settings, tuple(found))
        return self._shown[1]

    def _own_bindings(self) -> Iterator[Binding]:
        """What drives the walk, steps by hand, and what may be adjusted of the world."""
        experiment, begun = self.preset.experiment, str(self.preset.mode)
        yield Binding(
            Control(
                name="mode", label="what drives the joints", group="monitor", kind=ControlKind.CHOICE,
                value=begun, default=begun, choices=tuple(map(str, Mode)), help=_DRIVES,
            ),
            lambda settings: {"mode": str(settings.mode)},
            lambda settings, fields: replace(settings, mode=Mode(fields["mode"])),
        )  # fmt: skip
        if HELD_PHASE in experiment.table.phases and experiment.modes is None:
            yield Binding(
                Control(
                    name="manual", label="steps by hand", group="walk", kind=ControlKind.SWITCH,
                    value=self.preset.manual, default=self.preset.manual, help=_WAITS,
                ),
                lambda settings: {"manual": settings.manual},
                lambda settings, fields: replace(settings, manual=fields["manual"]),
            )  # fmt: skip
        for item in experiment.scenario.adjustments:
            control = Control(
                name=item.name, label=item.label, group="walk", kind=ControlKind.NUMBER, value=item.shown,
                default=item.shown, unit=item.unit, least=item.least, largest=item.largest, step=item.step,
                help=item.help,
            )  # fmt: skip
            yield Binding(control, partial(_adjustment, item.name), _adjusted, item.scale)

    def _joint_bindings(self, place: Place, group: str) -> Iterator[Binding]:
        """All quantities that can be set in a place."""
        record = place.read(self.preset)
        for name, quantity in QUANTITIES.items():
            fields = [item for item in (quantity.field, f"{quantity.field}_ratio") if hasattr(record, item)]
            if not fields:
                continue
            least, largest = self.range_of(name, JointName(place.joint))
            value = (getattr(record, quantity.field) or 0.0) / quantity.scale
            control = Control(
                name=f"{place.prefix}.{name}", label=quantity.label, group=group, kind=ControlKind.NUMBER,
                value=value, default=value, unit=quantity.unit, least=least, largest=largest,
                step=quantity.step, phase=place.phase or None, joint=place.joint, side=place.side,
                help=quantity.help,
            )  # fmt: skip
            yield Binding(control, partial(_fields_of, place, fields), place.write, quantity.scale)

    def _dampings(self, problem: Problem) -> dict[str, float]:
        """Values of the table's controls of damping, of a leg that each reaches, ratios resolved."""
        found, differing = {}, self.preset.table.side_phases
        for place in self._places:
            common = (side for side in self.problem.sides if place.phase not in differing.get(side, {}))
            side = place.side or next(common, self.problem.sides[0])
            found[f"{place.prefix}.damping"] = resolved_damping(problem, side, str(place.phase), place.joint)
        return found

    def range_of(self, quantity: str, joint: JointName) -> tuple[float, float]:
        """Least and largest value of a quantity of a joint, in the unit of the control.

        ``quantity``: a key of ``QUANTITIES``. Angles: the stops, or what the table has if that is beyond.
        Stiffness: the published range, or what the table has if that is more. Damping: critical at that
        stiffness with the leg's inertia, or twice what the table has if that is more.
        """
        own = [place for place in self._places if place.joint == joint]
        if quantity == "equilibrium":
            low, high = self._angles[joint]
            # Whole tenths just inside the stops.
            stops = math.ceil(10.0 * low / _DEGREE) / 10.0, math.floor(10.0 * high / _DEGREE) / 10.0
            angles = (*stops, *(place.read(self.preset).equilibrium_angle / _DEGREE for place in own))
            return min(angles), max(angles)
        if quantity == "torque":
            return -self._torque, self._torque
        if quantity == "gain":
            return 0.0, 1.0
        unit = QUANTITIES["stiffness"].scale
        has = (place.read(self.preset).stiffness / unit for place in own)
        stiffness = max(STIFFNESS_RANGES[joint].most, *has)
        if quantity == "stiffness":
            return 0.0, stiffness
        critical = 2.0 * math.sqrt(stiffness * unit * self._inertias[joint])
        dampings = self._dampings(self.problem)
        most = max(dampings[f"{place.prefix}.damping"] for place in own)
        return 0.0, math.ceil(max(critical, 2.0 * most))

    # ------------------------------------------------------------------ setting

    def set(self, settings: Settings, name: str, value: Value) -> Settings:
        """Settings with one control changed; whether they are safe is not looked at.

        Raises MessageRefused if there is no such control, or the value is out of its range.
        """
        binding = self._bindings.get(name)
        if binding is None:
            raise MessageRefused(f"control: no {name!r}; the state lists them all")
        return binding.turned(settings, checked(binding.control, value))

    def revert(self, settings: Settings, name: str) -> Settings:
        """Settings with one control, or ``all`` of them, as the session began.

        Raises MessageRefused if there is no such control.
        """
        if name == EVERYTHING:
            return self.preset
        if name not in self._bindings:
            raise MessageRefused(f"revert: no control {name!r}; give one of the state's, or {EVERYTHING}")
        binding = self._bindings[name]
        return binding.write(settings, binding.read(self.preset))


def _adjustment(name: str, settings: Settings) -> Fields:
    """Value of an adjustment of the world, in SI."""
    found = settings.experiment.scenario.adjustments
    return {item.name: item.value for item in found if item.name == name}


def _adjusted(settings: Settings, fields: Fields) -> Settings:
    experiment, ((name, value),) = settings.experiment, fields.items()
    scenario = experiment.scenario.adjusted(name, value)
    return replace(settings, experiment=replace(experiment, scenario=scenario))


def _fields_of(place: Place, names: Sequence[str], settings: Settings) -> Fields:
    return {name: getattr(place.read(settings), name) for name in names}
