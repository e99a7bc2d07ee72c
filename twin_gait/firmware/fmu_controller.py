"""FMU of the controller: boards and gait controller of an experiment, with tunable parameters."""

from collections.abc import Iterator, Sequence

from twin_gait.control.safety import TripCause
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.guards import GuardProgram
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware import units
from twin_gait.firmware.exoskeleton_unit import build_exoskeleton_unit
from twin_gait.firmware.fmu import FmuUnit, FmuVariable, pad_lists
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.firmware.project import EXOSKELETON, require_printable
from twin_gait.gait.guards import Comparison
from twin_gait.gait.signals import find_signal
from twin_gait.gait.table import StateTable
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

NAME = "controller"
_SI_UNITS = {"deg": "rad", "deg/s": "rad/s", "s": "s"}  # Units of thresholds by their units in a table.


def controller_fmu(experiment: Experiment) -> tuple[FmuUnit, list[FmuVariable]]:
    """Print the controller of an experiment for an FMU, and return the unit with its variables.

    All records are part of the unit: several instances with different parameters may run in one process.
    Raises FirmwareError, with key, value and remedy, for functions that only the simulation has.
    """
    require_printable(experiment)
    setup = build_setup(experiment)
    linked = build_exoskeleton_unit(setup, single=False)
    record, inputs = linked.record, linked.inputs
    pad_lists(record, GuardProgram)
    for board, given in zip(record.boards, inputs.boards, strict=True):
        given.angle = board.encoder.angle
    inputs.direct.bus_voltage = record.controller.supply.voltage
    records = {"unit": record, "inputs": inputs, "outputs": linked.outputs}
    program = print_units(
        [TranslationUnit(NAME, [units.exoskeleton_step, units.exoskeleton_update], {EXOSKELETON: record})],
        {**linked.build_flags, "sine_cosine": sine_cosine},
        linked.kernel,
        list(records.values()),
    )
    text = f"Controller of {experiment.name}, boards included, in ticks of 1 ms. Not a medical device."
    made = FmuUnit(NAME, EXOSKELETON, text, program, records)
    return made, list(_variables(made, setup))


def joint_names(setup: SimulationSetup) -> list[str]:
    """Return the joints of the device in the order of the records, such as ``left_hip``."""
    return [f"{item.side}_{item.joint}" for item in setup.joints]


def leg_names(setup: SimulationSetup) -> list[str]:
    """Return the legs of the device in the order of the records, such as ``left_leg``."""
    return [f"{side}_leg" for side in setup.sides]


def exchanged_labels(setup: SimulationSetup) -> dict[str, list[str]]:
    """Return the names of the entries of the lists that controller and plant exchange, by their fields."""
    by_leg = dict.fromkeys(("loads", "phases", "transitions"), leg_names(setup))
    return by_leg | dict.fromkeys(("boards", "setpoints", "commands"), joint_names(setup))


def _variables(unit: FmuUnit, setup: SimulationSetup) -> Iterator[FmuVariable]:
    table, modes, labels = setup.table, setup.experiment.modes, exchanged_labels(setup)
    yield from unit.exchanged("input", labels)
    notes = {"phase": _numbered(table.phase_names), "trip_cause": _numbered(list(TripCause))}
    if modes is not None:
        notes |= {"mode": _numbered(modes.phase_names), "rejected": _numbered(modes.requests, 1)}
    for item in unit.exchanged("output", labels):
        note = notes.get(item.name.rpartition(".")[2], "")
        yield item._replace(description=f"{item.description} {note}".strip())
    state = "unit.controller"
    for index, phase in enumerate(table.phase_names):
        for number, joint in enumerate(labels["boards"]):
            for name in ("stiffness", "damping", "equilibrium", "gain"):
                path = f"{state}.joints[{number}].setpoints[{index}].{name}"
                yield from unit.variable(f"{joint}.{phase}.{name}", path, "parameter")
        for number, leg in enumerate(labels["loads"]):
            path = f"{state}.legs[{number}].gravity_shares[{index}]"
            yield from unit.variable(f"{leg}.{phase}.gravity_share", path, "parameter")
    yield from _thresholds(unit, f"{state}.program", table)
    if modes is not None:
        yield from _thresholds(unit, f"{state}.supervisor.program", modes)


def _thresholds(unit: FmuUnit, program: str, table: StateTable) -> Iterator[FmuVariable]:
    """Yield the thresholds of a table in SI, in the order of its compiled guards."""
    pairs = (
        (rule, atom) for rule in table.transitions for atom in rule.atoms if isinstance(atom, Comparison)
    )
    for number, (rule, atom) in enumerate(pairs):
        sign = 1.0 if atom.operator == ">" else -1.0  # the program compares with ">" only
        name = f"threshold.{rule.source}.{rule.target}.{rule.cause}"
        si = _SI_UNITS.get(find_signal(atom.signal).unit.name, "")
        text = f"threshold from {rule.source} to {rule.target} ({rule.cause}): {atom}"
        path = f"{program}.comparisons[{number}].threshold"
        for item in unit.variable(name, path, "parameter", unit=si, description=text, sign=sign):
            yield item._replace(start=sign * item.start)


def _numbered(names: Sequence[str], first: int = 0) -> str:
    """Return the meanings of the values of an integer as text."""
    return f"({', '.join(f'{value} {name}' for value, name in enumerate(names, first))})"
