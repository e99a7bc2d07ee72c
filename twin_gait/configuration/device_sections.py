"""The device as YAML: drives, friction, battery, stops, orthosis, controller, interface to the wearer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.sections import JointNumbers, PerJoint, Section
from twin_gait.configuration.validation import Number, Strict, of_kind
from twin_gait.control import AssistanceParameters, PathParameters
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import (
    ControlMode,
    ControlParameters,
    PlantParameters,
)
from twin_gait.parameters import (
    HIP_FRICTION,
    KNEE_FRICTION,
    ActuatorParameters,
    AnkleParameters,
    AsymmetricFriction,
    BatteryParameters,
    BraceParameters,
    ElectronicsParameters,
    FrictionParameters,
    LimitParameters,
    LuGreFriction,
    SafetyParameters,
    SpringDamper,
    StopParameters,
    StribeckFriction,
)
from twin_gait.vocabulary import JointName


class FrictionEntry(Section):
    """Rotational friction, equation (3.1): the law where none is named."""

    parameters: ClassVar = FrictionParameters
    law: Literal["rotational"] = "rotational"
    breakaway_torque_Nm: Number
    coulomb_friction_Nm: Number
    breakaway_velocity_rad_per_s: Number
    viscous_friction_Nms_per_rad: Number


class JointFrictionEntry(PerJoint):
    """Friction of hip and knee as the compensator models it."""

    hip: FrictionEntry
    knee: FrictionEntry


_DIRECTIONS = ("viscous_friction_forward", "viscous_friction_backward")


class StribeckFrictionEntry(Section):
    """Friction with a Stribeck curve and directions of its own; keys as ``identify`` reports them."""

    parameters: ClassVar[type[StribeckFriction]] = StribeckFriction
    coulomb_friction_Nm: Number
    breakaway_torque_Nm: Number | None = None
    stribeck_velocity_rad_per_s: Number | None = None
    stribeck_exponent: Number | None = None
    viscous_friction_Nms_per_rad: Number | None = None
    viscous_friction_forward_Nm: Number | None = None
    viscous_friction_backward_Nm: Number | None = None
    viscous_exponent: Number | None = None
    offset_Nm: Number | None = None

    def values(self) -> dict[str, Any]:
        """Fields that are given; a linear viscous friction is that of both directions."""
        values, both = super().values(), self.viscous_friction_Nms_per_rad
        if both is None:
            return values
        linear = dict.fromkeys(_DIRECTIONS, both) | {"viscous_exponent": 1.0}
        if any(values[name] != linear[name] for name in linear if name in values):
            raise ParameterError(
                f"viscous_friction_Nms_per_rad: {both:g} is linear and of both directions; leave it out "
                "beside viscous_friction_forward_Nm, viscous_friction_backward_Nm or viscous_exponent"
            )
        return {**values, **linear}

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """As the mapping of a file: the name of the law and what is given."""
        given = {key: value for key, value in super().document(parameters).items() if value is not None}
        forward, backward = (getattr(parameters, name) for name in _DIRECTIONS)
        if forward == backward and parameters.viscous_exponent == 1.0:
            for key in ("viscous_friction_forward_Nm", "viscous_friction_backward_Nm", "viscous_exponent"):
                del given[key]
            given["viscous_friction_Nms_per_rad"] = forward
        return {"law": cls.model_fields["law"].default, **given}


class AsymmetricFrictionEntry(StribeckFrictionEntry):
    """A static law that differs between the directions."""

    parameters: ClassVar = AsymmetricFriction
    law: Literal["asymmetric"] = "asymmetric"
    transition_velocity_rad_per_s: Number


class LuGreFrictionEntry(StribeckFrictionEntry):
    """LuGre's bristles; Dahl's without break-away torque and bristle damping."""

    parameters: ClassVar = LuGreFriction
    law: Literal["lugre"] = "lugre"
    bristle_stiffness_Nm_per_rad: Number
    bristle_damping_Nms_per_rad: Number | None = None


def _with_law(value: Any) -> Any:
    return {"law": "rotational", **value} if isinstance(value, Mapping) else value


PlantFrictionEntry = Annotated[
    FrictionEntry | AsymmetricFrictionEntry | LuGreFrictionEntry,
    Field(discriminator="law"),
    BeforeValidator(_with_law),
]


class PlantFrictionsEntry(PerJoint):
    """True friction of hip and knee; a joint that is left out has table 3.1."""

    hip: PlantFrictionEntry = FrictionEntry(**FrictionEntry.document(HIP_FRICTION))
    knee: PlantFrictionEntry = FrictionEntry(**FrictionEntry.document(KNEE_FRICTION))


class ActuatorEntry(Section):
    """Motor and gear of a joint; what is left out is that of TWIN's."""

    parameters: ClassVar = ActuatorParameters
    torque_constant_Nm_per_A: Number | None = None
    resistance_Ohm: Number | None = None
    rotor_inertia_kgm2: Number | None = None
    gear_ratio: Number | None = None
    gear_inertia_kgm2: Number | None = None
    gear_efficiency: Number | None = None
    continuous_torque_Nm: Number | None = None


class ActuatorsEntry(PerJoint):
    """Motors and gears of hip and knee."""

    hip: ActuatorEntry = ActuatorEntry()
    knee: ActuatorEntry = ActuatorEntry()

    def _of(self, joint: JointName) -> ActuatorParameters:
        default, given = PlantParameters().actuators[joint], getattr(self, joint).values()
        try:
            return replace(default, **given)
        except ParameterError as error:
            raise ParameterError(f"{joint}.{error}") from error


class BatteryEntry(Section):
    """The battery."""

    parameters: ClassVar = BatteryParameters
    voltage_V: Number = BatteryParameters.voltage
    internal_resistance_Ohm: Number = BatteryParameters.internal_resistance
    continuous_power_W: Number = BatteryParameters.continuous_power
    energy_J: Number = BatteryParameters.energy


class ElectronicsEntry(Section):
    """Inverters, computers, and what braking motors give back."""

    parameters: ClassVar = ElectronicsParameters
    inverter_resistance_Ohm: Number = ElectronicsParameters.inverter_resistance
    inverter_power_W: Number = ElectronicsParameters.inverter_power
    constant_power_W: Number = ElectronicsParameters.constant_power
    regeneration: Number = ElectronicsParameters.regeneration


class StopsEntry(Section):
    """Mechanical stops."""

    parameters: ClassVar = StopParameters
    stiffness_Nm_per_rad: Number = StopParameters.stiffness
    dissipation_s_per_rad: Number = StopParameters.dissipation


class AnkleEntry(Section):
    """Ankle-foot orthosis."""

    parameters: ClassVar = AnkleParameters
    stiffness_Nm_per_rad: Number = AnkleParameters.stiffness
    damping_Nms_per_rad: Number = AnkleParameters.damping
    rest_deg: Number | None = None
    rest_rad: Number | None = None


class PlantEntry(Section):
    """The plant, beside its rigid bodies."""

    parameters: ClassVar = PlantParameters
    friction_ratio: JointNumbers | None = None
    friction: PlantFrictionsEntry | None = None
    actuators: ActuatorsEntry | None = None
    battery: BatteryEntry = BatteryEntry()
    electronics: ElectronicsEntry = ElectronicsEntry()
    stops: StopsEntry = StopsEntry()
    ankle: AnkleEntry = AnkleEntry()
    gravity_m_per_s2: Number = PlantParameters.gravity

    @model_validator(mode="before")
    @classmethod
    def _without_load_friction(cls, data: Any) -> Any:
        """Runs from before the efficiency of a gear cost torque say that they had no load friction."""
        if not isinstance(data, Mapping) or "load_friction" not in data:
            return data
        if data["load_friction"] not in (None, {"hip": 0.0, "knee": 0.0}):
            raise ValueError("load_friction is gone; set actuators.hip.gear_efficiency to 1 less it")
        return {key: value for key, value in data.items() if key != "load_friction"}


class AssistanceEntry(Section):
    """Assistance level: the share of the impedance that is applied."""

    parameters: ClassVar = AssistanceParameters
    hip: Number = 1.0
    knee: Number = 1.0
    adaptive: bool = AssistanceParameters.adaptive
    forgetting: Number = AssistanceParameters.forgetting
    gain_per_rad: Number = AssistanceParameters.gain
    allowance_deg: Number | None = None
    allowance_rad: Number | None = None
    least: Number = AssistanceParameters.least

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        return {"share": {JointName.HIP: self.hip, JointName.KNEE: self.knee}, **super().values()}

    @classmethod
    def document(cls, parameters: AssistanceParameters) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        share = {str(joint): value for joint, value in parameters.share.items()}
        return share | super().document(parameters)


class PathEntry(Section):
    """Spring and damper that track the predetermined path."""

    parameters: ClassVar = PathParameters
    stiffness_Nm_per_deg: JointNumbers | None = None
    stiffness_Nm_per_rad: JointNumbers | None = None
    damping_ratio: Number = PathParameters.damping_ratio
    friction_compensation_gain: Number = PathParameters.friction_compensation_gain
    gravity_compensation: Number = PathParameters.gravity_compensation


class LimitsEntry(Section):
    """Limits of the command."""

    parameters: ClassVar = LimitParameters
    torque_Nm: Number = LimitParameters.torque
    current_A: Number = LimitParameters.current


class SafetyEntry(Section):
    """Bounds of the safety monitor and its hold."""

    parameters: ClassVar = SafetyParameters
    enabled: bool = SafetyParameters.enabled
    stopping_deceleration_rad_per_s2: Number = SafetyParameters.stopping_deceleration
    speed_share: Number = SafetyParameters.speed_share
    angle_step_rad: Number = SafetyParameters.angle_step
    frozen_time_s: Number = SafetyParameters.frozen_time
    frozen_speed_rad_per_s: Number = SafetyParameters.frozen_speed
    model_deviation_rad: Number = SafetyParameters.model_deviation
    model_time_constant_s: Number = SafetyParameters.model_time_constant
    model_resistance_ratio: Number = SafetyParameters.model_resistance_ratio
    torque_time_s: Number = SafetyParameters.torque_time
    highest_command_Nm: Number = SafetyParameters.highest_command
    current_share: Number = SafetyParameters.current_share
    thermal_time_constant_s: Number = SafetyParameters.thermal_time_constant
    drive_deviation_A: Number = SafetyParameters.drive_deviation
    drive_time_s: Number = SafetyParameters.drive_time
    phase_time_out_s: Number = SafetyParameters.phase_time_out
    frozen_load_time_s: Number = SafetyParameters.frozen_load_time
    least_voltage_share: Number = SafetyParameters.least_voltage_share
    voltage_time_s: Number = SafetyParameters.voltage_time
    hold_damping_Nms_per_rad: Number = SafetyParameters.hold_damping
    lowering_time_s: Number = SafetyParameters.lowering_time


class ControlEntry(Section):
    """The controller."""

    parameters: ClassVar = ControlParameters
    mode: ControlMode = ControlParameters.mode
    assistance: AssistanceEntry = AssistanceEntry()
    path: PathEntry = PathEntry()
    friction_model: JointFrictionEntry | None = None
    inertia_compensation: Number = 0.0
    target_torque_Nm: JointNumbers | None = None
    limits: LimitsEntry = LimitsEntry()
    safety: SafetyEntry = SafetyEntry()
    patient: PatientEntry | None = None
    delay_s: Number | None = None
    delay_ms: Number | None = None


PLACES = ("pelvis", "hip", "knee", "ankle")


class TurningBraceEntry(Section):
    """Spring and damper of a brace at a joint."""

    parameters: ClassVar = SpringDamper
    stiffness_Nm_per_rad: Number | None = None
    damping_Nms_per_rad: Number | None = None


class SlidingBraceEntry(Section):
    """Spring and damper of the brace at the pelvis."""

    parameters: ClassVar = SpringDamper
    stiffness_N_per_m: Number | None = None
    damping_Ns_per_m: Number | None = None


class InterfaceEntry(Strict):
    """Between wearer and device: ``rigid``, ``brace``, or a mapping with such a ``kind``."""

    kind: Literal["rigid", "brace"]
    pelvis: SlidingBraceEntry | None = None
    hip: TurningBraceEntry | None = None
    knee: TurningBraceEntry | None = None
    ankle: TurningBraceEntry | None = None

    @model_validator(mode="before")
    @classmethod
    def _word_for_a_mapping(cls, value: Any) -> Any:
        return of_kind(value, "rigid, brace")

    @model_validator(mode="after")
    def _rigid_has_no_springs(self) -> InterfaceEntry:
        given = [name for name in PLACES if getattr(self, name) is not None]
        if self.kind == "rigid" and given:
            raise ValueError(f"rigid has no {given[0]}: set kind to brace, or interface to rigid as a whole")
        return self

    def convert(self) -> BraceParameters | None:
        """Convert; None for one body."""
        if self.kind == "rigid":
            return None
        standard = BraceParameters()
        found = {}
        for name in PLACES:
            entry, default = getattr(self, name), getattr(standard, name)
            try:
                found[name] = default if entry is None else replace(default, **entry.values())
            except ParameterError as error:
                raise ParameterError(f"{name} {error}") from error
        return BraceParameters(**found)


def interface_document(braces: BraceParameters | None) -> dict[str, Any]:
    """What binds wearer and device as the mapping of a file."""
    if braces is None:
        return {"kind": "rigid"}
    kinds = {name: TurningBraceEntry if name in list(JointName) else SlidingBraceEntry for name in PLACES}
    return {"kind": "brace", **{name: kinds[name].document(getattr(braces, name)) for name in PLACES}}
