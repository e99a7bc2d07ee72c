"""Parameters of motors and gears, battery, limits of the command, safety monitor, and encoders."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName, Side

# Efficiency below which a back-driven gear locks itself.
MIN_GEAR_EFFICIENCY = 0.5
EFFICIENCIES = quantities.Range(MIN_GEAR_EFFICIENCY, 1.0, words=f"{MIN_GEAR_EFFICIENCY:g} to 1")

ROTORS = quantities.Range(0.0, 0.01, reason="thirty times the inertia of the motors, 3.06e-4 kg·m²")


@dataclass(frozen=True, kw_only=True)
class ActuatorParameters(quantities.Parameters):
    """Motor and harmonic drive of one joint.

    Attributes:
        torque_constant: Torque constant K_t of the motor in [N·m/A].
        resistance: Terminal resistance, line to line, in [Ω].
        rotor_inertia: Inertia of the rotor in [kg·m²], at the motor.
        gear_ratio: Motor turns per joint turn.
        gear_inertia: Inertia of the wave generator in [kg·m²], at the motor.
        gear_efficiency: Efficiency η of the gear under load, in addition to the friction law, which is that
            of a joint without load: the share of the motor's torque that the joint receives, or of the
            joint's torque that the motor receives when it is back-driven
            (:func:`twin_gait.core.friction.gear_loss_torque`). 0.5 to 1; 1 is no such loss.
        continuous_torque: Torque that the motor can hold, before the gear's losses, in [N·m].
        inductance: Inductance of the winding, line to line, in [H], for the current loop of the joint bench;
            None if it is not known.
        peak_torque: Repeated peak torque of the gear in [N·m], the ceiling of the joint's torque limit; None
            if it is not known.
        peak_current: Largest current of motor and inverter in [A], from which the ceiling follows without a
            peak torque; None if it is not known.
    """

    torque_constant: Annotated[quantities.TorqueConstant, quantities.POSITIVE]
    resistance: Annotated[quantities.Resistance, quantities.POSITIVE]
    rotor_inertia: Annotated[quantities.Inertia, ROTORS]
    gear_ratio: Annotated[quantities.Ratio, quantities.POSITIVE]
    gear_inertia: Annotated[quantities.Inertia, ROTORS]
    gear_efficiency: Annotated[quantities.Ratio, EFFICIENCIES]
    continuous_torque: Annotated[quantities.Torque, quantities.POSITIVE]
    inductance: Annotated[quantities.Inductance | None, quantities.POSITIVE] = None
    peak_torque: Annotated[quantities.Torque | None, quantities.POSITIVE] = None
    peak_current: Annotated[quantities.Current | None, quantities.POSITIVE] = None

    @property
    def armature(self) -> float:
        """Inertia of rotor and wave generator seen at the joint, in [kg·m²]."""
        return (self.rotor_inertia + self.gear_inertia) * self.gear_ratio * self.gear_ratio

    def torque_ceiling(self, voltage: float) -> float:
        r"""Return the highest torque limit that the drive allows, in [N·m].

        This is the repeated peak torque of the gear, if it is stated. Otherwise the drive limits the torque:
        :math:`K_t\,\tau\,\eta\,I` with the peak current, or without one with the current
        :math:`U / R` of the standing motor at a voltage in [V].
        """
        if self.peak_torque is not None:
            return self.peak_torque
        current = voltage / self.resistance if self.peak_current is None else self.peak_current
        return self.torque_constant * self.gear_ratio * self.gear_efficiency * current


PACKS = quantities.Range(0.0, 10.0, reason="fifty times the resistance of a pack of this size")


@dataclass(frozen=True, kw_only=True)
class BatteryParameters(quantities.Parameters):
    """Battery pack.

    Attributes:
        voltage: Open-circuit voltage in [V].
        internal_resistance: Internal resistance in [Ω].
        continuous_power: Continuous power in [W].
        energy: Energy in [J].
    """

    voltage: Annotated[quantities.Voltage, quantities.POSITIVE]
    internal_resistance: Annotated[quantities.Resistance, PACKS]
    continuous_power: Annotated[quantities.Power, quantities.POSITIVE]
    energy: Annotated[quantities.Energy, quantities.POSITIVE]


@dataclass(frozen=True, kw_only=True)
class ElectronicsParameters(quantities.Parameters):
    """Loads of the battery in addition to the windings, and the share of regenerated power.

    Attributes:
        inverter_resistance: Resistance of the two switches and the shunt that carry the current of a motor,
            in [Ω].
        inverter_power: Constant power of each inverter in [W]: gates and switching.
        constant_power: Power of computers, sensors and radio in [W].
        regeneration: Share that returns to the battery of the power that braking motors feed into the bus
            beyond its other loads; 0 for a brake chopper.
    """

    inverter_resistance: Annotated[quantities.Resistance, quantities.NOT_NEGATIVE]
    inverter_power: Annotated[quantities.Power, quantities.NOT_NEGATIVE]
    constant_power: Annotated[quantities.Power, quantities.NOT_NEGATIVE]
    regeneration: Annotated[quantities.Ratio, quantities.SHARE]


@dataclass(frozen=True, kw_only=True)
class LimitParameters(quantities.Parameters):
    """Limits of a joint. The torque that its motor can hold is ``continuous_torque`` of the drive.

    Attributes:
        torque: Limit of the motor torque at the joint in [N·m], at most the ceiling of the drive
            (:meth:`ActuatorParameters.torque_ceiling`).
        current: Limit of the motor current in [A].
        highest_speed: Highest joint speed in [rad/s], at most that of the URDF; None for that of the URDF.
        lowest_angle: Lowest joint angle in [rad], not below that of the URDF; None for that of the URDF.
        highest_angle: Highest joint angle in [rad], not above that of the URDF; None for that of the URDF.
    """

    torque: Annotated[quantities.Torque, quantities.POSITIVE]
    current: Annotated[quantities.Current, quantities.POSITIVE]
    highest_speed: Annotated[quantities.AngularVelocity | None, quantities.POSITIVE] = None
    lowest_angle: quantities.Angle | None = None
    highest_angle: quantities.Angle | None = None

    def __post_init__(self) -> None:
        """Check the ranges, and that the lowest angle is below the highest one."""
        super().__post_init__()
        if self.lowest_angle is not None and self.highest_angle is not None:
            below = f"below highest_angle, {self.highest_angle:g} rad"
            require(self.lowest_angle < self.highest_angle, "lowest_angle", below, self.lowest_angle)


# Calibration by eye leaves 1 to 3 deg, either way (an assumption).
LARGEST_OFFSET = math.radians(10.0)  # [rad]
OFFSETS = quantities.Range(
    -LARGEST_OFFSET, LARGEST_OFFSET, words=f"{LARGEST_OFFSET:.4f} rad (10 deg) at most, either way"
)


# Positions on the trunk at which a backpack can hold an inertial unit.
HEIGHTS = quantities.Range(0.0, 1.0, reason="from the hips to above the head")
DEPTHS = quantities.Range(-0.5, 0.5, reason="within the depth of a trunk with its backpack")


@dataclass(frozen=True, kw_only=True)
class TrunkSensorParameters(quantities.Parameters):
    """Inertial unit in the backpack, and the filter that estimates the pitch of a free trunk from it.

    Attributes:
        height: Height of the unit above the hips, along the trunk, in [m] (an assumption).
        behind: Distance of the unit behind the line from hips to shoulders in [m] (an assumption).
        gyroscope_noise: Standard deviation of a sample at 1 kHz in [rad/s]; white.
        gyroscope_bias: Bias of the angular rate in [rad/s] (an assumption: 0.1 deg/s, as after a
            calibration at rest).
        accelerometer_noise: Standard deviation of a sample of each axis in [m/s²]; white.
        accelerometer_bias: Bias of the forward axis in [m/s²] (an assumption: 5 mg, as after a
            calibration at rest).
        time_constant: Time constant with which the pitch follows the accelerometer in [s] (an assumption:
            with it the steps of the walk on the floor cause an error of 0.8 deg, with 0.5 s one of 4
            deg; the bias of the gyroscope adds 0.3 deg).
    """

    height: Annotated[quantities.Length, HEIGHTS]
    behind: Annotated[quantities.Length, DEPTHS]
    gyroscope_noise: Annotated[quantities.AngularVelocity, quantities.NOT_NEGATIVE]
    gyroscope_bias: quantities.AngularVelocity
    accelerometer_noise: Annotated[quantities.Acceleration, quantities.NOT_NEGATIVE]
    accelerometer_bias: quantities.Acceleration
    time_constant: Annotated[quantities.Time, quantities.POSITIVE]


COUNTS = quantities.integer_range(1, 2**26, "the finest encoders")
# A mean over more ticks does not represent a velocity of a gait; the samples are kept in memory.
LONGEST_WINDOW = 2000  # Length in ticks; the delay of 0.5 s that the thesis states takes 1010.
SAMPLES = quantities.integer_range(1, LONGEST_WINDOW, "at most 2 s of samples")


@dataclass(frozen=True, kw_only=True)
class SensorParameters(quantities.Parameters):
    """Encoders and the velocity estimates of the firmware, and the inertial unit on the trunk.

    Attributes:
        ideal: True for angles that are exact except for the offset, and an exact pitch; the velocity filters
            stay.
        encoder_counts: Counts per motor turn (an assumption).
        angle_noise: Standard deviation of white noise on the motor-side angle, seen at the joint, in [rad].
        offset: Calibration error of the joints in [rad], from the start: reading of the encoder minus the
            angle. A joint that is not named has none.
        fast_time_constant: Time constant of ``velocity_fast`` in [s].
        decimation: Number of ticks between two encoder differences of ``velocity_slow``.
        window: Number of samples in the moving average of ``velocity_slow``.
        trunk: Inertial unit of a free trunk.
    """

    ideal: bool
    encoder_counts: Annotated[int, COUNTS]
    angle_noise: Annotated[quantities.Angle, quantities.NOT_NEGATIVE]
    offset: Annotated[
        Mapping[Side, Mapping[JointName, quantities.Angle]], OFFSETS, quantities.UnitInKeys()
    ] = field(default_factory=dict)
    fast_time_constant: Annotated[quantities.Time, quantities.NOT_NEGATIVE]
    decimation: Annotated[int, SAMPLES]
    window: Annotated[int, SAMPLES]
    trunk: TrunkSensorParameters

    def __post_init__(self) -> None:
        """Check the ranges, and that there is no noise on ideal encoders."""
        super().__post_init__()
        span, most = self.window * self.decimation, f"at most {LONGEST_WINDOW} ticks with the decimation"
        require(span <= LONGEST_WINDOW, "window", f"{most} of {self.decimation}", self.window)
        fits = not self.ideal or self.angle_noise == 0.0
        require(fits, "angle_noise", "0, or ideal: false", self.angle_noise)


# Bounds beyond which a monitor detects nothing; to run without a monitor, switch it off as a whole.
SHARES = quantities.Range(0.0, 5.0, exclusive_minimum=True, reason="a larger share of a limit is no limit")
STEPS = quantities.Range(
    0.0, 0.2, exclusive_minimum=True, reason="200 rad/s, fifty times the speed of the drives"
)
DEVIATIONS = quantities.Range(
    0.0, 0.5, exclusive_minimum=True, reason="29 deg; a leg falls at a smaller angle"
)
REACTIONS = quantities.Range(
    0.0, 1.0, exclusive_minimum=True, reason="after 1 s a leg has moved through its range"
)
OVERLOADS = quantities.Range(
    0.0, 10.0, exclusive_minimum=True, reason="a fifth of the winding's time constant"
)
VOLTAGES = quantities.Range(0.0, 1.0, exclusive_minimum=True, reason="a share of the open-circuit voltage")
LOWERINGS = quantities.Range(0.0, 60.0, exclusive_minimum=True, reason="a longer hold is not plausible")


@dataclass(frozen=True, kw_only=True)
class SafetyParameters(quantities.Parameters):
    """Bounds of the safety monitor, and the hold after a trip.

    Joint range, highest speed, torque and current are those of :class:`LimitParameters`, the continuous
    current follows from the motor's continuous torque. A value without a named source is an assumption,
    chosen so that the shipped gaits stay away from it by half.

    Attributes:
        enabled: Whether the monitor is on.
        stopping_deceleration: Deceleration with which a joint can be braked, in [rad/s²], for the stop
            distance: the limit of 60 N·m on the hip with the leg of a wearer, about 6 kg·m².
        speed_share: Highest joint speed over the speed limit of the joint, which is that of the URDF unless
            ``control.limits`` states one.
        angle_step: Largest plausible change of an encoder in a tick in [rad]: 20 rad/s, five times the
            no-load speed.
        frozen_time: Time in [s] after which an encoder counts as frozen if its reading does not change at all
            while the motor turns.
        frozen_speed: Estimated speed in [rad/s] above which a motor counts as turning.
        model_deviation: Largest angle in [rad] by which an encoder may deviate from the motor's model.
        model_time_constant: Time constant with which that angle decays, in [s].
        model_resistance_ratio: Resistance of winding and inverter that the monitor assumes over the true one.
        torque_time: Longest time in [s] for which a command may be above the torque limit.
        highest_command: Largest plausible command in [N·m].
        command_deviation: Largest filtered deviation in [N·m] of the command from the torque that the
            setpoint of the joint gives for the measurement of the next tick. In normal operation it is
            reached when the spring and damper torque changes by 200 N·m within a tick.
        command_time_constant: Time constant of the filter of that deviation in [s].
        current_share: Measured current over the current limit above which the monitor trips at once.
        thermal_time_constant: Thermal time constant of the winding in [s] (maxon EC 90 flat data sheet).
        drive_deviation: Largest deviation of the measured current from the drive's target, in [A].
        drive_time: Longest time in [s] for which a drive may deviate by more.
        phase_timeout: Longest time in a phase in [s]; no phase of the shipped gaits lasts 0.8 s.
        frozen_load_time: Longest time in [s] for which a loaded foot's sensor may be constant while the
            proximal joint turns.
        min_voltage_share: Share of the battery's open-circuit voltage below which the drives are not
            reliable.
        voltage_time: Longest time in [s] for which the bus may be below that voltage.
        hold_damping: Damping of the safe hold in [N·m·s/rad].
        lowering_time: Time in which the hold reduces its support of the leg's weight to 0, in [s].
    """

    enabled: bool
    stopping_deceleration: Annotated[quantities.AngularAcceleration, quantities.POSITIVE]
    speed_share: Annotated[quantities.Ratio, SHARES]
    angle_step: Annotated[quantities.Angle, STEPS]
    frozen_time: Annotated[quantities.Time, REACTIONS]
    frozen_speed: Annotated[quantities.AngularVelocity, quantities.NOT_NEGATIVE]
    model_deviation: Annotated[quantities.Angle, DEVIATIONS]
    model_time_constant: Annotated[quantities.Time, OVERLOADS]
    model_resistance_ratio: Annotated[quantities.Ratio, SHARES]
    torque_time: Annotated[quantities.Time, OVERLOADS]
    highest_command: Annotated[quantities.Torque, quantities.POSITIVE]
    command_deviation: Annotated[quantities.Torque, quantities.POSITIVE]
    command_time_constant: Annotated[quantities.Time, REACTIONS]
    current_share: Annotated[quantities.Ratio, SHARES]
    thermal_time_constant: Annotated[quantities.Time, quantities.POSITIVE]
    drive_deviation: Annotated[quantities.Current, quantities.POSITIVE]
    drive_time: Annotated[quantities.Time, REACTIONS]
    phase_timeout: Annotated[quantities.Time, quantities.POSITIVE]
    frozen_load_time: Annotated[quantities.Time, OVERLOADS]
    min_voltage_share: Annotated[quantities.Ratio, VOLTAGES]
    voltage_time: Annotated[quantities.Time, REACTIONS]
    hold_damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE]
    lowering_time: Annotated[quantities.Time, LOWERINGS]
