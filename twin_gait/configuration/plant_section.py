"""The plant as YAML: friction, motors and gears, battery, stops, orthosis."""

from __future__ import annotations

from typing import ClassVar

from twin_gait.configuration.sections import JointNumbers, PerJoint, Section
from twin_gait.configuration.validation import Number
from twin_gait.experiment import PlantParameters
from twin_gait.parameters import (
    ActuatorParameters,
    AnkleParameters,
    BatteryParameters,
    FrictionParameters,
    StopParameters,
)


class FrictionEntry(Section):
    """Rotational friction, equation (3.1)."""

    parameters: ClassVar = FrictionParameters
    breakaway_torque_Nm: Number
    coulomb_friction_Nm: Number
    breakaway_velocity_rad_per_s: Number
    viscous_friction_Nms_per_rad: Number


class JointFrictionEntry(PerJoint):
    """Friction of hip and knee."""

    hip: FrictionEntry
    knee: FrictionEntry


class ActuatorEntry(Section):
    """Motor and gear."""

    parameters: ClassVar = ActuatorParameters
    torque_constant_Nm_per_A: Number
    resistance_Ohm: Number
    rotor_inertia_kgm2: Number = ActuatorParameters.rotor_inertia
    gear_ratio: Number = ActuatorParameters.gear_ratio
    gear_inertia_kgm2: Number = ActuatorParameters.gear_inertia
    gear_efficiency: Number = ActuatorParameters.gear_efficiency
    continuous_torque_Nm: Number = ActuatorParameters.continuous_torque


class ActuatorsEntry(PerJoint):
    """Motors and gears of hip and knee."""

    hip: ActuatorEntry
    knee: ActuatorEntry


class BatteryEntry(Section):
    """The battery."""

    parameters: ClassVar = BatteryParameters
    voltage_V: Number = BatteryParameters.voltage
    internal_resistance_Ohm: Number = BatteryParameters.internal_resistance
    continuous_power_W: Number = BatteryParameters.continuous_power
    energy_J: Number = BatteryParameters.energy


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


class PlantEntry(Section):
    """The plant, beside its rigid bodies."""

    parameters: ClassVar = PlantParameters
    friction_ratio: JointNumbers | None = None
    friction: JointFrictionEntry | None = None
    load_friction: JointNumbers | None = None
    actuators: ActuatorsEntry | None = None
    battery: BatteryEntry = BatteryEntry()
    stops: StopsEntry = StopsEntry()
    ankle: AnkleEntry = AnkleEntry()
    gravity_m_per_s2: Number = PlantParameters.gravity
