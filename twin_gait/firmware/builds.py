"""What builds of an experiment's firmware give for the vectors of its runs, and in a loop with the plant."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.lib.recfunctions import assign_fields_by_name, require_fields

from twin_gait.core.safety import NO_TRIP
from twin_gait.experiment import Experiment
from twin_gait.firmware import linked
from twin_gait.firmware.cross import Unit, build_host, build_image, build_object, sizes
from twin_gait.firmware.emulator import Emulator, HostUnit, UnitProcess
from twin_gait.firmware.project import Project
from twin_gait.simulation.compiled_engine import CompiledEngine, loop_of, run_part
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run


def walk_with(
    unit: UnitProcess,
    project: Project,
    experiment: Experiment,
    progress: linked.Progress | None = None,
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
    problem = build_problem(linked.without_bus(experiment))
    engine = CompiledEngine(problem, on_compile=on_compile)
    plant = loop_of(engine.pattern, on_compile, run_part)
    record, recording, address = engine.store, engine.episode["recording"], engine.store.ctypes.data
    inputs, (given, taken) = np.zeros(1, dtype_of(project.linked.inputs)), project.dtypes(double=double)
    drives, sensors = linked.drive_pairs(record, inputs), linked.sensor_pairs(record, inputs)

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        recording["log"], recording["first_row"] = rows.ctypes.data, first_row
        plant(address, 0, tick)
        linked.keep([*drives, *sensors], 0)
        obey(engine, unit.exchange(require_fields(inputs, given)[0]).view(taken)[0], tick)
        plant(address, 1, tick)
        return end

    return linked.run_by_ticks(engine, run_tick, progress)


def obey(engine: CompiledEngine, answer: np.void, tick: int) -> None:
    """Bring commands, phases and trip of a unit's answer in a tick into the record of an engine."""
    e, decision = engine.episode, answer["decision"]
    commands, trip, legs = e["joints"]["board"]["command"], e["controller"]["trip"], e["controller"]["legs"]
    assign_fields_by_name(commands, answer["commands"], zero_unassigned=False)
    if "mode" in decision.dtype.names:
        supervisor = e["controller"]["supervisor"]
        supervisor["mode"], supervisor["refused"] = decision["mode"], decision["refused"]
    if trip["tick"] < 0:
        for number in np.flatnonzero(decision["phases"] != legs["phase"]).tolist():
            _switch(engine, number, decision, tick)
        if decision["trip_cause"] != NO_TRIP:
            trip["tick"], trip["cause"], trip["part"] = tick, decision["trip_cause"], decision["trip_part"]


def _switch(engine: CompiledEngine, number: int, decision: np.void, tick: int) -> None:
    """Note that a leg has gone into another phase."""
    leg, recording = engine.episode["controller"]["legs"][number], engine.episode["recording"]
    phase = decision["phases"][number]
    if recording["n_switches"] < recording["most_switches"]:
        row = (tick, number, leg["phase"], phase, decision["transitions"][number])
        engine.switches[recording["n_switches"]] = row
        recording["n_switches"] += 1
    leg["phase"], leg["entry_tick"] = phase, tick


@dataclass(frozen=True, eq=False)
class Bench:
    """Builds of a project, and their outputs for vectors; nothing is built before it is asked for.

    Whatever needs a compiler or an emulator raises
    :class:`~twin_gait.exceptions.MissingToolError` without it.
    """

    project: Project
    vectors: Sequence[linked.Vectors]  # of some runs
    folder: Path  # into which C and builds are written
    progress: linked.Progress | None = None  # of the walk in the loop, see :func:`walk_with`
    on_compile: Callable[[], None] | None = None  # likewise

    @cached_property
    def unit(self) -> Unit:
        """The C of the linked unit, written with that of all others."""
        return self.project.write_linked(self.folder)

    def host(self, *, double: bool) -> HostUnit:
        """The unit on this machine."""
        path = self.folder / ("double" if double else "single")
        return HostUnit(build_host(self.unit, path, flags=["-DREAL_DOUBLE"] if double else []))

    @cached_property
    def expected(self) -> list[np.ndarray]:
        """Outputs of the simulation, as the C in double numbers has them."""
        _, taken = self.project.dtypes(double=True)
        return [require_fields(item.outputs, taken) for item in self.vectors]

    @cached_property
    def double(self) -> list[np.ndarray]:
        """Outputs on this machine in double numbers."""
        unit = self.host(double=True)
        return [self._run(unit, item, double=True) for item in self.vectors]

    @cached_property
    def single(self) -> list[np.ndarray]:
        """Outputs on this machine in float."""
        unit = self.host(double=False)
        return [self._run(unit, item) for item in self.vectors]

    @cached_property
    def image(self) -> Path:
        """For the Cortex-M4F."""
        return build_image(self.unit, self.folder / "image.elf")

    def _run(self, unit: UnitProcess, vectors: linked.Vectors, *, double: bool = False) -> np.ndarray:
        given, taken = self.project.dtypes(double=double)
        with unit:
            return unit.exchange_many(require_fields(vectors.inputs, given)).view(taken)[:, 0]

    def on_target(self, vectors: linked.Vectors) -> tuple[np.ndarray, Emulator]:
        """Outputs on the Cortex-M4F, and the emulator with what it has counted."""
        target = Emulator(self.image)
        return self._run(target, vectors), target

    def bytes_of(self, name: str) -> dict[str, int]:
        """Flash of a unit of the device, and RAM of its record."""
        flash, variables = sizes(build_object(replace(self.unit, name=name), self.folder))
        return {"flash": flash, "ram": variables + self.project.record_bytes[name]}

    @cached_property
    def walk(self) -> Run:
        """The experiment of the first vectors with the Cortex-M4F as its controller."""
        experiment = self.vectors[0].run.experiment
        with Emulator(self.image) as target:
            return walk_with(target, self.project, experiment, self.progress, self.on_compile)
