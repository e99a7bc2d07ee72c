"""Gait controller: program of the central unit, which computes the phases of both legs and all setpoints.

In a tick of 1 ms it receives the measurements of the boards (:mod:`twin_gait.control.joint_board`) and of the
soles, monitors them, runs the state machine of each leg, blends into the parameters of a new phase, computes
the gravity torques of the legs, and sends a setpoint to every board. The simulation and the C firmware run
these functions in the order of :mod:`twin_gait.control.device_schedule`.
"""

from dataclasses import dataclass, field

from twin_gait.control.joint_board import (
    JointSetpoint,
    Limits,
    Measurement,
    SamplingConfig,
    set_hold_setpoint,
)
from twin_gait.control.supervisor import NO_POSTURE, Supervisor, choose_mode
from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import ImpedanceSetpoint, blend_setpoint, copy_setpoint
from twin_gait.core.estimation import first_order_step
from twin_gait.core.guards import NO_TRANSITION, GuardProgram, is_in_mask
from twin_gait.core.safety import BUS_TRIP, LOAD_TRIP, NO_TRIP, PHASE_TRIP, SUPPLY_TRIP, hold_weight_share
from twin_gait.gait import signals as declared
from twin_gait.gait.signals import DEVICE_SIGNALS, JOINT_SIGNALS, LEG_SIGNALS

# Build flags of the loop and of the firmware: number of legs, number of actuated joints of a leg, whether
# inertia torques are used, whether the controller changes the setpoints in every tick, and whether there are
# operating modes.
N_LEGS, N_JOINTS_PER_LEG = 1, 2
WITH_INERTIA_COMPENSATION = WITH_CONTROLLER = WITH_SUPERVISOR = False

# Numbers of signals of a joint and of a leg, and indices of signals. The list of signals contains those of
# the leg's joints, of the leg itself, of the other leg in the same order, and of the device.
PER_JOINT, PER_LEG = len(JOINT_SIGNALS), len(LEG_SIGNALS)
ANGLE, VELOCITY = map(JOINT_SIGNALS.index, (declared.ANGLE, declared.VELOCITY))
LOAD, TIME_IN_PHASE = map(LEG_SIGNALS.index, (declared.LOAD, declared.TIME_IN_PHASE))
TRUNK_PITCH, WALK, STEP = map(DEVICE_SIGNALS.index, (declared.TRUNK_PITCH, declared.WALK, declared.STEP))
MODE_TIME, MODE_PITCH, LEGS_IN_SWING = range(len(declared.MODE_SIGNALS))  # Signals of the supervisor.


@dataclass(slots=True)
class ControlledJoint:
    """State of a joint in the gait controller."""

    model_index: int  # Index in the coordinates of the controller's model.
    setpoints: list[ImpedanceSetpoint]  # Impedance setpoint of every phase.
    blend_start: ImpedanceSetpoint  # Blended impedance setpoint at the last phase switch.
    blended: ImpedanceSetpoint  # Blended impedance setpoint of this tick.
    target: float  # Target torque, which is added to the command, in [N·m].
    measurement: Measurement = field(default_factory=Measurement)  # Last measurement received from its board.
    setpoint: JointSetpoint = field(default_factory=JointSetpoint)  # Setpoint that is sent to its board.
    rate: float = 0.0  # Estimated acceleration in [rad/s²].
    hold_angle: float = 0.0  # Angle of the hold, measured before the trip, in [rad].
    ticks_since_message: int = 0  # Ticks since the last message of its board.


@dataclass(slots=True)
class ControlledLeg:
    """State of a leg in the gait controller."""

    phase: int  # Present phase.
    debounce: list[int]  # Consecutive ticks with a true guard, for each transition.
    gravity_shares: list[float]  # Share of the gravity compensation of each phase.
    gravity_start: float  # Blended share at the last phase switch.
    gravity: float  # Blended share of the gravity compensation in this tick.
    blend_ticks: list[int]  # Blending time of the parameters of each phase in ticks.
    frozen_speed: float  # Speed of the proximal joint in [rad/s], above which a constant load is a fault.
    start_phase: int = 0  # Phase at the start of the tick.
    entry_tick: int = 0  # Tick in which the phase was entered.
    ticks: int = 0  # Number of ticks since the phase was entered.
    chosen: int = NO_TRANSITION  # Transition that the leg takes in this tick, -1 for none.
    results: int = 0  # Results of the nodes of the guard that is being evaluated, one bit for each.
    load: float = 0.0  # Sole load as a fraction of body weight.
    last_load: float = 0.0  # Sole load of the tick before.
    load_streak: int = 0  # Consecutive ticks in which the load was constant in motion.
    cause: int = NO_TRIP  # Cause of a trip in this tick: a timeout of the phase, or a constant load.


@dataclass(slots=True)
class DeviceSignals:
    """Signals of the device as a whole, for the guards of both legs."""

    # Pitch of the trunk from upright in [rad], positive forward.
    trunk_pitch: float = declared.TRUNK_PITCH.initial_value
    walk: float = declared.WALK.initial_value  # 1 to walk, 0 to stand.
    step: float = declared.STEP.initial_value  # 1 to take a step, 0 to wait for one.


@dataclass(slots=True)
class SupplyMonitor:
    """State of the monitor for the bus voltage."""

    voltage: float  # Measured voltage in [V].
    least_voltage: float  # Minimum voltage in [V].
    low_ticks: int  # Number of consecutive ticks below it that leads to a trip.
    low_streak: int = 0  # Consecutive ticks below it.
    cause: int = NO_TRIP  # Cause of a trip in this tick: low voltage for too long.


@dataclass(slots=True)
class TripState:
    """Trip of the safety monitor."""

    tick: int = -1  # Tick of the trip, -1 before it.
    cause: int = NO_TRIP  # Cause, numbered as in :mod:`twin_gait.core.safety`.
    part: int = 0  # Index of a joint, or the number of joints plus a leg, or -1 for the supply.


@dataclass(slots=True)
class ControlModel:
    """The controller's rigid-body model."""

    bodies: list[float]  # Run-time values of the model's kernel.
    gravity: float  # Gravitational acceleration in [m/s²].
    q: list[float]  # Coordinates at which the model is evaluated in [rad].
    a: list[float]  # Accelerations in [rad/s²].
    gravity_torque: list[float]  # Gravity torques in [N·m].
    inertia_torque: list[float]  # Inertia torques in [N·m].
    inertia_gain: float  # Share of the inertia torques that is compensated.


@dataclass(slots=True)
class ControllerState:
    """State of the gait controller."""

    joints: list[ControlledJoint]  # Joints, leg by leg: left hip, left knee, right hip, …
    legs: list[ControlledLeg]  # Left and right leg.
    program: GuardProgram  # Transitions of the gait table with their guards.
    signals: list[float]  # Signals that the guards read: of this leg, of the other leg, of the device.
    supply: SupplyMonitor  # Monitor of the bus voltage.
    model: ControlModel  # Model for gravity and inertia torques.
    memory: object  # Memory of the controller, :mod:`twin_gait.control.controller`.
    supervisor: Supervisor  # Supervisor of the operating modes, if there are any.
    # Received signals of the device as a whole.
    device_signals: DeviceSignals = field(default_factory=DeviceSignals)
    trip: TripState = field(default_factory=TripState)  # Trip of the monitor.
    last_stand_tick: int = 0  # Last tick with the command to stand.


def receive_load(controller: ControllerState, number: int, load: float) -> None:
    """Store the received load of a foot, a fraction of body weight."""
    leg = controller.legs[number]
    leg.last_load = leg.load
    leg.load = load


def check_board_timeout(controller: ControllerState, limits: Limits, number: int, received: bool) -> None:
    """Count the ticks since the last bus message of a board, and set a cause of a trip after the timeout.

    ``received``: whether a message has arrived in this tick.
    """
    joint = controller.joints[number]
    joint.ticks_since_message = 0 if received else joint.ticks_since_message + 1
    if joint.ticks_since_message > limits.board_timeout and joint.measurement.cause == NO_TRIP:
        joint.measurement.cause = BUS_TRIP


def receive_device_signals(controller: ControllerState, received: DeviceSignals, tick: int) -> None:
    """Store the received signals of the device as a whole."""
    controller.device_signals.trunk_pitch = received.trunk_pitch
    controller.device_signals.step = received.step
    receive_walk_command(controller, received.walk, tick)


def receive_walk_command(controller: ControllerState, walk: float, tick: int) -> None:
    """Store the walk command, 1 to walk and 0 to stand, and the last tick with the command to stand."""
    controller.device_signals.walk = walk
    if walk == 0.0:
        controller.last_stand_tick = tick


def monitor_leg(controller: ControllerState, limits: Limits, number: int, tick: int) -> None:
    """Set a cause of a trip if a leg is in its phase for too long, or its load is constant in motion.

    A load is constant in motion if it has not changed for some ticks in which the proximal joint was faster
    than ``frozen_speed``.
    """
    leg, proximal = controller.legs[number], controller.joints[number * N_JOINTS_PER_LEG]
    late = tick - max(leg.entry_tick, controller.last_stand_tick) > limits.phase_ticks
    still = leg.load == leg.last_load and leg.load > 0.0
    turning = abs(proximal.measurement.motor_speed) > leg.frozen_speed
    leg.load_streak = leg.load_streak + 1 if still and turning else 0
    frozen = leg.load_streak >= limits.frozen_load_ticks
    leg.cause = PHASE_TRIP if late else (LOAD_TRIP if frozen else NO_TRIP)


def monitor_supply(controller: ControllerState) -> None:
    """Set a cause of a trip if the bus voltage has been too low for too long."""
    supply = controller.supply
    supply.low_streak = supply.low_streak + 1 if supply.voltage < supply.least_voltage else 0
    supply.cause = SUPPLY_TRIP if supply.low_streak >= supply.low_ticks else NO_TRIP


def has_cause(controller: ControllerState) -> bool:
    """Check whether a board, a leg or the supply has set a cause of a trip."""
    causes = controller.supply.cause
    for joint in controller.joints:
        causes |= joint.measurement.cause
    for leg in controller.legs:
        causes |= leg.cause
    return causes != NO_TRIP


def trip_on_causes(controller: ControllerState, tick: int) -> None:
    """Trip for the first cause in the order of joints, legs and supply; does nothing without a cause."""
    for number, joint in enumerate(controller.joints):
        trip(controller, tick, joint.measurement.cause, number)
    for number, leg in enumerate(controller.legs):
        trip(controller, tick, leg.cause, len(controller.joints) + number)
    trip(controller, tick, controller.supply.cause, -1)


def trip(controller: ControllerState, tick: int, cause: int, part: int) -> None:
    """Start the hold if there is a cause and no earlier trip.

    ``part``: index of a joint, or the number of joints plus that of a leg, or -1 for the supply.
    """
    noted = controller.trip
    if cause != NO_TRIP and noted.tick < 0:
        noted.tick, noted.cause, noted.part = tick, cause, part
        for joint in controller.joints:
            # The angle of the tick before is used, because that of this tick may be the cause of the trip.
            joint.hold_angle = joint.measurement.last_angle


def begin_tick(controller: ControllerState, number: int, tick: int) -> None:
    """Store phase and time in phase of a leg at the start of the tick, for the guards of both legs."""
    leg = controller.legs[number]
    leg.ticks, leg.start_phase = tick - leg.entry_tick, leg.phase


def write_signals(controller: ControllerState, rates: SamplingConfig, number: int) -> None:
    """Write all signals that the guards of a leg read: of this leg, of the other leg, and of the device."""
    write_leg(controller, rates, number, 0, controller.signals)
    other = PER_JOINT * N_JOINTS_PER_LEG + PER_LEG
    if N_LEGS == 2:
        write_leg(controller, rates, 1 - number, other, controller.signals)
    controller.signals[2 * other + TRUNK_PITCH] = controller.device_signals.trunk_pitch
    controller.signals[2 * other + WALK] = controller.device_signals.walk
    controller.signals[2 * other + STEP] = controller.device_signals.step


def write_leg(
    controller: ControllerState, rates: SamplingConfig, number: int, first: int, target: list[float]
) -> None:
    """Write the measured signals of a leg into a list of signals, from the index ``first`` on."""
    leg, behind = controller.legs[number], first + PER_JOINT * N_JOINTS_PER_LEG
    for position in range(N_JOINTS_PER_LEG):
        measured = controller.joints[number * N_JOINTS_PER_LEG + position].measurement
        target[first + PER_JOINT * position + ANGLE] = measured.angle
        target[first + PER_JOINT * position + VELOCITY] = measured.velocity
    target[behind + LOAD] = leg.load
    target[behind + TIME_IN_PHASE] = leg.ticks * rates.period


def enter_phase(controller: ControllerState, number: int, phase: int, tick: int) -> None:
    """Set the phase of a leg, reset its debounce counters and start the blending."""
    leg = controller.legs[number]
    leg.phase = phase
    leg.entry_tick = tick
    for index in range(len(leg.debounce)):
        leg.debounce[index] = 0
    for joint in range(number * N_JOINTS_PER_LEG, (number + 1) * N_JOINTS_PER_LEG):
        copy_setpoint(controller.joints[joint].blended, controller.joints[joint].blend_start)
    leg.gravity_start = leg.gravity


def blend_parameters(controller: ControllerState, rates: SamplingConfig, number: int, tick: int) -> None:
    """Blend the parameters of a leg towards those of its phase, until the blending is complete."""
    leg = controller.legs[number]
    ticks, since = leg.blend_ticks[leg.phase], tick - leg.entry_tick
    if since <= ticks and controller.trip.tick < 0:
        share = blend_share(1.0 if ticks <= 0 else since / ticks, rates.blend_law)
        for index in range(number * N_JOINTS_PER_LEG, (number + 1) * N_JOINTS_PER_LEG):
            joint = controller.joints[index]
            blend_setpoint(joint.blend_start, joint.setpoints[leg.phase], share, joint.blended)
        leg.gravity = blend(leg.gravity_start, leg.gravity_shares[leg.phase], share)


def run_supervisor(controller: ControllerState, rates: SamplingConfig, tick: int) -> None:
    """Run the supervisor: write its signals, choose the mode, and set the walk and step commands of the mode.

    :func:`required_posture` returns the posture of the mode.
    """
    supervisor, signals, behind = controller.supervisor, controller.supervisor.signals, 0
    swinging = 0
    for number in range(N_LEGS):
        begin_tick(controller, number, tick)
        swinging += is_in_mask(supervisor.swing, controller.legs[number].phase)
        write_leg(controller, rates, number, behind, signals)
        behind += PER_JOINT * N_JOINTS_PER_LEG + PER_LEG
    signals[behind + MODE_TIME] = (tick - supervisor.entry_tick) * rates.period
    signals[behind + MODE_PITCH] = controller.device_signals.trunk_pitch
    signals[behind + LEGS_IN_SWING] = float(swinging)
    choose_mode(supervisor, tick, controller.trip.tick >= 0)
    command = supervisor.modes[supervisor.mode]
    receive_walk_command(controller, command.walk, tick)
    controller.device_signals.step = command.step
    if command.step == 0.0 and swinging == 0:
        controller.last_stand_tick = tick


def required_posture(controller: ControllerState, number: int) -> int:
    """Return the phase that a new mode requires of a leg, or ``NO_POSTURE``.

    The result is ``NO_POSTURE`` if the mode is not new, has no posture, or the leg is already in that phase.
    """
    supervisor = controller.supervisor
    posture = supervisor.modes[supervisor.mode].posture
    return posture if supervisor.entered and posture != controller.legs[number].phase else NO_POSTURE


def needs_gravity(controller: ControllerState) -> bool:
    """Check whether gravity torques are needed: for compensation, for the inertia model, or in the hold."""
    needed = WITH_INERTIA_COMPENSATION or controller.trip.tick >= 0
    for leg in controller.legs:
        needed = needed or leg.gravity != 0.0
    return needed


def set_model_angle(controller: ControllerState, number: int) -> None:
    """Set a joint of the model to its measured angle, or to the angle at which the monitor tripped."""
    joint = controller.joints[number]
    angle = joint.hold_angle if controller.trip.tick >= 0 else joint.measurement.angle
    controller.model.q[joint.model_index] = angle


def estimate_acceleration(controller: ControllerState, rates: SamplingConfig, number: int) -> None:
    """Estimate the acceleration of a joint: low-pass filtered change of its fast velocity over a tick."""
    joint = controller.joints[number]
    rate = (joint.measurement.velocity - joint.measurement.last_velocity) / rates.period
    joint.rate = first_order_step(joint.rate, rate, rates.fast_gain)
    controller.model.a[joint.model_index] = joint.rate


def controller_tick(memory: object, device: ControllerState, tick: int, period: float) -> None:
    """Run the tick of the controller, see :class:`twin_gait.control.controller.Controller`."""
    raise NotImplementedError


def run_controller(controller: ControllerState, rates: SamplingConfig, tick: int) -> None:
    """Set the setpoints of the phases, and run the tick of the controller, which may change them."""
    for number in range(len(controller.joints)):
        set_phase_setpoint(controller, number)
    controller_tick(controller.memory, controller, tick, rates.period)


def compute_setpoint(controller: ControllerState, limits: Limits, number: int, tick: int) -> None:
    """Set the setpoint of a board: from the phase or the controller, or to hold its joint after a trip."""
    joint = controller.joints[number]
    if controller.trip.tick >= 0:
        share = hold_weight_share(tick - controller.trip.tick, limits.lowering_ticks)
        weight = controller.model.gravity_torque[joint.model_index]
        set_hold_setpoint(joint.setpoint, limits, joint.hold_angle, share, weight)
    elif not WITH_CONTROLLER:
        set_phase_setpoint(controller, number)


def set_phase_setpoint(controller: ControllerState, number: int) -> None:
    """Set the setpoint of a board to the blended impedance and the feed-forward torques."""
    joint, leg = controller.joints[number], controller.legs[number // N_JOINTS_PER_LEG]
    target, setpoint, index = joint.setpoint, joint.blended, joint.model_index
    weight, inertia = controller.model.gravity_torque[index], controller.model.inertia_torque[index]
    target.stiffness, target.damping = setpoint.stiffness, setpoint.damping
    target.equilibrium, target.gain = setpoint.equilibrium, setpoint.gain
    target.gravity = leg.gravity * weight if leg.gravity != 0.0 else 0.0
    target.inertia = controller.model.inertia_gain * inertia
    target.target = joint.target
