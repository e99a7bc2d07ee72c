"""The controller of an experiment as one unit without a bus, and its inputs and outputs in a run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from twin_gait.control.joint_board import Command, JointSetpoint
from twin_gait.core.guards import GuardProgram
from twin_gait.exceptions import FirmwareError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware import units
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import TIME
from twin_gait.gait.table import TICK
from twin_gait.kernels.generated import write_control_gravity, write_control_inertia, write_merged_functions
from twin_gait.simulation.compiled_engine import CompiledEngine, assemble
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.worlds.faults import FaultKind

Progress: TypeAlias = Callable[[int, int], None]  # arguments: finished ticks and total number of ticks
Tick: TypeAlias = Callable[[int, int, np.ndarray, int], int]  # runs one tick; arguments as of an engine
Pairs: TypeAlias = list[tuple[np.ndarray, np.ndarray]]  # rows of ticks, and fields of the engine's record

# Inputs of the unit, and their fields in the record of an engine, valid from the end of a tick to the end of
# the next one.
DRIVES = {
    "boards.voltage": "joints.voltage",
    "boards.current": "joints.current",
    "boards.current_deviation": "joints.current_deviation",
    "direct.bus_voltage": "supply.bus_voltage",
}
# Inputs that are valid after the sensors have been read.
SENSORS = {
    "boards.angle": "joints.board.encoder.angle",
    "direct.loads": "feet.load",
    "direct.device_signals": "controller.device_signals",
    "direct.request": "controller.supervisor.request",
}
# Outputs of the unit, and their fields in the record of an engine, valid at the end of a tick.
OUTPUT_FIELDS = {
    "setpoints": "joints.board.setpoint",
    "commands": "joints.board.command",
    "decision.phases": "controller.legs.phase",
    "decision.transitions": "controller.legs.chosen",
    "decision.trip_cause": "controller.trip.cause",
    "decision.trip_part": "controller.trip.part",
    "decision.mode": "controller.supervisor.mode",
    "decision.rejected": "controller.supervisor.rejected",
}


class ExoskeletonUnit(NamedTuple):
    """The data from which the unit of an experiment is printed, and to which it is bound."""

    record: units.Exoskeleton  # state at tick 0
    inputs: units.ExoskeletonInputs  # inputs of a tick; only their shape has a meaning
    outputs: units.ExoskeletonOutputs  # outputs of a tick; only their shape has a meaning
    build_flags: Mapping[str, Any]  # constants and functions of the controller to which it is bound
    kernel: str  # source of the functions of the controller's model


def build_exoskeleton_unit(setup: SimulationSetup, *, single: bool = True) -> ExoskeletonUnit:
    """Build the unit of a simulation setup; it receives angles as counts times the angle of a count.

    ``single``: whether its numbers may be float; thresholds on times are then moved by half a tick.
    """
    bodies, episode, structure = assemble(setup)
    boards = [joint.board for joint in episode.joints]
    for board in boards:
        board.encoder.resolution = 0.0
    controller = episode.controller
    trim(setup.program, controller.program, [leg.debounce for leg in controller.legs])
    if single:
        shift_time_thresholds(controller.program, setup.table.signals)
    if setup.experiment.modes is not None:
        modes = replace(setup.experiment.modes, joints=setup.table.joints)
        trim(compile_guards(modes), controller.supervisor.program, [controller.supervisor.debounce])
        if single:
            shift_time_thresholds(controller.supervisor.program, modes.signals)
    phases = len(setup.table.phases)
    for joint in controller.joints:
        del joint.setpoints[phases:]
    for leg in controller.legs:
        del leg.gravity_shares[phases:], leg.blend_ticks[phases:]
    joints, legs = len(boards), len(episode.controller.legs)
    settings = units.UnitSettings(episode.rates, episode.limits, episode.watching)
    inputs = units.ExoskeletonInputs(
        [units.JointBoardInputs() for _ in range(joints)], units.DirectInputs([0.0] * legs)
    )
    setpoints, commands = [JointSetpoint() for _ in range(joints)], [Command() for _ in range(joints)]
    outputs = units.ExoskeletonOutputs(setpoints, commands, units.Decision([0] * legs, [0] * legs))
    texts = [write_control_gravity(bodies.control_bodies, bodies.up_axis)]
    if structure["WITH_INERTIA_COMPENSATION"]:
        texts.append(write_control_inertia(bodies.control_bodies))
    kernel = "\n\n".join([*write_merged_functions("".join(texts)), *texts])
    names = {**structure, **setup.controller.tick_functions()}
    return ExoskeletonUnit(
        units.Exoskeleton(settings, boards, episode.controller), inputs, outputs, names, kernel
    )


def trim(program: GuardProgram, padded: GuardProgram, debounces: Sequence[list[int]]) -> None:
    """Remove, in place, the empty entries with which tables of similar size share a compiled loop."""
    count = max(1, len(program.transitions))
    del padded.minimum_ticks[len(program.minimum_ticks) :]
    del padded.transitions[count:]
    del padded.nodes[max(1, len(program.nodes)) :]
    del padded.comparisons[max(1, len(program.comparisons)) :]
    for debounce in debounces:
        del debounce[count:]


def shift_time_thresholds(program: GuardProgram, signals: Sequence[str]) -> None:
    """Move, in place, thresholds on the time in a phase half-way to the next tick; no result changes.

    A time of whole ticks that meets its threshold exactly in double numbers may not do so in float.
    """
    for comparison in program.comparisons:
        if comparison.factor_b == 0.0 and signals[comparison.signal_a].endswith(TIME):
            ticks = round(comparison.threshold / TICK)
            ticks -= ticks * TICK > comparison.threshold
            comparison.threshold = (ticks + 0.5) * TICK


class RunVectors(NamedTuple):
    """Inputs and outputs of the unit in a run."""

    run: Run  # run of the compiled engine
    inputs: np.ndarray  # inputs of each tick, shape ``(n_ticks,)``, in the layout of ExoskeletonInputs
    outputs: np.ndarray  # expected outputs, in the layout of ExoskeletonOutputs
    measurements: np.ndarray  # measurements of the boards, shape ``(n_ticks, n_joints)``

    def csv(self, joints: Sequence[str]) -> str:
        """Format one line per tick for runner.c: its inputs, then the expected outputs."""
        boards, around = self.inputs["boards"], self.inputs["direct"]
        commands, decision = self.outputs["commands"], self.outputs["decision"]
        read = ("angle", "voltage", "current", "current_deviation")
        columns = {f"{joint}_{name}": boards[name][:, k] for k, joint in enumerate(joints) for name in read}
        columns |= {f"foot_{side}_load": load for side, load in enumerate(around["loads"].T)}
        columns["bus_voltage"] = around["bus_voltage"]
        columns |= {
            name: around["device_signals"][name] for name in around["device_signals"].dtype.fields or ()
        }
        if self.run.experiment.modes is not None:
            columns["request"] = around["request"]
        for k, joint in enumerate(joints):
            columns |= {f"{joint}_{name}": commands[name][:, k] for name in ("torque", "target_current")}
        columns |= {f"foot_{side}_phase": phase for side, phase in enumerate(decision["phases"].T)}
        table = pd.DataFrame(columns | {"trip_cause": decision["trip_cause"]})
        return table.to_csv(index=False, lineterminator="\n", na_rep="nan")


def record_vectors(
    experiment: Experiment, progress: Progress | None = None, on_compile: Callable[[], None] | None = None
) -> RunVectors:
    """Run an experiment on the compiled engine, and record inputs and outputs of the unit in each tick.

    ``experiment``: run without its bus. ``progress``: called at intervals with finished ticks and total
    number of ticks. ``on_compile``: called if the engine has to be compiled first. Raises FirmwareError: a
    fault of the controller itself.
    """
    engine = engine_without_bus(experiment, on_compile)
    unit, ticks, record = build_exoskeleton_unit(engine.setup), experiment.n_ticks, engine.store
    inputs, outputs = (np.zeros(ticks, dtype_of(sample)) for sample in (unit.inputs, unit.outputs))
    earlier = field_pairs(DRIVES, inputs, record)
    measured = record["controller"]["joints"]["measurement"]
    measurements = np.zeros((ticks, measured.shape[1]), measured.dtype)
    now = field_pairs(SENSORS, inputs, record) + field_pairs(OUTPUT_FIELDS, outputs, record)
    now.append((measurements, measured))

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        copy_row(earlier, tick)
        engine.run_ticks(tick, end, rows, first_row)
        copy_row(now, tick)
        return end

    run = engine.run(progress, run_tick=run_tick)
    return RunVectors(run, *(rows[: len(run.log)] for rows in (inputs, outputs, measurements)))


def engine_without_bus(
    experiment: Experiment, on_compile: Callable[[], None] | None = None
) -> CompiledEngine:
    """Create the engine of an experiment without its bus.

    Raises FirmwareError: a fault of the controller itself.
    """
    for fault in experiment.faults:
        if fault.kind is FaultKind.CONTROLLER_RUNAWAY:
            raise FirmwareError(f"faults: {fault} is a fault of the controller itself; verify without it")
    return CompiledEngine(build_setup(replace(experiment, network=None)), on_compile=on_compile)


def field_pairs(fields: Mapping[str, str], rows: np.ndarray, record: np.ndarray) -> Pairs:
    """Return fields of rows with those of an engine's record, shape ``(1,)``.

    Fields of a supervisor are included if there is one.
    """
    modes = "supervisor" in (record["controller"].dtype.fields or ())
    named = [pair for pair in fields.items() if modes or "supervisor" not in pair[1]]
    return [(_field(rows, ours), _field(record, theirs)) for ours, theirs in named]


def _field(records: np.ndarray, name: str) -> np.ndarray:
    """Return a field of records; of the feet only those of the legs of the device, which are neighbours."""
    found = reduce(lambda inner, part: inner[part], name.split("."), records)
    if not name.startswith("feet."):
        return found
    soles = records["soles"][0]
    return found[:, soles[0] : soles[-1] + 1]


def copy_row(pairs: Pairs, tick: int) -> None:
    """Copy the values in the engine to the row of a tick."""
    for rows, record in pairs:
        rows[tick] = record[0]
