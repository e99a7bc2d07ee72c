"""What the leg really is as YAML: friction, motors and gears, battery, stops, orthosis."""

from __future__ import annotations

from twin_gait.configuration.validation import Number, Strict
from twin_gait.experiment import PlantParameters
from twin_gait.parameters import (
    ActuatorParameters,
    AnkleParameters,
    BatteryParameters,
    FrictionParameters,
    StopParameters,
)
from twin_gait.vocabulary import JointName


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
    load_friction: JointNumbers | None = None
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
            load_friction=standard.load_friction
            if self.load_friction is None
            else self.load_friction.convert(),
            actuators=standard.actuators if self.actuators is None else self.actuators.convert(),
            battery=self.battery.convert(),
            stops=self.stops.convert(),
            ankle=self.ankle.convert(),
            gravity=self.gravity_m_per_s2,
        )
