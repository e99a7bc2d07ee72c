"""A test on the joint bench: one nested record of everything that a tick reads and writes.

What is said of motor and rotor is what the joint sees of them, behind the gear.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from twin_gait.control.joint_board import Demand, Measurement
from twin_gait.core.actuator import Motor
from twin_gait.core.control_tick import Encoder
from twin_gait.core.estimation import DelayLine
from twin_gait.core.friction import PlantFriction
from twin_gait.core.plant import ImposedMotion
from twin_gait.core.transparency import Transparency
from twin_gait.simulation.episode import COMPLETED
from twin_gait.simulation.log import column, columns_of
from twin_gait.worlds.bench_joint import (
    BenchJoint,
    CatalogueEfficiency,
    CosinePath,
    InertialUnit,
    OldFrictionModel,
    TorqueControl,
    Torsion,
)

# What drives the winding.
OPEN, IDEAL, PI, DUTY = range(4)
# What the inertia compensation takes its acceleration from.
ENCODER, GYROSCOPE, ACCELEROMETER = range(3)


@dataclass(slots=True)
class BenchRow:
    """A row of the log: the columns of the thesis's log files, then what no bench can see."""

    time: float = column("s", "since the start")
    position: float = column("rad", "encoder angle")
    target_position: float = column("rad", "of the path, or the equilibrium of the impedance")
    measured_current: float = column("A", "sample of the shunts that the current loop works with")
    target_current: float = column("A", "that the drive is asked for; with a duty, what it should drive")
    bus_voltage: float = column("V", "of the drive")
    target_torque: float = column("N m", "added to the command, with what the path's acceleration needs")
    velocity: float = column("rad/s", "difference of the encoder angle over a tick")
    duty: float = column("1", "share of the bus voltage on the winding")
    motor_angle: float = column("rad", "true angle of the rotor at the joint")
    motor_velocity: float = column("rad/s", "of it")
    motor_acceleration: float = column("rad/s²", "of it")
    link_angle: float = column("rad", "true angle of the link")
    link_velocity: float = column("rad/s", "of it")
    velocity_fast: float = column("rad/s", "first-order estimate")
    velocity_slow: float = column("rad/s", "decimated and averaged estimate")
    current: float = column("A", "true current of the winding")
    voltage: float = column("V", "on the winding")
    impedance_torque: float = column("N m", "of virtual spring and damper")
    friction_compensation_torque: float = column("N m", "G times the friction of the model")
    inertia_compensation_torque: float = column("N m", "share of the inertia torque that is compensated")
    motor_command_torque: float = column("N m", "sum of the four, before limits")
    motor_torque: float = column("N m", "of the current, before the losses of the gear")
    friction_torque: float = column("N m", "of motor and gear on the rotor")
    gear_loss_torque: float = column("N m", "that the gear loses under load, on the rotor")
    load_torque: float = column("N m", "of gravity on the link")
    stop_torque: float = column("N m", "of the mechanical stops on the link")
    imposed_motion_torque: float = column("N m", "of the hand that leads the link")


COLUMNS = tuple(columns_of(BenchRow))
# Columns of the thesis's log files, in this order.
LOG_COLUMNS = COLUMNS[:9]


@dataclass(frozen=True, eq=False)
class BenchVariation:
    """What differs from one test to the next though nothing was changed.

    Attributes:
        current_offset: Of the current measurement in [A].
        friction_ratio: On the friction law.
        ripple_phase: Of the friction that repeats with the angle, in [rad].
        duty_start: Ticks that the sine of (2.1a) has run when the test begins.
    """

    current_offset: float = 0.0
    friction_ratio: float = 1.0
    ripple_phase: float = 0.0
    duty_start: int = 0


@dataclass(slots=True)
class Winding:
    """Winding of the motor, with the inverter on it and the loop that drives it.

    Attributes:
        drive: ``OPEN`` winding, ``IDEAL`` or ``PI`` current loop, or a ``DUTY`` without one.
        periods: Of the current loop in a tick.
        period: Its length in [s].
        proportional_gain: K_p in [V] / [A].
        integral_gain: K_i in [V] / [A s].
        line: Samples of the current on their way to the loop in [A].
        sample: With which the loop works in [A].
        target_current: In [A].
        integral: Voltage of the integral part in [V].
        voltage: In [V].
        duty: Share of the bus voltage.
        current: In [A].
        mean_current: Over the last period in [A].
        energy: Drawn in this tick in [J].
    """

    drive: int
    periods: int
    period: float
    proportional_gain: float
    integral_gain: float
    line: DelayLine
    sample: float = 0.0
    target_current: float = 0.0
    integral: float = 0.0
    voltage: float = 0.0
    duty: float = 0.0
    current: float = 0.0
    mean_current: float = 0.0
    energy: float = 0.0


@dataclass(slots=True)
class Acceleration:
    """Acceleration for the inertia compensation, as the firmware estimates it.

    Attributes:
        source: ``ENCODER``, whose fast velocity is differentiated, ``GYROSCOPE`` or ``ACCELEROMETER``.
        gain: Of the filter.
        line: Samples of the inertial unit on their way.
        last_sample: The last one that was used.
        estimate: In [rad] / [s²].
    """

    source: int
    gain: float
    line: DelayLine
    last_sample: float = 0.0
    estimate: float = 0.0


@dataclass(slots=True)
class Body:
    """What turns: rotor with wave generator, or link with weight.

    Attributes:
        inertia: In [kg m²].
        angle: In [rad].
        velocity: In [rad] / [s].
    """

    inertia: float
    angle: float
    velocity: float


@dataclass(slots=True)
class Torques:
    """What acts beside motor, torsion and imposed motion, as it was last, in [N m].

    Attributes:
        friction: On the rotor.
        gear_loss: On the rotor.
        load: Of gravity on the link.
        stop: On the link.
    """

    friction: float = 0.0
    gear_loss: float = 0.0
    load: float = 0.0
    stop: float = 0.0


@dataclass(slots=True)
class DeviceJoint:
    """The joint as a controller has it.

    Attributes:
        measurement: Angle and fast velocity.
        demand: Of the torque control, changed by the controller.
    """

    measurement: Measurement = field(default_factory=Measurement)
    demand: Demand = field(default_factory=Demand)


@dataclass(slots=True)
class DeviceLeg:
    """The leg as a controller has it: in one phase for as long as the test lasts.

    Attributes:
        phase: 0.
        entry_tick: 0.
        load: 0: nobody stands on it.
    """

    phase: int = 0
    entry_tick: int = 0
    load: float = 0.0


@dataclass(slots=True)
class BenchDevice:
    """The bench as a controller has it, see :class:`twin_gait.control.Controller`.

    Attributes:
        memory: Of the controller.
        joints: One.
        legs: One.
    """

    memory: object
    joints: list[DeviceJoint] = field(default_factory=lambda: [DeviceJoint()])
    legs: list[DeviceLeg] = field(default_factory=lambda: [DeviceLeg()])


@dataclass(slots=True)
class BenchEpisode:
    """Everything that a tick reads and writes.

    Parts that a test may lack stand here all the same, so that all tests share one compiled loop.

    Attributes:
        test: Parameters of the parts that every test has.
        variation: What chance adds to them.
        fast_gain: Of the fast velocity filter.
        encoder: On the motor.
        motor: Motor and gear.
        bus_voltage: Present one in [V].
        horizontal_angle: At which the link is level, in [rad].
        moment: Of weight and link in [kg m].
        torsion: Of the gear.
        compliant: Whether there is torsion.
        efficiency: Of the gear, from its catalogue.
        catalogued: Whether it is that, not the constant one of the motor and gear.
        friction: Of motor and gear.
        deflection: Of the bristles that some laws of friction have, at the start of the step, in [rad].
        ripple_cosine: Part in [N m] of the friction that repeats with the angle.
        ripple_sine: Likewise.
        imposed_motion: Of the link; its place is 0, or -1 for none.
        unit: Inertial unit on the link.
        acceleration: For the inertia compensation.
        torque_control: What the torque control asks for.
        device: What a controller sees and changes of it.
        path: Of its equilibrium angle.
        old_model: TWIN's old friction model.
        old: Whether it takes the place of the compensator's friction model.
        follows_path: Whether friction is compensated at the velocity of the path.
        transparency: What the control of duties asks for.
        ticks_at_stop: Since the upper stop was reached.
        status: ``COMPLETED`` or ``DIVERGED``.
        log: Address of the rows.
        noise: Address of the noise, see :func:`~twin_gait.simulation.bench_joint.filling.bench_noise`.
    """

    test: BenchJoint
    variation: BenchVariation
    fast_gain: float
    encoder: Encoder
    motor: Motor
    winding: Winding
    bus_voltage: float
    rotor: Body
    link: Body
    horizontal_angle: float
    moment: float
    torsion: Torsion
    compliant: bool
    efficiency: CatalogueEfficiency
    catalogued: bool
    friction: PlantFriction
    ripple_cosine: float
    ripple_sine: float
    imposed_motion: ImposedMotion
    unit: InertialUnit
    acceleration: Acceleration
    torque_control: TorqueControl
    device: BenchDevice
    path: CosinePath
    old_model: OldFrictionModel
    old: bool
    follows_path: bool
    transparency: Transparency
    ticks_at_stop: int = 0
    status: int = COMPLETED
    deflection: float = 0.0
    torques: Torques = field(default_factory=Torques)
    log: int = 0
    noise: int = 0
