"""Joint test bench: one motor, one gear, a rigid link with a weight, a stop (thesis, section 2.2.1).

Sources: *thesis* is printed there; *data sheet* is maxon's EC 90 flat 323772 (24 V); *from memory* was not
found again; *assumption* has no source, and its reason is given next to it.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.parameters import quantities
from twin_gait.parameters.drives import (
    ActuatorParameters,
    BatteryParameters,
    LimitParameters,
    SensorParameters,
)
from twin_gait.parameters.environment import StopParameters
from twin_gait.parameters.friction import FrictionLaw
from twin_gait.parameters.quantities import require
from twin_gait.worlds.bench_control import DutyControl, TorqueControl
from twin_gait.worlds.bench_leg import ImposedMotionParameters

HORIZONTAL = math.pi / 2.0  # [rad], angle at which the fall begins (thesis 2.3.1)
STOP_ANGLE = math.radians(125.0)  # angle at which the fall ends (thesis, appendix B)
LOWER_STOP = math.radians(-4.0)  # angle of the lower stop (thesis 2.4)
TEMPERATURES = quantities.Range(-40.0, 100.0, reason="temperatures that greases of such gears tolerate")
BANDWIDTHS = quantities.Range(
    0.0, 2e5, exclusive_minimum=True, reason="the rate of the fastest loops, in rad/s"
)
RIPPLES = quantities.Range(0.0, 1.0, reason="a share of the current")
DUTY_COUNTS = quantities.integer_range(0, 2**24, "the finest timers")
POLE_PAIRS = quantities.integer_range(1, 100, "eight times the pole pairs of the motors")
BENCH_STOPS = quantities.Range(-1e3, 1e3, reason="160 turns; no test turns farther")
MOMENT = quantities.QuantityUnits("kgm", 100.0, "50 kg at 2 m")
CATALOGUE = quantities.Range(-10.0, 40.0, words="-10 to 40 °C, the range of the catalogue")

_PER_KELVIN = 10.0, "a change by the whole friction of a joint in a kelvin"


class LoadAngle(StrEnum):
    """Reference from which the angle of the load torque is counted."""

    CORRECTED = "corrected"  # F b cos(θ − 90°): the link is level where the fall begins
    PRINTED = "printed"  # F b cos θ, equation (2.8) as printed


@dataclass(frozen=True, kw_only=True)
class BenchFriction(quantities.Parameters):
    """True friction of the joint: its law, and further effects that may be added to it.

    The further effects reverse within a tenth of the law's break-away or Stribeck velocity.

    Attributes:
        law: Equation (3.1), or a law with directions or bristles.
        coulomb_per_load: Coulomb friction per load torque, no unit.
        coulomb_per_kelvin: Change of the Coulomb friction in [N·m/K] from 25 °C.
        viscous_per_kelvin: Change of the viscous friction in [N·m·s/(rad·K)] from 25 °C.
        temperature: Temperature in [°C].
        ripple: Amplitude of a torque that repeats twice in a turn of the wave generator, in [N·m].
    """

    law: FrictionLaw
    coulomb_per_load: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    coulomb_per_kelvin: Annotated[float, quantities.QuantityUnits("Nm_per_K", *_PER_KELVIN)] = 0.0
    viscous_per_kelvin: Annotated[float, quantities.QuantityUnits("Nms_per_rad_K", *_PER_KELVIN)] = 0.0
    temperature: Annotated[float, quantities.QuantityUnits("degC"), TEMPERATURES] = 25.0
    ripple: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 0.0


@dataclass(frozen=True, kw_only=True)
class LinkParameters(quantities.Parameters):
    """Link and weight on the joint, and their stops.

    Attributes:
        mass: Mass of the weight in [kg].
        lever: Lever b, from the axis to the weight, in [m]. The thesis does not print it: an assumption.
        inertia: Inertia of the link about the axis in [kg·m²]; an assumption.
        moment: Mass of the link times the distance of its centre in [kg·m].
        load_angle: Form of the load torque.
        stops: Stops of the bench: the link hits its base, some 2e6 N/m at 0.3 m (an assumption).
        lower_stop: Angle of the lower stop in [rad].
        upper_stop: Angle of the upper stop in [rad].
    """

    mass: Annotated[quantities.Mass, quantities.NOT_NEGATIVE] = 2.0
    lever: Annotated[quantities.Length, quantities.POSITIVE] = 0.30
    inertia: Annotated[quantities.Inertia, quantities.POSITIVE] = 0.02
    moment: Annotated[float, MOMENT, quantities.NOT_NEGATIVE] = 0.0
    load_angle: LoadAngle = LoadAngle.CORRECTED
    stops: StopParameters = field(default_factory=lambda: StopParameters(stiffness=2e5, dissipation=0.5))
    lower_stop: Annotated[quantities.Angle, BENCH_STOPS] = LOWER_STOP
    upper_stop: Annotated[quantities.Angle, BENCH_STOPS] = STOP_ANGLE

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        require(self.lower_stop < self.upper_stop, "stops", "lower < upper", self.lower_stop)

    @property
    def total_inertia(self) -> float:
        """Inertia of link and weight about the axis, with m b² and not the thesis's m b, in [kg·m²]."""
        return self.inertia + self.mass * self.lever * self.lever

    @property
    def total_moment(self) -> float:
        """First moment of weight and link in [kg·m]."""
        return self.moment + self.mass * self.lever


class InertialSensor(StrEnum):
    """Quantity that an inertial unit measures."""

    GYROSCOPE = "gyroscope"  # the velocity of the link, differentiated by the firmware
    ACCELEROMETER = "accelerometer"  # the specific force along the path of the unit


@dataclass(frozen=True, kw_only=True)
class InertialUnit(quantities.Parameters):
    """Inertial unit on the link, sampled at 1 kHz.

    Attributes:
        sensor: Quantity that it measures.
        noise: Standard deviation of a sample in [rad/s] or [m/s²]; white.
        delay: Ticks between a sample and its use; 2 for a bus of 500 Hz (thesis 2.1.2).
        lever: Distance from the axis to the unit in [m].
        time_constant: Time constant of the first-order filter after it in [s].
    """

    sensor: InertialSensor
    noise: Annotated[quantities.Ratio, quantities.NOT_NEGATIVE] = 0.0  # in the sensor's unit
    delay: Annotated[int, quantities.Range(0, 1000, words="0 to 1000 ticks")] = 2
    lever: Annotated[quantities.Length, quantities.POSITIVE] = 0.30
    time_constant: Annotated[quantities.Time, quantities.NOT_NEGATIVE] = 0.001


class CurrentLoop(StrEnum):
    """Model of the current loop."""

    IDEAL = "ideal"  # the target current flows at once, as far as the bus voltage drives it
    PI = "pi"  # figure 2.13: PI on the six-step measurement


@dataclass(frozen=True, kw_only=True)
class DriveParameters(quantities.Parameters):
    """Winding, inverter and current loop.

    Attributes:
        inductance: L, line to line, in [H].
        pole_pairs: Of the motor (data sheet: 12).
        rate: Rate of the current loop in [Hz], a whole multiple of 1 kHz; 20 kHz like the thesis's position
            loop.
        counts: Counts of full duty: 120 MHz of the controller over 20 kHz (computed). 0 for no steps.
        loop: Ideal or PI.
        bandwidth: Bandwidth of the PI loop in [rad/s]; an assumption, a fortieth of the loop's rate.
        noise: Standard deviation of a current sample in [A]; chosen so that the RMSE of target and measured
            current is near the thesis's 0.0113 A (calibrated, not predicted).
        ripple: Relative first harmonic of the commutation. A sine of back-EMF over 60° varies by 13.4 % from
            end to end, a cosine of 0.067; the loop measures this as current. An assumption: a tenth is left.
        delay: Periods of the loop between a sample and its use; an assumption.
    """

    inductance: Annotated[quantities.Inductance, quantities.POSITIVE]
    pole_pairs: Annotated[int, POLE_PAIRS] = 12
    rate: Annotated[quantities.Frequency, quantities.POSITIVE] = 20_000.0
    counts: Annotated[int, DUTY_COUNTS] = 6000
    loop: CurrentLoop = CurrentLoop.PI
    bandwidth: Annotated[quantities.AngularVelocity, BANDWIDTHS] = 2.0 * math.pi * 500.0
    noise: Annotated[quantities.Current, quantities.NOT_NEGATIVE] = 0.011
    ripple: Annotated[quantities.Ratio, RIPPLES] = 0.0067
    delay: Annotated[int, quantities.Range(0, 100, words="0 to 100 periods of the loop")] = 1

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        per_tick = self.rate / 1000.0
        require(per_tick == round(per_tick), "rate", "a whole multiple of 1000 Hz", self.rate)


@dataclass(frozen=True, kw_only=True)
class CatalogueEfficiency(quantities.Parameters):
    """Efficiency of the CSD-25-100 at rated torque with grease, a quadratic in temperature and input speed.

    Least squares over 44 values of Harmonic Drive's catalogue (−10 to 40 °C, 500 to 3500 1/min): RMS error
    0.011, largest 0.024 (computed). Below rated torque the efficiency is lower still.

    Attributes:
        temperature: Temperature of the grease in [°C].
        coefficients: Coefficients of the polynomial, see
            :func:`twin_gait.core.motor_drive.drive_efficiency`.
        transition_velocity: Transition velocity of the loss at a reversal, in [rad/s]; an assumption.
    """

    temperature: Annotated[float, quantities.QuantityUnits("degC"), CATALOGUE] = 25.0
    coefficients: tuple[float, float, float, float, float, float] = (
        0.688878205, 9.24475524e-3, -1.18764569e-4, -1.47423702e-3, 1.06902515e-5, 1.57005966e-6,
    )  # fmt: skip
    transition_velocity: Annotated[quantities.AngularVelocity, quantities.POSITIVE] = 0.02


@dataclass(frozen=True, kw_only=True)
class Torsion(quantities.Parameters):
    """Compliance of the flexspline between motor and link.

    Attributes:
        stiffness: Stiffness in [N·m/rad]; 3.1e4 is CSF-25 at low torque (from memory, medium confidence).
        damping: Damping in [N·m·s/rad]; an assumption, about 3 % of critical for the default link.
    """

    stiffness: Annotated[quantities.RotaryStiffness, quantities.POSITIVE] = 3.1e4
    damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 5.0


@dataclass(frozen=True, kw_only=True)
class BenchJoint(quantities.Parameters):
    """Test on the joint bench.

    Attributes:
        actuator: Motor and gear.
        drive: Winding, inverter, current loop.
        friction: True friction.
        control: Controller; None leaves the winding open.
        link: Link, weight and stops.
        battery: Its voltage is the bus voltage at rest.
        efficiency: Losses of the gear under load beyond the friction law; None, because equation (3.1)
            already contains the measured losses.
        torsion: Compliance of the gear; None for a rigid one.
        sensors: Encoder and velocity estimates.
        inertial_unit: Inertial unit on the link, for the inertia compensation; None for the differentiated
            encoder.
        limits: Limits of torque and current.
        imposed_motion: Imposed motion of the link, or None.
        start_angle: Angle at the start in [rad].
        start_velocity: Velocity at the start in [rad/s].
        gravity: Gravitational acceleration in [m/s²].
        duration: Duration of the test in [s].
        rest_at_stop: Time in [s] from reaching the upper stop to the end of the test; infinite for a test
            that does not end there.
    """

    actuator: ActuatorParameters
    drive: DriveParameters
    friction: BenchFriction
    control: DutyControl | TorqueControl | None
    link: LinkParameters = field(default_factory=LinkParameters)
    battery: BatteryParameters
    efficiency: CatalogueEfficiency | None = None
    torsion: Torsion | None = None
    sensors: SensorParameters
    inertial_unit: InertialUnit | None = None
    limits: LimitParameters
    imposed_motion: ImposedMotionParameters | None = None
    start_angle: Annotated[quantities.Angle, BENCH_STOPS] = HORIZONTAL
    start_velocity: quantities.AngularVelocity = 0.0
    gravity: Annotated[quantities.Acceleration, quantities.NOT_NEGATIVE] = 9.81
    duration: Annotated[quantities.Time, quantities.Range(1e-3, 3600.0, words="0.001 to 3600 s")] = 5.0
    rest_at_stop: Annotated[quantities.Time, quantities.NON_NEGATIVE_OR_INFINITE] = math.inf

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        expected = "no offset on the joint bench"
        require(not self.sensors.offset, "sensors offset", expected, self.sensors.offset)
        counted = self.drive.counts > 0 or not isinstance(self.control, DutyControl)
        expected = "1 or more, because the controller computes a duty"
        require(counted, "drive counts", expected, self.drive.counts)
