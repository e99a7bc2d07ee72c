"""The units of the firmware, which are printed as C: a joint's board, the gait controller, and both as one.

The order of the device in a tick of 1 ms is that of :mod:`twin_gait.control.device_schedule`, which the
simulation runs, too (:mod:`twin_gait.simulation.schedule`). A step takes a unit with its inputs, and changes
unit and outputs in place.
"""

from dataclasses import dataclass, field

from twin_gait.control import device_schedule as device
from twin_gait.control.gait_controller import (
    SUPERVISED,
    ControllerState,
    Device,
    demand,
    hear_board,
    hear_device,
    hear_load,
)
from twin_gait.control.joint_board import (
    BoardState,
    Command,
    Demand,
    Limits,
    Measurement,
    Rates,
    copy_command,
    copy_demand,
    copy_measurement,
    hear,
    note_drive,
    obey,
    report,
    set_current,
)
from twin_gait.control.supervisor import NO_REQUEST
from twin_gait.core.safety import NO_TRIP
from twin_gait.simulation.executors import Names, scalar_driver


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


def note_last_drive(board: BoardState, inputs: JointBoardInputs, tick: int) -> None:
    """Note for the monitor what the drive did in the tick before."""
    if tick > 0:
        note_drive(board, inputs.voltage, inputs.current, inputs.current_deviation)


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
    listen(controller, inputs.surroundings, unit.tick)
    decide(controller, settings, unit.tick)
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
    listen(controller, inputs.surroundings, tick)
    decide(controller, settings, tick)
    for number in range(len(unit.boards)):
        drive(unit.boards[number], controller, settings, number, tick)
        copy_demand(unit.boards[number].demand, outputs.demands[number])
        copy_command(unit.boards[number].command, outputs.commands[number])
    tell(controller, outputs.decision)
    unit.tick += 1


# ------------------------------------------------------------------ parts in the order of the device

_NAMES = Names(
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
    (note_last_drive, *device.MEASURE, device.WATCH_DRIVES),
    _ONE_JOINT,
    head="(board, settings, inputs, tick)",
    module=__name__,
    says="First half of a board's tick: encoder, velocities, friction model, monitor.",
)
decide = scalar_driver(
    "decide",
    device.DECIDE,
    _NAMES,
    head="(controller, settings, tick)",
    module=__name__,
    says="Watch, run both state machines, fade, and compute the torques that are fed forward.",
)
drive = scalar_driver(
    "drive",
    device.COMMAND,
    _ONE_JOINT,
    head="(board, controller, settings, number, tick)",
    module=__name__,
    says="Set the current of a joint; an implausible command trips at once.",
)
