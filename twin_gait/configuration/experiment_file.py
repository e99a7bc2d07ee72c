"""Experiments as YAML: the schema, with units in the keys, and its conversion to SI."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from twin_gait.configuration.control_modes import AssistanceEntry, PathEntry
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.validation import Count, Number, Strict, converting, one_of, validate
from twin_gait.exceptions import ModelError, ParameterError
from twin_gait.experiment import (
    ControlMode,
    ControlParameters,
    Engine,
    Experiment,
    Integration,
    IntegrationMethod,
    PlantParameters,
    Scenario,
    default_integration,
)
from twin_gait.leg_model import LegJoints
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.parameters import (
    ActuatorParameters,
    AnkleParameters,
    BatteryParameters,
    BeltProfile,
    ContactParameters,
    FrictionParameters,
    LimitParameters,
    SafetyParameters,
    SensorParameters,
    StopParameters,
    SupportParameters,
)
from twin_gait.scenario import BenchLegScenario, HandParameters, LegSource, TreadmillScenario
from twin_gait.scenario.faults import Fault, parse_fault
from twin_gait.vocabulary import JointName, Side

_DEGREE = math.pi / 180.0


class LegJointsEntry(Strict):
    """Joint and frame names of one leg."""

    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()

    def convert(self) -> LegJoints:
        """Convert."""
        return LegJoints(hip=self.hip, knee=self.knee, ankle=self.ankle, contact_frames=self.contact_frames)


class LegEntry(Strict):
    """URDF and joint names."""

    urdf: str = "twin.urdf"
    left: LegJointsEntry | None = None
    right: LegJointsEntry | None = None
    fit_device: bool = True
    up_axis: Literal["y", "z"] = "z"

    def convert(self, folder: Path) -> LegSource:
        """Convert; a relative path is taken from the folder of the file."""
        legs = {
            side: entry.convert()
            for side, entry in ((Side.LEFT, self.left), (Side.RIGHT, self.right))
            if entry is not None
        }
        if not legs:
            raise ParameterError("expected the joint names of left, right or both legs")
        beside = folder / self.urdf
        path = str(beside.resolve()) if beside.is_file() else self.urdf
        find_urdf(path)
        return LegSource(urdf=path, legs=legs, fit_device=self.fit_device, up_axis=self.up_axis)


class ContactEntry(Strict):
    """Foot contact."""

    stiffness_N_per_m1p5: Number = ContactParameters.stiffness
    dissipation_s_per_m: Number = ContactParameters.dissipation
    friction_coefficient: Number = ContactParameters.friction_coefficient
    transition_velocity_m_per_s: Number = ContactParameters.transition_velocity

    def convert(self) -> ContactParameters:
        """Convert."""
        return ContactParameters(
            stiffness=self.stiffness_N_per_m1p5,
            dissipation=self.dissipation_s_per_m,
            friction_coefficient=self.friction_coefficient,
            transition_velocity=self.transition_velocity_m_per_s,
        )


class SupportEntry(Strict):
    """Body-weight support."""

    share: Number = SupportParameters.share
    damping_Ns_per_m: Number = SupportParameters.damping

    def convert(self) -> SupportParameters:
        """Convert."""
        return SupportParameters(share=self.share, damping=self.damping_Ns_per_m)


class BeltEntry(Strict):
    """A belt that starts and stops."""

    start_s: Number
    stop_s: Number | None = None
    ramp_s: Number
    delay_s: Number = BeltProfile.delay

    def convert(self) -> BeltProfile:
        """Convert."""
        stop = math.inf if self.stop_s is None else self.stop_s
        return BeltProfile(start=self.start_s, stop=stop, ramp=self.ramp_s, delay=self.delay_s)


class AnglesEntry(Strict):
    """Hip and knee angle."""

    hip_deg: Number | None = None
    hip_rad: Number | None = None
    knee_deg: Number | None = None
    knee_rad: Number | None = None

    def convert(self) -> tuple[float, float]:
        """Convert to SI."""
        return (
            one_of(self, {"hip_deg": _DEGREE, "hip_rad": 1.0}),
            one_of(self, {"knee_deg": _DEGREE, "knee_rad": 1.0}),
        )


class TreadmillEntry(Strict):
    """The treadmill."""

    kind: Literal["treadmill"]
    belt_speed_m_per_s: Number | None = None
    belt_speed_km_per_h: Number | None = None
    belt: BeltEntry | None = None
    support: SupportEntry = SupportEntry()
    contact: ContactEntry = ContactEntry()
    leading: Side = Side.LEFT
    leading_start: AnglesEntry | None = None
    trailing_start: AnglesEntry | None = None
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    def convert(self) -> TreadmillScenario:
        """Convert to SI."""
        standard = TreadmillScenario()
        leading, trailing = self.leading_start, self.trailing_start
        return TreadmillScenario(
            belt_speed=one_of(self, {"belt_speed_m_per_s": 1.0, "belt_speed_km_per_h": 1.0 / 3.6}),
            belt=None if self.belt is None else self.belt.convert(),
            support=self.support.convert(),
            contact=self.contact.convert(),
            leading=self.leading,
            leading_angles=standard.leading_angles if leading is None else leading.convert(),
            trailing_angles=standard.trailing_angles if trailing is None else trailing.convert(),
            initial_phases=(self.leading_phase, self.trailing_phase),
        )


class HandEntry(Strict):
    """A hand on the bench leg."""

    joint: JointName = JointName.KNEE
    amplitude_deg: Number | None = None
    amplitude_rad: Number | None = None
    frequency_Hz: Number = HandParameters.frequency
    stiffness_Nm_per_rad: Number = HandParameters.stiffness
    damping_Nms_per_rad: Number = HandParameters.damping
    release_s: Number | None = None

    def convert(self) -> HandParameters:
        """Convert to SI."""
        return HandParameters(
            joint=self.joint,
            amplitude=one_of(self, {"amplitude_deg": _DEGREE, "amplitude_rad": 1.0}),
            frequency=self.frequency_Hz,
            stiffness=self.stiffness_Nm_per_rad,
            damping=self.damping_Nms_per_rad,
            release_time=math.inf if self.release_s is None else self.release_s,
        )


class BenchLegEntry(Strict):
    """The bench leg."""

    kind: Literal["bench_leg"]
    start: AnglesEntry | None = None
    start_phase: str | None = None
    hand: HandEntry | None = None

    def convert(self) -> BenchLegScenario:
        """Convert to SI."""
        return BenchLegScenario(
            start_angles=BenchLegScenario.start_angles if self.start is None else self.start.convert(),
            initial_phase=self.start_phase,
            hand=None if self.hand is None else self.hand.convert(),
        )


class FrictionEntry(Strict):
    """Rotational friction, equation (3.1)."""

    breakaway_torque_Nm: Number
    coulomb_friction_Nm: Number
    breakaway_velocity_rad_per_s: Number
    viscous_friction_Nms_per_rad: Number

    def convert(self) -> FrictionParameters:
        """Convert."""
        return FrictionParameters(
            breakaway_torque=self.breakaway_torque_Nm,
            coulomb_friction=self.coulomb_friction_Nm,
            breakaway_velocity=self.breakaway_velocity_rad_per_s,
            viscous_friction=self.viscous_friction_Nms_per_rad,
        )


class JointFrictionEntry(Strict):
    """Friction of hip and knee."""

    hip: FrictionEntry
    knee: FrictionEntry

    def convert(self) -> dict[JointName, FrictionParameters]:
        """Convert."""
        return {JointName.HIP: self.hip.convert(), JointName.KNEE: self.knee.convert()}


class JointNumbers(Strict):
    """A number for the hip and one for the knee."""

    hip: Number
    knee: Number

    def convert(self) -> dict[JointName, float]:
        """Convert."""
        return {JointName.HIP: self.hip, JointName.KNEE: self.knee}


class ActuatorEntry(Strict):
    """Motor and gear."""

    torque_constant_Nm_per_A: Number
    resistance_Ohm: Number
    rotor_inertia_kgm2: Number = ActuatorParameters.rotor_inertia
    gear_ratio: Number = ActuatorParameters.gear_ratio
    gear_inertia_kgm2: Number = ActuatorParameters.gear_inertia
    gear_efficiency: Number = ActuatorParameters.gear_efficiency
    continuous_torque_Nm: Number = ActuatorParameters.continuous_torque

    def convert(self) -> ActuatorParameters:
        """Convert."""
        return ActuatorParameters(
            torque_constant=self.torque_constant_Nm_per_A,
            resistance=self.resistance_Ohm,
            rotor_inertia=self.rotor_inertia_kgm2,
            gear_ratio=self.gear_ratio,
            gear_inertia=self.gear_inertia_kgm2,
            gear_efficiency=self.gear_efficiency,
            continuous_torque=self.continuous_torque_Nm,
        )


class ActuatorsEntry(Strict):
    """Motors and gears of hip and knee."""

    hip: ActuatorEntry
    knee: ActuatorEntry

    def convert(self) -> dict[JointName, ActuatorParameters]:
        """Convert."""
        return {JointName.HIP: self.hip.convert(), JointName.KNEE: self.knee.convert()}


class BatteryEntry(Strict):
    """The battery."""

    voltage_V: Number = BatteryParameters.voltage
    internal_resistance_Ohm: Number = BatteryParameters.internal_resistance
    continuous_power_W: Number = BatteryParameters.continuous_power
    energy_J: Number = BatteryParameters.energy

    def convert(self) -> BatteryParameters:
        """Convert."""
        return BatteryParameters(
            voltage=self.voltage_V,
            internal_resistance=self.internal_resistance_Ohm,
            continuous_power=self.continuous_power_W,
            energy=self.energy_J,
        )


class StopsEntry(Strict):
    """Mechanical stops."""

    stiffness_Nm_per_rad: Number = StopParameters.stiffness
    dissipation_s_per_rad: Number = StopParameters.dissipation

    def convert(self) -> StopParameters:
        """Convert."""
        return StopParameters(stiffness=self.stiffness_Nm_per_rad, dissipation=self.dissipation_s_per_rad)


class AnkleEntry(Strict):
    """Ankle-foot orthosis."""

    stiffness_Nm_per_rad: Number = AnkleParameters.stiffness
    damping_Nms_per_rad: Number = AnkleParameters.damping

    def convert(self) -> AnkleParameters:
        """Convert."""
        return AnkleParameters(stiffness=self.stiffness_Nm_per_rad, damping=self.damping_Nms_per_rad)


class PlantEntry(Strict):
    """What the leg really is."""

    friction_ratio: JointNumbers | None = None
    friction: JointFrictionEntry | None = None
    actuators: ActuatorsEntry | None = None
    battery: BatteryEntry = BatteryEntry()
    stops: StopsEntry = StopsEntry()
    ankle: AnkleEntry = AnkleEntry()
    gravity_m_per_s2: Number = PlantParameters.gravity

    def convert(self) -> PlantParameters:
        """Convert."""
        standard = PlantParameters()
        return PlantParameters(
            friction_ratio=standard.friction_ratio
            if self.friction_ratio is None
            else self.friction_ratio.convert(),
            friction=standard.friction if self.friction is None else self.friction.convert(),
            actuators=standard.actuators if self.actuators is None else self.actuators.convert(),
            battery=self.battery.convert(),
            stops=self.stops.convert(),
            ankle=self.ankle.convert(),
            gravity=self.gravity_m_per_s2,
        )


class LimitsEntry(Strict):
    """Limits of the command."""

    torque_Nm: Number = LimitParameters.torque
    current_A: Number = LimitParameters.current


class SafetyEntry(Strict):
    """Bounds of the safety monitor and its hold."""

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
    phase_overstay_s: Number = SafetyParameters.phase_overstay
    frozen_load_time_s: Number = SafetyParameters.frozen_load_time
    least_voltage_share: Number = SafetyParameters.least_voltage_share
    voltage_time_s: Number = SafetyParameters.voltage_time
    hold_damping_Nms_per_rad: Number = SafetyParameters.hold_damping
    lowering_time_s: Number = SafetyParameters.lowering_time

    def convert(self) -> SafetyParameters:
        """Convert; the keys are the names of the parameters with their units."""
        keys = safety_keys()
        return SafetyParameters(**{name: getattr(self, key) for name, key in keys.items()})


def safety_keys() -> dict[str, str]:
    """Keys of a file by the names of :class:`~twin_gait.parameters.SafetyParameters`, in order."""
    names = list(SafetyParameters.__dataclass_fields__)
    return dict(zip(names, SafetyEntry.model_fields, strict=True))


class ControlEntry(Strict):
    """The controller."""

    mode: ControlMode = ControlMode.IMPEDANCE
    assistance: AssistanceEntry = AssistanceEntry()
    path: PathEntry = PathEntry()
    friction_model: JointFrictionEntry | None = None
    inertia_compensation: Number = 0.0
    target_torque_Nm: JointNumbers | None = None
    limits: LimitsEntry = LimitsEntry()
    safety: SafetyEntry = SafetyEntry()
    patient: PatientEntry | None = None

    def convert(self) -> ControlParameters:
        """Convert."""
        standard = ControlParameters()
        return ControlParameters(
            mode=self.mode,
            assistance=self.assistance.convert(),
            path=self.path.convert(),
            friction_model=standard.friction_model
            if self.friction_model is None
            else self.friction_model.convert(),
            inertia_compensation=self.inertia_compensation,
            target_torque=standard.target_torque
            if self.target_torque_Nm is None
            else self.target_torque_Nm.convert(),
            limits=LimitParameters(torque=self.limits.torque_Nm, current=self.limits.current_A),
            safety=self.safety.convert(),
            patient=None if self.patient is None else self.patient.convert(),
        )


class SensorsEntry(Strict):
    """Encoders and filters."""

    ideal: bool = SensorParameters.ideal
    encoder_counts: Count = SensorParameters.encoder_counts
    angle_noise_deg: Number | None = None
    angle_noise_rad: Number | None = None
    fast_time_constant_s: Number = SensorParameters.fast_time_constant
    decimation: Count = SensorParameters.decimation
    window: Count = SensorParameters.window

    def convert(self) -> SensorParameters:
        """Convert to SI."""
        noise = 0.0
        if self.angle_noise_deg is not None or self.angle_noise_rad is not None:
            noise = one_of(self, {"angle_noise_deg": _DEGREE, "angle_noise_rad": 1.0})
        return SensorParameters(
            ideal=self.ideal,
            encoder_counts=self.encoder_counts,
            angle_noise=noise,
            fast_time_constant=self.fast_time_constant_s,
            decimation=self.decimation,
            window=self.window,
        )


class IntegrationEntry(Strict):
    """Integrator and step."""

    method: IntegrationMethod | None = None
    step_s: Number | None = None
    step_ms: Number | None = None

    def convert(self, default: Integration) -> Integration:
        """Convert to SI.

        Args:
            default: For what is not given.
        """
        method = default.method if self.method is None else self.method
        if self.step_s is None and self.step_ms is None:
            return Integration(method=method, step=default.step)
        return Integration(method=method, step=one_of(self, {"step_ms": 1e-3, "step_s": 1.0}))


class ProvenanceEntry(Strict):
    """What a resolved experiment was made with."""

    urdf_sha256: str | None = None
    table_sha256: str | None = None
    versions: dict[str, str] = Field(default_factory=dict)


class ExperimentFile(Strict):
    """An experiment file, presets merged in."""

    schema_version: Literal[1] = 1
    name: str = Field(min_length=1)
    description: str = ""
    scenario: Annotated[TreadmillEntry | BenchLegEntry, Field(discriminator="kind")]
    leg: LegEntry
    patient: PatientEntry | None = None
    table: dict[str, Any]
    duration_s: Number = 20.0
    control: ControlEntry = ControlEntry()
    plant: PlantEntry = PlantEntry()
    sensors: SensorsEntry = SensorsEntry()
    integration: IntegrationEntry | None = None
    engine: Engine = Engine.COMPILED
    seed: Count = 0
    faults: tuple[str, ...] = ()
    provenance: ProvenanceEntry | None = None

    @model_validator(mode="after")
    def _name_is_a_word(self) -> ExperimentFile:
        if any(character in self.name for character in "/\\\0\n"):
            raise ValueError(f"name: expected a plain name, got {self.name!r}")
        return self


def experiment_from_mapping(data: dict[str, Any], source: str, folder: Path) -> Experiment:
    """Turn a resolved mapping (presets merged, table inline) into an experiment.

    Args:
        data: The mapping.
        source: File name for messages.
        folder: Folder that relative paths start from.

    Returns:
        The experiment.

    Raises:
        ParameterFileError: If something is wrong; one line with file, key and value.
    """
    entry = validate(ExperimentFile, data, source)
    table = gait_table_from_mapping(entry.table, f"{source}: table", entry.name)
    scenario = converting(source, "scenario", lambda: _scenario(entry.scenario))
    leg = converting(source, "leg", lambda: entry.leg.convert(folder))
    if entry.provenance is not None and entry.provenance.urdf_sha256 is not None:
        wanted = entry.provenance.urdf_sha256
        converting(source, "provenance.urdf_sha256", lambda: _check_hash(leg.urdf, wanted))
    patient = entry.patient
    return converting(
        source,
        "",
        lambda: Experiment(
            name=entry.name,
            scenario=scenario,
            leg=leg,
            table=table,
            duration=entry.duration_s,
            patient=None if patient is None else converting(source, "patient", patient.convert),
            control=converting(source, "control", entry.control.convert),
            plant=converting(source, "plant", entry.plant.convert),
            sensors=converting(source, "sensors", entry.sensors.convert),
            integration=converting(source, "integration", lambda: _integration(entry, scenario)),
            engine=entry.engine,
            seed=entry.seed,
            faults=_faults(entry, source),
        ),
    )


def _integration(entry: ExperimentFile, scenario: Scenario) -> Integration | None:
    if entry.integration is None:
        return None
    return entry.integration.convert(default_integration(entry.engine, scenario))


def _faults(entry: ExperimentFile, source: str) -> tuple[Fault, ...]:
    return tuple(
        converting(source, f"faults[{index}]", partial(parse_fault, text))
        for index, text in enumerate(entry.faults)
    )


def _scenario(entry: TreadmillEntry | BenchLegEntry) -> Scenario:
    return entry.convert()


def _check_hash(urdf: str, wanted: str) -> None:
    found = urdf_hash(find_urdf(urdf))
    if found != wanted:
        raise ModelError(
            f"{urdf} is not the file that this experiment was made with (sha256 {found[:12]}…, expected "
            f"{wanted[:12]}…); restore it, or remove this key to run with the file as it is"
        )
