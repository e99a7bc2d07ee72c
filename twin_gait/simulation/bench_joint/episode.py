"""A test on the joint bench: one nested record of everything that a tick reads and writes.

What is said of motor and rotor is what the joint sees of them, behind the gear.
"""

from dataclasses import dataclass, field

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

# What drives the winding.
OPEN, IDEAL, PI, DUTY = range(4)
# What the inertia compensation takes its acceleration from: the encoder, or what an inertial unit measures.
ENCODER, GYROSCOPE, ACCELEROMETER = range(3)


# The columns of the thesis's log files, then what no bench can see.
BENCH = ColumnGroup(
    "encoder, winding, torques, setpoint, command = e.encoder, e.winding, e.torques, e.setpoint, e.command",
    time_s=("e.time", "since the start"),
    position_rad=("encoder.angle", "encoder angle"),
    target_position_rad=("setpoint.equilibrium", "of the path, or the equilibrium of the impedance"),
    measured_current_A=("winding.sample", "sample of the shunts that the current loop works with"),
    target_current_A=("winding.target_current", "that the drive is asked for, or what a duty should drive"),
    bus_voltage_V=("e.bus_voltage", "of the drive"),
    target_torque_Nm=("setpoint.target", "added to the command, with what the path's acceleration needs"),
    velocity_rad_per_s=("(encoder.angle - encoder.last_angle) / TICK", "of the encoder angle over a tick"),
    duty=("winding.duty", "share of the bus voltage on the winding"),
    motor_angle_rad=("e.rotor.angle", "true angle of the rotor at the joint"),
    motor_velocity_rad_per_s=("e.rotor.velocity", "of it"),
    motor_acceleration_rad_per_s2=("e.rotor.acceleration", "of it"),
    link_angle_rad=("e.link.angle", "true angle of the link"),
    link_velocity_rad_per_s=("e.link.velocity", "of it"),
    velocity_fast_rad_per_s=("encoder.velocity_fast", "first-order estimate"),
    velocity_slow_rad_per_s=("encoder.velocity_slow", "decimated and averaged estimate"),
    current_A=("winding.current", "true current of the winding"),
    voltage_V=("winding.voltage", "on the winding"),
    impedance_torque_Nm=("command.impedance", "of virtual spring and damper"),
    friction_compensation_torque_Nm=("command.friction", "G times the friction of the model"),
    inertia_compensation_torque_Nm=("setpoint.inertia", "share of the inertia torque that is compensated"),
    motor_command_torque_Nm=("command.torque", "sum of the four, before limits"),
    motor_torque_Nm=("torques.motor", "of the current, before the losses of the gear"),
    friction_torque_Nm=("torques.friction", "of motor and gear on the rotor"),
    gear_loss_torque_Nm=("torques.gear_loss", "that the gear loses under load, on the rotor"),
    load_torque_Nm=("torques.load", "of gravity on the link"),
    stop_torque_Nm=("torques.stop", "of the mechanical stops on the link"),
    imposed_motion_torque_Nm=("e.imposed_motion.torque", "of the hand that leads the link"),
)
LAYOUT = LogLayout((("", 0, BENCH),))
# Columns of the thesis's log files, in this order.
LOG_COLUMNS = LAYOUT.names[:9]


@dataclass(frozen=True, eq=False)
class BenchVariation:
    """What differs from one test to the next though nothing was changed."""

    current_offset: float = 0.0  # Of the current measurement in [A].
    friction_ratio: float = 1.0  # On the friction law.
    ripple_phase: float = 0.0  # Of the friction that repeats with the angle, in [rad].
    duty_start: int = 0  # Ticks that the sine of (2.1a) has run when the test begins.


@dataclass(slots=True)
class Winding:
    """Winding of the motor, with the inverter on it and the loop that drives it."""

    drive: int  # ``OPEN`` winding, ``IDEAL`` or ``PI`` current loop, or a ``DUTY`` without one.
    periods: int  # Of the current loop in a tick.
    period: float  # Its length in [s].
    proportional_gain: float  # K_p in [V] / [A].
    integral_gain: float  # K_i in [V] / [A s].
    line: DelayLine  # Samples of the current on their way to the loop in [A].
    sample: float = 0.0  # With which the loop works in [A].
    target_current: float = 0.0  # In [A].
    integral: float = 0.0  # Voltage of the integral part in [V].
    voltage: float = 0.0  # In [V].
    duty: float = 0.0  # Share of the bus voltage.
    current: float = 0.0  # In [A].
    mean_current: float = 0.0  # Over the last period in [A].
    energy: float = 0.0  # Drawn in this tick in [J].


@dataclass(slots=True)
class Acceleration:
    """Acceleration for the inertia compensation, as the firmware estimates it."""

    source: int  # ``ENCODER``, whose fast velocity is differentiated, ``GYROSCOPE`` or ``ACCELEROMETER``.
    gain: float  # Of the filter.
    line: DelayLine  # Samples of the inertial unit on their way.
    last_sample: float = 0.0  # The last one that was used.
    estimate: float = 0.0  # In [rad] / [s²].


@dataclass(slots=True)
class Body:
    """What turns: rotor with wave generator, or link with weight."""

    inertia: float  # In [kg m²].
    angle: float  # In [rad].
    velocity: float  # In [rad] / [s].
    acceleration: float = 0.0  # In [rad] / [s²], as the log has it.


@dataclass(slots=True)
class Torques:
    """What acts beside torsion and imposed motion, as it was last, in [N m]."""

    motor: float = 0.0  # Of the current, as the log has it.
    friction: float = 0.0  # On the rotor.
    gear_loss: float = 0.0  # On the rotor.
    load: float = 0.0  # Of gravity on the link.
    stop: float = 0.0  # On the link.


@dataclass(slots=True)
class BenchEpisode:
    """Everything that a tick reads and writes.

    Parts that a test may lack stand here all the same, so that all tests share one compiled loop.
    """

    test: BenchJoint  # Parameters of the parts that every test has.
    variation: BenchVariation  # What chance adds to them.
    fast_gain: float  # Of the fast velocity filter.
    encoder: Encoder  # On the motor.
    motor: Motor  # Motor and gear.
    winding: Winding
    bus_voltage: float  # Present one in [V].
    rotor: Body
    link: Body
    horizontal_angle: float  # At which the link is level, in [rad].
    mass_moment: float  # Of weight and link in [kg m].
    torsion: Torsion  # Of the gear.
    compliant: bool  # Whether there is torsion.
    efficiency: CatalogueEfficiency  # Of the gear, from its catalogue or constant.
    friction: PlantFriction  # Of motor and gear.
    ripple_cosine: float  # Part in [N m] of the friction that repeats with the angle.
    ripple_sine: float  # Likewise.
    imposed_motion: ImposedMotion  # Of the link; its place is 0, or -1 for none.
    unit: InertialUnit  # Inertial unit on the link.
    acceleration: Acceleration  # For the inertia compensation.
    torque_control: TorqueControl  # What the torque control asks for.
    path: CosinePath  # Of its equilibrium angle.
    old_model: OldFrictionModel  # TWIN's old friction model.
    uses_old_model: bool  # Whether it takes the place of the compensator's friction model.
    duty_control: DutyControl  # What the control of duties asks for.
    ticks_at_stop: int = 0  # Since the upper stop was reached.
    status: int = COMPLETED  # ``COMPLETED`` or ``DIVERGED``.
    # Of the bristles that some laws of friction have, at the start of the step, in [rad].
    deflection: float = 0.0
    setpoint: JointSetpoint = field(
        default_factory=JointSetpoint
    )  # What the control of torques feeds forward, and its θ0.
    command: Command = field(default_factory=Command)  # What it asks of the drive.
    torques: Torques = field(default_factory=Torques)
    time: float = 0.0  # Of the tick in [s].
    # Of the noise each number is a row, see :func:`~twin_gait.simulation.bench_joint.filling.bench_noise`.
    recording: Recording = field(default_factory=lambda: Recording(most_switches=0, n_noise=1))
