"""The controller as YAML: mode, assistance, path, models, limits, safety."""

from __future__ import annotations

from typing import Any, ClassVar

from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.plant_section import JointFrictionEntry
from twin_gait.configuration.sections import JointNumbers, Section
from twin_gait.configuration.validation import Number
from twin_gait.experiment import AssistanceParameters, ControlMode, ControlParameters, PathParameters
from twin_gait.parameters import LimitParameters, SafetyParameters
from twin_gait.vocabulary import JointName


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
    mode: ControlMode = ControlMode.IMPEDANCE
    assistance: AssistanceEntry = AssistanceEntry()
    path: PathEntry = PathEntry()
    friction_model: JointFrictionEntry | None = None
    inertia_compensation: Number = 0.0
    target_torque_Nm: JointNumbers | None = None
    limits: LimitsEntry = LimitsEntry()
    safety: SafetyEntry = SafetyEntry()
    patient: PatientEntry | None = None
