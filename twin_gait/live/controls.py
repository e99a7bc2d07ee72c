"""The actions of a live session as data, and what the values of their fields mean."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
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
    MonitorJoint,
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


_DEGREE = math.pi / 180.0
TORQUE_STEP = 0.05  # [N m], the step of the thesis's monitor


class Quantity(NamedTuple):
    """A parameter of an impedance as a control shows it."""

    label: str  # in words, with its letter
    unit: str  # of the control
    scale: float  # SI value of one unit
    step: float  # of the control, in its unit
    help: str  # one sentence


QUANTITIES = {
    "stiffness": Quantity("stiffness k", "Nm/deg", 1.0 / _DEGREE, 0.05, "How hard the spring pulls to θ0."),
    "damping": Quantity("damping b", "Nms/rad", 1.0, 0.5, "How much the spring's motion is braked."),
    "equilibrium": Quantity("equilibrium θ0", "deg", _DEGREE, 0.5, "Angle that the spring pulls to."),
    "gain": Quantity("friction gain G", "", 1.0, 0.01, "Share of the modelled friction that is compensated."),
    "torque": Quantity("target torque", "Nm", 1.0, TORQUE_STEP, "Added to the command in torque control."),
}
_FIELDS = {
    "stiffness": "stiffness", "damping": "damping", "equilibrium": "equilibrium_angle",
    "gain": "friction_compensation_gain", "torque": "target_torque",
}  # fmt: skip


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
        self._inertias = _inertias(self.problem)
        self._torque = experiment.control.limits.torque
        self._shown: tuple[Settings, tuple[Control, ...]] | None = None  # the last ones asked for

    # ------------------------------------------------------------------ drawing

    def controls(self, settings: Settings) -> tuple[Control, ...]:
        """All controls with the values of some settings.

        Returns controls in the order in which a page shows them.
        """
        if self._shown is not None and self._shown[0] is settings:
            return self._shown[1]
        found = (
            *self._walk_controls(settings),
            *self._table_controls(settings),
            *self._monitor_controls(settings),
        )
        self._shown = (settings, found)
        return found

    def _walk_controls(self, settings: Settings) -> Iterator[Control]:
        yield Control(
            name="mode",
            label="what drives the joints",
            group="monitor",
            kind=ControlKind.CHOICE,
            value=str(settings.mode),
            default=str(self.preset.mode),
            choices=tuple(str(item) for item in Mode),
            help="The gait table, or one of the monitor's three controls, for which the belt stands still.",
        )
        if HELD_PHASE in settings.table.phases and settings.experiment.modes is None:
            yield Control(
                name="manual",
                label="steps by hand",
                group="walk",
                kind=ControlKind.SWITCH,
                value=settings.manual,
                default=self.preset.manual,
                help="A leg at the end of stance waits for the step button, and the belt waits with it.",
            )
        yield from self._world_controls(settings)

    def _world_controls(self, settings: Settings) -> Iterator[Control]:
        presets = self.preset.experiment.scenario.adjustments
        for now, begun in zip(settings.experiment.scenario.adjustments, presets, strict=True):
            yield Control(
                name=now.name,
                label=now.label,
                group="walk",
                kind=ControlKind.NUMBER,
                value=now.shown,
                default=begun.shown,
                unit=now.unit,
                least=begun.least,
                largest=begun.largest,
                step=now.step,
                help=now.help,
            )

    def _table_controls(self, settings: Settings) -> Iterator[Control]:
        now = build_problem(settings.experiment)
        # A damping ratio follows the stiffness: the preset's b is the one that its ratio gives now.
        as_preset = build_problem(settings.with_table(self._with_preset_damping(settings.table)).experiment)
        for place in self._places:
            impedance, begun = place.read(settings.table), place.read(self.preset.table)
            for quantity in ("stiffness", "damping", "equilibrium", "gain"):
                if quantity == "damping":
                    value, default = self._damping(now, place), self._damping(as_preset, place)
                else:
                    value = getattr(impedance, _FIELDS[quantity]) / QUANTITIES[quantity].scale
                    default = getattr(begun, _FIELDS[quantity]) / QUANTITIES[quantity].scale
                yield self._number(place.prefix, quantity, "table", value, default, place=place)

    def _damping(self, problem: Problem, place: Place) -> float:
        return resolved_damping(problem, self._side_of(place), place.phase, place.joint)

    def _side_of(self, place: Place) -> Side:
        """A leg that the control reaches."""
        if place.side is not None:
            return place.side
        differing = self.preset.table.side_phases
        common = [side for side in self.problem.sides if place.phase not in differing.get(side, {})]
        return (common or list(self.problem.sides))[0]

    def _with_preset_damping(self, table: GaitTable) -> GaitTable:
        for place in self._places:
            begun = place.read(self.preset.table)
            changed = replace(place.read(table), damping=begun.damping, damping_ratio=begun.damping_ratio)
            table = place.write(table, changed)
        return table

    def _monitor_controls(self, settings: Settings) -> Iterator[Control]:
        for (side, joint), item in settings.monitor.items():
            begun = self.preset.monitor[side, joint]
            for quantity, field in _FIELDS.items():
                scale = QUANTITIES[quantity].scale
                value, default = getattr(item, field) / scale, getattr(begun, field) / scale
                prefix = f"monitor.{side}.{joint}"
                place = Place("", joint, side)
                yield self._number(prefix, quantity, "monitor", value, default, place=place)

    def _number(
        self, prefix: str, quantity: str, group: str, value: float, default: float, *, place: Place
    ) -> Control:
        least, largest = self.range_of(quantity, JointName(place.joint))
        return Control(
            name=f"{prefix}.{quantity}", label=QUANTITIES[quantity].label, group=group,
            kind=ControlKind.NUMBER, value=value, default=default, unit=QUANTITIES[quantity].unit,
            least=least, largest=largest, step=QUANTITIES[quantity].step, phase=place.phase or None,
            joint=place.joint, side=place.side, help=QUANTITIES[quantity].help,
        )  # fmt: skip

    def range_of(self, quantity: str, joint: JointName) -> tuple[float, float]:
        """Least and largest value of a quantity of a joint, in the unit of the control.

        ``quantity``: a key of ``QUANTITIES``. Returns angles: the stops, or what the table has if that is
        beyond. Stiffness: the published range, or what the table has if that is more. Damping: critical at
        that stiffness with the leg's inertia, or twice what the table has if that is more. Gain: 0 to 1.
        Torque: the limit, both ways.
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
        """Settings with one control changed.

        Returns the settings after it; whether they are safe is not looked at. Raises MessageRefused if there
        is no such control, or the value is out of its range.
        """
        controls = {item.name: item for item in self.controls(settings)}
        if name not in controls:
            raise MessageRefused(f"control: no {name!r}; the state lists them all")
        return self._changed(settings, controls[name], checked(controls[name], value))

    def _changed(self, settings: Settings, control: Control, value: Value) -> Settings:
        if control.name == "mode":
            return replace(settings, mode=Mode(str(value)))
        if control.name == "manual":
            return replace(settings, manual=bool(value))
        number = float(value)
        scales = {item.name: item.scale for item in settings.experiment.scenario.adjustments}
        if control.name in scales:
            return _adjusted(settings, control.name, number * scales[control.name])
        quantity = control.name.rpartition(".")[2]
        number *= QUANTITIES[quantity].scale
        assert control.joint is not None  # all other controls belong to a joint
        if control.group == "monitor":
            joint = (Side(str(control.side)), JointName(control.joint))
            item: MonitorJoint = replace(settings.monitor[joint], **{_FIELDS[quantity]: number})
            return replace(settings, monitor={**settings.monitor, joint: item})
        place = next(item for item in self._places if control.name == f"{item.prefix}.{quantity}")
        change: dict[str, float | None] = {_FIELDS[quantity]: number}
        if quantity == "damping":
            change["damping_ratio"] = None
        impedance = replace(place.read(settings.table), **change)  # type: ignore[arg-type]  # numbers as typed
        return settings.with_table(place.write(settings.table, impedance))

    def revert(self, settings: Settings, name: str) -> Settings:
        """Settings with one control, or everything, as the session began.

        ``name`` of the control, or ``all``. Raises MessageRefused if there is no such control.
        """
        if name == EVERYTHING:
            return self.preset
        controls = {item.name: item for item in self.controls(settings)}
        if name not in controls:
            raise MessageRefused(f"revert: no control {name!r}; give one of the state's, or {EVERYTHING}")
        prefix, _, quantity = name.rpartition(".")
        # Numbers are taken over as they were: through the unit of the control the last bit could differ.
        if controls[name].group == "table":
            place = next(item for item in self._places if item.prefix == prefix)
            begun = place.read(self.preset.table)
            fields = ("damping", "damping_ratio") if quantity == "damping" else (_FIELDS[quantity],)
            impedance = replace(place.read(settings.table), **{item: getattr(begun, item) for item in fields})
            return settings.with_table(place.write(settings.table, impedance))
        if prefix:
            joint = (Side(str(controls[name].side)), JointName(str(controls[name].joint)))
            value = getattr(self.preset.monitor[joint], _FIELDS[quantity])
            item = replace(settings.monitor[joint], **{_FIELDS[quantity]: value})
            return replace(settings, monitor={**settings.monitor, joint: item})
        begun_values = {item.name: item.value for item in self.preset.experiment.scenario.adjustments}
        if name in begun_values:
            return _adjusted(settings, name, begun_values[name])
        if name in ("mode", "manual"):
            settings = replace(settings, **{name: getattr(self.preset, name)})
        return settings


def _inertias(problem: Problem) -> dict[JointName, float]:
    """Inertia of the leg about every joint, all joints at zero, in [kg m²], armature included."""
    model = problem.control_model
    q = np.zeros(model.nv)
    return {item.joint: model.effective_inertia(q, item.control_coordinate) for item in problem.joints}


def _adjusted(settings: Settings, name: str, value: float) -> Settings:
    """With another value of an adjustment of the world, in SI."""
    experiment = settings.experiment
    return replace(
        settings, experiment=replace(experiment, scenario=experiment.scenario.adjusted(name, value))
    )
