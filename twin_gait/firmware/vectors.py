"""What the linked unit reads tick by tick in a run of the compiled engine, and what it is to give."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from twin_gait.exceptions import FirmwareError
from twin_gait.experiment import Experiment
from twin_gait.firmware.linked import LinkedUnit, linked_unit
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import run_of
from twin_gait.worlds.faults import FaultKind

Progress: TypeAlias = Callable[[int, int], None]  # takes ticks done and ticks in all
Pairs: TypeAlias = list[tuple[np.ndarray, np.ndarray]]  # rows of ticks, and where in the engine they stand


class Vectors(NamedTuple):
    """A run as the unit sees it."""

    run: Run  # of the compiled engine
    unit: LinkedUnit  # that is to run on the inputs
    inputs: np.ndarray  # of each tick, shape ``(n_ticks,)``, laid out as ExoskeletonInputs
    outputs: np.ndarray  # expected, likewise as ExoskeletonOutputs


def without_bus(experiment: Experiment) -> Experiment:
    """The experiment without its bus; FirmwareError if its controller goes wrong by itself."""
    for fault in experiment.faults:
        if fault.kind is FaultKind.CONTROLLER_RUNAWAY:
            raise FirmwareError(f"faults: {fault} is one of the controller itself; verify without it")
    return replace(experiment, network=None)


def record_vectors(
    experiment: Experiment, progress: Progress | None = None, on_compile: Callable[[], None] | None = None
) -> Vectors:
    """Run an experiment on the compiled engine, and keep what the unit reads and gives in each tick.

    ``experiment``: run without its bus. ``progress``: called now and then with ticks done and ticks in all.
    ``on_compile``: called if the engine has to be compiled first. Raises FirmwareError: a fault of the
    controller itself.
    """
    problem = build_problem(without_bus(experiment))
    engine, unit = CompiledEngine(problem, on_compile=on_compile), linked_unit(problem)
    ticks = problem.experiment.n_ticks
    inputs, outputs = (np.zeros(ticks, dtype_of(sample)) for sample in (unit.inputs, unit.outputs))
    record = engine.store
    earlier, now = drive_pairs(record, inputs), sensor_pairs(record, inputs) + answer_pairs(record, outputs)

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        keep(earlier, tick)
        engine.run_ticks(tick, end, rows, first_row)
        keep(now, tick)
        return end

    run = run_by_ticks(engine, run_tick, progress)
    return Vectors(run, unit, inputs[: len(run.log)], outputs[: len(run.log)])


def run_by_ticks(
    engine: CompiledEngine,
    run_tick: Callable[[int, int, np.ndarray, int], int],
    progress: Progress | None,
) -> Run:
    """The run of an engine that is taken through every tick by a function."""
    began = time.perf_counter()
    result = engine.run(progress, run_tick=run_tick)
    return run_of(engine.problem, result, time.perf_counter() - began)


def drive_pairs(record: np.ndarray, inputs: np.ndarray) -> Pairs:
    """Inputs that stand in an engine's record, shape ``(1,)``, from the end of a tick to that of the next."""
    boards, joints = inputs["boards"], record["joints"]
    return [
        *((boards[name], joints[name]) for name in ("voltage", "current", "current_deviation")),
        (inputs["surroundings"]["bus_voltage"], record["supply"]["bus_voltage"]),
    ]


def sensor_pairs(record: np.ndarray, inputs: np.ndarray) -> Pairs:
    """Inputs that stand there once the sensors have been read."""
    around = inputs["surroundings"]
    return [
        (inputs["boards"]["angle"], record["joints"]["board"]["encoder"]["angle"]),
        (around["loads"], record["soles"]["load"]),
        (around["common"], record["controller"]["common"]),
        *_supervisor_pairs(record, around, ("request",)),
    ]


def answer_pairs(record: np.ndarray, outputs: np.ndarray) -> Pairs:
    """Outputs that stand there at the end of a tick."""
    decision, controller = outputs["decision"], record["controller"]
    return [
        (outputs["commands"], record["joints"]["board"]["command"]),
        (decision["phases"], controller["legs"]["phase"]),
        (decision["transitions"], controller["legs"]["chosen"]),
        (decision["trip_cause"], controller["trip"]["cause"]),
        (decision["trip_part"], controller["trip"]["part"]),
        *_supervisor_pairs(record, decision, ("mode", "refused")),
    ]


def _supervisor_pairs(record: np.ndarray, rows: np.ndarray, names: tuple[str, ...]) -> Pairs:
    controller = record["controller"]
    if "supervisor" not in (controller.dtype.names or ()):
        return []
    return [(rows[name], controller["supervisor"][name]) for name in names]


def keep(pairs: Pairs, tick: int) -> None:
    """Take what stands in the engine into the row of a tick."""
    for rows, record in pairs:
        rows[tick] = record[0]
