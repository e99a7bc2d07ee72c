"""The units of the firmware, which are printed as C: a joint's board, the gait controller, and both as one.

The order of the device in a tick of 1 ms is defined by :mod:`twin_gait.control.device_schedule`, which the
simulation runs, too (:mod:`twin_gait.simulation.schedule`). A step takes a unit with its inputs, and changes
unit and outputs in place.
"""

from dataclasses import dataclass, field

from twin_gait.control import device_schedule as device
from twin_gait.control.gait_controller import (
    N_JOINTS_PER_LEG,
    WITH_SUPERVISOR,
    ControllerState,
    DeviceSignals,
    check_board_timeout,
    compute_setpoint,
    receive_device_signals,
    receive_load,
)
from twin_gait.control.joint_board import (
    BoardState,
    Command,
    JointSetpoint,
    Limits,
    Measurement,
    SamplingConfig,
    copy_command,
    copy_joint_setpoint,
    copy_measurement,
    execute,
    receive,
    set_current,
    store_drive_state,
    write_measurement,
)
from twin_gait.control.supervisor import NO_REQUEST
from twin_gait.core.control_tick import copy_setpoint
from twin_gait.core.safety import NO_TRIP
from twin_gait.simulation.executors import ScheduleNames, scalar_driver


@dataclass(slots=True)
class UnitSettings:
    """Settings of all units."""

    rates: SamplingConfig  # Configuration of the sampling.
    limits: Limits  # Timeouts, and the hold after a trip.
    watching: bool  # Whether the safety monitor is on.


@dataclass(slots=True)
class JointBoardInputs:
    """Inputs of a board at the start of a tick."""

    # Counts of the encoder times the angle of a count, in [rad]; NaN if the measurement is missing.
    angle: float = 0.0
    voltage: float = 0.0  # Voltage of the winding in the tick before, in [V].
    current: float = 0.0  # Current measured in the tick before, in [A].
    current_deviation: float = 0.0  # Deviation of this current from its expected value, in [A].
    # Last setpoint received from the gait controller; in the unit of all boards it is not used.
    setpoint: JointSetpoint = field(default_factory=JointSetpoint)
    received: bool = False  # Whether the setpoint was received since the tick before.


@dataclass(slots=True)
class JointBoardOutputs:
    """Outputs of a board in a tick."""

    command: Command = field(default_factory=Command)  # Command with the current setpoint of the drive.
    measurement: Measurement = field(default_factory=Measurement)  # Measurement for the gait controller.


@dataclass(slots=True)
class JointBoard:
    """Unit of a board, with its state."""

    settings: UnitSettings  # Settings of all units.
    state: BoardState  # State of the board.
    tick: int = 0  # Present tick.


def joint_board_step(unit: JointBoard, inputs: JointBoardInputs, outputs: JointBoardOutputs) -> None:
    """Measure, and set the current for the last setpoint of the gait controller."""
    board, settings = unit.state, unit.settings
    measure(board, settings, inputs, unit.tick)
    receive(board, settings.limits, inputs.setpoint, inputs.received)
    execute(board, settings.limits, settings.watching)
    set_current(board, board.command.torque)
    write_measurement(board, outputs.measurement)
    copy_command(board.command, outputs.command)
    unit.tick += 1


def note_last_drive(board: BoardState, inputs: JointBoardInputs, tick: int) -> None:
    """Record the voltage and current of the drive in the tick before, for the monitor."""
    if tick > 0:
        store_drive_state(board, inputs.voltage, inputs.current, inputs.current_deviation)


@dataclass(slots=True)
class DirectInputs:
    """Direct inputs of the gait controller at the start of a tick."""

    loads: list[float]  # Loads of the feet over body weight.
    bus_voltage: float = 0.0  # Voltage of the bus in [V].
    # Signals of the device as a whole, for the guards of both legs; with operating modes only the pitch of
    # the trunk is used.
    device_signals: DeviceSignals = field(default_factory=DeviceSignals)
    request: int = NO_REQUEST  # Request to the supervisor in this tick, counted from 1, 0 for none.


@dataclass(slots=True)
class Decision:
    """Decision of the gait controller."""

    phases: list[int]  # Phases of the legs.
    transitions: list[int]  # Transitions of the legs in this tick, -1 for none; without meaning after a trip.
    trip_cause: int = NO_TRIP  # Cause of the trip of the monitor, 0 for none.
    # Part that tripped: a joint, or the number of joints plus a leg, or -1 for the supply.
    trip_part: int = 0
    mode: int = 0  # Operating mode.
    rejected: int = NO_REQUEST  # Request of this tick that was rejected, 0 for none.


@dataclass(slots=True)
class GaitControllerInputs:
    """Inputs of the gait controller at the start of a tick."""

    direct: DirectInputs  # Direct inputs of the gait controller.
    measurements: list[Measurement]  # Last measurement received from each board.
    received: list[bool]  # Whether each was received since the tick before.


@dataclass(slots=True)
class GaitControllerOutputs:
    """Outputs of the gait controller in a tick."""

    decision: Decision  # Decision with phases and trip.
    setpoints: list[JointSetpoint]  # Setpoint for each board.


@dataclass(slots=True)
class GaitController:
    """Unit of the gait controller, with its state."""

    settings: UnitSettings  # Settings of all units.
    state: ControllerState  # State of the gait controller.
    tick: int = 0  # Present tick.


def read_inputs(controller: ControllerState, inputs: DirectInputs, tick: int) -> None:
    """Read loads, voltage and the signals of the device as a whole."""
    for number in range(len(controller.legs)):
        receive_load(controller, number, inputs.loads[number])
    controller.supply.voltage = inputs.bus_voltage
    if WITH_SUPERVISOR:
        controller.device_signals.trunk_pitch = inputs.device_signals.trunk_pitch
        controller.supervisor.request = inputs.request
    else:
        receive_device_signals(controller, inputs.device_signals, tick)


def publish(controller: ControllerState, decision: Decision) -> None:
    """Write the decision; ``decision`` is changed in place."""
    for number in range(len(controller.legs)):
        decision.phases[number] = controller.legs[number].phase
        decision.transitions[number] = controller.legs[number].chosen
    decision.trip_cause = controller.trip.cause
    decision.trip_part = controller.trip.part
    if WITH_SUPERVISOR:
        decision.mode = controller.supervisor.mode
        decision.rejected = controller.supervisor.rejected


def gait_controller_step(
    unit: GaitController, inputs: GaitControllerInputs, outputs: GaitControllerOutputs
) -> None:
    """Receive the measurements of the boards, decide, and compute the setpoint for every board."""
    controller, settings = unit.state, unit.settings
    for number in range(len(controller.joints)):
        measured = controller.joints[number].measurement
        if inputs.received[number]:
            copy_measurement(inputs.measurements[number], measured)
        else:
            measured.last_angle, measured.last_velocity = measured.angle, measured.velocity
        check_board_timeout(controller, settings.limits, number, inputs.received[number])
    read_inputs(controller, inputs.direct, unit.tick)
    decide(controller, settings, unit.tick)
    for number in range(len(controller.joints)):
        compute_setpoint(controller, settings.limits, number, unit.tick)
        copy_joint_setpoint(controller.joints[number].setpoint, outputs.setpoints[number])
    publish(controller, outputs.decision)
    unit.tick += 1


@dataclass(slots=True)
class Exoskeleton:
    """Boards and gait controller in one unit."""

    settings: UnitSettings  # Settings of boards and gait controller.
    boards: list[BoardState]  # States of the boards, leg by leg: left hip, left knee, right hip, …
    controller: ControllerState  # State of the gait controller.
    tick: int = 0  # Present tick.


@dataclass(slots=True)
class ExoskeletonInputs:
    """Inputs of all sensors at the start of a tick."""

    boards: list[JointBoardInputs]  # Inputs of the board of each joint.
    direct: DirectInputs  # Direct inputs of the gait controller.


@dataclass(slots=True)
class ExoskeletonOutputs:
    """Outputs of the unit in a tick."""

    setpoints: list[JointSetpoint]  # Setpoint for the board of each joint.
    commands: list[Command]  # Command of each board, with the current setpoint of its drive.
    decision: Decision  # Decision with phases and trip.


def exoskeleton_step(unit: Exoskeleton, inputs: ExoskeletonInputs, outputs: ExoskeletonOutputs) -> None:
    """Measure all joints, decide, and set all currents, in one tick."""
    controller, settings, tick = unit.controller, unit.settings, unit.tick
    for number in range(len(unit.boards)):
        measure(unit.boards[number], settings, inputs.boards[number], tick)
        write_measurement(unit.boards[number], controller.joints[number].measurement)
    read_inputs(controller, inputs.direct, tick)
    decide(controller, settings, tick)
    for number in range(len(unit.boards)):
        drive(unit.boards[number], controller, settings, number, tick)
        copy_joint_setpoint(unit.boards[number].setpoint, outputs.setpoints[number])
        copy_command(unit.boards[number].command, outputs.commands[number])
    publish(controller, outputs.decision)
    unit.tick += 1


def exoskeleton_update(unit: Exoskeleton, outputs: ExoskeletonOutputs) -> None:
    """Use changed parameters of the phases from the next tick on, and write the decision.

    The controller reads the parameters of a phase only while it blends, so that they are copied here if the
    blending is over. Before the first tick, the gait starts with them.
    """
    controller, tick = unit.controller, unit.tick
    for number in range(len(controller.joints)):
        joint, leg = controller.joints[number], controller.legs[number // N_JOINTS_PER_LEG]
        if tick == 0 or tick - leg.entry_tick > leg.blend_ticks[leg.phase]:
            copy_setpoint(joint.setpoints[leg.phase], joint.blended)
            leg.gravity = leg.gravity_shares[leg.phase]
        if tick == 0:
            copy_setpoint(joint.blended, joint.blend_start)
            leg.gravity_start = leg.gravity
    publish(controller, outputs.decision)


# ------------------------------------------------------------------ parts in the order of the device

_NAMES = ScheduleNames(
    arguments={
        **{name: name for name in ("board", "controller", "inputs", "number", "tick")},
        "reading": "inputs.angle",
        **{name: f"settings.{name}" for name in ("rates", "limits", "watching")},
        "leg": "controller.legs[number]",
    },
    counts={"joints": "len(controller.joints)", "legs": "len(controller.legs)"},
    fields={"tick": "tick", "decimation": "settings.rates.decimation", "watching": "settings.watching"},
    flags=device.FLAGS,
)
_ONE_JOINT = _NAMES._replace(counts={"joints": ""})

measure = scalar_driver(
    "measure",
    (note_last_drive, *device.MEASURE, device.MONITOR_DRIVES),
    _ONE_JOINT,
    head="(board, settings, inputs, tick)",
    module=__name__,
    docstring="First half of a board's tick: encoder, velocities, friction model, monitor.",
)
decide = scalar_driver(
    "decide",
    device.DECIDE,
    _NAMES,
    head="(controller, settings, tick)",
    module=__name__,
    docstring="Check for trips, run both state machines, blend, and compute the feed-forward torques.",
)
drive = scalar_driver(
    "drive",
    device.COMMAND,
    _ONE_JOINT,
    head="(board, controller, settings, number, tick)",
    module=__name__,
    docstring="Set the current of a joint; an implausible command trips at once.",
)
