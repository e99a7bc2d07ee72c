"""The gait controller: the device's central unit, which decides on the phases of both legs and all demands.

In a tick of 1 ms it takes what the boards of the joints (:mod:`twin_gait.control.joint_board`) and the soles
report, watches it, runs the state machine of each leg, fades into the parameters of a new phase, computes the
weight of the legs, and tells every board what it wants. The simulation and the C firmware run these functions
in the order of :mod:`twin_gait.control.device_schedule`.
"""

from dataclasses import dataclass, field

from twin_gait.control.joint_board import Demand, Limits, Measurement, Rates, demand_rest
from twin_gait.control.supervisor import NO_POSTURE, Supervisor, choose_mode
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import Setpoint, blend_setpoint, copy_setpoint
from twin_gait.core.estimation import first_order_step
from twin_gait.core.guards import NO_TRANSITION, GuardProgram, is_among
from twin_gait.core.safety import BUS_TRIP, LOAD_TRIP, NO_TRIP, PHASE_TRIP, SUPPLY_TRIP, support_share
from twin_gait.gait import signals as declared
from twin_gait.gait.signals import DEVICE_SIGNALS, JOINT_SIGNALS, LEG_SIGNALS

# What a loop is bound to, and a firmware printed with: legs, actuated joints of a leg, whether inertia
# torques are wanted, the controller changes the demands in every tick, and there are operating modes.
LEGS, JOINTS_PER_LEG = 1, 2
INERTIA_WANTED = CONTROLLED = SUPERVISED = False

# Places in the list of signals: among those of a joint, of a leg behind them, of the device behind both legs.
PER_JOINT, PER_LEG = len(JOINT_SIGNALS), len(LEG_SIGNALS)
ANGLE, VELOCITY = map(JOINT_SIGNALS.index, (declared.ANGLE, declared.VELOCITY))
LOAD, TIME_IN_PHASE = map(LEG_SIGNALS.index, (declared.LOAD, declared.TIME_IN_PHASE))
TRUNK_PITCH, WALK, STEP = map(DEVICE_SIGNALS.index, (declared.TRUNK_PITCH, declared.WALK, declared.STEP))
MODE_TIME, MODE_PITCH, LEGS_IN_SWING = range(len(declared.MODE_SIGNALS))  # of the supervisor, likewise


@dataclass(slots=True)
class ControlledJoint:
    """A joint as the gait controller has it."""

    control_place: int  # In the coordinates of the controller's model.
    setpoints: list[Setpoint]  # Of every phase.
    blend_start: Setpoint  # Setpoint at the last switch.
    blended: Setpoint  # Present setpoint.
    target: float  # Torque that is added to the command, in [N m].
    measurement: Measurement = field(default_factory=Measurement)  # Last heard from its board.
    demand: Demand = field(default_factory=Demand)  # What its board is asked for.
    rate: float = 0.0  # Estimate of the acceleration in [rad] / [s²].
    hold_angle: float = 0.0  # Angle at the trip in [rad].
    silent_ticks: int = 0  # Since its board was heard.


@dataclass(slots=True)
class ControlledLeg:
    """A leg as the gait controller has it."""

    phase: int  # Present phase.
    debounce: list[int]  # Consecutive ticks with an open guard, by transition.
    gravity_shares: list[float]  # Of the gravity compensation, by phase.
    gravity_start: float  # Share at the last switch.
    gravity: float  # Present share.
    blend_ticks: list[int]  # How long parameters fade into a phase, by phase.
    frozen_speed: float  # Speed of the hip at which a load that stands still is broken in [rad] / [s].
    before: int = 0  # Phase at the start of the tick.
    entry_tick: int = 0  # Tick in which the phase was entered.
    ticks: int = 0  # Since then.
    chosen: int = NO_TRANSITION  # Transition that it takes in this tick, -1 for none.
    results: int = 0  # Of the guard that is being evaluated, a bit each.
    load: float = 0.0  # Of the foot over body weight.
    last_load: float = 0.0  # Of the tick before.
    load_streak: int = 0  # Consecutive ticks in which the load stood still while the hip turned.
    cause: int = NO_TRIP  # Of a trip in this tick: the phase has timed out, or the load stands still.


@dataclass(slots=True)
class Device:
    """What is heard of the device as a whole, for the guards of both legs."""

    trunk_pitch: float = declared.TRUNK_PITCH.first  # Of the trunk from upright in [rad], positive forward.
    walk: float = declared.WALK.first  # 1 to walk, 0 to stand.
    step: float = declared.STEP.first  # 1 to take a step, 0 to wait for one.


@dataclass(slots=True)
class WatchedSupply:
    """The bus voltage as the gait controller sees it."""

    voltage: float  # Measured in [V].
    least_voltage: float  # That it bears, in [V].
    low_ticks: int  # How long it bears less.
    low_streak: int = 0  # Consecutive ticks with less.
    cause: int = NO_TRIP  # Of a trip in this tick: less for too long.


@dataclass(slots=True)
class Trip:
    """What the safety monitor has tripped on."""

    tick: int = -1  # Of the trip, -1 before it.
    cause: int = NO_TRIP  # As :mod:`twin_gait.core.safety` numbers them.
    part: int = 0  # A joint, or the number of joints plus a leg, or -1 for the supply.


@dataclass(slots=True)
class ControlModel:
    """The controller's rigid-body model."""

    bodies: list[float]  # Run-time values of its kernel.
    gravity: float  # In [m] / [s²].
    q: list[float]  # Coordinates at which it is evaluated in [rad].
    a: list[float]  # Accelerations in [rad] / [s²].
    gravity_torque: list[float]  # In [N m].
    inertia_torque: list[float]  # In [N m].
    inertia_gain: float  # Share of the inertia torques that is compensated.


@dataclass(slots=True)
class ControllerState:
    """Everything that the gait controller keeps."""

    joints: list[ControlledJoint]  # Leg by leg: left hip, left knee, right hip, …
    legs: list[ControlledLeg]  # Left, right.
    program: GuardProgram  # Transitions of the gait table with their guards.
    signals: list[float]  # What the guards read: of this leg, of the other, then of the device.
    supply: WatchedSupply  # The bus voltage.
    model: ControlModel  # For gravity and inertia torques.
    memory: object  # Of the controller, :mod:`twin_gait.control.controller`.
    supervisor: Supervisor  # Of the operating modes, where there are any.
    common: Device = field(default_factory=Device)  # Heard of the device as a whole.
    trip: Trip = field(default_factory=Trip)  # Of the monitor.
    last_rest: int = 0  # Last tick in which the legs were told to stand.


def hear_load(controller: ControllerState, number: int, load: float) -> None:
    """Take the load of a foot over body weight."""
    leg = controller.legs[number]
    leg.last_load = leg.load
    leg.load = load


def hear_board(controller: ControllerState, limits: Limits, number: int, heard: bool) -> None:
    """Note over a bus whether a board has been silent for too long."""
    joint = controller.joints[number]
    joint.silent_ticks = 0 if heard else joint.silent_ticks + 1
    if joint.silent_ticks > limits.board_silence and joint.measurement.cause == NO_TRIP:
        joint.measurement.cause = BUS_TRIP


def hear_device(controller: ControllerState, heard: Device, tick: int) -> None:
    """Take all that is heard of the device as a whole."""
    controller.common.trunk_pitch = heard.trunk_pitch
    controller.common.step = heard.step
    hear_command(controller, heard.walk, tick)


def hear_command(controller: ControllerState, walk: float, tick: int) -> None:
    """Take the command to walk, 1, or to stand, 0."""
    controller.common.walk = walk
    if walk == 0.0:
        controller.last_rest = tick


def watch_leg(controller: ControllerState, limits: Limits, number: int, tick: int) -> None:
    """Note whether a leg stays in its phase for too long, or its load stands still while its hip turns."""
    leg, proximal = controller.legs[number], controller.joints[number * JOINTS_PER_LEG]
    late = tick - max(leg.entry_tick, controller.last_rest) > limits.phase_ticks
    still = leg.load == leg.last_load and leg.load > 0.0
    turning = abs(proximal.measurement.motor_speed) > leg.frozen_speed
    leg.load_streak = leg.load_streak + 1 if still and turning else 0
    frozen = leg.load_streak >= limits.frozen_load_ticks
    leg.cause = PHASE_TRIP if late else (LOAD_TRIP if frozen else NO_TRIP)


def watch_supply(controller: ControllerState) -> None:
    """Note whether the bus voltage has been too low for too long."""
    supply = controller.supply
    supply.low_streak = supply.low_streak + 1 if supply.voltage < supply.least_voltage else 0
    supply.cause = SUPPLY_TRIP if supply.low_streak >= supply.low_ticks else NO_TRIP


def has_cause(controller: ControllerState) -> bool:
    """Whether anything has been noted on which the monitor has to trip."""
    causes = controller.supply.cause
    for joint in controller.joints:
        causes |= joint.measurement.cause
    for leg in controller.legs:
        causes |= leg.cause
    return causes != NO_TRIP


def trip_on_causes(controller: ControllerState, tick: int) -> None:
    """Trip on the first cause that was noted: joints, then legs and supply."""
    for number, joint in enumerate(controller.joints):
        trip(controller, tick, joint.measurement.cause, number)
    for number, leg in enumerate(controller.legs):
        trip(controller, tick, leg.cause, len(controller.joints) + number)
    trip(controller, tick, controller.supply.cause, -1)


def trip(controller: ControllerState, tick: int, cause: int, part: int) -> None:
    """Go to the safe hold if there is a cause; the first one is kept."""
    noted = controller.trip
    if cause != NO_TRIP and noted.tick < 0:
        noted.tick, noted.cause, noted.part = tick, cause, part
        for joint in controller.joints:
            # The angles of this tick may be what the monitor tripped on.
            joint.hold_angle = joint.measurement.last_angle


def begin_tick(controller: ControllerState, number: int, tick: int) -> None:
    """Keep the phase of a leg as it is now, which both legs' guards read."""
    leg = controller.legs[number]
    leg.ticks, leg.before = tick - leg.entry_tick, leg.phase


def write_signals(controller: ControllerState, rates: Rates, number: int) -> None:
    """Write all that the guards of a leg read: of itself, of the other leg, and of the device."""
    write_leg(controller, rates, number, 0, controller.signals)
    other = PER_JOINT * JOINTS_PER_LEG + PER_LEG
    if LEGS == 2:
        write_leg(controller, rates, 1 - number, other, controller.signals)
    controller.signals[2 * other + TRUNK_PITCH] = controller.common.trunk_pitch
    controller.signals[2 * other + WALK] = controller.common.walk
    controller.signals[2 * other + STEP] = controller.common.step


def write_leg(controller: ControllerState, rates: Rates, number: int, first: int, into: list[float]) -> None:
    """Write what is measured on a leg from a place in a list of signals on."""
    leg, behind = controller.legs[number], first + PER_JOINT * JOINTS_PER_LEG
    for position in range(JOINTS_PER_LEG):
        measured = controller.joints[number * JOINTS_PER_LEG + position].measurement
        into[first + PER_JOINT * position + ANGLE] = measured.angle
        into[first + PER_JOINT * position + VELOCITY] = measured.velocity
    into[behind + LOAD] = leg.load
    into[behind + TIME_IN_PHASE] = leg.ticks * rates.period


def enter_phase(controller: ControllerState, number: int, phase: int, tick: int) -> None:
    """Let a leg be in a phase from now on."""
    leg = controller.legs[number]
    leg.phase = phase
    leg.entry_tick = tick
    for index in range(len(leg.debounce)):
        leg.debounce[index] = 0
    for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
        copy_setpoint(controller.joints[place].blended, controller.joints[place].blend_start)
    leg.gravity_start = leg.gravity


def fade(controller: ControllerState, rates: Rates, number: int, tick: int) -> None:
    """Fade the parameters of a leg towards those of its phase, unless they have arrived."""
    leg = controller.legs[number]
    ticks, since = leg.blend_ticks[leg.phase], tick - leg.entry_tick
    if since <= ticks and controller.trip.tick < 0:
        share = blend_share(1.0 if ticks <= 0 else since / ticks, rates.blend_law)
        for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
            joint = controller.joints[place]
            blend_setpoint(joint.blend_start, joint.setpoints[leg.phase], share, joint.blended)
        leg.gravity = blend(leg.gravity_start, leg.gravity_shares[leg.phase], share)


def supervise(controller: ControllerState, rates: Rates, tick: int) -> None:
    """Choose the mode, and tell the legs what it sets but for its posture, see :func:`sent_to`."""
    supervisor, signals, behind = controller.supervisor, controller.supervisor.signals, 0
    swinging = 0
    for number in range(LEGS):
        begin_tick(controller, number, tick)
        swinging += is_among(supervisor.swing, controller.legs[number].phase)
        write_leg(controller, rates, number, behind, signals)
        behind += PER_JOINT * JOINTS_PER_LEG + PER_LEG
    signals[behind + MODE_TIME] = (tick - supervisor.entry_tick) * rates.period
    signals[behind + MODE_PITCH] = controller.common.trunk_pitch
    signals[behind + LEGS_IN_SWING] = float(swinging)
    choose_mode(supervisor, tick, controller.trip.tick >= 0)
    told = supervisor.modes[supervisor.mode]
    hear_command(controller, told.walk, tick)
    controller.common.step = told.step
    if told.step == 0.0 and swinging == 0:
        controller.last_rest = tick


def sent_to(controller: ControllerState, number: int) -> int:
    """Phase that a leg is not in and enters with a mode that begins now, or ``NO_POSTURE``."""
    supervisor = controller.supervisor
    posture = supervisor.modes[supervisor.mode].posture
    return posture if supervisor.entered and posture != controller.legs[number].phase else NO_POSTURE


def wants_gravity(controller: ControllerState) -> bool:
    """Whether the weight of a leg is compensated, or carried in the hold."""
    wanted = INERTIA_WANTED or controller.trip.tick >= 0
    for leg in controller.legs:
        wanted = wanted or leg.gravity != 0.0
    return wanted


def pose(controller: ControllerState, number: int) -> None:
    """Bring a joint of the model to where it is measured, or was when the monitor tripped."""
    joint = controller.joints[number]
    angle = joint.hold_angle if controller.trip.tick >= 0 else joint.measurement.angle
    controller.model.q[joint.control_place] = angle


def estimate_acceleration(controller: ControllerState, rates: Rates, number: int) -> None:
    """Acceleration of a joint, from the change of its fast velocity."""
    joint = controller.joints[number]
    rate = (joint.measurement.velocity - joint.measurement.last_velocity) / rates.period
    joint.rate = first_order_step(joint.rate, rate, rates.fast_gain)
    controller.model.a[joint.control_place] = joint.rate


def controller_tick(memory: object, device: ControllerState, tick: int, period: float) -> None:
    """What the controller does in a tick, see :class:`twin_gait.control.controller.Controller`."""
    raise NotImplementedError


def change_demands(controller: ControllerState, rates: Rates, tick: int) -> None:
    """Let the controller change what the phases demand."""
    for number in range(len(controller.joints)):
        demand_setpoint(controller, number)
    controller_tick(controller.memory, controller, tick, rates.period)


def demand(controller: ControllerState, limits: Limits, number: int, tick: int) -> None:
    """Ask a board for what the phase demands, or the controller has, or to hold its joint after a trip."""
    joint = controller.joints[number]
    if controller.trip.tick >= 0:
        share = support_share(tick - controller.trip.tick, limits.lowering_ticks)
        weight = controller.model.gravity_torque[joint.control_place]
        demand_rest(joint.demand, limits, joint.hold_angle, share, weight)
    elif not CONTROLLED:
        demand_setpoint(controller, number)


def demand_setpoint(controller: ControllerState, number: int) -> None:
    """Ask a board for the present setpoint and what is fed forward."""
    joint, leg = controller.joints[number], controller.legs[number // JOINTS_PER_LEG]
    asked, setpoint, place = joint.demand, joint.blended, joint.control_place
    weight, inertia = controller.model.gravity_torque[place], controller.model.inertia_torque[place]
    asked.stiffness, asked.damping = setpoint.stiffness, setpoint.damping
    asked.equilibrium, asked.gain = setpoint.equilibrium, setpoint.gain
    asked.gravity = leg.gravity * weight if leg.gravity != 0.0 else 0.0
    asked.inertia = controller.model.inertia_gain * inertia
    asked.target = joint.target
