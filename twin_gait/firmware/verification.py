"""The proof that what is printed is what walks in the simulation: on this machine, and on a Cortex-M4F."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured

from twin_gait.exceptions import MissingToolError
from twin_gait.experiment import Experiment
from twin_gait.firmware.builds import Bench
from twin_gait.firmware.linked import Progress, record_vectors
from twin_gait.firmware.project import GAIT_CONTROLLER, JOINT_BOARD, print_project
from twin_gait.simulation.run import Run
from twin_gait.worlds.faults import Fault, FaultKind

MOST_SHIFT = 1  # ticks between a switch in float and in double numbers
MOST_CURRENT_ERROR = 1e-4  # [A], root mean square; the thesis compares at 0.0035 A
FAULT_TIME, FAULT_RUN = 2.5, 4.0  # [s] of the fault, and of the run with it

# Ticks, leg by leg, with what happened: leg, phases before and after; of a trip its cause.
Events: TypeAlias = Sequence[tuple[int, tuple[Any, ...]]]


def differing(first: np.ndarray, second: np.ndarray) -> int:
    """Numbers of two arrays of records of one layout that are not the same bits; of NaN any is the same."""
    ours, theirs = (structured_to_unstructured(rows, float) for rows in (first, second))
    same = (ours.view(np.uint64) == theirs.view(np.uint64)) | (np.isnan(ours) & np.isnan(theirs))
    return int(same.size - same.sum())


def events_of(outputs: np.ndarray) -> Events:
    """Switches of the legs that a unit decided on, leg by leg in the order of time, and its trip."""
    decision, found = outputs["decision"], list[tuple[int, tuple[Any, ...]]]()
    for leg, phases in enumerate(decision["phases"].T.tolist()):
        found += [(tick, (leg, *pair)) for tick, pair in enumerate(pairwise(phases), 1) if pair[0] != pair[1]]
    for tick in np.flatnonzero(decision["trip_cause"])[:1].tolist():
        found.append((tick, (int(decision["trip_cause"][tick]),)))
    return found


def largest_shift(first: Events, second: Events) -> int | None:
    """Ticks between events that belong together; None if others come, or in another order."""
    if [event for _, event in first] != [event for _, event in second]:
        return None
    return max((abs(ours - theirs) for (ours, _), (theirs, _) in zip(first, second, strict=True)), default=0)


def current_errors(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Root mean square of the differences of the target currents in [A], shape ``(n_joints,)``."""
    ours, theirs = (outputs["commands"]["target_current"].astype(float) for outputs in (first, second))
    return np.asarray(np.sqrt(np.mean((ours - theirs) ** 2, axis=0)))


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
    runs = [*cases_of(experiment), experiment]  # the last one with the processor in the loop
    ticks = [run.n_ticks for run in runs]

    def part(number: int) -> Progress | None:
        """Progress in one of the runs as that in all."""
        before = sum(ticks[:number])
        return None if progress is None else lambda done, _: progress(before + done, sum(ticks))

    vectors = [record_vectors(case, part(number), on_compile) for number, case in enumerate(runs[:-1])]
    with TemporaryDirectory() as folder:
        bench = Bench(project, vectors, Path(folder), part(len(vectors)), on_compile)
        checks = tuple(_tried(name, check, bench) for name, check in CHECKS.items())
        loop_walk = None if checks[-1].passed is None else bench.walk
    return Verification(project.program.source_hash, checks, vectors[0].run, loop_walk)


def cases_of(experiment: Experiment) -> Iterator[Experiment]:
    """The experiment itself, and with a fault of each kind that it can have."""
    yield experiment
    length = min(FAULT_RUN, experiment.duration)
    impossible = {FaultKind.CONTROLLER_RUNAWAY}
    if not experiment.scenario.grounded:
        impossible.add(FaultKind.FOOT_LOAD_STUCK)
    if not experiment.control.safety.enabled:
        impossible.add(FaultKind.ENCODER_MISSING)
    for kind in (kind for kind in FaultKind if kind not in impossible):
        place = kind.place(next(iter(experiment.leg.legs)), experiment.joints[-1])
        fault = Fault(kind=kind, time=FAULT_TIME / FAULT_RUN * length, place=place)
        yield replace(experiment, duration=length, faults=(fault,))


Found: TypeAlias = tuple[bool, str, dict[str, Any]]  # whether it passes, in a line, and in numbers


def _tried(name: str, check: Callable[[Bench], Found], bench: Bench) -> Check:
    try:
        return Check(name, *check(bench))
    except MissingToolError as error:
        return Check(name, None, str(error), {})


def _same_bits(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> Found:
    count = sum(structured_to_unstructured(rows).size for rows in first)
    wrong = sum(map(differing, first, second))
    text = f"{wrong} of {count} numbers differ in {len(first)} runs"
    return wrong == 0, text, {"numbers": count, "differing": wrong, "runs": len(first)}


def host_in_double(bench: Bench) -> Found:
    """The C in double numbers gives the bits of the simulation."""
    return _same_bits(bench.expected, bench.double)


def host_in_float(bench: Bench) -> Found:
    """In float it decides in the same ticks, and asks for the same currents."""
    pairs = list(zip(bench.expected, bench.single, strict=True))
    shifts = [largest_shift(events_of(ours), events_of(theirs)) for ours, theirs in pairs]
    shift = None if None in shifts else max(item for item in shifts if item is not None)
    errors = np.max([current_errors(ours, theirs) for ours, theirs in pairs], axis=0)
    named = dict(zip(bench.project.joints, errors.tolist(), strict=True))
    worst = max(named, key=lambda joint: named[joint])
    passed = shift is not None and shift <= MOST_SHIFT and named[worst] <= MOST_CURRENT_ERROR
    text = f"RMSE of a current {named[worst]:.1e} A ({worst}; limit {MOST_CURRENT_ERROR:g} A)"
    return passed, f"{_moved(shift)}; {text}", {"largest_shift_ticks": shift, "current_rmse_A": named}


def target_in_float(bench: Bench) -> Found:
    """A Cortex-M4F gives the bits of this machine, and counts its instructions."""
    answers = [bench.on_target(item) for item in bench.vectors]
    passed, same, figures = _same_bits(bench.single, [outputs for outputs, _ in answers])
    counts = np.concatenate([target.instructions for _, target in answers])
    figures |= {
        "instructions_mean": float(counts.mean()),
        "instructions_worst": int(counts.max()),
        "stack_bytes": max(target.stack_bytes for _, target in answers),
        "bytes": {name: bench.bytes_of(name) for name in (JOINT_BOARD, GAIT_CONTROLLER)},
    }
    units = (f"{name} {item['flash']} and {item['ram']}" for name, item in figures["bytes"].items())
    text = (
        f"{same}; {counts.mean():.0f} instructions a tick for all joints, {counts.max()} in the worst; "
        f"bytes of flash and RAM: {', '.join(units)}; {figures['stack_bytes']} bytes of stack"
    )
    return passed, text, figures


def in_the_loop(bench: Bench) -> Found:
    """With the emulated processor as the controller of the same plant the walk has the same outcome."""
    walk = bench.walk
    runs = bench.vectors[0].run, walk
    switches = [[(item.tick, (item.side, item.source, item.target)) for item in run.switches] for run in runs]
    shift = largest_shift(*switches)
    words = [str(run.verdict.outcome or run.status) for run in runs]
    strides = [[len(leg.strides_by_phase(skip=0)) for leg in run.leg_records()] for run in runs]
    text = f"{words[1]}, without it {words[0]}; {_moved(shift)}; {walk.duration:g} s in {walk.wall_s:.1f} s"
    figures = {
        "outcome": words[1],
        "outcome_before": words[0],
        "strides": strides[1],
        "strides_before": strides[0],
        "switches": len(walk.switches),
        "largest_shift_ticks": shift,
        "wall_s": walk.wall_s,
    }
    return words[0] == words[1] and strides[0] == strides[1], text, figures


def _moved(shift: int | None) -> str:
    if shift is None:
        return "switches come in another order"
    return f"switches up to {shift} ticks apart" if shift else "every switch in the same tick"


CHECKS: dict[str, Callable[[Bench], Found]] = {
    "host in double against the simulation, bit for bit": host_in_double,
    "host in float against double": host_in_float,
    "Cortex-M4F against host in float, bit for bit": target_in_float,
    "processor in the loop": in_the_loop,
}
