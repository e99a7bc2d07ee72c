"""An episode: one nested record of everything that a tick reads and writes.

From these classes come the dtype of the compiled loop, the plain tree that the reference engine runs on and
the types that are checked (:mod:`twin_gait.simulation.record`). Joints are numbered leg by leg (left hip,
left knee, right hip, …). With braces the coordinates are those of the device, then those of the wearer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from twin_gait.control.gait_controller import ControllerState
from twin_gait.control.joint_board import BoardState, Demand, Limits, Rates
from twin_gait.core.actuator import Motor
from twin_gait.core.arm_policy import Habit, Sense
from twin_gait.core.arms import Arm
from twin_gait.core.belt import Belt
from twin_gait.core.can_bus import Bus
from twin_gait.core.can_codec import SignalLayout
from twin_gait.core.contact import Ground, Point
from twin_gait.core.estimation import DelayLine
from twin_gait.core.faults import Fault
from twin_gait.core.inertial import TrunkUnit
from twin_gait.core.plant import Brace, ImposedMotion, Plant
from twin_gait.core.seat import Seat
from twin_gait.core.trunk import Trunk
from twin_gait.core.wearer import Condition
from twin_gait.simulation.log import WorkRow
from twin_gait.simulation.rows import Efforts, Recording

COMPLETED, FELL, DIVERGED, TIPPED, LET_GO = 0, 1, 2, 3, 4


@dataclass(slots=True)
class Joint:
    """A controlled joint.

    Attributes:
        place: In the coordinates.
        board: Its board.
        motor: Motor and gear.
        line: Commands on their way to the drive in [N m].
        reading: What the encoder reads before it quantises, in [rad].
        last_reading: Likewise in the tick before.
        current: Of the motor in [A].
        current_deviation: From what the drive should give in [A].
        voltage: On the winding in [V].
        due: Command that reaches the drive in this tick, where they come late, in [N m].
        push: Torque from outside, held over the tick, in [N m].
        off: Whether its board is rebooting.
        heard: What its board heard last over the bus.
    """

    place: int
    board: BoardState
    motor: Motor
    line: DelayLine
    reading: float
    last_reading: float = 0.0
    current: float = 0.0
    current_deviation: float = 0.0
    voltage: float = 0.0
    due: float = 0.0
    push: float = 0.0
    off: bool = False
    heard: Demand = field(default_factory=Demand)


@dataclass(slots=True)
class Limb:
    """A hip or knee of the wearer.

    Attributes:
        place: In the coordinates of the device.
        condition: What the wearer does.
        moments: Normative moment in [N m] by phase and posture of the hip.
    """

    place: int
    condition: Condition
    moments: list[list[float]]


@dataclass(slots=True)
class Sole:
    """The load sensor of a foot.

    Attributes:
        load: Over body weight.
        last_load: Of the tick before.
    """

    load: float = 0.0
    last_load: float = 0.0


@dataclass(slots=True)
class Supply:
    """Battery and bus.

    Attributes:
        voltage: Open-circuit voltage in [V].
        resistance: Internal one in [Ω].
        constant_power: Of inverters and electronics in [W].
        regeneration: Share of what is fed into the bus that returns to the battery.
        bus_voltage: Present one in [V].
        power: That is drawn from the battery in this tick in [W]; until all motors are driven, by them alone.
    """

    voltage: float
    resistance: float
    constant_power: float
    regeneration: float
    bus_voltage: float
    power: float = 0.0


@dataclass(slots=True)
class Asked:
    """A request of the schedule.

    Attributes:
        tick: In which it is made, -1 for none.
        request: Its code.
    """

    tick: int = -1
    request: int = 0


@dataclass(slots=True)
class Ends:
    """What ends a run.

    Attributes:
        fall_height: Height of the pelvis below which the wearer has fallen, in [m].
        diverged_velocity: In [rad] / [s].
        fall_pitch: Pitch of the trunk beyond which the wearer has fallen, in [rad].
        longest_reach: Length of arm and crutch beyond which a hand has let go, in [m].
    """

    fall_height: float
    diverged_velocity: float
    fall_pitch: float = math.inf
    longest_reach: float = math.inf


@dataclass(slots=True)
class Stages:
    """Room of the integrators, one entry per coordinate each.

    Attributes:
        q: Coordinates of a stage.
        v: Its velocities; of a step without stages the mean of those before and after.
        sum_v: Weighted sum of the velocities.
        sum_a: Of the accelerations.
    """

    q: list[float]
    v: list[float]
    sum_v: list[float]
    sum_a: list[float]


@dataclass(slots=True)
class Lately:
    """A frame as its receiver has it, which may be later than it arrived.

    Attributes:
        halves: Of the frame.
        tick: From which the receiver would have had it without more delay; 0 for none.
        written: Tick in which its sender wrote it.
    """

    halves: list[int] = field(default_factory=lambda: [0, 0])
    tick: int = 0
    written: int = 0


@dataclass(slots=True)
class Wire:
    """A frame between a board and the gait controller.

    Attributes:
        frame: Its place among those of the bus.
        layout: Of its signals.
        lately: What has arrived, taken in turn.
        written: Tick in which its sender wrote what the receiver goes by.
        ages: Sum over all ticks of how many ticks old that was.
        oldest: Most of them.
    """

    frame: int
    layout: list[SignalLayout]
    lately: list[Lately]
    written: int = 0
    ages: int = 0
    oldest: int = 0


@dataclass(slots=True)
class Network:
    """The bus, and what is said on it.

    Attributes:
        bus: With all its frames.
        delay: Ticks by which every frame is used later than it arrives.
        setpoints: To each board.
        measurements: Of each.
        numbers: Room for what a frame says.
    """

    bus: Bus
    delay: int
    setpoints: list[Wire]
    measurements: list[Wire]
    numbers: list[float]


@dataclass(slots=True)
class Episode:
    """Everything that a tick reads and writes.

    Attributes:
        step: Of the integration in [s].
        substeps: Steps in a tick.
        gravity: In [m] / [s²].
        body_weight: Of wearer and device in [N].
        catch_stiffness: Of the harness that locks at a trip in [N] / [m].
        catch_dissipation: In [s] / [m].
        watching: Whether the safety monitor is on.
        first_fault: First tick with a fault.
        requests: That are made of the supervisor, with room for more; none without one.
        limbs: Hip and knee of the wearer, leg by leg.
        ankles: Place of the ankle of each leg in the coordinates; none without.
        passive: Places of the joints that are not controlled, in the order of the log.
        status: ``COMPLETED``, ``DIVERGED``, or how the wearer fell: ``FELL``, ``TIPPED`` or ``LET_GO``.
        contact_power: Of the contact forces in [W].
        last_contact_power: Of the step before.
        q: Coordinates in [rad] and [m].
        v: Velocities.
        a: Accelerations.
        motor: Motor torques on the coordinates in [N m].
        external: Torques of push and wearer on them.
        torque: All torques on them.
        bodies: Run-time values of the plant's kernel.
        points: Of the soles.
        braced: Coordinates of the device in the order of the log's braces.
        brace_work: Work of the braces since the start in [J].
        trunk: If it is free.
        trunk_unit: On it, unless its pitch is known exactly.
        arms: That hold a crutch.
        habit: How they are used.
        sense: What the person feels.
        swing_phases: 1 for phases in which a leg swings.
        chair_phases: What a person feels of a chair in a phase, :class:`twin_gait.core.arm_policy.Sense`.
        seat: If there is one.
    """

    step: float
    substeps: int
    gravity: float
    body_weight: float
    catch_stiffness: float
    catch_dissipation: float
    watching: bool
    first_fault: int
    q: list[float]
    v: list[float]
    a: list[float]
    motor: list[float]
    external: list[float]
    torque: list[float]
    stages: Stages
    bodies: list[float]
    rates: Rates
    supply: Supply
    limits: Limits
    ends: Ends
    controller: ControllerState
    joints: list[Joint]
    soles: list[Sole]
    network: Network
    limbs: list[Limb]
    ankles: list[int]
    passive: list[int]
    plant: list[Plant]
    ground: Ground
    points: list[Point]
    belt: Belt
    imposed_motion: ImposedMotion
    braces: list[Brace]
    braced: list[int]
    faults: list[Fault]
    requests: list[Asked]
    efforts: Efforts
    recording: Recording
    trunk: Trunk
    trunk_unit: TrunkUnit
    arms: list[Arm]
    habit: Habit
    sense: Sense
    swing_phases: list[float]
    chair_phases: list[float]
    seat: Seat
    works: WorkRow = field(default_factory=WorkRow)
    brace_work: float = 0.0
    status: int = COMPLETED
    contact_power: float = 0.0
    last_contact_power: float = 0.0
