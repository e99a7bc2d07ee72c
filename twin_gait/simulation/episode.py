"""An episode: one nested record of everything that a tick reads and writes.

From these classes come the dtype of the compiled loop, the plain tree that the reference engine runs on and
the types that are checked (:mod:`twin_gait.simulation.record`). Joints are numbered leg by leg (left hip,
left knee, right hip, …). With braces the coordinates are those of the device, then those of the wearer.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from twin_gait.core.actuator import Motor
from twin_gait.core.assistance import Adaptation
from twin_gait.core.belt import Belt
from twin_gait.core.contact import Ground, Point
from twin_gait.core.control_tick import Encoder, Setpoint
from twin_gait.core.estimation import DelayLine
from twin_gait.core.faults import Fault
from twin_gait.core.guards import GuardProgram
from twin_gait.core.plant import Brace, ImposedMotion, Plant
from twin_gait.core.safety import NO_TRIP, Bounds, Watched
from twin_gait.core.wearer import Condition
from twin_gait.parameters import FrictionParameters
from twin_gait.simulation.log import WorkRow
from twin_gait.simulation.rows import Efforts, Recording

COMPLETED, FELL, DIVERGED = 0, 1, 2


@dataclass(slots=True)
class Command:
    """What a joint is asked for in a tick, by the controller or in the hold.

    Attributes:
        stiffness: k in [N m] / [rad].
        damping: b in [N m s] / [rad].
        equilibrium: θ0 in [rad].
        gain: G, of the friction compensation.
        impedance: Torque in [N m], as all of them.
        friction: Compensation.
        gravity: Compensation.
        inertia: Compensation.
        target: That is added.
        torque: Sum of these, before limits.
        target_current: That the drive is asked for in [A].
        cause: Of a trip, if no drive may be asked for what the controller wants.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    equilibrium: float = 0.0
    gain: float = 0.0
    impedance: float = 0.0
    friction: float = 0.0
    gravity: float = 0.0
    inertia: float = 0.0
    target: float = 0.0
    torque: float = 0.0
    target_current: float = 0.0
    cause: int = NO_TRIP


@dataclass(slots=True)
class Joint:
    """An actuated joint.

    Attributes:
        place: In the coordinates.
        control_place: In the coordinates of the controller's model.
        encoder: With its velocity estimates.
        reading: What it reads before it quantises, in [rad].
        last_reading: Likewise in the tick before.
        motor: Motor and gear.
        friction_model: Of the compensator.
        model_friction: Its torque at the slow velocity in [N m].
        setpoints: Of every phase.
        blend_start: Setpoint at the last switch.
        blended: Present setpoint.
        target: Torque that is added to the command, in [N m].
        push: Torque from outside, held over the tick, in [N m].
        rate: Estimate of the acceleration in [rad] / [s²].
        lead: Torque that lets the damper follow the path, in [N m].
        assistance: Share of the impedance that the joint is given.
        tracking: Sum of the absolute errors of the stride in [rad].
        bounds: Of the safety monitor.
        line: Commands on their way to the drive in [N m].
        watched: What the monitor remembers.
        command: Of this tick.
        due: Command that reaches the drive in this tick, where they come late, in [N m].
        drive_off: Whether the drive is cut off.
        hold_angle: Angle at the trip in [rad].
        condition: What the wearer does.
        moments: Normative moment in [N m] by phase and posture of the hip.
    """

    place: int
    control_place: int
    encoder: Encoder
    reading: float
    motor: Motor
    friction_model: FrictionParameters
    setpoints: list[Setpoint]
    blend_start: Setpoint
    blended: Setpoint
    target: float
    assistance: float
    bounds: Bounds
    line: DelayLine
    condition: Condition
    moments: list[list[float]]
    watched: Watched = field(default_factory=Watched)
    command: Command = field(default_factory=Command)
    due: float = 0.0
    last_reading: float = 0.0
    model_friction: float = 0.0
    push: float = 0.0
    rate: float = 0.0
    lead: float = 0.0
    tracking: float = 0.0
    drive_off: bool = False
    hold_angle: float = 0.0


@dataclass(slots=True)
class Leg:
    """A leg.

    Attributes:
        ankle: Place of its ankle in the coordinates, -1 without one.
        phase: Present phase.
        before: Phase at the start of the tick.
        entry_tick: Tick in which the phase was entered.
        ticks: Since then.
        chosen: Transition that it takes in this tick, -1 for none.
        results: Of the guard that is being evaluated, a bit each.
        debounce: Consecutive ticks with an open guard, by transition.
        gravity_shares: Of the gravity compensation, by phase.
        gravity_start: Share at the last switch.
        gravity: Present share.
        load: Of the foot over body weight.
        last_load: Of the tick before.
        load_streak: Consecutive ticks in which the load stood still while the hip turned.
        phase_cause: Of a trip in this tick: the phase has timed out.
        load_cause: Of a trip in this tick: the load stands still.
        path_start: Share of the cycle at which the leg begins.
        stride_start: Tick in which its stride began.
        stride_ticks: Length of the last stride.
    """

    ankle: int
    phase: int
    debounce: list[int]
    gravity_shares: list[float]
    gravity_start: float
    gravity: float
    path_start: float
    stride_ticks: int
    before: int = 0
    entry_tick: int = 0
    ticks: int = 0
    chosen: int = -1
    results: int = 0
    load: float = 0.0
    last_load: float = 0.0
    load_streak: int = 0
    phase_cause: int = NO_TRIP
    load_cause: int = NO_TRIP
    stride_start: int = 0


@dataclass(slots=True)
class Trip:
    """What the safety monitor has tripped on.

    Attributes:
        tick: Of the trip, -1 before it.
        cause: As :mod:`twin_gait.core.safety` numbers them.
        part: A joint, or the number of joints plus a leg, or -1 for the supply.
    """

    tick: int = -1
    cause: int = 0
    part: int = 0


@dataclass(slots=True)
class Rates:
    """How the firmware samples.

    Attributes:
        period: Length of a tick in [s].
        fast_gain: Of the fast velocity filter.
        decimation: Ticks between two slow samples.
        blend_law: Of the setpoints, see :mod:`twin_gait.core.blending`.
        blend_ticks: How long they fade.
    """

    period: float
    fast_gain: float
    decimation: int
    blend_law: int
    blend_ticks: int


@dataclass(slots=True)
class Supply:
    """Battery and bus.

    Attributes:
        voltage: Open-circuit voltage in [V].
        resistance: Internal one in [Ω].
        constant_power: Of inverters and electronics in [W].
        regeneration: Share of what is fed into the bus that returns to the battery.
        bus_voltage: Present one in [V].
        least_voltage: That the monitor bears, in [V].
        low_ticks: How long it bears less.
        low_streak: Consecutive ticks with less.
        power: That is drawn from the battery in this tick in [W]; until all motors are driven, by them alone.
        cause: Of a trip in this tick: less for too long.
    """

    voltage: float
    resistance: float
    constant_power: float
    regeneration: float
    bus_voltage: float
    least_voltage: float
    low_ticks: int
    low_streak: int = 0
    power: float = 0.0
    cause: int = NO_TRIP


@dataclass(slots=True)
class Limits:
    """What ends or bounds a run.

    Attributes:
        torque: Of the command in [N m].
        current: Of the drives in [A].
        fall_height: Height of the pelvis below which the wearer has fallen, in [m].
        diverged_velocity: In [rad] / [s].
        phase_ticks: Longest time in a phase.
        frozen_load_ticks: Longest time for which a load may stand still.
        lowering_ticks: In which a held leg is lowered.
        hold_damping: Of a held joint in [N m s] / [rad].
    """

    torque: float
    current: float
    fall_height: float
    diverged_velocity: float
    phase_ticks: int
    frozen_load_ticks: int
    lowering_ticks: int
    hold_damping: float


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
class ControlModel:
    """The controller's rigid-body model.

    Attributes:
        bodies: Run-time values of its kernel.
        q: Coordinates at which it is evaluated in [rad].
        a: Accelerations in [rad] / [s²].
        gravity_torque: In [N m].
        inertia_torque: In [N m].
        inertia_gain: Share of the inertia torques that is compensated.
    """

    bodies: list[float]
    q: list[float]
    a: list[float]
    gravity_torque: list[float]
    inertia_torque: list[float]
    inertia_gain: float


@dataclass(slots=True)
class Path:
    """The reference walk: followed, or what the tracking error is measured against.

    Attributes:
        angles: Over a cycle in [rad], by sample and joint of a leg.
        cycle_ticks: Length of a cycle.
        adaptation: Of the assistance level.
    """

    angles: list[list[float]]
    cycle_ticks: int
    adaptation: Adaptation


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
        status: ``COMPLETED``, ``FELL`` or ``DIVERGED``.
        last_rest: Last tick in which the legs were told to stand.
        contact_power: Of the contact forces in [W].
        last_contact_power: Of the step before.
        q: Coordinates in [rad] and [m].
        v: Velocities.
        a: Accelerations.
        motor: Motor torques on the coordinates in [N m].
        external: Torques of push and wearer on them.
        torque: All torques on them.
        bodies: Run-time values of the plant's kernel.
        signals: What the guards read: of this leg, of the other, then the command to walk.
        points: Of the soles.
        braced: Coordinates of the device in the order of the log's braces.
        brace_work: Work of the braces since the start in [J].
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
    signals: list[float]
    rates: Rates
    supply: Supply
    limits: Limits
    control: ControlModel
    joints: list[Joint]
    legs: list[Leg]
    plant: list[Plant]
    ground: Ground
    points: list[Point]
    belt: Belt
    program: GuardProgram
    imposed_motion: ImposedMotion
    braces: list[Brace]
    braced: list[int]
    faults: list[Fault]
    path: Path
    efforts: Efforts
    recording: Recording
    works: WorkRow = field(default_factory=WorkRow)
    brace_work: float = 0.0
    trip: Trip = field(default_factory=Trip)
    status: int = COMPLETED
    last_rest: int = 0
    contact_power: float = 0.0
    last_contact_power: float = 0.0
