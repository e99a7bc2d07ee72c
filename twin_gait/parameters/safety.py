"""Bounds of the safety monitor."""

from dataclasses import dataclass
from typing import Annotated

from twin_gait.parameters import quantities


@dataclass(frozen=True, kw_only=True)
class SafetyParameters(quantities.Parameters):
    """Bounds of the safety monitor, and the hold that a trip leads to.

    Joint range and highest speed are those of the URDF, torque and current limits those of
    :class:`LimitParameters`, the continuous current follows from the motor's continuous torque. Where no
    source is named a value is an assumption, chosen so that the shipped gaits stay away from it by half.

    Attributes:
        enabled: False runs without a monitor.
        stopping_deceleration: With which a joint can be braked, in [rad] / [s²], for the stop distance: the
            limit of 60 N m on the hip with the leg of a wearer, about 6 kg m².
        speed_share: Highest joint speed over that of the URDF, which is the motor's no-load speed.
        angle_step: Largest plausible change of an encoder in a tick in [rad]: 20 rad/s, five times the
            no-load speed.
        frozen_time: For so long in [s] an encoder may stand still to the last bit while the motor turns.
        frozen_speed: Inferred speed in [rad] / [s] above which a motor turns.
        model_deviation: Angle in [rad] by which an encoder may run away from the motor's model.
        model_time_constant: With which that angle is forgotten, in [s].
        model_resistance_ratio: Resistance of winding and inverter that the monitor assumes over the true one.
        torque_time: For so long in [s] a command may lie above the torque limit.
        highest_command: Largest plausible command in [N m].
        current_share: Measured current over the current limit that trips at once.
        thermal_time_constant: Of the winding in [s] (maxon EC 90 flat data sheet).
        drive_deviation: Of the measured current from what the drive was told, in [A].
        drive_time: For so long in [s] a drive may deviate.
        phase_time_out: Longest time in a phase in [s]; no phase of the shipped gaits lasts 0.8 s.
        frozen_load_time: For so long in [s] a loaded foot's sensor may stand still while the hip turns.
        least_voltage_share: Of the battery's open-circuit voltage, below which the drives are not to be
            trusted.
        voltage_time: For so long in [s] the bus may lie below that.
        hold_damping: Of the safe hold in [N m s] / [rad].
        lowering_time: In which the hold gives up the leg's weight, in [s].
    """

    enabled: bool = True
    stopping_deceleration: Annotated[quantities.AngularAcceleration, quantities.POSITIVE] = 10.0
    speed_share: Annotated[quantities.Ratio, quantities.POSITIVE] = 1.0
    angle_step: Annotated[quantities.Angle, quantities.POSITIVE] = 0.02
    frozen_time: Annotated[quantities.Time, quantities.POSITIVE] = 0.01
    frozen_speed: Annotated[quantities.AngularVelocity, quantities.NOT_NEGATIVE] = 0.3
    model_deviation: Annotated[quantities.Angle, quantities.POSITIVE] = 0.05
    model_time_constant: Annotated[quantities.Time, quantities.POSITIVE] = 0.2
    model_resistance_ratio: Annotated[quantities.Ratio, quantities.POSITIVE] = 1.0
    torque_time: Annotated[quantities.Time, quantities.POSITIVE] = 0.5
    highest_command: Annotated[quantities.Torque, quantities.POSITIVE] = 300.0
    current_share: Annotated[quantities.Ratio, quantities.POSITIVE] = 1.2
    thermal_time_constant: Annotated[quantities.Time, quantities.POSITIVE] = 52.6
    drive_deviation: Annotated[quantities.Current, quantities.POSITIVE] = 1.0
    drive_time: Annotated[quantities.Time, quantities.POSITIVE] = 0.02
    phase_time_out: Annotated[quantities.Time, quantities.POSITIVE] = 5.0
    frozen_load_time: Annotated[quantities.Time, quantities.POSITIVE] = 0.1
    least_voltage_share: Annotated[quantities.Ratio, quantities.POSITIVE] = 0.6
    voltage_time: Annotated[quantities.Time, quantities.POSITIVE] = 0.01
    hold_damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 60.0
    lowering_time: Annotated[quantities.Time, quantities.POSITIVE] = 3.0
