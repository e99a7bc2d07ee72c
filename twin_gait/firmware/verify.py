"""The proof that what is printed is what walks in the simulation: on this machine, and on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from twin_gait.exceptions import MissingToolError
from twin_gait.experiment import Experiment
from twin_gait.firmware.comparing import current_errors, differing, events_of, largest_shift, size_of
from twin_gait.firmware.cross import build_host, build_image, build_objects, sizes
from twin_gait.firmware.emulator import Emulator, HostUnit, UnitProcess
from twin_gait.firmware.linked import converted
from twin_gait.firmware.processor import walk_with
from twin_gait.firmware.project import GAIT_CONTROLLER, JOINT_BOARD, Project, print_project
from twin_gait.firmware.vectors import Vectors, record_vectors
from twin_gait.scenario import TreadmillScenario
from twin_gait.scenario.faults import Fault, FaultKind
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

MOST_SHIFT = 1  # ticks between a switch in float and in double numbers
MOST_CURRENT_ERROR = 1e-4  # [A], root mean square; the thesis compares at 0.0035 A
FAULT_TIME, FAULT_RUN = 2.5, 4.0  # [s] of the fault, and of the run with it
Progress = Callable[[int, int], None]


class Check(NamedTuple):
    """A part of the proof.

    Attributes:
        name: What is compared.
        passed: None if a tool is missing.
        text: What was found, in a line.
        figures: What was found, in numbers.
    """

    name: str
    passed: bool | None
    text: str
    figures: dict[str, Any]


@dataclass(frozen=True)
class Verification:
    """What was found.

    Attributes:
        source_hash: Of the C.
        checks: Parts of the proof.
        walk: Of the compiled engine.
        loop_walk: Of the same plant with the emulated processor; None if a tool is missing.
    """

    source_hash: str
    checks: tuple[Check, ...]
    walk: Run
    loop_walk: Run | None

    @property
    def passed(self) -> bool:
        """Whether no check has failed."""
        return all(check.passed is not False for check in self.checks)


def verify(
    experiment: Experiment, progress: Progress | None = None, on_compile: Callable[[], None] | None = None
) -> Verification:
    """Print an experiment's controller, build it, and compare it with the simulation.

    Its walk is run, and a shorter one with a fault of each kind. A controller that runs away is a fault of
    the controller itself, which no C has.

    Args:
        experiment: Run without its bus.
        progress: Called now and then with ticks done and ticks in all.
        on_compile: Called if an engine has to be compiled first.

    Raises:
        FirmwareError: It uses something that the firmware does not have, or a compiler refuses the C.
    """
    project = print_project(experiment)
    cases = list(cases_of(experiment))
    counted = _Counted(progress, sum(case.n_ticks for case in cases) + experiment.n_ticks)
    vectors = [record_vectors(case, counted.next(case), on_compile) for case in cases]
    with TemporaryDirectory() as folder:
        bench = _Bench(project, vectors, Path(folder))
        checks = [_tried(name, check, bench) for name, check in _CHECKS]
        walks: list[Run] = []

        def walk(bench: _Bench) -> Check:
            run = bench.walk(counted.next(experiment), on_compile)
            walks.append(run)
            return _walks_as_before(vectors[0].run, run)

        checks.append(_tried("processor in the loop", walk, bench))
    return Verification(project.program.source_hash, tuple(checks), vectors[0].run, next(iter(walks), None))


def cases_of(experiment: Experiment) -> Iterator[Experiment]:
    """The experiment itself, and with a fault of each kind that it can have."""
    yield experiment
    length = min(FAULT_RUN, experiment.duration)
    for kind in FaultKind:
        on_foot, on_supply = kind is FaultKind.FOOT_LOAD_STUCK, kind is FaultKind.SUPPLY_DIP
        impossible = on_foot and not isinstance(experiment.scenario, TreadmillScenario)
        impossible |= kind is FaultKind.ENCODER_MISSING and not experiment.control.safety.enabled
        if kind is not FaultKind.CONTROLLER_RUNAWAY and not impossible:
            side = None if on_supply else next(iter(experiment.leg.legs))
            joint = None if on_supply or on_foot else JointName.KNEE
            fault = Fault(kind=kind, time=FAULT_TIME / FAULT_RUN * length, side=side, joint=joint)
            yield replace(experiment, duration=length, faults=(fault,))


# ------------------------------------------------------------------ builds and what they give


class _Bench:
    """Builds of a project, and their outputs for vectors."""

    def __init__(self, project: Project, vectors: Sequence[Vectors], folder: Path) -> None:
        self.project, self.vectors, self.folder = project, vectors, folder
        self.unit = project.write_linked(folder)

    @cached_property
    def double(self) -> list[np.ndarray]:
        """Outputs on this machine in double numbers."""
        program = build_host(self.unit, self.folder / "double", flags=["-DREAL_DOUBLE"])
        return [self._run(HostUnit(program), item, double=True) for item in self.vectors]

    @cached_property
    def single(self) -> list[np.ndarray]:
        """Outputs on this machine in float."""
        program = build_host(self.unit, self.folder / "single")
        return [self._run(HostUnit(program), item) for item in self.vectors]

    @cached_property
    def image(self) -> Path:
        return build_image(self.unit, self.folder / "image.elf")

    def _run(self, unit: UnitProcess, vectors: Vectors, *, double: bool = False) -> np.ndarray:
        given, taken = self.project.dtypes(double=double)
        with unit:
            return unit.exchange_many(converted(vectors.inputs, given)).view(taken)[:, 0]

    def on_target(self, vectors: Vectors) -> tuple[np.ndarray, Emulator]:
        """Outputs on the Cortex-M4F, and the emulator with what it has counted."""
        target = Emulator(self.image)
        return self._run(target, vectors), target

    def expected(self, *, double: bool) -> list[np.ndarray]:
        """Outputs of the simulation."""
        _, taken = self.project.dtypes(double=double)
        return [converted(item.outputs, taken) for item in self.vectors]

    def bytes_of(self, name: str) -> dict[str, int]:
        """Flash of a unit of the device, and RAM of its record."""
        unit = replace(self.unit, name=name, sources=(self.folder / f"{name}.c",))
        flash, variables = sizes(build_objects(unit, self.folder))
        return {"flash": flash, "ram": variables + self.project.record_bytes[name]}

    def walk(self, progress: Progress | None, on_compile: Callable[[], None] | None) -> Run:
        """The experiment with the Cortex-M4F as its controller."""
        with Emulator(self.image) as target:
            return walk_with(target, self.project, self.vectors[0].run.experiment, progress, on_compile)


# ------------------------------------------------------------------ checks


def _tried(name: str, check: Callable[[_Bench], Check], bench: _Bench) -> Check:
    try:
        return check(bench)._replace(name=name)
    except MissingToolError as error:
        return Check(name, None, str(error), {})


def _same_bits(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> Check:
    count = sum(map(size_of, first))
    wrong = sum(differing(ours, theirs) for ours, theirs in zip(first, second, strict=True))
    text = f"{wrong} of {count} numbers differ in {len(first)} runs"
    return Check("", wrong == 0, text, {"numbers": count, "differing": wrong, "runs": len(first)})


def _double(bench: _Bench) -> Check:
    return _same_bits(bench.expected(double=True), bench.double)


def _single(bench: _Bench) -> Check:
    pairs = list(zip(bench.expected(double=True), bench.single, strict=True))
    shifts = [largest_shift(events_of(ours), events_of(theirs)) for ours, theirs in pairs]
    errors = np.max([current_errors(ours, theirs) for ours, theirs in pairs], axis=0)
    number, error = int(errors.argmax()), float(errors.max())
    shift = None if None in shifts else max(item for item in shifts if item is not None)
    passed = shift is not None and shift <= MOST_SHIFT and error <= MOST_CURRENT_ERROR
    moved = "switches come in another order" if shift is None else f"switches move by {shift} ticks at most"
    worst = f"{error:.1e} A ({bench.project.joints[number]}; limit {MOST_CURRENT_ERROR:g} A)"
    text = f"{moved}; RMSE of a current {worst}"
    named = dict(zip(bench.project.joints, errors.tolist(), strict=True))
    return Check("", passed, text, {"largest_shift_ticks": shift, "current_rmse_A": named})


def _target(bench: _Bench) -> Check:
    answers = [bench.on_target(item) for item in bench.vectors]
    check = _same_bits(bench.single, [outputs for outputs, _ in answers])
    counts = np.concatenate([target.instructions for _, target in answers])
    figures: dict[str, Any] = {
        "instructions_mean": float(counts.mean()),
        "instructions_worst": int(counts.max()),
        "stack_bytes": max(target.stack_bytes for _, target in answers),
        "bytes": {name: bench.bytes_of(name) for name in (JOINT_BOARD, GAIT_CONTROLLER)},
    }
    units = (f"{name} {item['flash']} and {item['ram']}" for name, item in figures["bytes"].items())
    text = (
        f"{check.text}; {counts.mean():.0f} instructions a tick for all joints, {counts.max()} in the worst; "
        f"bytes of flash and RAM: {', '.join(units)}; {figures['stack_bytes']} bytes of stack"
    )
    return check._replace(text=text, figures={**check.figures, **figures})


_CHECKS: tuple[tuple[str, Callable[[_Bench], Check]], ...] = (
    ("host in double against the simulation, bit for bit", _double),
    ("host in float against double", _single),
    ("Cortex-M4F against host in float, bit for bit", _target),
)


def _walks_as_before(before: Run, after: Run) -> Check:
    order = [[(item.side, item.source, item.target) for item in run.switches] for run in (before, after)]
    same = order[0] == order[1]
    shift = max(
        (abs(a.tick - b.tick) for a, b in zip(before.switches, after.switches, strict=False)), default=0
    )
    words = [run.verdict.outcome or run.status for run in (before, after)]
    strides = [[len(leg.strides_by_phase(skip=0)) for leg in run.leg_records()] for run in (before, after)]
    moved = f"switches move by {shift} ticks at most" if same else "switches come in another order"
    text = f"{words[1]} as {words[0]} before; {len(after.switches)} {moved}; {after.wall_s:.0f} s"
    figures = {
        "outcome": str(words[1]),
        "outcome_before": str(words[0]),
        "strides": strides[1],
        "strides_before": strides[0],
        "switches": len(after.switches),
        "largest_shift_ticks": shift if same else None,
        "wall_s": after.wall_s,
    }
    return Check("", words[0] == words[1] and strides[0] == strides[1], text, figures)


class _Counted:
    """Progress over several runs."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._before, self._ticks = progress, total, 0, 0

    def next(self, experiment: Experiment) -> Progress | None:
        """Of the next run."""
        progress, self._before = self._progress, self._before + self._ticks
        self._ticks = experiment.n_ticks
        before, total = self._before, self._total
        return None if progress is None else lambda done, _: progress(before + done, total)
