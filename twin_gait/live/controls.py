"""The controls and actions of a live session as data: names, units, ranges, and what setting one does.

Ranges are those that other parts of the program go by: angles end at the stops of the URDF, stiffness at the
published ranges of the check or what the table itself has, torque at the limit of the motors, gain and shares
at 0 and 1. Whether a value within its range is safe is for :mod:`twin_gait.live.tuning` to say.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.check import build_case
from twin_gait.checking.sense import STIFFNESS_RANGES
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
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
from twin_gait.vocabulary import JointName, Side
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


class Actions:
    """What can be done in one experiment, beside setting controls."""

    def __init__(self, problem: Problem) -> None:
        """Keep what the fields depend on."""
        self._problem = problem

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints in the order of the arrays, such as ``left_knee``."""
        return tuple(f"{item.side}_{item.joint}" for item in self._problem.joints)

    def specs(self) -> tuple[ActionSpec, ...]:
        """All actions with their fields."""
        experiment, plain = self._problem.experiment, dict(_PLAIN)
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
        feet = tuple(f"{side}_{FOOT}" for side in self._problem.sides if experiment.scenario.grounded)
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
        place, size = (str(values[name]).strip() for name in ("place", "size"))
        written = f"{values['kind']}{f':{place}' if place else ''}@0s{f'={size}' if size else ''}"
        fault = parse_fault(written)
        # The experiment knows which faults it can have.
        replace(self._problem.experiment, faults=(fault,))
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
Write = Callable[[Settings, Fields], Settings]


class Handle(NamedTuple):
    """What a control sets: some fields."""

    begun: Fields  # as the session began: not one bit is lost in another unit
    fields_of: Callable[[Value], Fields]  # of a value of the control
    write: Write  # settings with other fields


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
        self._handles: dict[str, Handle] = {}
        # The last ones asked for.
        self._shown: tuple[Settings, tuple[Control, ...]] | None = None

    # ------------------------------------------------------------------ drawing

    def controls(self, settings: Settings) -> tuple[Control, ...]:
        """All controls with the values of some settings, in the order in which a page shows them."""
        if self._shown is None or self._shown[0] is not settings:
            parts = (self._walk_controls, self._table_controls, self._monitor_controls)
            pairs = [pair for part in parts for pair in part(settings)]
            self._handles = {control.name: handle for control, handle in pairs}
            self._shown = (settings, tuple(control for control, _ in pairs))
        return self._shown[1]

    def _walk_controls(self, settings: Settings) -> Iterator[tuple[Control, Handle]]:
        def own(name: str, kind: Callable[[Value], Any]) -> Handle:
            begun = {name: getattr(self.preset, name)}
            return Handle(begun, lambda value: {name: kind(value)}, lambda s, fields: replace(s, **fields))

        mode = Control(
            name="mode", label="what drives the joints", group="monitor", kind=ControlKind.CHOICE,
            value=str(settings.mode), default=str(self.preset.mode), choices=tuple(map(str, Mode)),
            help=_DRIVES,
        )  # fmt: skip
        yield mode, own("mode", lambda value: Mode(str(value)))
        if HELD_PHASE in settings.table.phases and settings.experiment.modes is None:
            manual = Control(
                name="manual", label="steps by hand", group="walk", kind=ControlKind.SWITCH,
                value=settings.manual, default=self.preset.manual, help=_WAITS,
            )  # fmt: skip
            yield manual, own("manual", bool)
        presets = self.preset.experiment.scenario.adjustments
        for now, begun in zip(settings.experiment.scenario.adjustments, presets, strict=True):
            control = Control(
                name=now.name, label=now.label, group="walk", kind=ControlKind.NUMBER, value=now.shown,
                default=begun.shown, unit=now.unit, least=begun.least, largest=begun.largest, step=now.step,
                help=now.help,
            )  # fmt: skip
            yield control, self._handle(begun.name, {begun.name: begun.value}, now.scale, _adjusted)

    def _table_controls(self, settings: Settings) -> Iterator[tuple[Control, Handle]]:
        now = build_problem(settings.experiment)
        # A damping ratio follows the stiffness: the preset's b is the one that its ratio gives now.
        as_preset = build_problem(settings.with_table(self._with_preset_damping(settings.table)).experiment)
        for place in self._places:
            impedance, begun = place.read(settings.table), place.read(self.preset.table)
            for name, quantity in QUANTITIES.items():
                if name == "torque":
                    continue
                own = {quantity.field: getattr(begun, quantity.field)}
                value = getattr(impedance, quantity.field) if name != "damping" else self._damping(now, place)
                default = own[quantity.field]
                if name == "damping":
                    own["damping_ratio"] = begun.damping_ratio
                    default = self._damping(as_preset, place)
                shown = (value / quantity.scale, default / quantity.scale)
                handle = self._handle(quantity.field, own, quantity.scale, partial(_impeded, place))
                yield self._number(place.prefix, name, "table", shown, place), handle

    def _damping(self, problem: Problem, place: Place) -> float:
        """Of a leg that the control reaches, its ratio resolved."""
        side = place.side
        if side is None:
            differing = self.preset.table.side_phases
            common = [side for side in self.problem.sides if place.phase not in differing.get(side, {})]
            side = (common or list(self.problem.sides))[0]
        return resolved_damping(problem, side, place.phase, place.joint)

    def _with_preset_damping(self, table: GaitTable) -> GaitTable:
        for place in self._places:
            begun = place.read(self.preset.table)
            changed = replace(place.read(table), damping=begun.damping, damping_ratio=begun.damping_ratio)
            table = place.write(table, changed)
        return table

    def _monitor_controls(self, settings: Settings) -> Iterator[tuple[Control, Handle]]:
        for (side, joint), item in settings.monitor.items():
            begun = self.preset.monitor[side, joint]
            for name, quantity in QUANTITIES.items():
                own = {quantity.field: getattr(begun, quantity.field)}
                shown = (getattr(item, quantity.field) / quantity.scale, own[quantity.field] / quantity.scale)
                place = Place("", joint, side)
                handle = self._handle(quantity.field, own, quantity.scale, partial(_monitored, (side, joint)))
                yield self._number(f"monitor.{side}.{joint}", name, "monitor", shown, place), handle

    @staticmethod
    def _handle(field: str, begun: Fields, scale: float, write: Write) -> Handle:
        """Of a number, which leaves nothing of the other fields."""
        others = dict.fromkeys(begun)
        return Handle(begun, lambda value: {**others, field: float(value) * scale}, write)

    def _number(
        self, prefix: str, name: str, group: str, shown: tuple[float, float], place: Place
    ) -> Control:
        quantity, (least, largest) = QUANTITIES[name], self.range_of(name, JointName(place.joint))
        return Control(
            name=f"{prefix}.{name}", label=quantity.label, group=group, kind=ControlKind.NUMBER,
            value=shown[0], default=shown[1], unit=quantity.unit, least=least, largest=largest,
            step=quantity.step, phase=place.phase or None, joint=place.joint, side=place.side,
            help=quantity.help,
        )  # fmt: skip

    def range_of(self, quantity: str, joint: JointName) -> tuple[float, float]:
        """Least and largest value of a quantity of a joint, in the unit of the control.

        ``quantity``: a key of ``QUANTITIES``. Angles: the stops, or what the table has if that is beyond.
        Stiffness: the published range, or what the table has if that is more. Damping: critical at that
        stiffness with the leg's inertia, or twice what the table has if that is more.
        """
        own = [place.read(self.preset.table) for place in self._places if place.joint == joint]
        if quantity == "equilibrium":
            low, high = self._angles[joint]
            # Whole tenths just inside the stops.
            stops = math.ceil(10.0 * low / _DEGREE) / 10.0, math.floor(10.0 * high / _DEGREE) / 10.0
            angles = (*stops, *(item.equilibrium_angle / _DEGREE for item in own))
            return min(angles), max(angles)
        if quantity == "torque":
            return -self._torque, self._torque
        if quantity == "gain":
            return 0.0, 1.0
        unit = QUANTITIES["stiffness"].scale
        stiffness = max(STIFFNESS_RANGES[joint].most, *(item.stiffness / unit for item in own))
        if quantity == "stiffness":
            return 0.0, stiffness
        critical = 2.0 * math.sqrt(stiffness * unit * self._inertias[joint])
        has = [self._damping(self.problem, place) for place in self._places if place.joint == joint]
        return 0.0, math.ceil(max(critical, 2.0 * max(has)))

    # ------------------------------------------------------------------ setting

    def set(self, settings: Settings, name: str, value: Value) -> Settings:
        """Settings with one control changed; whether they are safe is not looked at.

        Raises MessageRefused if there is no such control, or the value is out of its range.
        """
        control = next((item for item in self.controls(settings) if item.name == name), None)
        if control is None:
            raise MessageRefused(f"control: no {name!r}; the state lists them all")
        handle = self._handles[name]
        return handle.write(settings, handle.fields_of(checked(control, value)))

    def revert(self, settings: Settings, name: str) -> Settings:
        """Settings with one control, or ``all`` of them, as the session began.

        Raises MessageRefused if there is no such control.
        """
        if name == EVERYTHING:
            return self.preset
        self.controls(settings)
        if name not in self._handles:
            raise MessageRefused(f"revert: no control {name!r}; give one of the state's, or {EVERYTHING}")
        handle = self._handles[name]
        return handle.write(settings, handle.begun)


def _adjusted(settings: Settings, fields: Fields) -> Settings:
    """With another value of an adjustment of the world, in SI."""
    experiment, ((name, value),) = settings.experiment, fields.items()
    scenario = experiment.scenario.adjusted(name, value)
    return replace(settings, experiment=replace(experiment, scenario=scenario))


def _impeded(place: Place, settings: Settings, fields: Fields) -> Settings:
    impedance = replace(place.read(settings.table), **fields)
    return settings.with_table(place.write(settings.table, impedance))


def _monitored(place: tuple[Side, JointName], settings: Settings, fields: Fields) -> Settings:
    item = replace(settings.monitor[place], **fields)
    return replace(settings, monitor={**settings.monitor, place: item})
