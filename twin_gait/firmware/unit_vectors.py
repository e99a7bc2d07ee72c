"""Test vectors of every unit of a project: inputs and outputs of simulated walks, and of excitations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.recfunctions import require_fields, structured_to_unstructured

from twin_gait.core.safety import NO_TRIP
from twin_gait.firmware.excitation import board_episodes, codec_rows, controller_episodes
from twin_gait.firmware.exoskeleton_unit import RunVectors
from twin_gait.firmware.guard_excitation import CONTROLLER_TICKS, Guards, exoskeleton_episodes
from twin_gait.firmware.layout import identifier
from twin_gait.firmware.project import CAN_CODEC, EXOSKELETON, GAIT_CONTROLLER, JOINT_BOARD, Project
from twin_gait.firmware.python_unit import PythonUnit, UnitSample

HASH_FACTOR = 1_099_511_628_211  # Factor of the hash, which must be odd; the runner has the same factor.
_CONVERSIONS = {"f": "(real)", "i": "(int32_t)", "b": "0.0 != "}
MOST_ROWS = 2500  # Longest episode in a file, in rows of equal inputs; --verify also runs longer ones.


@dataclass(frozen=True, eq=False)
class UnitVectors:
    """Runs of a unit from its tick 0 on; the layout of the rows is that of C with double precision."""

    sample: UnitSample  # Unit at tick 0.
    inputs: Sequence[np.ndarray]  # Inputs of each run, shape ``(n_ticks,)``.
    expected: Sequence[np.ndarray]  # Outputs of the simulation for each run, shape ``(n_ticks,)``.


def walks_of(project: Project, sample: UnitSample, walks: Sequence[RunVectors]) -> UnitVectors:
    """Return the inputs and outputs of a unit in runs of the simulation without a bus.

    A board receives the setpoint of the tick in which it measures, as in the simulation. Its rows end before
    the tick in which it detects a cause of a trip: from then on the gait controller holds a board without a
    bus, but a separate board holds itself.
    """
    given, taken = project.dtypes(double=True, sample=sample)
    inputs, expected = list[np.ndarray](), list[np.ndarray]()
    for walk in walks if sample.name != CAN_CODEC else ():  # A walk without a bus has no frames.
        read, answered = walk.inputs, walk.outputs
        rows, answers = np.zeros(len(read), given), np.zeros(len(read), taken)
        if sample.name == EXOSKELETON:
            rows, answers = require_fields(read, given), require_fields(answered, taken)
        elif sample.name == GAIT_CONTROLLER:
            rows["received"] = True
            _copy(rows, direct=read["direct"], measurements=walk.measurements)
            _copy(answers, decision=answered["decision"], setpoints=answered["setpoints"])
        else:
            index = project.joints.index(sample.init.removeprefix(f"{JOINT_BOARD}_"))
            board, measured, rows["received"] = read["boards"][:, index], walk.measurements[:, index], True
            for name in ("angle", "voltage", "current", "current_deviation"):
                rows[name] = board[name]
            _copy(rows, setpoint=answered["setpoints"][:, index])
            _copy(answers, command=answered["commands"][:, index], measurement=measured)
            tripped = np.flatnonzero(measured["cause"] != NO_TRIP)
            end = tripped[0] if len(tripped) else len(rows)
            rows, answers = rows[:end], answers[:end]
        inputs.append(rows)
        expected.append(answers)
    return UnitVectors(sample, inputs, expected)


def _copy(rows: np.ndarray, **fields: np.ndarray) -> None:
    """Copy records into fields of rows, for those names that the fields of the rows have."""
    for name, values in fields.items():
        rows[name] = require_fields(values, rows.dtype[name].base)


def excitations_of(project: Project) -> list[UnitVectors]:
    """Return generated inputs of every unit, and the outputs of the simulation's functions for them.

    The result of the last firmware is cached, because it depends only on the source of the firmware.
    """
    if project.program.source_hash not in _last:
        _last.clear()
        _last[project.program.source_hash] = _excitations(project)
    return _last[project.program.source_hash]


_last: dict[str, list[UnitVectors]] = {}  # Excitations by the hash of the source.


def _excitations(project: Project) -> list[UnitVectors]:
    modes = project.setup.experiment.modes
    requests = 0 if modes is None else len(modes.requests)
    found, boards = list[UnitVectors](), list[Any]()
    for sample in project.samples:
        unit, record = project.python_unit(sample), sample.record
        given, taken = project.dtypes(double=True, sample=sample)
        if sample.name == JOINT_BOARD:
            constants = record.settings, record.state.bounds, record.state.motor, record.state.friction_model
            rows = list(board_episodes(record, given, repeated=constants in boards))
            boards.append(constants)
            episodes = [(item, _answer(unit, item)) for item in rows]
        elif sample.name == GAIT_CONTROLLER:
            episodes = [(item, _answer(unit, item)) for item in controller_episodes(record, given)]
            episodes += Guards(unit, record.state, given, []).episodes(CONTROLLER_TICKS, requests)
        elif sample.name == EXOSKELETON:
            episodes = list(exoskeleton_episodes(record, given, unit))
        else:
            rows = [codec_rows(record.messages, given)]
            episodes = [(item, _answer(unit, item)) for item in rows]
        inputs, outputs = zip(*episodes, strict=True)
        found.append(UnitVectors(sample, inputs, [require_fields(item, taken) for item in outputs]))
    return found


def _answer(unit: PythonUnit, rows: np.ndarray) -> np.ndarray:
    """Return the outputs of a unit for inputs from its tick 0 on."""
    with unit:
        return unit.exchange(rows)


def members(dtype: np.dtype[Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the members of a record in C, in the order of its numbers, with the conversion from double."""
    for name in dtype.names or ():
        kind, member = dtype[name], f"{prefix}{identifier(name)}"
        entries = [f"{member}[{k}]" for k in range(kind.shape[0])] if kind.shape else [member]
        for entry in entries:
            if kind.base.names is None:
                yield entry, _CONVERSIONS[kind.base.kind]
            else:
                yield from members(kind.base, f"{entry}.")


def excitation_csv(excitations: Sequence[UnitVectors]) -> str:
    """Return excitations as a file for the runner.

    A line contains the number of the unit, 1 if it begins at tick 0, the number of ticks with these inputs,
    the inputs, and the hash of all outputs in these ticks.
    """
    lines = ["unit,restart,ticks,inputs and the hash of the outputs"]
    for number, vectors in enumerate(excitations):
        for rows, outputs in zip(vectors.inputs, vectors.expected, strict=True):
            values = structured_to_unstructured(rows, float)
            bits = values.view(np.uint64)
            starts = np.flatnonzero(np.r_[True, np.any(bits[1:] != bits[:-1], axis=1)])
            if len(starts) > MOST_ROWS:
                continue
            hashes = _hashes(outputs)
            for first, end in zip(starts.tolist(), [*starts[1:].tolist(), len(rows)], strict=True):
                found = _joined(hashes[first:end])
                shown = ",".join(f"{value:.17g}" for value in values[first].tolist())
                lines.append(f"{number},{int(first == 0)},{end - first},{shown},{found}")
    return "\n".join(lines) + "\n"


def _hashes(outputs: np.ndarray) -> list[int]:
    """Return the hash of the outputs of each tick; all NaN count as one."""
    values = structured_to_unstructured(outputs, float)
    bits = np.where(np.isnan(values), np.float64(np.nan), values).view(np.uint64)
    found = np.zeros(len(bits), np.uint64)
    for column in bits.T:
        found = found * np.uint64(HASH_FACTOR) + column
    return [int(item) for item in found]


def _joined(hashes: Sequence[int]) -> int:
    """Return the hash of several ticks from the hash of each."""
    found = 0
    for item in hashes:
        found = (found * HASH_FACTOR + item) % 2**64
    return found


def runner_records(project: Project) -> dict[str, Any]:
    """Return the members of the records that the runner of a project writes and hashes."""
    excited = dict[str, dict[str, Any]]()
    counts = list[int]()
    for sample in project.samples:
        given, taken = project.dtypes(double=True, sample=sample)
        inputs = list(members(given))
        counts.append(len(inputs))
        record = type(sample.record).__name__
        outputs = list(members(taken))
        excited[sample.name] = {"name": sample.name, "record": record, "inputs": inputs, "outputs": outputs}
    return {"excited": list(excited.values()), "counts": counts, "most_numbers": max(counts)}
