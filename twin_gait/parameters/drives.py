"""Motors and gears, their battery, the limits of what is asked of them, and encoders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin_gait.parameters.checks import (
    require,
    require_count,
    require_non_negative,
    require_positive,
    require_share,
)
from twin_gait.vocabulary import JointName, Side

# Below it a gear that is driven backwards locks itself, and its load does not settle (core.plant.gear_load).
LEAST_EFFICIENCY = 0.5
# Of the CSD-25-100 under load, without what it loses without one. Its catalogue has 0.78 at 500 1/min, 25 °C
# and 47 N m: 13.3 N m lost of 60.3, of which equation (3.1) says 4.2 (knee) to 5.2 (hip) at that speed, so
# that 9 N m are the load's. A geared servo has 0.852 (Duclusaud et al. 2025). Not measured on TWIN.
LOADED_EFFICIENCY = 0.85


@dataclass(frozen=True, kw_only=True)
class ActuatorParameters:
    """Motor and harmonic drive of one joint.

    Attributes:
        torque_constant: K_t of the motor in [N m] / [A].
        resistance: Terminal resistance, line to line, in [Ω].
        rotor_inertia: In [kg m²], at the motor.
        gear_ratio: Motor turns per joint turn.
        gear_inertia: Wave generator in [kg m²], at the motor.
        gear_efficiency: η of the gear under load, beside the friction law, which is that of a joint without
            load: the share that the joint receives of the torque that the motor puts into the gear, and the
            motor of the joint's (:func:`twin_gait.core.friction.gear_loss_torque`). 0.5 to 1, no such loss.
        continuous_torque: Torque that the motor can hold, before the gear's losses, in [N m].
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
            LEAST_EFFICIENCY <= self.gear_efficiency <= 1.0,
            "gear_efficiency",
            f"{LEAST_EFFICIENCY:g} to 1",
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


STATED_AUTONOMY = 4.0 * 3600.0  # [s] of TWIN with its battery (thesis, table 2.1), doing what is not said


@dataclass(frozen=True, kw_only=True)
class ElectronicsParameters:
    """What draws from the battery beside the windings, and what comes back to it.

    By default nothing draws and everything comes back, as if inverters and computers were free.

    Attributes:
        inverter_resistance: Of the two switches and the shunt that carry the current of a motor, in [Ω].
        inverter_power: Of each inverter, whatever its motor does, in [W]: gates and switching.
        constant_power: Of computers, sensors and radio in [W].
        regeneration: Share of the power that braking motors feed into the bus beyond what is drawn from it
            that returns to the battery; 0 for a brake chopper.
    """

    inverter_resistance: float = 0.0
    inverter_power: float = 0.0
    constant_power: float = 0.0
    regeneration: float = 1.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_non_negative("inverter_resistance", self.inverter_resistance)
        require_non_negative("inverter_power", self.inverter_power)
        require_non_negative("constant_power", self.constant_power)
        require_share("regeneration", self.regeneration)


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


# Calibration by eye leaves 1 to 3 deg, either way (an assumption).
LARGEST_OFFSET = math.radians(10.0)  # [rad]


@dataclass(frozen=True, kw_only=True)
class SensorParameters:
    """Encoders and the velocity estimates of the firmware.

    Attributes:
        ideal: True for angles that are exact but for the offset; the velocity filters stay.
        encoder_counts: Counts per motor turn (an assumption).
        angle_noise: Standard deviation of white noise on the motor-side angle, seen at the joint, in [rad].
        offset: Calibration error of the joints in [rad], from the start: what an encoder reads in excess of
            the angle. One that is not named has none.
        fast_time_constant: Of ``velocity_fast`` in [s].
        decimation: Of ``velocity_slow``: every so many ticks one encoder difference.
        window: Samples in the moving average of ``velocity_slow``.
    """

    ideal: bool = True
    encoder_counts: int = 8192
    angle_noise: float = 0.0
    offset: Mapping[tuple[Side, JointName], float] = field(default_factory=dict)
    fast_time_constant: float = 0.005
    decimation: int = 10
    window: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_count("encoder_counts", self.encoder_counts)
        require_non_negative("angle_noise", self.angle_noise)
        for (side, joint), offset in self.offset.items():
            name = f"offset of the {side} {joint}"
            largest = f"{LARGEST_OFFSET:.4f} rad (10 deg) at most, either way"
            require(abs(offset) <= LARGEST_OFFSET, name, largest, offset)
        require_non_negative("fast_time_constant", self.fast_time_constant)
        require_count("decimation", self.decimation)
        require_count("window", self.window)
