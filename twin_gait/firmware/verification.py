"""Verification of the printed C: comparison with the simulation on this machine and on a Cortex-M4F."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.recfunctions import assign_fields_by_name, require_fields, structured_to_unstructured

from twin_gait.core.safety import NO_TRIP
from twin_gait.exceptions import MissingToolError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware import exoskeleton_unit
from twin_gait.firmware.cross import UnitSources, build_host, build_image, build_object, sizes
from twin_gait.firmware.emulator import Emulator, HostUnit, UnitProcess
from twin_gait.firmware.exoskeleton_unit import Progress
from twin_gait.firmware.project import (
    CAN_CODEC,
    CODEC_STEP,
    EXOSKELETON,
    GAIT_CONTROLLER,
    JOINT_BOARD,
    Project,
    print_project,
)
from twin_gait.firmware.python_unit import UnitSample
from twin_gait.firmware.unit_vectors import UnitVectors, excitations_of, walks_of
from twin_gait.simulation.compiled_engine import CompiledEngine, load_or_compile_loop, run_plant_part
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate
from twin_gait.worlds.faults import Fault, FaultKind

MOST_SHIFT = 1  # largest number of ticks between a switch in float and in double numbers
MOST_CURRENT_ERROR = 1e-4  # [A], largest root mean square error; the thesis reports 0.0035 A
FAULT_TIME, FAULT_RUN = 2.5, 4.0  # [s]; time of the fault, and duration of the run with it

# Tick and event, leg by leg. The event of a switch is the leg and the phases before and after, that of a trip
# is its cause.
Events: TypeAlias = Sequence[tuple[int, tuple[Any, ...]]]


def count_differences(first: np.ndarray, second: np.ndarray) -> int:
    """Count the numbers that differ in their bits between two arrays of records of one layout.

    All NaN count as equal.
    """
    ours, theirs = (structured_to_unstructured(rows, float) for rows in (first, second))
    same = (ours.view(np.uint64) == theirs.view(np.uint64)) | (np.isnan(ours) & np.isnan(theirs))
    return int(same.size - same.sum())


def events_of(outputs: np.ndarray) -> Events:
    """Return the phase switches in the outputs of a unit, leg by leg in the order of time, and its trip."""
    decision, found = outputs["decision"], list[tuple[int, tuple[Any, ...]]]()
    for leg, phases in enumerate(decision["phases"].T.tolist()):
        found += [(tick, (leg, *pair)) for tick, pair in enumerate(pairwise(phases), 1) if pair[0] != pair[1]]
    for tick in np.flatnonzero(decision["trip_cause"])[:1].tolist():
        found.append((tick, (int(decision["trip_cause"][tick]),)))
    return found


def largest_shift(first: Events, second: Events) -> float:
    """Compute the largest number of ticks between corresponding events.

    The result is infinite if the events differ in more than their ticks.
    """
    if [event for _, event in first] != [event for _, event in second]:
        return math.inf
    return max((abs(ours - theirs) for (ours, _), (theirs, _) in zip(first, second, strict=True)), default=0)


@dataclass(frozen=True, eq=False)
class VerificationBuild:
    """C of a project, its builds, and their outputs for test vectors; each is computed on first use.

    Methods that need a compiler or an emulator raise :class:`~twin_gait.exceptions.MissingToolError` if it is
    missing.
    """

    project: Project
    vectors: Sequence[exoskeleton_unit.RunVectors]  # inputs and outputs of some runs
    unit: UnitSources  # C of the project; builds are written to its folder

    @cached_property
    def all_vectors(self) -> Sequence[UnitVectors]:
        """Inputs and expected outputs of all units: of their part in the runs, then of the excitations."""
        walks = (walks_of(self.project, sample, self.vectors) for sample in self.project.samples)
        pairs = zip(walks, excitations_of(self.project), strict=True)
        return [
            UnitVectors(walk.sample, [*walk.inputs, *more.inputs], [*walk.expected, *more.expected])
            for walk, more in pairs
        ]

    def unit_of(self, sample: UnitSample) -> UnitSources:
        """Return the C of a unit."""
        header = CODEC_STEP if sample.name == CAN_CODEC else ""
        return UnitSources(sample.name, self.unit.folder, sample.init, header)

    def host(self, *, double: bool, sample: UnitSample | None = None) -> HostUnit:
        """Build a unit for this machine, by default the linked unit of boards and gait controller."""
        unit = self.unit if sample is None else self.unit_of(sample)
        path = self.unit.folder / f"{unit.init or unit.name}_{'double' if double else 'single'}"
        return HostUnit(build_host(unit, path, flags=["-DREAL_DOUBLE"] if double else []))

    def unit_outputs(
        self, unit: UnitProcess, vectors: UnitVectors, *, double: bool = False
    ) -> list[np.ndarray]:
        """Return the outputs of a build of a unit for its inputs."""
        (input_type, output_type), found = self.project.dtypes(double=double, sample=vectors.sample), []
        for rows in vectors.inputs:
            with unit:
                found.append(unit.exchange(require_fields(rows, input_type)).view(output_type)[:, 0])
        return found

    @cached_property
    def all_float_outputs(self) -> list[list[np.ndarray]]:
        """Outputs of all units on this machine in float."""
        return [
            self.unit_outputs(self.host(double=False, sample=item.sample), item) for item in self.all_vectors
        ]

    @cached_property
    def target(self) -> Emulator:
        """Build of the linked unit for a Cortex-M4F."""
        return Emulator(build_image(self.unit, self.unit.folder / "image.elf"))

    def target_of(self, sample: UnitSample) -> Emulator:
        """Build a unit for a Cortex-M4F."""
        return Emulator(build_image(self.unit_of(sample), self.unit.folder / f"{sample.init}.elf"))

    def outputs(self, unit: UnitProcess, *, double: bool = False) -> list[np.ndarray]:
        """Return the outputs of a build of the linked unit for all runs."""
        (input_type, output_type), found = self.project.dtypes(double=double), []
        for item in self.vectors:
            with unit:
                found.append(unit.exchange(require_fields(item.inputs, input_type)).view(output_type)[:, 0])
        return found

    @cached_property
    def expected(self) -> list[np.ndarray]:
        """Outputs of the simulation, in the layout of the C with double numbers."""
        _, output_type = self.project.dtypes(double=True)
        return [require_fields(item.outputs, output_type) for item in self.vectors]

    @cached_property
    def single(self) -> list[np.ndarray]:
        """Outputs of the linked unit on this machine in float."""
        return self.outputs(self.host(double=False))


def verify(
    experiment: Experiment, progress: Progress | None = None, on_compile: Callable[[], None] | None = None
) -> dict[str, Any]:
    """Print an experiment's controller as C, build it, and compare it with the simulation.

    The test vectors are recorded in a run of the experiment, and in a shorter run with a fault of each kind.
    A runaway controller is excluded, because it is a fault of the controller itself, which the C does not
    have. Nothing is compared if the experiment does not walk without faults.

    ``experiment``: run without its bus. ``progress``: called at intervals with finished ticks and total
    number of ticks of each of the runs. ``on_compile``: called if an engine has to be compiled first. Returns
    the content of ``verification.json``: the hash of the source, whether all checks have passed, and for each
    check its name, whether it has passed (None if a tool is missing) and its findings. If the experiment does
    not walk, there are no checks, and ``baseline_problem`` is the reason. Raises FirmwareError if the
    experiment uses a feature that the firmware does not have, or if a compiler rejects the C.
    """
    project = print_project(experiment)
    problem = simulate(replace(experiment, faults=()), on_compile=on_compile).baseline_problem
    if problem:
        return {
            "source_sha256": project.program.source_hash,
            "passed": False,
            "baseline_problem": problem,
            "checks": [],
        }
    vectors = [exoskeleton_unit.record_vectors(case, progress, on_compile) for case in cases_of(experiment)]
    checks = list[dict[str, Any]]()
    with TemporaryDirectory() as folder:
        build = VerificationBuild(project, vectors, project.write_sources(Path(folder)))
        for name, check in CHECKS.items():
            passed: bool | None = None
            try:
                passed, found = check(build)
            except MissingToolError as error:
                found = {"missing": str(error)}
            checks.append({"name": name, "passed": passed, "found": found})
    passed = all(item["passed"] is not False for item in checks)
    return {"source_sha256": project.program.source_hash, "passed": passed, "checks": checks}


def cases_of(experiment: Experiment) -> Iterator[Experiment]:
    """Yield the experiment itself, and a shorter copy of it with one fault of each possible kind."""
    yield experiment
    length = min(FAULT_RUN, experiment.duration)
    impossible = {FaultKind.CONTROLLER_RUNAWAY}
    if not experiment.scenario.grounded:
        impossible.add(FaultKind.FOOT_LOAD_STUCK)
    if not experiment.control.safety.enabled:
        impossible.add(FaultKind.ENCODER_MISSING)
    for kind in (kind for kind in FaultKind if kind not in impossible):
        location = kind.location(experiment.sides[0], experiment.joints[-1])
        fault = Fault(kind=kind, time=FAULT_TIME / FAULT_RUN * length, location=location)
        yield replace(experiment, duration=length, faults=(fault,))


Found: TypeAlias = tuple[bool, dict[str, Any]]  # whether a check has passed, and its findings


def _same_bits(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> Found:
    count = sum(structured_to_unstructured(rows).size for rows in first)
    wrong = sum(map(count_differences, first, second))
    return wrong == 0, {"numbers": count, "differing": wrong, "runs": len(first)}


def _same_units(
    build: VerificationBuild, first: Sequence[Sequence[np.ndarray]], second: Sequence[Sequence[np.ndarray]]
) -> Found:
    """Compare outputs of all units, bit for bit, and count the differing numbers of each unit."""
    found = [_same_bits(ours, theirs)[1] for ours, theirs in zip(first, second, strict=True)]
    names = [item.sample.init for item in build.all_vectors]
    wrong = {name: item["differing"] for name, item in zip(names, found, strict=True)}
    total = {key: sum(item[key] for item in found) for key in ("numbers", "differing")}
    excitations = sum(len(item.inputs) for item in excitations_of(build.project))
    runs = {"runs": len(build.vectors), "excitations": excitations}
    return not any(wrong.values()), {**total, **runs, "differing_by_unit": wrong}


def host_in_double(build: VerificationBuild) -> Found:
    """Compare all units in double numbers with the simulation, bit for bit."""
    given = [
        build.unit_outputs(build.host(double=True, sample=item.sample), item, double=True)
        for item in build.all_vectors
    ]
    return _same_units(build, [item.expected for item in build.all_vectors], given)


def host_in_float(build: VerificationBuild) -> Found:
    """Compare switches and currents of the linked unit in float with the simulation.

    The check passes if switches differ by at most ``MOST_SHIFT`` and currents by at most
    ``MOST_CURRENT_ERROR``.
    """
    shift, errors = 0.0, list[np.ndarray]()
    for ours, theirs in zip(build.expected, build.single, strict=True):
        shift = max(shift, largest_shift(events_of(ours), events_of(theirs)))
        apart = ours["commands"]["target_current"] - theirs["commands"]["target_current"]
        errors.append(np.sqrt(np.mean(apart**2, axis=0)))
    currents = dict(zip(build.project.joints, np.max(errors, axis=0).tolist(), strict=True))
    passed = shift <= MOST_SHIFT and max(currents.values()) <= MOST_CURRENT_ERROR
    return passed, {"largest_shift_ticks": shift, "current_rmse_A": currents}


def target_in_float(build: VerificationBuild) -> Found:
    """Compare a Cortex-M4F with this machine, bit for bit, and count its instructions."""
    build.outputs(build.target)
    given = []
    for item in build.all_vectors:
        linked_unit = item.sample.name == EXOSKELETON
        target = build.target if linked_unit else build.target_of(item.sample)
        given.append(build.unit_outputs(target, item))
    passed, found = _same_units(build, build.all_float_outputs, given)
    counts, weights = build.target.instructions, {}
    for name in (JOINT_BOARD, GAIT_CONTROLLER):
        flash, variables = sizes(build_object(replace(build.unit, name=name), build.unit.folder))
        weights[name] = {"flash": flash, "ram": variables + build.project.record_bytes[name]}
    return passed, {
        **found,
        "instructions_mean": float(counts.mean()),
        "instructions_worst": int(counts.max()),
        "stack_bytes": build.target.stack_bytes,
        "bytes": weights,
    }


def compare_in_the_loop(build: VerificationBuild) -> Found:
    """Compare outcome and strides of a walk with the emulated processor as its controller."""
    before = build.vectors[0].run
    with build.target as target:
        walk = run_with_unit(target, build.project, before.experiment)
    runs = before, walk
    switches = [[(item.tick, (item.side, item.source, item.target)) for item in run.switches] for run in runs]
    outcomes = [str(run.verdict.outcome or run.status) for run in runs]
    strides = [[len(leg.strides_by_phase(skip=0)) for leg in run.leg_records()] for run in runs]
    return outcomes[0] == outcomes[1] and strides[0] == strides[1], {
        "outcome": outcomes[1],
        "outcome_before": outcomes[0],
        "strides": strides[1],
        "largest_shift_ticks": largest_shift(*switches),
        "wall_s": walk.wall_s,
    }


def run_with_unit(
    unit: UnitProcess, project: Project, experiment: Experiment, *, double: bool = False
) -> Run:
    """Run an experiment with a unit as its controller.

    The log contains the state of the plant and the commands of the unit. Its velocities are estimates of the
    simulated boards from the same encoders.

    ``unit``: unit at tick 0. ``project``: project from which it was built. ``experiment``: run without its
    bus. ``double``: whether the unit was built with double numbers; Cortex-M4F builds never are. Raises
    FirmwareError if the unit does not respond, or if a fault is one of the controller itself.
    """
    engine = exoskeleton_unit.engine_without_bus(experiment)
    plant = load_or_compile_loop(engine, None, run_plant_part)
    recording, address = engine.episode["recording"], engine.store.ctypes.data
    inputs = np.zeros(1, dtype_of(project.exoskeleton.inputs))
    input_type, output_type = project.dtypes(double=double)
    read = exoskeleton_unit.field_pairs(
        {**exoskeleton_unit.DRIVES, **exoskeleton_unit.SENSORS}, inputs, engine.store
    )

    def run_tick(tick: int, end: int, rows: np.ndarray, first_row: int) -> int:
        recording["log"], recording["first_row"] = rows.ctypes.data, first_row
        plant(address, 0, tick)
        exoskeleton_unit.copy_row(read, 0)
        outputs = unit.exchange(require_fields(inputs, input_type)).view(output_type)[0, 0]
        _apply_outputs(engine, outputs, tick)
        plant(address, 1, tick)
        return end

    return engine.run(run_tick=run_tick)


def _apply_outputs(engine: CompiledEngine, outputs: np.void, tick: int) -> None:
    """Copy the outputs of a unit in a tick to an engine: setpoints, commands, phases, mode and trip."""
    e, decision = engine.episode, outputs["decision"]
    board, trip, recording = e["joints"]["board"], e["controller"]["trip"], e["recording"]
    for name in ("setpoint", "command"):
        assign_fields_by_name(board[name], outputs[f"{name}s"], zero_unassigned=False)
    if "mode" in (decision.dtype.fields or ()):
        supervisor = e["controller"]["supervisor"]
        supervisor["mode"], supervisor["rejected"] = decision["mode"], decision["rejected"]
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


CHECKS: dict[str, Callable[[VerificationBuild], Found]] = {
    "host in double against the simulation, bit for bit": host_in_double,
    "host in float against double": host_in_float,
    "Cortex-M4F against host in float, bit for bit": target_in_float,
    "processor in the loop": compare_in_the_loop,
}
