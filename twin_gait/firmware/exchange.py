"""What the linked unit reads and gives in a run: recorded from it, or exchanged with it tick by tick."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from numpy.lib.recfunctions import assign_fields_by_name, require_fields

from twin_gait.core.safety import NO_TRIP
from twin_gait.exceptions import FirmwareError
from twin_gait.experiment import Experiment
from twin_gait.firmware.emulator import UnitProcess
from twin_gait.firmware.linked import LinkedUnit, linked_unit
from twin_gait.firmware.project import Project
from twin_gait.simulation.compiled_engine import CompiledEngine, loop_of, run_part
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import run_of
from twin_gait.worlds.faults import FaultKind

Progress: TypeAlias = Callable[[int, int], None]  # takes ticks done and ticks in all
Pairs: TypeAlias = list[tuple[np.ndarray, np.ndarray]]  # rows of ticks, and where in the engine they stand

# Fields of the unit's inputs, and where an engine has them: from the end of a tick to that of the next,
DRIVES = {
    "boards.voltage": "joints.voltage",
    "boards.current": "joints.current",
    "boards.current_deviation": "joints.current_deviation",
    "surroundings.bus_voltage": "supply.bus_voltage",
}
# and once the sensors have been read;
SENSORS = {
    "boards.angle": "joints.board.encoder.angle",
    "surroundings.loads": "soles.load",
    "surroundings.common": "controller.common",
    "surroundings.request": "controller.supervisor.request",
}
# of its outputs, at the end of a tick.
ANSWERS = {
    "commands": "joints.board.command",
    "decision.phases": "controller.legs.phase",
    "decision.transitions": "controller.legs.chosen",
    "decision.trip_cause": "controller.trip.cause",
    "decision.trip_part": "controller.trip.part",
    "decision.mode": "controller.supervisor.mode",
    "decision.refused": "controller.supervisor.refused",
}


class Vectors(NamedTuple):
    """A run as the unit sees it."""

    run: Run  # of the compiled engine
    unit: LinkedUnit  # that is to run on the inputs
    inputs: np.ndarray  # of each tick, shape ``(n_ticks,)``, laid out as ExoskeletonInputs
    outputs: np.ndarray  # expected, likewise as ExoskeletonOutputs

    def csv(self, joints: Sequence[str]) -> str:
        """A tick in a line as runner.c reads it: its inputs, then what is expected."""
        boards, around = self.inputs["boards"], self.inputs["surroundings"]
        commands, decision = self.outputs["commands"], self.outputs["decision"]
        read = ("angle", "voltage", "current", "current_deviation")
        columns = {f"{joint}_{name}": boards[name][:, k] for k, joint in enumerate(joints) for name in read}
        columns |= {f"foot_{side}_load": load for side, load in enumerate(around["loads"].T)}
        columns["bus_voltage"] = around["bus_voltage"]
        columns |= {name: around["common"][name] for name in around["common"].dtype.fields or ()}
        if self.run.experiment.modes is not None:
            columns["request"] = around["request"]
        for k, joint in enumerate(joints):
            columns |= {f"{joint}_{name}": commands[name][:, k] for name in ("torque", "target_current")}
        columns |= {f"foot_{side}_phase": phase for side, phase in enumerate(decision["phases"].T)}
        table = pd.DataFrame(columns | {"trip_cause": decision["trip_cause"]})
        return table.to_csv(index=False, lineterminator="\n", na_rep="nan")


def record_vectors(
    experiment: Experiment, progress: Progress | None = None, on_compile: Callable[[], None] | None = None
) -> Vectors:
    """Run an experiment on the compiled engine, and keep what the unit reads and gives in each tick.

    ``experiment``: run without its bus. ``progress``: called now and then with ticks done and ticks in all.
    ``on_compile``: called if the engine has to be compiled first. Raises FirmwareError: a fault of the
    controller itself.
    """
    engine = _engine_of(experiment, on_compile)
    unit, ticks, record = linked_unit(engine.problem), experiment.n_ticks, engine.store
    inputs, outputs = (np.zeros(ticks, dtype_of(sample)) for sample in (unit.inputs, unit.outputs))
    earlier = _pairs(DRIVES, inputs, record)
    now = _pairs(SENSORS, inputs, record) + _pairs(ANSWERS, outputs, record)

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        _keep(earlier, tick)
        engine.run_ticks(tick, end, rows, first_row)
        _keep(now, tick)
        return end

    run = _run(engine, run_tick, progress)
    return Vectors(run, unit, inputs[: len(run.log)], outputs[: len(run.log)])


def walk_with(
    unit: UnitProcess,
    project: Project,
    experiment: Experiment,
    progress: Progress | None = None,
    on_compile: Callable[[], None] | None = None,
    *,
    double: bool = False,
) -> Run:
    """Run an experiment with a unit as its controller.

    The log has the plant and the unit's commands; velocities are as the boards of the simulation estimate
    them from the same encoders.

    ``unit``: at tick 0. ``project``: that it was built from. ``experiment``: run without its bus.
    ``progress``: called now and then with ticks done and ticks in all. ``on_compile``: called if the plant
    has to be compiled first. ``double``: whether the unit was built with double numbers, as no Cortex-M4F is.
    Raises FirmwareError: the unit does not answer, or a fault is one of the controller itself.
    """
    engine = _engine_of(experiment, on_compile)
    plant = loop_of(engine.pattern, on_compile, run_part)
    recording, address = engine.episode["recording"], engine.store.ctypes.data
    inputs, (given, taken) = np.zeros(1, dtype_of(project.linked.inputs)), project.dtypes(double=double)
    read = _pairs({**DRIVES, **SENSORS}, inputs, engine.store)

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        recording["log"], recording["first_row"] = rows.ctypes.data, first_row
        plant(address, 0, tick)
        _keep(read, 0)
        _obey(engine, unit.exchange(require_fields(inputs, given)).view(taken)[0, 0], tick)
        plant(address, 1, tick)
        return end

    return _run(engine, run_tick, progress)


def _engine_of(experiment: Experiment, on_compile: Callable[[], None] | None) -> CompiledEngine:
    """The engine of an experiment without its bus; a controller that goes wrong by itself is refused."""
    for fault in experiment.faults:
        if fault.kind is FaultKind.CONTROLLER_RUNAWAY:
            raise FirmwareError(f"faults: {fault} is one of the controller itself; verify without it")
    return CompiledEngine(build_problem(replace(experiment, network=None)), on_compile=on_compile)


def _run(
    engine: CompiledEngine, run_tick: Callable[[int, int, np.ndarray, int], int], progress: Progress | None
) -> Run:
    """The run of an engine that is taken through every tick by a function."""
    began = time.perf_counter()
    result = engine.run(progress, run_tick=run_tick)
    return run_of(engine.problem, result, time.perf_counter() - began)


def _pairs(fields: Mapping[str, str], rows: np.ndarray, record: np.ndarray) -> Pairs:
    """Fields of rows with those of an engine's record, shape ``(1,)``; a supervisor's where there is one."""
    modes = "supervisor" in (record["controller"].dtype.fields or ())
    named = [pair for pair in fields.items() if modes or "supervisor" not in pair[1]]
    return [(_field(rows, ours), _field(record, theirs)) for ours, theirs in named]


def _field(records: np.ndarray, name: str) -> np.ndarray:
    return reduce(lambda found, part: found[part], name.split("."), records)


def _keep(pairs: Pairs, tick: int) -> None:
    """Take what stands in the engine into the row of a tick."""
    for rows, record in pairs:
        rows[tick] = record[0]


def _obey(engine: CompiledEngine, answer: np.void, tick: int) -> None:
    """Bring commands, phases and trip of a unit's answer in a tick into the record of an engine."""
    e, decision = engine.episode, answer["decision"]
    commands, trip, recording = e["joints"]["board"]["command"], e["controller"]["trip"], e["recording"]
    assign_fields_by_name(commands, answer["commands"], zero_unassigned=False)
    if "mode" in (decision.dtype.fields or ()):
        supervisor = e["controller"]["supervisor"]
        supervisor["mode"], supervisor["refused"] = decision["mode"], decision["refused"]
    if trip["tick"] >= 0:
        return
    for number, (leg, phase) in enumerate(zip(e["controller"]["legs"], decision["phases"], strict=True)):
        if phase != leg["phase"]:
            if recording["n_switches"] < recording["most_switches"]:
                row = (tick, number, leg["phase"], phase, decision["transitions"][number])
                engine.switches[recording["n_switches"]] = row
                recording["n_switches"] += 1
            leg["phase"], leg["entry_tick"] = phase, tick
    if decision["trip_cause"] != NO_TRIP:
        trip["tick"], trip["cause"], trip["part"] = tick, decision["trip_cause"], decision["trip_part"]
