"""What hangs on the joint of the bench: a link with a weight, driven by motor, gear and winding."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.parameters import ACCELEROMETER_NOISE, GYROSCOPE_NOISE, FrictionLaw, StopParameters
from twin_gait.parameters.quantities import (
    COUNT,
    NOT_NEGATIVE,
    POSITIVE,
    WHOLE,
    Angle,
    AngularVelocity,
    Current,
    Frequency,
    Inertia,
    Length,
    Mass,
    Parameters,
    Range,
    Ratio,
    RotaryDamping,
    RotaryStiffness,
    Time,
    Torque,
    Unit,
    require,
)

HORIZONTAL = math.pi / 2.0  # [rad]: where the fall begins (thesis 2.3.1)
STOP_ANGLE = math.radians(125.0)  # where it ends (thesis, appendix B)
LOWER_STOP = math.radians(-4.0)  # thesis 2.4
CATALOGUE = Range(-10.0, 40.0, words="-10 to 40 °C, the range of the catalogue")


class LoadAngle(StrEnum):
    """From where the angle of the load torque is counted."""

    CORRECTED = "corrected"  # F b cos(θ − 90°): the link is level where the fall begins
    PRINTED = "printed"  # F b cos θ, equation (2.8) as printed


@dataclass(frozen=True, kw_only=True)
class BenchFriction(Parameters):
    """True friction of the joint: its law, and what may come on top of it.

    What comes on top turns over within a tenth of the law's break-away or Stribeck velocity.

    Attributes:
        law: Equation (3.1), or one with directions or bristles.
        coulomb_per_load: Coulomb friction per load torque, no unit.
        coulomb_per_kelvin: In [N m] / [K] from 25 °C.
        viscous_per_kelvin: In [N m s] / [rad K] from 25 °C.
        temperature: In [°C].
        ripple: Amplitude of a torque that repeats twice in a turn of the wave generator, in [N m].
    """

    law: FrictionLaw
    coulomb_per_load: Annotated[Ratio, NOT_NEGATIVE] = 0.0
    coulomb_per_kelvin: Annotated[float, Unit("Nm_per_K")] = 0.0
    viscous_per_kelvin: Annotated[float, Unit("Nms_per_rad_K")] = 0.0
    temperature: Annotated[float, Unit("degC")] = 25.0
    ripple: Annotated[Torque, NOT_NEGATIVE] = 0.0


@dataclass(frozen=True, kw_only=True)
class LinkParameters(Parameters):
    """What hangs on the joint.

    Attributes:
        mass: In [kg].
        lever: b, from the axis to the weight, in [m]. The thesis does not print it: an assumption.
        inertia: Of the link about the axis in [kg m²]; an assumption.
        moment: Mass of the link times the distance of its centre in [kg m].
        load_angle: Form of the load torque.
        stops: Of the bench: the link hits its base, some 2e6 N/m at 0.3 m (an assumption).
        lower_stop: In [rad].
        upper_stop: In [rad].
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 2.0
    lever: Annotated[Length, POSITIVE] = 0.30
    inertia: Annotated[Inertia, POSITIVE] = 0.02
    moment: Annotated[float, Unit("kgm"), NOT_NEGATIVE] = 0.0
    load_angle: LoadAngle = LoadAngle.CORRECTED
    stops: StopParameters = field(default_factory=lambda: StopParameters(stiffness=2e5))
    lower_stop: Angle = LOWER_STOP
    upper_stop: Angle = STOP_ANGLE

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        require(self.lower_stop < self.upper_stop, "stops", "lower < upper", self.lower_stop)

    @property
    def total_inertia(self) -> float:
        """Link and weight about the axis, m b² and not the thesis's m b, in [kg m²]."""
        return self.inertia + self.mass * self.lever * self.lever

    @property
    def total_moment(self) -> float:
        """Of weight and link in [kg m]."""
        return self.moment + self.mass * self.lever


class InertialSensor(StrEnum):
    """What an inertial unit measures."""

    GYROSCOPE = "gyroscope"  # the velocity of the link, differentiated by the firmware
    ACCELEROMETER = "accelerometer"  # the specific force along the path of the unit


# Noise of a sample at 1 kHz.
INERTIAL_NOISE: Mapping[InertialSensor, float] = {
    InertialSensor.GYROSCOPE: GYROSCOPE_NOISE,
    InertialSensor.ACCELEROMETER: ACCELEROMETER_NOISE,
}


@dataclass(frozen=True, kw_only=True)
class InertialUnit(Parameters):
    """An inertial unit on the link, sampled at 1 kHz.

    Attributes:
        sensor: What it measures.
        noise: Standard deviation of a sample in [rad] / [s] or [m] / [s²]; white.
        delay: Ticks between a sample and its use; 2 for a bus of 500 Hz (thesis 2.1.2).
        lever: From the axis to the unit in [m].
        time_constant: Of the first-order filter behind it in [s].
    """

    sensor: InertialSensor
    noise: Annotated[float, Unit(""), NOT_NEGATIVE] = 0.0  # of the sensor's unit
    delay: Annotated[int, Range(0, 1000, words="0 to 1000 ticks")] = 2
    lever: Annotated[Length, POSITIVE] = 0.30
    time_constant: Annotated[Time, NOT_NEGATIVE] = 0.001


class CurrentLoop(StrEnum):
    """How a target current becomes a current."""

    IDEAL = "ideal"  # at once, as far as the bus voltage drives it
    PI = "pi"  # figure 2.13: PI on the six-step measurement


@dataclass(frozen=True, kw_only=True)
class DriveParameters(Parameters):
    """Winding, inverter and current loop.

    Attributes:
        inductance: L, line to line, in [H].
        pole_pairs: Of the motor (data sheet: 12).
        rate: Of the current loop in [Hz], a whole multiple of 1 kHz; 20 kHz as the thesis's position loop.
        counts: Counts of full duty: 120 MHz of the controller over 20 kHz (computed). 0 for no steps.
        loop: Ideal or PI.
        bandwidth: Of the PI loop in [rad] / [s]; an assumption, a fortieth of the loop's rate.
        noise: Standard deviation of a current sample in [A]; chosen so that the RMSE of target and measured
            current is near the thesis's 0.0113 A (calibrated, not predicted).
        ripple: Relative first harmonic of the commutation. A sine of back-EMF over 60° varies by 13.4 % from
            end to end, a cosine of 0.067; the loop sees that as current. An assumption: a tenth is left.
        delay: Periods of the loop between a sample and its use; an assumption.
        resolution: Of the current converter in [A]; 0 for none.
    """

    inductance: Annotated[float, Unit("H"), POSITIVE]
    pole_pairs: Annotated[int, COUNT] = 12
    rate: Annotated[Frequency, POSITIVE] = 20_000.0
    counts: Annotated[int, WHOLE] = 6000
    loop: CurrentLoop = CurrentLoop.PI
    bandwidth: Annotated[AngularVelocity, POSITIVE] = 2.0 * math.pi * 500.0
    noise: Annotated[Current, NOT_NEGATIVE] = 0.011
    ripple: Annotated[Ratio, NOT_NEGATIVE] = 0.0067
    delay: Annotated[int, Range(0, 100, words="0 to 100 periods of the loop")] = 1
    resolution: Annotated[Current, NOT_NEGATIVE] = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        per_tick = self.rate / 1000.0
        require(per_tick == round(per_tick), "rate", "a whole multiple of 1000 Hz", self.rate)


@dataclass(frozen=True, kw_only=True)
class CatalogueEfficiency(Parameters):
    """Efficiency of the CSD-25-100 at rated torque with grease, a quadratic in temperature and input speed.

    Least squares over 44 values of Harmonic Drive's catalogue (−10 to 40 °C, 500 to 3500 1/min): RMS error
    0.011, largest 0.024 (computed). Below rated torque the efficiency is lower still.

    Attributes:
        temperature: Of the grease in [°C].
        coefficients: See :func:`twin_gait.core.motor_drive.drive_efficiency`.
        transition_velocity: Of the loss at a reversal, in [rad] / [s]; an assumption.
    """

    temperature: Annotated[float, Unit("degC"), CATALOGUE] = 25.0
    coefficients: tuple[float, float, float, float, float, float] = (
        0.688878205,
        9.24475524e-3,
        -1.18764569e-4,
        -1.47423702e-3,
        1.06902515e-5,
        1.57005966e-6,
    )
    transition_velocity: Annotated[AngularVelocity, POSITIVE] = 0.02


@dataclass(frozen=True, kw_only=True)
class Torsion(Parameters):
    """Compliance of the flexspline between motor and link.

    Attributes:
        stiffness: In [N m] / [rad]; 3.1e4 is CSF-25 at low torque (from memory, medium confidence).
        damping: In [N m s] / [rad]; an assumption, about 3 % of critical for the default link.
    """

    stiffness: Annotated[RotaryStiffness, POSITIVE] = 3.1e4
    damping: Annotated[RotaryDamping, NOT_NEGATIVE] = 5.0
