"""Frozen parameters in SI units, checked when they are made.

Every number that a user can change lives in one of these dataclasses, with its source beside it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from twin_gait.exceptions import ParameterError
from twin_gait.vocabulary import JointName, Sex, Side


def require(condition: bool, name: str, expected: str, value: object) -> None:
    """Raise a :class:`ParameterError` that names the parameter unless a condition holds.

    Args:
        condition: What must be true.
        name: Name of the parameter as the user knows it.
        expected: What would have been right, in words.
        value: What came.

    Raises:
        ParameterError: If the condition is false.
    """
    if not condition:
        raise ParameterError(f"{name}: expected {expected}, got {value!r}")


def require_positive(name: str, value: float) -> None:
    """Raise unless a value is a finite number above zero.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(math.isfinite(value) and value > 0.0, name, "a number above 0", value)


def require_non_negative(name: str, value: float) -> None:
    """Raise unless a value is a finite number, zero or above.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(math.isfinite(value) and value >= 0.0, name, "a number of 0 or more", value)


def require_share(name: str, value: float) -> None:
    """Raise unless a value lies in [0, 1].

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it does not.
    """
    require(0.0 <= value <= 1.0, name, "a number from 0 to 1", value)


def require_count(name: str, value: int) -> None:
    """Raise unless a value is a whole number above zero.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(isinstance(value, int) and value >= 1, name, "a whole number above 0", value)


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Parameters of the rotational friction law, equation (3.1) of the thesis.

    Attributes:
        breakaway_torque: a in [N m].
        coulomb_friction: b in [N m].
        breakaway_velocity: c in [rad] / [s].
        viscous_friction: d in [N m s] / [rad].
    """

    breakaway_torque: float
    coulomb_friction: float
    breakaway_velocity: float
    viscous_friction: float

    def __post_init__(self) -> None:
        """Check the ranges.

        The law is odd: a, b, c may all be negative together (table 3.1 prints the knee so). The
        friction must not inject power, which non-negative normalised parameters and a dip that
        stays above zero guarantee; :meth:`normalised` brings them to that form first.
        """
        require(
            math.isfinite(self.breakaway_velocity) and self.breakaway_velocity != 0.0,
            "breakaway_velocity",
            "a number other than 0",
            self.breakaway_velocity,
        )
        sign = math.copysign(1.0, self.breakaway_velocity)
        require_non_negative("breakaway_torque (with the sign of c)", sign * self.breakaway_torque)
        require_non_negative("coulomb_friction (with the sign of c)", sign * self.coulomb_friction)
        require_non_negative("viscous_friction", self.viscous_friction)
        # With a < b the law dips near c/√2, where tanh(10/√2) lacks 1.4e-6 to 1: a and d must make up for it.
        law = self.normalised()
        floor = law.breakaway_torque + law.viscous_friction * law.breakaway_velocity / math.sqrt(2.0)
        require(
            floor >= 2e-6 * law.coulomb_friction,
            "breakaway_torque",
            "some breakaway or viscous friction, without which the dip of the law drives the joint",
            self.breakaway_torque,
        )

    def normalised(self) -> FrictionParameters:
        """Return the same law with a, b and c positive."""
        if self.breakaway_velocity > 0.0:
            return self
        return replace(
            self,
            breakaway_torque=-self.breakaway_torque,
            coulomb_friction=-self.coulomb_friction,
            breakaway_velocity=-self.breakaway_velocity,
        )

    def scaled(self, ratio: float) -> FrictionParameters:
        """Return the law multiplied by a ratio, for a plant with other friction than the model.

        Args:
            ratio: Plant friction over model friction, 0 or more.
        """
        require_non_negative("friction ratio", ratio)
        return replace(
            self,
            breakaway_torque=ratio * self.breakaway_torque,
            coulomb_friction=ratio * self.coulomb_friction,
            viscous_friction=ratio * self.viscous_friction,
        )


# Table 3.1 of the thesis, as printed. The knee's a, b and c are all negative there: the same law
# as (1.743, 3.193, 0.2031). In both joints a < b, which the Simscape block that the law comes from
# would refuse; it is kept because it is what was measured between 0 and 0.6 rad/s.
KNEE_FRICTION = FrictionParameters(
    breakaway_torque=-1.743, coulomb_friction=-3.193, breakaway_velocity=-0.2031, viscous_friction=2.06
)
HIP_FRICTION = FrictionParameters(
    breakaway_torque=1.664, coulomb_friction=4.2, breakaway_velocity=0.2252, viscous_friction=2.26
)


@dataclass(frozen=True, kw_only=True)
class ActuatorParameters:
    """Motor and harmonic drive of one joint.

    Attributes:
        torque_constant: K_t of the motor in [N m] / [A].
        resistance: Terminal resistance, line to line, in [Ω].
        rotor_inertia: In [kg m²], at the motor.
        gear_ratio: Motor turns per joint turn.
        gear_inertia: Wave generator in [kg m²], at the motor.
        gear_efficiency: η in (0, 1]. 1 by default, because equation (3.1) already holds the losses.
        continuous_torque: Torque at the joint that the motor can hold in [N m].
    """

    torque_constant: float
    resistance: float
    rotor_inertia: float = 3.06e-4  # maxon EC 90 flat data sheet: 3060 g cm²
    gear_ratio: float = 100.0  # CSD-25-100, thesis 2.2.1
    gear_inertia: float = 0.282e-4  # CSD-25, catalogue value from memory (medium-high confidence)
    gear_efficiency: float = 1.0
    continuous_torque: float = 43.0  # nominal 6.06 A of the 24 V winding: 6.06 × 7.05 = 42.7

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("torque_constant", self.torque_constant)
        require_positive("resistance", self.resistance)
        require_non_negative("rotor_inertia", self.rotor_inertia)
        require_positive("gear_ratio", self.gear_ratio)
        require_non_negative("gear_inertia", self.gear_inertia)
        require(
            0.0 < self.gear_efficiency <= 1.0,
            "gear_efficiency",
            "a number above 0 and at most 1",
            self.gear_efficiency,
        )
        require_positive("continuous_torque", self.continuous_torque)

    @property
    def armature(self) -> float:
        """Inertia of rotor and wave generator seen at the joint, in [kg m²]."""
        return (self.rotor_inertia + self.gear_inertia) * self.gear_ratio * self.gear_ratio


# maxon EC 90 flat, 24 V winding 323772: K_t and R from the data sheet.
KNEE_ACTUATOR = ActuatorParameters(torque_constant=0.0705, resistance=0.343)
# 36 V winding 429271: its sheet was not found. K_t is chosen, R follows from the same motor
# constant K_t/sqrt(R) as the 24 V winding: 0.343 (0.109/0.0705)² = 0.82.
HIP_ACTUATOR = ActuatorParameters(torque_constant=0.109, resistance=0.82)


@dataclass(frozen=True, kw_only=True)
class BatteryParameters:
    """Battery pack CMX820P (thesis 2.2.1).

    Attributes:
        voltage: Open-circuit voltage in [V].
        internal_resistance: In [Ω]; typical of an 8-cell pack, not found for this one.
        continuous_power: In [W]: 15 A at 22 V.
        energy: In [J]: 92.2 Wh.
    """

    voltage: float = 28.8
    internal_resistance: float = 0.2
    continuous_power: float = 330.0
    energy: float = 92.2 * 3600.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("battery voltage", self.voltage)
        require_non_negative("battery internal_resistance", self.internal_resistance)
        require_positive("battery continuous_power", self.continuous_power)
        require_positive("battery energy", self.energy)


HARD_TORQUE_LIMIT = 100.0  # [N m]: just below the repeated peak torque of the gear (110 N m)


@dataclass(frozen=True, kw_only=True)
class LimitParameters:
    """Limits of the command.

    Attributes:
        torque: Limit of the motor torque at the joint in [N m], at most ``HARD_TORQUE_LIMIT``.
        current: Limit of the motor current in [A].
    """

    torque: float = 60.0
    current: float = 15.0  # the battery's continuous current, thesis 2.2.1

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("torque limit", self.torque)
        require(
            self.torque <= HARD_TORQUE_LIMIT,
            "torque limit",
            f"at most {HARD_TORQUE_LIMIT:g} N m, what the gear stands",
            self.torque,
        )
        require_positive("current limit", self.current)


@dataclass(frozen=True, kw_only=True)
class SafetyParameters:
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
        model_resistance_ratio: Winding resistance that the monitor reckons with over the true one.
        torque_time: For so long in [s] a command may lie above the torque limit.
        highest_command: Largest plausible command in [N m].
        current_share: Measured current over the current limit that trips at once.
        thermal_time_constant: Of the winding in [s] (maxon EC 90 flat data sheet).
        drive_deviation: Of the measured current from what the drive was told, in [A].
        drive_time: For so long in [s] a drive may deviate.
        phase_overstay: Longest time in a phase in [s]; no phase of the shipped gaits lasts 0.8 s.
        frozen_load_time: For so long in [s] a loaded foot's sensor may stand still while the hip turns.
        least_voltage_share: Of the battery's open-circuit voltage, below which the drives are not to be
            trusted.
        voltage_time: For so long in [s] the bus may lie below that.
        hold_damping: Of the safe hold in [N m s] / [rad].
        lowering_time: In which the hold gives up the leg's weight, in [s].
    """

    enabled: bool = True
    stopping_deceleration: float = 10.0
    speed_share: float = 1.0
    angle_step: float = 0.02
    frozen_time: float = 0.01
    frozen_speed: float = 0.3
    model_deviation: float = 0.05
    model_time_constant: float = 0.2
    model_resistance_ratio: float = 1.0
    torque_time: float = 0.5
    highest_command: float = 300.0
    current_share: float = 1.2
    thermal_time_constant: float = 52.6
    drive_deviation: float = 1.0
    drive_time: float = 0.02
    phase_overstay: float = 5.0
    frozen_load_time: float = 0.1
    least_voltage_share: float = 0.6
    voltage_time: float = 0.01
    hold_damping: float = 60.0
    lowering_time: float = 3.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.__dataclass_fields__:
            if name == "enabled":
                continue
            check = require_non_negative if name in ("frozen_speed", "hold_damping") else require_positive
            check(f"safety {name}", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class SensorParameters:
    """Encoders and the velocity estimates of the firmware.

    Attributes:
        ideal: True for exact angles; the velocity filters stay.
        encoder_counts: Counts per motor turn (an assumption).
        angle_noise: Standard deviation of white noise on the motor-side angle, seen at the joint, in [rad].
        fast_time_constant: Of ``velocity_fast`` in [s].
        decimation: Of ``velocity_slow``: every so many ticks one encoder difference.
        window: Samples in the moving average of ``velocity_slow``.
    """

    ideal: bool = True
    encoder_counts: int = 8192
    angle_noise: float = 0.0
    fast_time_constant: float = 0.005
    decimation: int = 10
    window: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_count("encoder_counts", self.encoder_counts)
        require_non_negative("angle_noise", self.angle_noise)
        require_non_negative("fast_time_constant", self.fast_time_constant)
        require_count("decimation", self.decimation)
        require_count("window", self.window)


@dataclass(frozen=True, kw_only=True)
class BeltProfile:
    """A belt that starts and stops, and when its wearer is told to walk; see :mod:`twin_gait.core.belt`.

    Attributes:
        start: Command to walk in [s].
        stop: Command to stand in [s]; infinite for a walk without end.
        ramp: Time in which the belt comes to its speed, and to rest, in [s].
        delay: Time from either command until the belt follows it in [s].
    """

    start: float
    stop: float = math.inf
    ramp: float
    delay: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_non_negative("belt start", self.start)
        require_positive("belt ramp", self.ramp)
        require_non_negative("belt delay", self.delay)
        earliest = self.start + self.ramp
        require(self.stop >= earliest, "belt stop", f"start + ramp, {earliest:g} s, or later", self.stop)


@dataclass(frozen=True, kw_only=True)
class ContactParameters:
    """Foot contact at heel and toe.

    Attributes:
        stiffness: Hertz stiffness in [N] / [m]^1.5; about 1 cm under half a supported body.
        dissipation: Of Hunt and Crossley in [s] / [m].
        friction_coefficient: Coulomb coefficient of the sole on the belt.
        transition_velocity: Of the regularised friction in [m] / [s].
    """

    stiffness: float = 3.0e5
    dissipation: float = 0.5
    friction_coefficient: float = 0.8
    transition_velocity: float = 0.05

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("contact stiffness", self.stiffness)
        require_non_negative("contact dissipation", self.dissipation)
        require_non_negative("friction_coefficient", self.friction_coefficient)
        require_positive("transition_velocity", self.transition_velocity)


@dataclass(frozen=True, kw_only=True)
class StopParameters:
    """Mechanical stops of the joints; where they sit comes from the URDF limits.

    Attributes:
        stiffness: In [N m] / [rad].
        dissipation: In [s] / [rad].
    """

    stiffness: float = 2000.0
    dissipation: float = 0.5

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_non_negative("stop stiffness", self.stiffness)
        require_non_negative("stop dissipation", self.dissipation)


@dataclass(frozen=True, kw_only=True)
class AnkleParameters:
    """Ankle-foot orthosis: a passive spring and damper about the neutral position.

    Attributes:
        stiffness: In [N m] / [rad] (an assumption).
        damping: In [N m s] / [rad].
    """

    stiffness: float = 200.0
    damping: float = 6.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_non_negative("ankle stiffness", self.stiffness)
        require_non_negative("ankle damping", self.damping)


@dataclass(frozen=True, kw_only=True)
class SupportParameters:
    """Body-weight support and guide of the treadmill.

    Attributes:
        share: Share of the weight of wearer and device that the support carries.
        damping: Of the vertical guide in [N s] / [m].
    """

    share: float = 0.6
    damping: float = 90.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_share("support share", self.share)
        require_non_negative("support damping", self.damping)


@dataclass(frozen=True, kw_only=True)
class JointCondition:
    """What the wearer does at one joint; see :mod:`twin_gait.core.wearer`. The default does nothing.

    Attributes:
        passive: Share of the passive moment of healthy men (Riener and Edrich 1999).
        contracture: By which the joint resists as a sound one would, further extended, in [rad].
        catch_speed: Beyond which a spastic muscle catches, in [rad] / [s].
        catch_gain: Of the catch in [N m s] / [rad]; 0 without spasticity.
        effort: Share of the normative moment that the wearer wants to give.
        strength: Share of it that the muscles can give; less than 1 is weakness.
    """

    passive: float = 0.0
    contracture: float = 0.0
    catch_speed: float = 1.0
    catch_gain: float = 0.0
    effort: float = 0.0
    strength: float = 1.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(math.isfinite(self.passive) and 0.0 <= self.passive <= 3.0, "passive", "0 to 3", self.passive)
        require(
            math.isfinite(self.contracture) and 0.0 <= self.contracture <= math.radians(60.0),
            "contracture",
            f"0 to {math.radians(60.0):.3f} rad (60 deg)",
            self.contracture,
        )
        require(
            self.contracture == 0.0 or self.passive > 0.0,
            "contracture",
            "0 without a passive moment that it could shift (passive is 0)",
            self.contracture,
        )
        require_non_negative("catch_speed", self.catch_speed)
        require_non_negative("catch_gain", self.catch_gain)
        require_share("effort", self.effort)
        require_share("strength", self.strength)

    @property
    def does_nothing(self) -> bool:
        """Whether no torque comes from the wearer at this joint."""
        return self.passive == 0.0 and self.catch_gain == 0.0 and self.effort * self.strength == 0.0


@dataclass(frozen=True, kw_only=True)
class Patient:
    """The wearer.

    The shipped gaits were tuned for a wearer who is mass alone, so that is the default.

    Attributes:
        mass: In [kg]; TWIN carries at most 110 kg (thesis, table 2.1).
        height: In [m].
        sex: For the segment tables of de Leva (1996).
        conditions: Of hips and knees; what is not named does nothing.
        effort_delay: From phase and posture to the torque of the effort, in [s].
        effort_noise: Standard deviation of the effort's torque from tick to tick, as a share of it.
    """

    mass: float = 70.0
    height: float = 1.75
    sex: Sex = Sex.MALE
    conditions: Mapping[tuple[Side, JointName], JointCondition] = field(default_factory=dict)
    effort_delay: float = 0.1
    effort_noise: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(
            math.isfinite(self.mass) and 30.0 <= self.mass <= 110.0,
            "patient mass",
            "30 to 110 kg (TWIN carries 110 kg)",
            self.mass,
        )
        require(
            math.isfinite(self.height) and 1.40 <= self.height <= 2.05,
            "patient height",
            "1.40 to 2.05 m",
            self.height,
        )
        require(
            math.isfinite(self.effort_delay) and 0.0 <= self.effort_delay <= 1.0,
            "effort_delay",
            "0 to 1 s",
            self.effort_delay,
        )
        require_non_negative("effort_noise", self.effort_noise)
        for side, joint in self.conditions:
            require(
                joint is not JointName.ANKLE, f"condition of the {side} {joint}", "a hip or a knee", joint
            )

    @property
    def is_mass_alone(self) -> bool:
        """Whether no torque comes from the wearer."""
        return all(item.does_nothing for item in self.conditions.values())
