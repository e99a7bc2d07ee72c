"""FMU of the plant: bodies of wearer and device, drives, sensors and ground of an experiment.

Its inputs are outputs of the controller and its outputs are inputs of the controller, with the same names.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

from twin_gait.control import device_schedule as device
from twin_gait.control.gait_controller import WITH_SUPERVISOR
from twin_gait.core.contact import ground_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import DelayLine, quantise
from twin_gait.core.guards import GuardProgram
from twin_gait.core.schedule import replace_steps
from twin_gait.exceptions import FirmwareError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.exoskeleton_unit import build_exoskeleton_unit
from twin_gait.firmware.fmu import FmuUnit, FmuVariable, pad_lists
from twin_gait.firmware.fmu_controller import exchanged_labels, joint_names
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.firmware.single_episode import SingleEpisode, real_sqrt
from twin_gait.firmware.units import ExoskeletonInputs, ExoskeletonOutputs
from twin_gait.kernels.generated import write_contact_forces, write_dynamics, write_merged_functions
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import COMPLETED, CRUTCH_LOST, DIVERGED, FELL, TIPPED, Episode
from twin_gait.simulation.executors import scalar_driver
from twin_gait.simulation.schedule import ACT, NAMES, SENSE, update_status
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.stages.environment import update_commands
from twin_gait.worlds.arm_policy import AS_NEEDED

NAME = "plant"
# Words for the status of the walk.
ENDINGS = {
    COMPLETED: "walking",
    FELL: "fell",
    DIVERGED: "diverged",
    TIPPED: "tipped",
    CRUTCH_LOST: "lost a crutch",
}


@dataclass(slots=True)
class PlantEpisode(Episode):
    """State record of the plant."""

    noise: list[float] = field(default_factory=list)  # Row of the noise, which is the same in every tick.


@dataclass(slots=True)
class PlantUnit:
    """Unit of the plant, with its state."""

    episode: PlantEpisode  # State of the simulation.
    resolutions: list[float]  # Angle of a count of each encoder in [rad]; 0 for an ideal sensor.
    has_sensed: bool = False  # Whether the sensors of tick 0 have been read.
    tick: int = 0  # Present tick.


def sense(e: Episode, tick: int) -> None:
    """Read the sensors; replaced by the schedule."""
    raise NotImplementedError


def act(e: Episode, tick: int) -> bool:
    """Move the plant for a tick; replaced by the schedule."""
    raise NotImplementedError


def plant_step(unit: PlantUnit, inputs: ExoskeletonOutputs, outputs: ExoskeletonInputs) -> None:
    """Move the plant for a tick under the commands of the controller, and read the sensors after it."""
    e, tick = unit.episode, unit.tick
    for number in range(len(e.joints)):
        command = e.joints[number].board.command
        command.target_current = inputs.commands[number].target_current
        command.drive_off = inputs.commands[number].drive_off
    for number in range(len(e.controller.legs)):
        leg = e.controller.legs[number]
        if leg.phase != inputs.decision.phases[number]:
            leg.phase = inputs.decision.phases[number]
            leg.entry_tick = tick
    if inputs.decision.trip_cause != 0 and e.controller.trip.tick < 0:
        e.controller.trip.tick = tick
    act(e, tick)
    unit.tick = tick + 1
    sense(e, unit.tick)
    write_outputs(unit, outputs)


def plant_update(unit: PlantUnit, outputs: ExoskeletonInputs) -> None:
    """Read the sensors of tick 0, or move the belt at a changed speed, and write the outputs."""
    if unit.has_sensed:
        update_commands(unit.episode, unit.tick)
    else:
        sense(unit.episode, 0)
        unit.has_sensed = True
    write_outputs(unit, outputs)


def write_outputs(unit: PlantUnit, outputs: ExoskeletonInputs) -> None:
    """Write the outputs; ``outputs`` are changed in place."""
    e, direct = unit.episode, outputs.direct
    for number in range(len(e.joints)):
        joint, board = e.joints[number], outputs.boards[number]
        board.angle = quantise(joint.reading, unit.resolutions[number])
        board.voltage, board.current = joint.voltage, joint.current
        board.current_deviation = joint.current_deviation
    for number in range(len(e.soles)):
        direct.loads[number] = e.feet[e.soles[number]].load
    direct.bus_voltage = e.supply.bus_voltage
    direct.device_signals.trunk_pitch = e.controller.device_signals.trunk_pitch
    direct.device_signals.walk = e.controller.device_signals.walk
    if WITH_SUPERVISOR:
        direct.request = e.controller.supervisor.request


def plant_fmu(experiment: Experiment) -> tuple[FmuUnit, list[FmuVariable]]:
    """Print the plant of an experiment for an FMU, and return the unit with its variables.

    Raises FirmwareError, with key, value and remedy, for functions that only the simulation has.
    """
    setup = build_setup(replace(experiment, network=None))
    if experiment.faults:
        raise FirmwareError(
            f"faults: {experiment.faults[0]} is a fault, which the plant as FMU does not have"
        )
    if setup.world.policy is not None and setup.world.policy.pattern != AS_NEEDED:
        raise FirmwareError(
            f"scenario.arms.pattern={setup.world.policy.arms.pattern}: the FMU of the plant announces no "
            "steps to the controller: set scenario.arms.pattern=as_needed"
        )
    if len(setup.noise) > 1:
        raise FirmwareError(
            "the FMU of the plant draws no random numbers in each tick: set sensors.angle_noise_rad, "
            "patient.effort_noise and own_gait.angle_noise_rad to 0, and sensors.ideal=true for a free trunk"
        )
    bodies, episode, flags = assemble(setup)
    exchanged = build_exoskeleton_unit(setup)
    given = {item.name: getattr(episode, item.name) for item in fields(episode)}
    state = PlantEpisode(**given, noise=setup.noise[0].tolist())
    for kind in (DelayLine, GuardProgram):
        pad_lists(state, kind)
    unit = PlantUnit(state, [joint.board.encoder.resolution for joint in state.joints])
    records = {"unit": unit, "inputs": exchanged.outputs, "outputs": exchanged.inputs}
    exchanged.outputs.decision.phases[:] = [leg.phase for leg in state.controller.legs]
    constant = ("has_wearer_torques", "has_inertial_unit", "watching")
    known = {**{name: str(getattr(state, name)) for name in constant}, "recording": "False"}
    names = NAMES._replace(fields={**NAMES.fields, **known})
    of_boards = (device.measure_position, device.MEASURE[1])
    drivers = {
        "sense": scalar_driver("sense", replace_steps(SENSE, dict.fromkeys(of_boards, ())), names),
        "act": scalar_driver("act", ACT, names, result=update_status),
    }
    texts = [write_dynamics(bodies), write_contact_forces(bodies)]
    kernel = "\n\n".join([*write_merged_functions("".join(texts)), *texts])
    laws = {item.__name__: item for item in (sine_cosine, ground_contact_force, real_sqrt)}
    program = print_units(
        [TranslationUnit(NAME, [plant_step, plant_update], {NAME: unit})],
        {**flags, "WITH_FAULTS": False, **laws, **drivers},
        kernel,
        list(records.values()),
        SingleEpisode(flags),
    )
    text = f"Plant of {experiment.name}: wearer, device, drives and sensors, in ticks of 1 ms."
    made = FmuUnit(NAME, NAME, text, program, records)
    return made, list(_variables(made, setup, state))


def _variables(unit: FmuUnit, setup: SimulationSetup, state: Episode) -> Iterator[FmuVariable]:
    pelvis = setup.world.model.pelvis_index
    labels = exchanged_labels(setup)
    for item in unit.exchanged("input", labels):
        name = item.name.rpartition(".")[2]
        if name == "phase":
            yield item._replace(most=len(setup.table.phases) - 1)
        elif name in ("target_current", "drive_off", "trip_cause"):
            yield item
    yield from unit.exchanged("output", labels)
    for name, joint in zip(joint_names(setup), state.joints, strict=True):
        for quantity, key, si, meaning in (
            ("position", "q", "rad", "True angle"),
            ("velocity", "v", "rad/s", "True velocity"),
            ("motor_torque", "motor", "N.m", "Torque of the motor on the joint"),
        ):
            path = f"unit.episode.{key}[{joint.index}]"
            more = {"unit": si, "description": f"{name.replace('_', ' ')}: {meaning}, positive in flexion."}
            yield from unit.variable(f"{name}.{quantity}", path, "output", **more)
    ends = ", ".join(f"{code} {words}" for code, words in ENDINGS.items())
    text = f"Status of the walk: {ends}."
    yield from unit.variable("status", "unit.episode.status", "output", description=text)
    yield from unit.variable("belt_speed", "unit.episode.belt.cruise", "parameter")
    if pelvis is not None:  # the support acts on the wearer's pelvis, or on the trunk
        guide = f"plant[{pelvis + setup.world.wearer_offset}].spring"
        path = f"unit.episode.{guide if setup.world.trunk is None else 'trunk.harness'}.force"
        more = {"unit": "N", "description": "Force of the body-weight support in [N]."}
        yield from unit.variable("support_force", path, "parameter", **more)
