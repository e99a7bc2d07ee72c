"""State record of a test on the joint bench: everything that a tick reads and writes.

Quantities of motor and rotor are those at the joint, on the output of the gear.
"""

from dataclasses import dataclass, field
from pathlib import Path

from twin_gait.control.joint_board import Command, JointSetpoint
from twin_gait.core.actuator import Motor
from twin_gait.core.control_tick import Encoder
from twin_gait.core.estimation import DelayLine
from twin_gait.core.friction import PlantFriction
from twin_gait.core.plant import ImposedMotion
from twin_gait.simulation.episode import COMPLETED, Recording
from twin_gait.simulation.log import ColumnGroup, LogLayout
from twin_gait.worlds.bench_control import CosinePath, DutyControl, OldFrictionModel, TorqueControl
from twin_gait.worlds.bench_joint import BenchJoint, CatalogueEfficiency, InertialUnit, Torsion
from twin_gait.yaml12 import load_data

# Drive of the winding.
OPEN, IDEAL, PI, DUTY = range(4)
# Source of the acceleration for the inertia compensation: the encoder, or a sensor of the inertial unit.
ENCODER, GYROSCOPE, ACCELEROMETER = range(3)


BENCH = ColumnGroup(**load_data(Path(__file__).with_name("log.yaml")))
LAYOUT = LogLayout((("", 0, BENCH),))
# Columns of the thesis's log files, in the order of the files.
LOG_COLUMNS = LAYOUT.names[:9]


@dataclass(frozen=True, eq=False)
class BenchVariation:
    """Random differences between repeated tests with the same parameters."""

    current_offset: float = 0.0  # Offset of the current measurement in [A].
    friction_ratio: float = 1.0  # Factor on the friction law.
    ripple_phase: float = 0.0  # Phase of the friction that is periodic in the angle, in [rad].
    duty_start: int = 0  # Ticks that the sine of (2.1a) has run when the test begins.


@dataclass(slots=True)
class Winding:
    """State of the winding of the motor, of its inverter and of its current loop."""

    drive: int  # Drive: ``OPEN`` winding, ``IDEAL`` or ``PI`` current loop, or a ``DUTY`` without one.
    periods: int  # Number of periods of the current loop in a tick.
    period: float  # Length of a period of the current loop in [s].
    proportional_gain: float  # Gain K_p of the current loop in [V/A].
    integral_gain: float  # Gain K_i of the current loop in [V/(A·s)].
    line: DelayLine  # Delay line of the current samples in [A].
    sample: float = 0.0  # Sample that the current loop uses in [A].
    target_current: float = 0.0  # Target current in [A].
    integral: float = 0.0  # Voltage of the integral part in [V].
    voltage: float = 0.0  # Voltage on the winding in [V].
    duty: float = 0.0  # Share of the bus voltage on the winding.
    current: float = 0.0  # Current of the winding in [A].
    mean_current: float = 0.0  # Mean current over the last period in [A].
    energy: float = 0.0  # Energy drawn in this tick in [J].


@dataclass(slots=True)
class Acceleration:
    """State of the firmware's estimate of the acceleration for the inertia compensation."""

    source: int  # ``ENCODER``, whose fast velocity is differentiated, ``GYROSCOPE`` or ``ACCELEROMETER``.
    gain: float  # Gain of the first-order filter.
    line: DelayLine  # Delay line of the samples of the inertial unit.
    last_sample: float = 0.0  # Last sample that was used.
    estimate: float = 0.0  # Filtered angular acceleration in [rad/s²].


@dataclass(slots=True)
class Body:
    """State of a rotating body: rotor with wave generator, or link with weight."""

    inertia: float  # Moment of inertia at the joint in [kg·m²].
    angle: float  # Angle in [rad].
    velocity: float  # Angular velocity in [rad/s].
    acceleration: float = 0.0  # Angular acceleration in [rad/s²], for the log.


@dataclass(slots=True)
class Torques:
    """Last torques on rotor and link in [N·m], except torsion and imposed motion."""

    motor: float = 0.0  # Torque of the current, for the log.
    friction: float = 0.0  # Friction torque on the rotor.
    gear_loss: float = 0.0  # Torque on the rotor that the gear loses under load.
    load: float = 0.0  # Torque of gravity on the link.
    stop: float = 0.0  # Torque of the mechanical stops on the link.


@dataclass(slots=True)
class BenchEpisode:
    """State record of a test: everything that a tick reads and writes.

    Parts that a test may lack are included, so that all tests share one compiled loop.
    """

    test: BenchJoint  # Parameters of the parts that every test has.
    variation: BenchVariation  # Random differences from other tests with these parameters.
    fast_gain: float  # Gain of the filter of the fast velocity.
    encoder: Encoder  # Encoder on the motor.
    motor: Motor  # Motor and gear.
    winding: Winding
    bus_voltage: float  # Present bus voltage in [V].
    rotor: Body
    link: Body
    horizontal_angle: float  # Angle at which the link is level, in [rad].
    mass_moment: float  # Mass moment of weight and link in [kg·m].
    torsion: Torsion  # Torsion of the gear.
    compliant: bool  # Whether the gear has torsion.
    efficiency: CatalogueEfficiency  # Efficiency of the gear, from its catalogue or constant.
    friction: PlantFriction  # Friction of motor and gear.
    ripple_cosine: float  # Cosine amplitude of the friction that is periodic in the angle, in [N·m].
    ripple_sine: float  # Sine amplitude of this friction in [N·m].
    imposed_motion: ImposedMotion  # Imposed motion of the link; its place is 0, or -1 for none.
    unit: InertialUnit  # Inertial unit on the link.
    acceleration: Acceleration  # Acceleration for the inertia compensation.
    torque_control: TorqueControl  # Parameters of the torque control.
    path: CosinePath  # Path of the equilibrium angle.
    old_model: OldFrictionModel  # TWIN's old friction model.
    uses_old_model: bool  # Whether the old model replaces the friction model of the compensation.
    duty_control: DutyControl  # Parameters of the duty control.
    ticks_at_stop: int = 0  # Ticks since the link reached the upper stop.
    status: int = COMPLETED  # ``COMPLETED`` or ``DIVERGED``.
    # Deflection of the bristles in some friction laws at the start of the step, in [rad].
    deflection: float = 0.0
    # Feed-forward torques and θ0 of the torque control.
    setpoint: JointSetpoint = field(default_factory=JointSetpoint)
    command: Command = field(default_factory=Command)  # Torques of the command to the drive.
    torques: Torques = field(default_factory=Torques)
    time: float = 0.0  # Time of the tick in [s].
    # Each number of the noise is a row, see :func:`~twin_gait.simulation.bench_joint.loop.bench_noise`.
    recording: Recording = field(default_factory=lambda: Recording(most_switches=0, n_noise=1))
