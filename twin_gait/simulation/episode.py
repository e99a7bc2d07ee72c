"""State record of an episode: everything that a tick reads and writes, as nested records.

These classes define the dtype of the compiled loop, the plain objects that the reference engine uses and the
types for mypy (:mod:`twin_gait.simulation.record`). Joints are numbered leg by leg (left hip, left knee,
right hip, …). With braces the coordinates are those of the device, followed by those of the wearer.
"""

import math
from dataclasses import dataclass, field

from twin_gait.control.gait_controller import ControllerState
from twin_gait.control.joint_board import BoardState, JointSetpoint, Limits, SamplingConfig
from twin_gait.core.actuator import Motor
from twin_gait.core.arms import Arm
from twin_gait.core.belt import Belt
from twin_gait.core.can_bus import Bus
from twin_gait.core.can_codec import SignalLayout
from twin_gait.core.contact import ContactState, Ground
from twin_gait.core.estimation import DelayLine
from twin_gait.core.faults import FaultRecord
from twin_gait.core.inertial import TrunkUnit
from twin_gait.core.own_gait import OwnGait
from twin_gait.core.plant import Brace, ImposedMotion, Plant, Seat, Trunk
from twin_gait.parameters.wearer import JointCondition
from twin_gait.worlds.arm_policy import ArmPolicy, Perception

COMPLETED, FELL, DIVERGED, TIPPED, CRUTCH_LOST = 0, 1, 2, 3, 4
DIVERGED_VELOCITY = 1e3  # Joint velocity above which a state is no longer physical, in [rad/s].
# Lowest hip angle of the normative moments, and the distance of two hip angles, in [rad].
MIN_HIP_ANGLE, HIP_ANGLE_STEP = math.radians(-30.0), math.radians(2.0)


@dataclass(slots=True)
class Joint:
    """State of a controlled joint."""

    index: int  # Index of the joint in the coordinates.
    board: BoardState  # State of the board of the joint.
    motor: Motor  # Motor and gear.
    line: DelayLine  # Delay line of the torque commands to the drive in [N·m].
    reading: float  # Angle that the encoder measures before it is quantized, in [rad].
    current: float = 0.0  # Motor current in [A].
    current_deviation: float = 0.0  # Deviation of the current from that of an intact drive, in [A].
    voltage: float = 0.0  # Voltage on the winding in [V].
    due_command: float = 0.0  # Delayed command that reaches the drive in this tick, in [N·m].
    push: float = 0.0  # Disturbance torque of a push, constant over the tick, in [N·m].
    external_torque: float = 0.0  # External torque of wearer, push and imposed motion in [N·m], for the log.
    disturbance_torque: float = 0.0  # Part of the external torque from push and imposed motion, in [N·m].
    off: bool = False  # Whether the board of the joint is rebooting.
    # Last setpoint that the board received over the bus.
    received_setpoint: JointSetpoint = field(default_factory=JointSetpoint)


@dataclass(slots=True)
class Limb:
    """State of a hip or knee of the wearer."""

    index: int  # Index of the joint in the coordinates of the device.
    condition: JointCondition  # Condition of the wearer's joint.
    moments: list[list[float]]  # Normative moment in [N·m] by phase and hip angle.
    effort_line: DelayLine  # Delay line of the voluntary efforts in [N·m].
    # Leg of the device whose phase determines the effort; the first one for a leg without device.
    leg: int = 0


@dataclass(slots=True)
class FootState:
    """State of a foot: the load that its sensor measures, and its values in the log."""

    load: float = 0.0  # Measured foot load as a fraction of body weight.
    normal: float = 0.0  # Normal component of the ground reaction force in [N].
    friction: float = 0.0  # Friction component of the ground reaction force in [N], positive forwards.
    clearance: float = 0.0  # Height of the lowest point of the sole above the ground in [m].
    cop_ratio: float = 0.0  # Centre of pressure as a ratio, 0 at the first point and 1 at the last one.


@dataclass(slots=True)
class Supply:
    """State of the battery and of the supply of the drives."""

    voltage: float  # Open-circuit voltage in [V].
    resistance: float  # Internal resistance of the battery in [Ω].
    constant_power: float  # Power of inverters and electronics in [W].
    regeneration: float  # Share of the power of braking motors that returns to the battery.
    bus_voltage: float  # Present bus voltage in [V].
    # Power drawn from the battery in this tick in [W]; during the drive steps the sum of the motors alone.
    power: float = 0.0


@dataclass(slots=True)
class TimedCommand:
    """Request to the supervisor at a given tick."""

    tick: int = -1  # Tick of the request, -1 for none.
    request: int = 0  # Code of the request, counted from 1.


@dataclass(slots=True)
class IntegratorBuffers:
    """Buffers of the integrators, each with one entry per coordinate."""

    q: list[float]  # Coordinates of a Runge-Kutta stage.
    v: list[float]  # Velocities of a stage; in a step without stages the mean of those before and after it.
    sum_v: list[float]  # Weighted sum of the velocities.
    sum_a: list[float]  # Weighted sum of the accelerations.


@dataclass(slots=True)
class ReceivedFrame:
    """Received frame, which its receiver may use with an additional delay."""

    halves: list[int] = field(default_factory=lambda: [0, 0])  # Two 32-bit halves of the data of the frame.
    tick: int = 0  # Tick of the arrival, before the additional delay; 0 for no frame.
    written: int = 0  # Tick in which the sender wrote the frame.


@dataclass(slots=True)
class CanChannel:
    """CAN channel between a board and the gait controller, with the frame that it carries."""

    frame: int  # Index of the frame among the frames of the bus.
    layout: list[SignalLayout]  # Layout of the signals in the frame.
    received: list[ReceivedFrame]  # Ring buffer of received frames.
    written_tick: int = 0  # Tick in which the sender wrote the values that the receiver uses.
    age_sum: int = 0  # Sum of the age of these values over all ticks, in ticks.
    max_age: int = 0  # Largest age of these values in ticks.


@dataclass(slots=True)
class Network:
    """State of the CAN bus and of its channels."""

    bus: Bus  # Bus with all its frames.
    delay: int  # Ticks between the arrival of a frame and its use.
    setpoints: list[CanChannel]  # Channel of the setpoints to each board.
    measurements: list[CanChannel]  # Channel of the measurements of each board.
    numbers: list[float]  # Buffer for the signals of a frame.


@dataclass(slots=True)
class Switch:
    """Change of phase of a leg."""

    tick: int  # Tick in which the new phase begins.
    leg: int  # Number of the leg.
    source: int  # Index of the phase before the switch.
    target: int  # Index of the phase after the switch.
    transition: int  # Index of the transition in the gait table, -1 for a posture of a mode.


@dataclass(slots=True)
class Recording:
    """Addresses and sizes of log, switches and noise, which are stored outside of the record."""

    most_switches: int  # Capacity of the buffer of switches.
    n_noise: int  # Number of rows of noise, which are repeated in a cycle.
    on: bool = True  # Whether the log is written.
    log: int = 0  # Address of the first row of the log.
    first_row: int = 0  # Tick of the first row of the log.
    switches: int = 0  # Address of the first switch.
    n_switches: int = 0  # Number of switches so far.
    noise: int = 0  # Address of the noise of each tick.


@dataclass(slots=True)
class WorkBySource:
    """Work done on the legs since the start in [J], by source."""

    motor: float = 0.0
    friction: float = 0.0
    stop: float = 0.0
    spring: float = 0.0
    contact: float = 0.0
    external: float = 0.0
    brace: float = 0.0
    own_gait: float = 0.0


@dataclass(slots=True)
class Episode:
    """State record of an episode: everything that a tick reads and writes."""

    step: float  # Integration step in [s].
    substeps: int  # Number of integration steps in a tick.
    gravity: float  # Gravitational acceleration in [m/s²].
    body_weight: float  # Weight of wearer and device in [N].
    lock_stiffness: float  # Stiffness of the harness that locks at a trip in [N/m].
    lock_dissipation: float  # Dissipation coefficient of the locked harness in [s/m].
    fall_height: float  # Height of the pelvis below which the wearer has fallen, in [m].
    fall_pitch: float  # Absolute pitch of the trunk beyond which the wearer has fallen, in [rad].
    max_reach: float  # Length of arm and crutch beyond which a hand has lost its crutch, in [m].
    watching: bool  # Whether the safety monitor is on.
    has_wearer_torques: bool  # Whether the wearer has passive moments, a stretch reflex or an effort.
    has_inertial_unit: bool  # Whether an inertial unit estimates the pitch of the trunk.
    first_fault: int  # First tick with a fault.
    q: list[float]  # Coordinates in [rad] and [m].
    v: list[float]  # Velocities in [rad/s] and [m/s].
    a: list[float]  # Accelerations in [rad/s²] and [m/s²].
    motor: list[float]  # Motor torques on the coordinates in [N·m].
    external: list[float]  # External torques of push and wearer in [N·m], and forces of the arms in [N].
    voluntary: list[float]  # Part of the external torques that is the wearer's voluntary effort.
    passive_moment: list[float]  # Part that is the wearer's passive moment with the stretch reflex.
    torque: list[float]  # Sum of all torques on the coordinates in [N·m], and of all forces in [N].
    rotors: list[float]  # Inertias of the rotors that act at the joints, less the gear losses, in [kg·m²].
    integrator: IntegratorBuffers
    bodies: list[float]  # Run-time values of the plant's kernel.
    rates: SamplingConfig
    supply: Supply
    limits: Limits
    controller: ControllerState
    joints: list[Joint]
    feet: list[FootState]  # Feet of the wearer.
    soles: list[int]  # Number of the foot of each leg of the device.
    network: Network
    limbs: list[Limb]  # Hip and knee of the wearer, leg by leg.
    own_gait: OwnGait  # The wearer's own gait, if the wearer moves joints without a drive.
    ankles: list[int]  # Index of the ankle of each leg in the coordinates; empty without ankles.
    passive: list[int]  # Indices of the joints that are not controlled, in the order of the log.
    plant: list[Plant]
    ground: Ground
    points: list[ContactState]  # Contact points of the soles.
    belt: Belt
    imposed_motion: ImposedMotion
    braces: list[Brace]
    braced: list[int]  # Indices of the joints of the device in the order of the log's braces.
    faults: list[FaultRecord]
    requests: list[TimedCommand]  # Requests to the supervisor, with spare entries; empty without modes.
    recording: Recording
    trunk: Trunk  # Trunk, if its pitch is free.
    trunk_unit: TrunkUnit  # Inertial measurement unit of the trunk, if its pitch is free.
    arms: list[Arm]  # Arms with a crutch.
    policy: ArmPolicy  # Parameters of the use of the crutches.
    perception: Perception  # Delayed perception of the wearer, on which the use of the arms depends.
    swing_phases: list[float]  # 1 for each phase of swing, otherwise 0.
    # Announced state of sitting on a chair by phase, see :class:`twin_gait.worlds.arm_policy.Perception`.
    chair_phases: list[float]
    seat: Seat  # Seat, if the wearer has a chair.
    work: WorkBySource = field(default_factory=WorkBySource)
    # Kinetic energy of bodies and rotors, and potential energy of gravity, in [J], for the log.
    kinetic_energy: float = 0.0
    potential_energy: float = 0.0
    guide_force: float = 0.0  # Force of the guides of the pelvis in [N].
    guide_moment: float = 0.0  # Moment of the guides of the pelvis in [N·m].
    first_tick: int = 0  # Tick of the block in which the episode began.
    diverged_velocity: float = DIVERGED_VELOCITY  # Velocity at which the state has diverged, in [rad/s].
    # ``COMPLETED``, ``DIVERGED``, or the kind of fall: ``FELL``, ``TIPPED`` or ``CRUTCH_LOST``.
    status: int = COMPLETED
    contact_power: float = 0.0  # Power of the contact forces in [W].
    last_contact_power: float = 0.0  # Power of the contact forces in the step before, in [W].
