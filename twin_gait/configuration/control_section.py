"""The controller as YAML: mode, models, limits, safety."""

from __future__ import annotations

from twin_gait.configuration.control_modes import AssistanceEntry, PathEntry
from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.plant_section import JointFrictionEntry, JointNumbers
from twin_gait.configuration.validation import Number, Strict
from twin_gait.experiment import ControlMode, ControlParameters
from twin_gait.parameters import LimitParameters, SafetyParameters


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
    phase_time_out_s: Number = SafetyParameters.phase_time_out
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
