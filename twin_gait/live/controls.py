"""Controls and actions of a live session as data: names, units, ranges, and the effect of each.

Ranges come from the physical limits of joint and drive: the stops of the URDF, the torque limit of the
motors, and 0 and 1 for gains and shares. No range ends at a value of the table, unless that is 0 or 1.
:mod:`twin_gait.live.forecast` decides whether a value within its range is safe, and warns of unusual values.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.check import build_case
from twin_gait.checking.published_ranges import STIFFNESS_RANGES
from twin_gait.configuration.validation import short
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM, STIFFNESS
from twin_gait.experiment.experiment import Experiment
from twin_gait.labels import NO_UNIT, label_of
from twin_gait.live.protocol import ActionSpec, Control, DoAction, MessageRejected, Value, check_value
from twin_gait.simulation.settings import MODES, Settings, first_settings, replace_at_path, value_at_path
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.faults import FaultKind
from twin_gait.yaml12 import load_data

EVERYTHING = "all"
_DEGREE = math.pi / 180.0
# The largest stiffness is the one with which the spring alone reaches the torque limit at this deflection,
# about the RMSE of the guided walk (hip 3.5 deg, knee 5.9 deg); the largest damping is the one with which
# the damper alone reaches it at this velocity, a tenth of the fastest knee in swing.
SATURATING_DEFLECTION = 4.0 * _DEGREE  # [rad]
SATURATING_VELOCITY = 0.5  # [rad/s]
HEADROOM = 1.5  # a range extends at least to this multiple of the largest value of the table
TORQUE_STEP = 0.05  # [N·m], step of the thesis's monitor
_SHOWN = load_data(Path(__file__).with_name("panel.yaml"))


def action_values(specs: Iterable[ActionSpec], message: DoAction) -> dict[str, Value]:
    """Return the values of an action's fields; missing ones have their initial values.

    Raises MessageRejected if a value is unknown or out of its range.
    """
    spec = next((item for item in specs if item.action == message.action), None)
    if spec is None:
        raise MessageRejected(f"{message.action}: is not available in this experiment")
    known = {item.name: item for item in spec.fields}
    for name in message.values:
        if name not in known:
            has = ", ".join(known) or "no values"
            raise MessageRejected(f"{message.action}: there is no value {name!r}; expected {has}")
    values: dict[str, Value] = {}
    for name, item in known.items():
        fitting = item.choices_by_value.get(str(values.get(item.depends_on)), ())
        begins = fitting[0] if fitting else item.value
        values[name] = check_value(item, message.values.get(name, begins))
    return values


def fault_text(values: Mapping[str, Value]) -> str:
    """Return the fault in the fields of the action as text for an experiment."""
    location, size = ("".join(str(values[name]).split()) for name in ("place", "size"))
    return f"{values['kind']}{f':{location}' if location else ''}@0s{f'={size}' if size else ''}"


def action_specs(simulation_setup: SimulationSetup) -> Iterator[ActionSpec]:
    """Yield the actions that are possible in an experiment."""
    experiment = simulation_setup.experiment
    modes, limits = experiment.modes, experiment.control.limits
    limit = max(limits[item.joint].torque for item in simulation_setup.joints)
    joints = tuple(f"{item.side}_{item.joint}" for item in simulation_setup.joints)
    requests = () if modes is None else tuple(modes.requests)
    locations = {
        str(kind): tuple(
            dict.fromkeys(kind.location(item.side, item.joint) for item in simulation_setup.joints)
        )
        for kind in FaultKind
        if simulation_setup.experiment.scenario.grounded or kind is not FaultKind.FOOT_LOAD_STUCK
    }
    anywhere = tuple(dict.fromkeys(itertools.chain(*locations.values())))
    offered = {"joint": joints, "kind": tuple(locations), "place": anywhere, "request": requests}
    options: dict[str, dict[str, Any]] = {"torque": {"minimum": -limit, "maximum": limit}}
    for name, choices in offered.items():
        options[name] = {"choices": choices, "value": next(iter(choices), "")}
    options["patient"] = {"value": (experiment.patient and experiment.patient.name) or experiment.name}
    options["place"] |= {"choices_by_value": locations, "depends_on": "kind"}
    for action, shown in _SHOWN["actions"].items():
        if action == ("step" if requests else "request"):  # with modes, requests replace steps by hand
            continue
        given = shown.get("fields", {})
        fields = tuple(Control(name=name, **field, **options.get(name, {})) for name, field in given.items())
        yield ActionSpec(action=action, **{**shown, "fields": fields})


class ControlQuantity(NamedTuple):
    """Parameter of an impedance as a control shows it, or the target torque."""

    key: str  # key of its label
    scale: float  # SI value of one unit
    step: float  # increment of the control in its unit
    field: str  # field of an impedance; empty for a torque

    @property
    def unit(self) -> str:
        """Unit of the control as text; empty for a pure number."""
        unit = label_of(self.key).display_unit
        return "" if unit == NO_UNIT else unit


QUANTITIES = {
    "stiffness": ControlQuantity("stiffness_Nm_per_deg", 1.0 / _DEGREE, 0.05, "stiffness"),
    "damping": ControlQuantity("damping_Nms_per_rad", 1.0, 0.5, "damping"),
    "equilibrium": ControlQuantity("equilibrium_deg", _DEGREE, 0.5, "equilibrium_angle"),
    "gain": ControlQuantity("friction_compensation_gain", 1.0, 0.01, "friction_compensation_gain"),
    "torque": ControlQuantity("target_torque_Nm", 1.0, TORQUE_STEP, ""),
}


_COLUMNS = {"stiffness": STIFFNESS, "damping": DAMPING, "equilibrium": EQUILIBRIUM}  # columns of a row


class Binding(NamedTuple):
    """A control and the setting that it changes."""

    control: Control  # control without its values
    path: str  # path in the settings for :func:`~twin_gait.simulation.settings.value_at_path`
    scale: float = 1.0  # SI value of one unit of the control

    def read(self, settings: Settings) -> Value:
        """Return the value of the control."""
        value: Value = value_at_path(settings, self.path)
        return float(value or 0.0) / self.scale if self.control.kind == "number" else value

    def with_value(self, settings: Settings, value: Value) -> Settings:
        """Return settings with another value of the control."""
        number = self.control.kind == "number"
        turned: Settings = replace_at_path(
            settings, self.path, float(value) * self.scale if number else value
        )
        return turned


class ControlPanel:
    """Controls of one experiment.

    Attributes:
        preset: Initial settings of the session.
        simulation_setup: Simulation setup of the initial experiment.
    """

    def __init__(self, experiment: Experiment) -> None:
        """Find the ranges of all controls."""
        self.preset: Settings = first_settings(experiment)
        self.simulation_setup: SimulationSetup = self.preset.setup
        self._stops = build_case(experiment.table, experiment).limits
        self._dampings: dict[str, tuple[int, int, int]] = {}  # indices of the table's dampings in phase_rows
        bindings = (*self._own_bindings(), *self._table_bindings(), *self._monitor_bindings())
        self._bindings = {item.control.name: item for item in bindings}
        self._initial_values = self._values(self.preset)

    # ------------------------------------------------------------------ drawing

    def controls(self, settings: Settings) -> tuple[Control, ...]:
        """Return all controls with the values of some settings, in the order of the page."""
        now, begun = self._values(settings), self._initial_values
        return tuple(
            replace(binding.control, value=now[name], default=begun[name], changed=name in settings.changes)
            for name, binding in self._bindings.items()
        )

    def _values(self, settings: Settings) -> dict[str, Value]:
        shown = {name: binding.read(settings) for name, binding in self._bindings.items()}
        rows = settings.setup.phase_rows  # with damping ratios resolved
        return shown | {name: float(rows[index]) for name, index in self._dampings.items()}

    def _own_bindings(self) -> Iterator[Binding]:
        """Yield the controls of mode, manual steps and adjustable values of the world."""
        experiment = self.preset.experiment
        yield Binding(Control(name="mode", choices=MODES, **_SHOWN["controls"]["mode"]), "mode")
        if experiment.stepped_by_hand:
            yield Binding(Control(name="manual", **_SHOWN["controls"]["manual"]), "manual")
        for item in experiment.scenario.adjustments:
            control = Control(
                name=item.name, label=item.label, group="walk", kind="number", unit=item.unit,
                minimum=item.minimum, maximum=item.maximum, step=item.step, help=item.help,
            )  # fmt: skip
            yield Binding(control, f"experiment.scenario.{item.path}", item.scale)

    def _table_bindings(self) -> Iterator[Binding]:
        """Yield the controls of every phase and joint; phases that differ by side have their own controls."""
        table, sides = self.preset.table, self.simulation_setup.sides
        for number, phase in enumerate(table.phases):
            separate = [side for side in sides if phase in table.side_phases.get(side, {})]
            common = [side for side in sides if side not in separate][:1]
            for joint_index, joint in enumerate(table.joints):
                for side in (*common, *separate):
                    only = side if side in separate else None
                    phases = f"side_phases.{only}" if only else "phases"
                    name = f"{only}.{phase}.{joint}" if only else f"{phase}.{joint}"
                    path = f"experiment.table.{phases}.{phase}.joints.{joint}"
                    column = COLUMNS_PER_JOINT * joint_index + DAMPING
                    self._dampings[f"{name}.damping"] = sides.index(side), number, column
                    yield from self._joint_bindings(name, path, joint, side=only, phase=phase)

    def _monitor_bindings(self) -> Iterator[Binding]:
        for side, phase in self.preset.monitor.items():
            for joint in phase.joints:
                path = f"monitor.{side}.joints.{joint}"
                yield from self._joint_bindings(f"monitor.{side}.{joint}", path, joint, side=side)

    def _joint_bindings(
        self, name: str, path: str, joint: str, *, side: Side | None, phase: str | None = None
    ) -> Iterator[Binding]:
        """Yield the controls of an impedance at a path and, for the monitor, of the target torque."""
        for quantity, shown in QUANTITIES.items():
            if not shown.field and phase is not None:
                continue
            least, largest = self.control_range(quantity, JointName(joint))
            control = Control(
                name=f"{name}.{quantity}", label=label_of(shown.key).full_name,
                group="table" if phase else "monitor", kind="number", unit=shown.unit, minimum=least,
                maximum=largest, step=shown.step, phase=phase, joint=joint, side=side,
            )  # fmt: skip
            value_path = f"{path}.{shown.field}" if shown.field else f"torques.{side}_{joint}"
            yield Binding(control, value_path, shown.scale)

    def control_range(self, quantity: str, joint: JointName) -> tuple[float, float]:
        """Return the smallest and the largest value of a quantity of a joint in the unit of the control.

        ``quantity``: a key of ``QUANTITIES``. Torque: the limit of the motors. Stiffness and damping: the
        value with which the spring or the damper alone reaches that limit at ``SATURATING_DEFLECTION`` or
        ``SATURATING_VELOCITY``, and at least ``HEADROOM`` times the largest value of the table. Equilibrium:
        the stops and all values of the table, extended on both sides by the deflection with which the
        stiffest published spring reaches the torque limit: an equilibrium beyond a stop is a torque towards
        it.
        """
        limit = self.preset.experiment.control.limits[joint].torque
        if quantity == "torque":
            return -limit, limit
        if quantity == "gain":
            return 0.0, 1.0
        table = self.preset.table
        column = COLUMNS_PER_JOINT * table.joints.index(joint) + _COLUMNS[quantity]
        values = self.simulation_setup.phase_rows[..., column].ravel()  # values scaled to the wearer
        if quantity == "stiffness":
            sides = (table.phases, *table.side_phases.values())
            given = [one.joints[joint].stiffness for phases in sides for one in phases.values()]
            values = np.append(values, given)
        if quantity == "equilibrium":
            angles = np.append(values, self._stops[joint]) / _DEGREE
            beyond = limit / STIFFNESS_RANGES[joint].high
            return math.floor(angles.min() - beyond), math.ceil(angles.max() + beyond)
        error = SATURATING_DEFLECTION if quantity == "stiffness" else SATURATING_VELOCITY
        largest = max(limit / error, HEADROOM * values.max())
        return 0.0, math.ceil(largest / QUANTITIES[quantity].scale)

    # ------------------------------------------------------------------ setting

    def set(self, settings: Settings, name: str, value: Value) -> Settings:
        """Return settings with one control changed, without checking that they are safe.

        Raises MessageRejected if there is no such control, or if the value is out of its range.
        """
        return self._apply_changes({**settings.changes, name: check_value(self._control(name), value)})

    def set_all(self, settings: Settings, changes: Mapping[str, Value | None]) -> Settings:
        """Return settings with several controls changed; None reverts a control to the preset.

        Raises MessageRejected as :meth:`set` does.
        """
        for name, value in changes.items():
            settings = self.revert(settings, name) if value is None else self.set(settings, name, value)
        return settings

    def revert(self, settings: Settings, name: str) -> Settings:
        """Return settings with one control, or ``all`` of them, reverted to the start of the session.

        Raises MessageRejected if there is no such control.
        """
        if name == EVERYTHING:
            return self.preset
        reverted = self._control(name).name
        return self._apply_changes({key: value for key, value in settings.changes.items() if key != reverted})

    def _control(self, name: str) -> Control:
        if name not in self._bindings:
            raise MessageRejected(f"control: there is no {short(name)}; the state contains all controls")
        return self._bindings[name].control

    def _apply_changes(self, changes: Mapping[str, Value]) -> Settings:
        settings = replace(self.preset, changes=changes)
        for name, value in changes.items():
            settings = self._bindings[name].with_value(settings, value)
        return settings
