"""What the units of the firmware do in a tick of 1 ms: a joint's board, the gait controller, and both as one.

They say in which order the functions of :mod:`twin_gait.control.joint_board` and
:mod:`twin_gait.control.gait_controller` are called; the rooms of the simulation's tick do the same for many
episodes at once (:mod:`twin_gait.simulation.rooms.tick`), with sensors, bus and motors in between. These
functions are printed as C. A step takes a unit with its inputs, and changes unit and outputs in place.
"""

from dataclasses import dataclass, field

from twin_gait.control.gait_controller import (
    CONTROLLED,
    INERTIA_WANTED,
    LEGS,
    SUPERVISED,
    ControllerState,
    Device,
    begin_tick,
    change_demands,
    demand,
    enter_phase,
    estimate_acceleration,
    fade,
    has_cause,
    hear_board,
    hear_device,
    hear_load,
    pose,
    sent_to,
    supervise,
    trip,
    trip_on_causes,
    wants_gravity,
    watch_leg,
    watch_supply,
    write_signals,
)
from twin_gait.control.joint_board import (
    BoardState,
    Command,
    Demand,
    Limits,
    Measurement,
    Rates,
    ask,
    check,
    copy_command,
    copy_demand,
    copy_measurement,
    demand_rest,
    hear,
    model_friction,
    note_drive,
    obey,
    report,
    set_current,
    sum_up,
    watch_drive,
)
from twin_gait.control.supervisor import NO_POSTURE, NO_REQUEST
from twin_gait.core.control_tick import measure_angle, sample_slowly
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.core.safety import NO_TRIP
from twin_gait.simulation.interface import control_gravity, control_inertia


@dataclass(slots=True)
class Settings:
    """What all units are set to."""

    rates: Rates  # How they sample.
    limits: Limits  # Of commands, and of what is borne how long.
    watching: bool  # Whether the monitor is on.


@dataclass(slots=True)
class JointBoardInputs:
    """What a board reads at the start of a tick."""

    # Counts of the encoder times the angle of a count, in [rad]; not a number if it is missing.
    angle: float = 0.0
    voltage: float = 0.0  # On the winding in the tick before, in [V].
    current: float = 0.0  # Measured in the tick before, in [A].
    current_deviation: float = 0.0  # Of this current from what the drive should have given, in [A].
    # Last heard from the gait controller; a unit of all boards has it itself.
    demand: Demand = field(default_factory=Demand)
    heard: bool = False  # Whether it came since the tick before.


@dataclass(slots=True)
class JointBoardOutputs:
    """What a board gives in a tick."""

    command: Command = field(default_factory=Command)  # With the current set point of the drive.
    measurement: Measurement = field(default_factory=Measurement)  # For the gait controller.


@dataclass(slots=True)
class JointBoard:
    """The unit of a board."""

    settings: Settings  # Of all units.
    state: BoardState  # All that it keeps.
    tick: int = 0  # Present one.


def joint_board_step(unit: JointBoard, inputs: JointBoardInputs, outputs: JointBoardOutputs) -> None:
    """Measure, and set the current of what the gait controller has demanded last."""
    board, settings = unit.state, unit.settings
    measure(board, settings, inputs, unit.tick)
    hear(board, settings.limits, inputs.demand, inputs.heard)
    obey(board, settings.limits, settings.watching)
    set_current(board, settings.limits, board.command.torque)
    report(board, outputs.measurement)
    copy_command(board.command, outputs.command)
    unit.tick += 1


def measure(board: BoardState, settings: Settings, inputs: JointBoardInputs, tick: int) -> None:
    """First half of a board's tick: encoder, velocities, friction model, monitor."""
    if tick > 0:
        note_drive(board, inputs.voltage, inputs.current, inputs.current_deviation)
    rates = settings.rates
    measure_angle(board.encoder, tick == 0, inputs.angle, rates.period, rates.fast_gain)
    if tick % rates.decimation == 0:
        if tick > 0:
            sample_slowly(board.encoder, tick // rates.decimation, rates.decimation * rates.period)
        model_friction(board)
    if settings.watching:
        watch_drive(board, rates)


@dataclass(slots=True)
class Surroundings:
    """What the gait controller reads itself at the start of a tick."""

    loads: list[float]  # Of the feet over body weight.
    bus_voltage: float = 0.0  # In [V].
    # Heard of the device as a whole, for the guards of both legs; with operating modes only the pitch of the
    # trunk is.
    common: Device = field(default_factory=Device)
    request: int = NO_REQUEST  # Of the supervisor in this tick, counted from 1, 0 for none.


@dataclass(slots=True)
class Decision:
    """What the gait controller has decided."""

    phases: list[int]  # Of the legs.
    transitions: list[int]  # That the legs take in this tick, -1 for none; of no meaning after a trip.
    trip_cause: int = NO_TRIP  # Of the monitor, 0 for none.
    trip_part: int = 0  # Of a trip: a joint, or the number of joints plus a leg, or -1 for the supply.
    mode: int = 0  # Operating mode.
    refused: int = NO_REQUEST  # Request of this tick that nothing has answered, 0 for none.


@dataclass(slots=True)
class GaitControllerInputs:
    """What the gait controller reads and has heard at the start of a tick."""

    surroundings: Surroundings  # Read by itself.
    measurements: list[Measurement]  # Last heard from each board.
    heard: list[bool]  # Which of them came since the tick before.


@dataclass(slots=True)
class GaitControllerOutputs:
    """What the gait controller gives in a tick."""

    decision: Decision  # Phases and trip.
    demands: list[Demand]  # For each board.


@dataclass(slots=True)
class GaitController:
    """The unit of the gait controller."""

    settings: Settings  # Of all units.
    state: ControllerState  # All that it keeps.
    tick: int = 0  # Present one.


def decide(controller: ControllerState, settings: Settings, inputs: Surroundings, tick: int) -> None:
    """Watch, run both state machines, fade, and compute what is fed forward."""
    listen(controller, inputs, tick)
    if settings.watching:
        watch(controller, settings.limits, tick)
    if SUPERVISED:
        choose_modes(controller, settings.rates, tick)
    if controller.trip.tick < 0:
        walk(controller, settings.rates, tick)
    feed_forward(controller, settings.rates)
    if CONTROLLED:
        if controller.trip.tick < 0:
            change_demands(controller, settings.rates, tick)


def listen(controller: ControllerState, inputs: Surroundings, tick: int) -> None:
    """Take loads, voltage and what is heard of the device as a whole."""
    for number in range(len(controller.legs)):
        hear_load(controller, number, inputs.loads[number])
    controller.supply.voltage = inputs.bus_voltage
    if SUPERVISED:
        controller.common.trunk_pitch = inputs.common.trunk_pitch
        controller.supervisor.request = inputs.request
    else:
        hear_device(controller, inputs.common, tick)


def watch(controller: ControllerState, limits: Limits, tick: int) -> None:
    """Let the monitor look at supply, phases, feet and what the boards have found."""
    watch_supply(controller)
    for number in range(len(controller.legs)):
        watch_leg(controller, limits, number, tick)
    if has_cause(controller):
        trip_on_causes(controller, tick)


def choose_modes(controller: ControllerState, rates: Rates, tick: int) -> None:
    """Let the supervisor choose the mode, and send the legs into its posture."""
    supervise(controller, rates, tick)
    for number in range(LEGS):
        posture = sent_to(controller, number)
        if posture != NO_POSTURE:
            enter_phase(controller, number, posture, tick)


def walk(controller: ControllerState, rates: Rates, tick: int) -> None:
    """Advance both legs on one snapshot, then blend their parameters."""
    legs, signals = controller.legs, controller.signals
    for number in range(LEGS):
        begin_tick(controller, number, tick)
    for number in range(LEGS):
        leg, other_phase = legs[number], -1
        write_signals(controller, rates, number)
        if LEGS == 2:
            other_phase = legs[1 - number].before
        leg.chosen = next_transition(
            controller.program, leg.before, leg.ticks, signals, other_phase, leg.debounce
        )
        if leg.chosen != NO_TRANSITION:
            enter_phase(controller, number, controller.program.transitions[leg.chosen].target, tick)
    for number in range(LEGS):
        fade(controller, rates, number, tick)


def feed_forward(controller: ControllerState, rates: Rates) -> None:
    """Gravity and inertia torques of the model, where a share of them is wanted."""
    model = controller.model
    if wants_gravity(controller):
        for number in range(len(controller.joints)):
            pose(controller, number)
        control_gravity(model.q, model.bodies, model.gravity, model.gravity_torque)
    if INERTIA_WANTED:
        for number in range(len(controller.joints)):
            estimate_acceleration(controller, rates, number)
        control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def tell(controller: ControllerState, decision: Decision) -> None:
    """Say what was decided; ``decision`` is changed in place."""
    for number in range(len(controller.legs)):
        decision.phases[number] = controller.legs[number].phase
        decision.transitions[number] = controller.legs[number].chosen
    decision.trip_cause = controller.trip.cause
    decision.trip_part = controller.trip.part
    if SUPERVISED:
        decision.mode = controller.supervisor.mode
        decision.refused = controller.supervisor.refused


def gait_controller_step(
    unit: GaitController, inputs: GaitControllerInputs, outputs: GaitControllerOutputs
) -> None:
    """Take what the boards have told, decide, and say what every board is to do."""
    controller, settings = unit.state, unit.settings
    for number in range(len(controller.joints)):
        measured = controller.joints[number].measurement
        if inputs.heard[number]:
            copy_measurement(inputs.measurements[number], measured)
        else:
            measured.last_angle, measured.last_velocity = measured.angle, measured.velocity
        hear_board(controller, settings.limits, number, inputs.heard[number])
    decide(controller, settings, inputs.surroundings, unit.tick)
    for number in range(len(controller.joints)):
        demand(controller, settings.limits, number, unit.tick)
        copy_demand(controller.joints[number].demand, outputs.demands[number])
    tell(controller, outputs.decision)
    unit.tick += 1


@dataclass(slots=True)
class Exoskeleton:
    """Boards and gait controller in one unit."""

    settings: Settings  # Of all.
    boards: list[BoardState]  # Leg by leg: left hip, left knee, right hip, …
    controller: ControllerState  # That demands of them.
    tick: int = 0  # Present one.


@dataclass(slots=True)
class ExoskeletonInputs:
    """What all sensors read at the start of a tick."""

    boards: list[JointBoardInputs]  # Of each joint.
    surroundings: Surroundings  # Of the gait controller itself.


@dataclass(slots=True)
class ExoskeletonOutputs:
    """What is given in a tick."""

    demands: list[Demand]  # That the board of each joint goes by.
    commands: list[Command]  # What it makes of it, with the current set point of its drive.
    decision: Decision  # Phases and trip.


def exoskeleton_step(unit: Exoskeleton, inputs: ExoskeletonInputs, outputs: ExoskeletonOutputs) -> None:
    """Measure everywhere, decide, and set every current, all in one tick."""
    controller, settings, tick = unit.controller, unit.settings, unit.tick
    for number in range(len(unit.boards)):
        measure(unit.boards[number], settings, inputs.boards[number], tick)
        report(unit.boards[number], controller.joints[number].measurement)
    decide(controller, settings, inputs.surroundings, tick)
    for number in range(len(unit.boards)):
        drive(unit.boards[number], controller, settings, number, tick)
        copy_demand(unit.boards[number].demand, outputs.demands[number])
        copy_command(unit.boards[number].command, outputs.commands[number])
    tell(controller, outputs.decision)
    unit.tick += 1


def drive(board: BoardState, controller: ControllerState, settings: Settings, number: int, tick: int) -> None:
    """Set the current of a joint; of a wild command the gait controller hears at once."""
    joint, limits = controller.joints[number], settings.limits
    demand(controller, limits, number, tick)
    copy_demand(joint.demand, board.demand)
    ask(board)
    check(board, settings.watching)
    if board.command.cause != NO_TRIP:  # what was asked was a walk, whose weight is not carried in this tick
        trip(controller, tick, board.command.cause, number)
        demand_rest(joint.demand, limits, joint.hold_angle, 0.0, 0.0)
        copy_demand(joint.demand, board.demand)
        ask(board)
        sum_up(board)
    set_current(board, limits, board.command.torque)
