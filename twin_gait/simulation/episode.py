"""An episode: one nested record of everything that a tick reads and writes.

From these classes come the dtype of the compiled loop, the plain tree that the reference engine runs on and
the types that are checked (:mod:`twin_gait.simulation.record`). Joints are numbered leg by leg (left hip,
left knee, right hip, …). With braces the coordinates are those of the device, then those of the wearer.
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
from twin_gait.core.plant import Brace, ImposedMotion, Plant, Seat, Trunk
from twin_gait.parameters.wearer import JointCondition
from twin_gait.worlds.arm_policy import ArmPolicy, Perception

COMPLETED, FELL, DIVERGED, TIPPED, CRUTCH_LOST = 0, 1, 2, 3, 4
DIVERGED_VELOCITY = 1e3  # [rad] / [s]: a joint that turns faster is no longer physical
# First hip angle of the normative moments, and from one to the next, in [rad].
MIN_HIP_ANGLE, HIP_ANGLE_STEP = math.radians(-30.0), math.radians(2.0)


@dataclass(slots=True)
class Joint:
    """A controlled joint."""

    index: int  # In the coordinates.
    board: BoardState  # Its board.
    motor: Motor  # Motor and gear.
    line: DelayLine  # Commands on their way to the drive in [N m].
    reading: float  # What the encoder reads before it quantises, in [rad].
    current: float = 0.0  # Of the motor in [A].
    current_deviation: float = 0.0  # From what the drive should give in [A].
    voltage: float = 0.0  # On the winding in [V].
    due_command: float = 0.0  # Command that reaches the drive in this tick, where they come late, in [N m].
    push: float = 0.0  # Torque from outside, held over the tick, in [N m].
    external_torque: float = 0.0  # Torque of wearer, push and imposed motion in [N m], as the log has it.
    disturbance_torque: float = 0.0  # The part of it that is push and imposed motion, in [N m].
    off: bool = False  # Whether its board is rebooting.
    received_setpoint: JointSetpoint = field(
        default_factory=JointSetpoint
    )  # What its board heard last over the bus.


@dataclass(slots=True)
class Limb:
    """A hip or knee of the wearer."""

    index: int  # In the coordinates of the device.
    condition: JointCondition  # What the wearer does.
    moments: list[list[float]]  # Normative moment in [N m] by phase and posture of the hip.
    effort_line: DelayLine  # Efforts on their way in [N m].


@dataclass(slots=True)
class FootState:
    """A foot on the ground: its load sensor, and what the log has of it."""

    load: float = 0.0  # Of the sensor, over body weight.
    normal: float = 0.0  # Force of the ground in [N], at right angles to it.
    friction: float = 0.0  # Along it, forwards positive.
    clearance: float = 0.0  # Height of the lowest point over the ground in [m].
    cop_ratio: float = 0.0  # Centre of pressure, 0 at the first point to 1 at the last.


@dataclass(slots=True)
class Supply:
    """Battery and bus."""

    voltage: float  # Open-circuit voltage in [V].
    resistance: float  # Internal one in [Ω].
    constant_power: float  # Of inverters and electronics in [W].
    regeneration: float  # Share of what is fed into the bus that returns to the battery.
    bus_voltage: float  # Present one in [V].
    # That is drawn from the battery in this tick in [W]; until all motors are driven, by them alone.
    power: float = 0.0


@dataclass(slots=True)
class TimedCommand:
    """A request of the schedule."""

    tick: int = -1  # In which it is made, -1 for none.
    request: int = 0  # Its code.


@dataclass(slots=True)
class IntegratorBuffers:
    """Room of the integrators, one entry per coordinate each."""

    q: list[float]  # Coordinates of a stage.
    v: list[float]  # Its velocities; of a step without stages the mean of those before and after.
    sum_v: list[float]  # Weighted sum of the velocities.
    sum_a: list[float]  # Of the accelerations.


@dataclass(slots=True)
class ReceivedFrame:
    """A frame as its receiver has it, which may be later than it arrived."""

    halves: list[int] = field(default_factory=lambda: [0, 0])  # Of the frame.
    tick: int = 0  # From which the receiver would have had it without more delay; 0 for none.
    written: int = 0  # Tick in which its sender wrote it.


@dataclass(slots=True)
class CanChannel:
    """A frame between a board and the gait controller."""

    frame: int  # Its place among those of the bus.
    layout: list[SignalLayout]  # Of its signals.
    received: list[ReceivedFrame]  # What has arrived, taken in turn.
    written_tick: int = 0  # Tick in which its sender wrote what the receiver goes by.
    age_sum: int = 0  # Sum over all ticks of how many ticks old that was.
    max_age: int = 0  # Most of them.


@dataclass(slots=True)
class Network:
    """The bus, and what is said on it."""

    bus: Bus  # With all its frames.
    delay: int  # Ticks by which every frame is used later than it arrives.
    setpoints: list[CanChannel]  # To each board.
    measurements: list[CanChannel]  # Of each.
    numbers: list[float]  # Room for what a frame says.


@dataclass(slots=True)
class Switch:
    """A change of phase."""

    tick: int  # At which the new phase begins.
    leg: int  # Which leg.
    source: int  # Phase that was left.
    target: int  # Phase that was entered.
    transition: int  # Place in the table.


@dataclass(slots=True)
class Recording:
    """Log, switches and noise; their rows are behind an address."""

    most_switches: int  # That there is room for.
    n_noise: int  # Rows of it, taken in turn.
    on: bool = True  # Whether the log is written.
    log: int = 0  # Address of its first row.
    first_row: int = 0  # Tick of that row.
    switches: int = 0  # Address of the first switch.
    n_switches: int = 0  # That have happened.
    noise: int = 0  # Address of what strays, tick by tick.


@dataclass(slots=True)
class WorkBySource:
    """Work done on the leg since the start in [J], by what does it."""

    motor: float = 0.0
    friction: float = 0.0
    stop: float = 0.0
    spring: float = 0.0
    contact: float = 0.0
    external: float = 0.0
    brace: float = 0.0


@dataclass(slots=True)
class Episode:
    """Everything that a tick reads and writes."""

    step: float  # Of the integration in [s].
    substeps: int  # Steps in a tick.
    gravity: float  # In [m] / [s²].
    body_weight: float  # Of wearer and device in [N].
    lock_stiffness: float  # Of the harness that locks at a trip in [N] / [m].
    lock_dissipation: float  # In [s] / [m].
    fall_height: float  # Height of the pelvis below which the wearer has fallen, in [m].
    fall_pitch: float  # Pitch of the trunk, either way, beyond which the wearer has fallen, in [rad].
    max_reach: float  # Length of arm and crutch beyond which a hand has let go, in [m].
    watching: bool  # Whether the safety monitor is on.
    first_fault: int  # First tick with a fault.
    q: list[float]  # Coordinates in [rad] and [m].
    v: list[float]  # Velocities.
    a: list[float]  # Accelerations.
    motor: list[float]  # Motor torques on the coordinates in [N m].
    external: list[float]  # Torques of push and wearer on them.
    voluntary: list[float]  # Part of these torques that is the wearer's voluntary effort.
    passive_moment: list[float]  # Part that is the wearer's passive moment with the stretch reflex.
    torque: list[float]  # All torques on them.
    integrator: IntegratorBuffers
    bodies: list[float]  # Run-time values of the plant's kernel.
    rates: SamplingConfig
    supply: Supply
    limits: Limits
    controller: ControllerState
    joints: list[Joint]
    feet: list[FootState]
    network: Network
    limbs: list[Limb]  # Hip and knee of the wearer, leg by leg.
    ankles: list[int]  # Place of the ankle of each leg in the coordinates; none without.
    passive: list[int]  # Places of the joints that are not controlled, in the order of the log.
    plant: list[Plant]
    ground: Ground
    points: list[ContactState]  # Of the soles.
    belt: Belt
    imposed_motion: ImposedMotion
    braces: list[Brace]
    braced: list[int]  # Joints of the device in the order of the log's braces.
    faults: list[FaultRecord]
    requests: list[TimedCommand]  # That are made of the supervisor, with room for more; none without one.
    recording: Recording
    trunk: Trunk  # If it is free.
    trunk_unit: TrunkUnit  # On it, unless its pitch is known exactly.
    arms: list[Arm]  # That hold a crutch.
    policy: ArmPolicy  # How they are used.
    perception: Perception  # What the person feels.
    swing_phases: list[float]  # 1 for phases in which a leg swings.
    # What a person feels of a chair in a phase, :class:`twin_gait.worlds.arm_policy.Sense`.
    chair_phases: list[float]
    seat: Seat  # If there is one.
    work: WorkBySource = field(default_factory=WorkBySource)
    # Of bodies and rotors, and of gravity, in [J], as the log has them.
    kinetic_energy: float = 0.0
    potential_energy: float = 0.0
    guide_force: float = 0.0  # That the guides of the pelvis take, in [N].
    guide_moment: float = 0.0  # In [N m].
    diverged_velocity: float = DIVERGED_VELOCITY  # In [rad] / [s].
    # ``COMPLETED``, ``DIVERGED``, or how the wearer fell: ``FELL``, ``TIPPED`` or ``LET_GO``.
    status: int = COMPLETED
    contact_power: float = 0.0  # Of the contact forces in [W].
    last_contact_power: float = 0.0  # Of the step before.
