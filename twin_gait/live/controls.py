"""The controls of a live session as data: names, units, ranges, present values, and what setting one does.

Ranges are those that other parts of the program go by: angles end at the stops of the URDF, stiffness at the
published ranges of the check or what the table itself has, torque at the limit of the motors, gain and shares
at 0 and 1. Whether a value within its range is safe is for :mod:`twin_gait.live.rules` to say.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.checking.check import build_case
from twin_gait.checking.sense import STIFFNESS_RANGES
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.live.actions import EVERYTHING
from twin_gait.live.protocol import Control, ControlKind, MessageRefused, Value
from twin_gait.live.protocol.to_page import checked
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
