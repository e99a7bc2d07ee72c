"""The proof that what is printed is what walks in the simulation: on this machine, and on a Cortex-M4F."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from twin_gait.exceptions import MissingToolError
from twin_gait.experiment import Experiment
from twin_gait.firmware.builds import Bench
from twin_gait.firmware.project import GAIT_CONTROLLER, JOINT_BOARD, print_project
from twin_gait.firmware.vectors import record_vectors
from twin_gait.simulation.run import Run
from twin_gait.worlds.faults import Fault, FaultKind


def differing(first: np.ndarray, second: np.ndarray) -> int:
    """Numbers of two arrays of records of one layout that are not the same bits; of NaN any is the same."""
    if first.dtype.names is not None:
        return sum(differing(first[name], second[name]) for name in first.dtype.names)
    ours, theirs = (np.ascontiguousarray(item) for item in (first, second))
    bits = np.dtype(f"u{ours.itemsize}")
    same = (ours.view(bits) == theirs.view(bits)) | ((ours != ours) & (theirs != theirs))
    return int(same.size - same.sum())


def size_of(rows: np.ndarray) -> int:
    """Numbers in an array of records."""
    if rows.dtype.names is None:
        return rows.size
    return sum(size_of(rows[name]) for name in rows.dtype.names)


class Events(NamedTuple):
    """Switches of the legs, and the trip of the monitor, leg by leg in the order of time."""

    ticks: np.ndarray  # of each
    kinds: list[tuple[int, ...]]  # leg, phases before and after; of a trip its cause


def events_of(outputs: np.ndarray) -> Events:
    """What a unit decided over time."""
    found = list(_events(outputs["decision"]))
    return Events(np.array([tick for tick, _ in found], int), [kind for _, kind in found])


def _events(decision: np.ndarray) -> Iterator[tuple[int, tuple[int, ...]]]:
    for leg, phases in enumerate(decision["phases"].T):
        for tick in (np.flatnonzero(np.diff(phases)) + 1).tolist():
            yield tick, (leg, int(phases[tick - 1]), int(phases[tick]))
    causes = decision["trip_cause"]
    if causes.any():
        first = int(np.flatnonzero(causes)[0])
        yield first, (int(causes[first]),)


def largest_shift(first: Events, second: Events) -> int | None:
    """Ticks between switches and trips that belong together; None if others come, or in another order."""
    if first.kinds != second.kinds:
        return None
    return int(np.abs(first.ticks - second.ticks).max(initial=0))


def current_errors(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Root mean square of the differences of the target currents in [A], shape ``(n_joints,)``."""
    currents = [outputs["commands"]["target_current"].astype(float) for outputs in (first, second)]
    return np.asarray(np.sqrt(np.mean((currents[0] - currents[1]) ** 2, axis=0)))


MOST_SHIFT = 1  # ticks between a switch in float and in double numbers
MOST_CURRENT_ERROR = 1e-4  # [A], root mean square; the thesis compares at 0.0035 A
FAULT_TIME, FAULT_RUN = 2.5, 4.0  # [s] of the fault, and of the run with it
Progress = Callable[[int, int], None]


class Check(NamedTuple):
    """A part of the proof."""

    name: str  # what is compared
    passed: bool | None  # None if a tool is missing
    text: str  # what was found, in a line
    figures: dict[str, Any]  # what was found, in numbers


@dataclass(frozen=True)
class Verification:
    """What was found."""

    source_hash: str  # of the C
    checks: tuple[Check, ...]  # parts of the proof
    walk: Run  # of the compiled engine
    loop_walk: Run | None  # of the same plant with the emulated processor; None if a tool is missing

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

    ``experiment``: run without its bus. ``progress``: called now and then with ticks done and ticks in all.
    ``on_compile``: called if an engine has to be compiled first. Raises FirmwareError: it uses something that
    the firmware does not have, or a compiler refuses the C.
    """
    project = print_project(experiment)
    cases = list(cases_of(experiment))
    counted = _Counted(progress, sum(case.n_ticks for case in cases) + experiment.n_ticks)
    vectors = [record_vectors(case, counted.next(case), on_compile) for case in cases]
    with TemporaryDirectory() as folder:
        bench = Bench(project, vectors, Path(folder))
        checks = [_tried(name, check, bench) for name, check in CHECKS]
        walks: list[Run] = []

        def walk(bench: Bench) -> Check:
            run = bench.walk(counted.next(experiment), on_compile)
            walks.append(run)
            return walks_as_before(vectors[0].run, run)

        checks.append(_tried("processor in the loop", walk, bench))
    return Verification(project.program.source_hash, tuple(checks), vectors[0].run, next(iter(walks), None))


def cases_of(experiment: Experiment) -> Iterator[Experiment]:
    """The experiment itself, and with a fault of each kind that it can have."""
    yield experiment
    length = min(FAULT_RUN, experiment.duration)
    for kind in FaultKind:
        on_foot, on_supply = kind is FaultKind.FOOT_LOAD_STUCK, kind is FaultKind.SUPPLY_DIP
        impossible = on_foot and not experiment.scenario.grounded
        impossible |= kind is FaultKind.ENCODER_MISSING and not experiment.control.safety.enabled
        if kind is not FaultKind.CONTROLLER_RUNAWAY and not impossible:
            side = None if on_supply else next(iter(experiment.leg.legs))
            joint = None if on_supply or on_foot else experiment.joints[-1]
            fault = Fault(kind=kind, time=FAULT_TIME / FAULT_RUN * length, side=side, joint=joint)
            yield replace(experiment, duration=length, faults=(fault,))


def _tried(name: str, check: Callable[[Bench], Check], bench: Bench) -> Check:
    try:
        return check(bench)._replace(name=name)
    except MissingToolError as error:
        return Check(name, None, str(error), {})


def _same_bits(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> Check:
    count = sum(map(size_of, first))
    wrong = sum(differing(ours, theirs) for ours, theirs in zip(first, second, strict=True))
    text = f"{wrong} of {count} numbers differ in {len(first)} runs"
    return Check("", wrong == 0, text, {"numbers": count, "differing": wrong, "runs": len(first)})


def host_in_double(bench: Bench) -> Check:
    """The C in double numbers gives the bits of the simulation."""
    return _same_bits(bench.expected(double=True), bench.double)


def host_in_float(bench: Bench) -> Check:
    """In float it decides in the same ticks, and asks for the same currents."""
    pairs = list(zip(bench.expected(double=True), bench.single, strict=True))
    shifts = [largest_shift(events_of(ours), events_of(theirs)) for ours, theirs in pairs]
    errors = np.max([current_errors(ours, theirs) for ours, theirs in pairs], axis=0)
    number, error = int(errors.argmax()), float(errors.max())
    shift = None if None in shifts else max(item for item in shifts if item is not None)
    passed = shift is not None and shift <= MOST_SHIFT and error <= MOST_CURRENT_ERROR
    worst = f"{error:.1e} A ({bench.project.joints[number]}; limit {MOST_CURRENT_ERROR:g} A)"
    text = f"{_moved(shift)}; RMSE of a current {worst}"
    named = dict(zip(bench.project.joints, errors.tolist(), strict=True))
    return Check("", passed, text, {"largest_shift_ticks": shift, "current_rmse_A": named})


def target_in_float(bench: Bench) -> Check:
    """A Cortex-M4F gives the bits of this machine, and counts its instructions."""
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


def _moved(shift: int | None) -> str:
    if shift is None:
        return "switches come in another order"
    return f"switches up to {shift} ticks apart" if shift else "every switch in the same tick"


CHECKS: tuple[tuple[str, Callable[[Bench], Check]], ...] = (
    ("host in double against the simulation, bit for bit", host_in_double),
    ("host in float against double", host_in_float),
    ("Cortex-M4F against host in float, bit for bit", target_in_float),
)


def walks_as_before(before: Run, after: Run) -> Check:
    """With the emulated processor as the controller of the same plant the walk has the same outcome."""
    order = [[(item.side, item.source, item.target) for item in run.switches] for run in (before, after)]
    ticks = [np.array([item.tick for item in run.switches], int) for run in (before, after)]
    shift = int(np.abs(ticks[0] - ticks[1]).max(initial=0)) if order[0] == order[1] else None
    words = [run.verdict.outcome or run.status for run in (before, after)]
    strides = [[len(leg.strides_by_phase(skip=0)) for leg in run.leg_records()] for run in (before, after)]
    text = f"{words[1]}, without it {words[0]}; {_moved(shift)}; {after.duration:g} s in {after.wall_s:.1f} s"
    figures = {
        "outcome": str(words[1]),
        "outcome_before": str(words[0]),
        "strides": strides[1],
        "strides_before": strides[0],
        "switches": len(after.switches),
        "largest_shift_ticks": shift,
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
