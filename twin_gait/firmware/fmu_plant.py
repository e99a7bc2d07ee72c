"""FMU of the plant: the bodies of wearer and device, drives, sensors and ground of an experiment."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

from twin_gait.control import device_schedule as device
from twin_gait.control.gait_controller import WITH_SUPERVISOR
from twin_gait.core.contact import ground_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import DelayLine, quantise
from twin_gait.exceptions import FirmwareError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.fmu import FmuUnit, FmuVariable, pad_lists
from twin_gait.firmware.fmu_controller import joint_names, leg_names, numbered
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.firmware.single_episode import SingleEpisode
from twin_gait.firmware.units import DirectInputs, JointBoardInputs
from twin_gait.gait.signals import WALK
from twin_gait.kernels.generated import write_contact_forces, write_dynamics, write_merged_functions
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.executors import scalar_driver
from twin_gait.simulation.schedule import ACT, NAMES, SENSE, compute_status
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.core.schedule import replace_steps

NAME = "plant"


@dataclass(slots=True)
class PlantEpisode(Episode):
    """State record of the plant."""

    noise: list[float] = None  # Random numbers of every tick, which are constant: offsets of the encoders in [rad].


@dataclass(slots=True)
class DriveCommand:
    """Command of a board for its drive."""

    target_current: float = 0.0  # Target current of the drive in [A].
    drive_off: bool = False  # Whether the drive is switched off.


@dataclass(slots=True)
class SimulatedPlantInputs:
    """Inputs of the plant: the outputs of the controller in a tick."""

    commands: list[DriveCommand]  # Command for the drive of each joint.
    phases: list[int]  # Phases of the legs, on which efforts and arms of the wearer depend.
    trip_cause: int = 0  # Cause of the trip of the monitor, 0 for none; it stops the belt and locks the harness.


@dataclass(slots=True)
class JointState:
    """State of a joint."""

    position: float = 0.0  # Angle of the joint in [rad].
    velocity: float = 0.0  # Velocity of the joint in [rad/s].
    motor_torque: float = 0.0  # Torque of the motor on the joint in [N·m].


@dataclass(slots=True)
class SimulatedPlantOutputs:
    """Outputs of the plant: the inputs of the controller in the next tick, and states."""

    boards: list[JointBoardInputs]  # Inputs of the board of each joint.
    direct: DirectInputs  # Direct inputs of the gait controller.
    joints: list[JointState]  # State of each joint.
    status: int = 0  # Status of the walk.


@dataclass(slots=True)
class SimulatedPlant:
    """Plant with its state."""

    episode: PlantEpisode  # State of the simulation.
    resolutions: list[float]  # Angle of a count of each encoder in [rad]; 0 for an ideal sensor.
    has_sensed: bool = False  # Whether the sensors of tick 0 have been read.
    tick: int = 0  # Present tick.


def sense(e: Episode, tick: int) -> None:
    """Read the sensors; replaced by the schedule."""
    raise NotImplementedError


def act(e: Episode, tick: int) -> None:
    """Move the plant for a tick; replaced by the schedule."""
    raise NotImplementedError


def plant_step(unit: SimulatedPlant, inputs: SimulatedPlantInputs, outputs: SimulatedPlantOutputs) -> None:
    """Move the plant for a tick under the commands of the controller, and read the sensors of the next one."""
    e, tick = unit.episode, unit.tick
    for number in range(len(e.joints)):
        command = e.joints[number].board.command
        command.target_current = inputs.commands[number].target_current
        command.drive_off = inputs.commands[number].drive_off
    for number in range(len(e.controller.legs)):
        leg = e.controller.legs[number]
        if leg.phase != inputs.phases[number]:
            leg.phase = inputs.phases[number]
            leg.entry_tick = tick
    if inputs.trip_cause != 0 and e.controller.trip.tick < 0:
        e.controller.trip.tick = tick
    act(e, tick)
    unit.tick = tick + 1
    sense(e, unit.tick)
    write_outputs(unit, outputs)


def plant_update(unit: SimulatedPlant, outputs: SimulatedPlantOutputs) -> None:
    """Read the sensors of tick 0, and write the outputs."""
    if not unit.has_sensed:
        sense(unit.episode, 0)
        unit.has_sensed = True
    write_outputs(unit, outputs)


def write_outputs(unit: SimulatedPlant, outputs: SimulatedPlantOutputs) -> None:
    """Write the outputs; ``outputs`` are changed in place."""
    e = unit.episode
    for number in range(len(e.joints)):
        joint, board, state = e.joints[number], outputs.boards[number], outputs.joints[number]
        board.angle = quantise(joint.reading, unit.resolutions[number])
        board.voltage = joint.voltage
        board.current = joint.current
        board.current_deviation = joint.current_deviation
        state.position = e.q[joint.index]
        state.velocity = e.v[joint.index]
        state.motor_torque = e.motor[joint.index]
    for number in range(len(e.soles)):
        outputs.direct.loads[number] = e.feet[e.soles[number]].load
    outputs.direct.bus_voltage = e.supply.bus_voltage
    outputs.direct.device_signals.trunk_pitch = e.controller.device_signals.trunk_pitch
    outputs.direct.device_signals.walk = e.controller.device_signals.walk
    if WITH_SUPERVISOR:
        outputs.direct.request = e.controller.supervisor.request
    outputs.status = compute_status(e)


def plant_fmu(experiment: Experiment) -> tuple[FmuUnit, list[FmuVariable]]:
    """Print the plant of an experiment for an FMU, and return the unit with its variables.

    Raises FirmwareError, with key, value and remedy, for what the FMU does not have: faults, and random
    numbers of every tick.
    """
    setup = build_setup(replace(experiment, network=None))
    if experiment.faults:
        raise FirmwareError(f"faults: {experiment.faults[0]} is not available in the FMU of the plant")
    if len(setup.noise) > 1:
        raise FirmwareError("sensors: noise is not available in the FMU of the plant; set sensors.ideal=true")
    bodies, episode, flags = assemble(setup)
    flags = {**flags, "WITH_FAULTS": False}
    given = {item.name: getattr(episode, item.name) for item in fields(episode)}
    state = PlantEpisode(**given, noise=setup.noise[0].tolist())
    pad_lists(state, DelayLine)
    joints, legs = len(setup.joints), len(setup.sides)
    unit = SimulatedPlant(state, [joint.board.encoder.resolution for joint in state.joints])
    inputs = SimulatedPlantInputs([DriveCommand() for _ in range(joints)], [leg.phase for leg in state.controller.legs])
    boards = [JointBoardInputs() for _ in range(joints)]
    outputs = SimulatedPlantOutputs(boards, DirectInputs([0.0] * legs), [JointState() for _ in range(joints)])
    constant = {name: str(getattr(state, name)) for name in ("has_wearer_torques", "has_inertial_unit", "watching")}
    names = NAMES._replace(fields={**NAMES.fields, **constant, "recording": "False"})
    board_steps = device.MEASURE[0].steps[0], device.MEASURE[1]
    schedules = {"sense": replace_steps(SENSE, dict.fromkeys(board_steps, ())), "act": ACT}
    drivers = {name: scalar_driver(name, steps, names) for name, steps in schedules.items()}
    texts = [write_dynamics(bodies), write_contact_forces(bodies)]
    kernel = "\n\n".join([*write_merged_functions("".join(texts)), *texts])
    functions = {"sine_cosine": sine_cosine, "ground_contact_force": ground_contact_force, **drivers}
    translation = TranslationUnit(NAME, [plant_step, plant_update], {NAME: unit})
    program = print_units(
        [translation], {**flags, **functions}, kernel, [unit, inputs, outputs], SingleEpisode(flags)
    )
    records = {"unit": unit, "inputs": inputs, "outputs": outputs}
    text = f"Plant of {experiment.name}"
    made = FmuUnit(NAME, NAME, text, program, records)
    return made, list(_variables(made, setup))


def _variables(unit: FmuUnit, setup: Any) -> Iterator[FmuVariable]:
    joints, legs = joint_names(setup), leg_names(setup)
    labels = dict.fromkeys(("commands", "boards", "joints"), joints) | dict.fromkeys(("phases", "loads"), legs)
    yield from unit.exchanged("input", labels)
    yield from unit.exchanged("output", labels)
