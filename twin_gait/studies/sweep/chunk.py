"""A few episodes of a sweep as one piece of work, which any process that has this package can do."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import converting
from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment import Experiment
from twin_gait.simulation import simulate
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.batch import Flat, Override, episode_of, flat_summary
from twin_gait.studies.sweep.spec import Sweep, sources_hash

# A cluster's worker may have several threads, and silencing the URDF parser redirects the process's
# standard error, which two of them would do to each other.
_ONE_AT_A_TIME = threading.Lock()


class Chunk(NamedTuple):
    """Episodes to run: plain values only.

    Attributes:
        document: The experiment that they have in common, with the hash of its URDF.
        sources: Hash of the sources that the rows must come from.
        seed: Of the sweep.
        episodes: Their numbers.
        overrides: What each changes.
    """

    document: Mapping[str, Any]
    sources: str
    seed: int
    episodes: tuple[int, ...]
    overrides: tuple[Override, ...]

    def __str__(self) -> str:
        if len(self.episodes) == 1:
            return f"episode {self.episodes[0]}"
        return f"episodes {self.episodes[0]} to {self.episodes[-1]}"


class ChunkResult(NamedTuple):
    """What comes back: plain values only.

    Attributes:
        rows: Flat summary by episode.
        problem: Why an episode could not be run, or nothing.
        wall_s: How long it took in [s].
        processor: Name of the processor that it ran on.
    """

    rows: dict[int, Flat]
    problem: str
    wall_s: float
    processor: str


def chunk_of(sweep: Sweep, episodes: Sequence[int]) -> Chunk:
    """Piece of work of some episodes.

    Args:
        sweep: The sweep.
        episodes: Their numbers.

    Returns:
        The chunk.
    """
    overrides = tuple(sweep.design[index] for index in episodes)
    return Chunk(sweep.document["experiment"], sources_hash(), sweep.seed, tuple(episodes), overrides)


def check_chunk(chunk: Chunk) -> str:
    """Check the overrides of every episode.

    Args:
        chunk: The episodes.

    Returns:
        The first mistake, or nothing.
    """
    try:
        base = experiment_from_mapping(dict(chunk.document), "the sweep", Path())
        for index, override in zip(chunk.episodes, chunk.overrides, strict=True):
            experiment = episode_of(base, override, index, chunk.seed)
            # A text may name a joint or phase that is not there; numbers are checked by their ranges.
            if index == 0 or not all(isinstance(value, int | float) for value in override.values()):
                converting(f"episode {index}", "", partial(_lay_out, experiment))
    except TwinGaitError as error:
        return str(error)
    return ""


def _lay_out(experiment: Experiment) -> None:
    """Do what goes before the first tick, to find what does not fit together."""
    problem = build_problem(experiment)
    for phase in problem.world.initial_phases.values():
        if phase is not None:
            problem.table.phase_index(phase)


def run_chunk(chunk: Chunk, on_compile: Callable[[], None] | None = None) -> ChunkResult:
    """Run every episode, up to the first that cannot be run.

    Args:
        chunk: The episodes.
        on_compile: As in :func:`twin_gait.simulation.simulate`.

    Returns:
        Their summaries; a fall or a divergence is one of them.
    """
    if chunk.sources != sources_hash():
        return ChunkResult(
            {}, "a worker has another version of twin_gait; install the same everywhere", 0.0, ""
        )
    rows: dict[int, Flat] = {}
    problem = ""
    with _ONE_AT_A_TIME:
        began = time.perf_counter()
        try:
            base = experiment_from_mapping(dict(chunk.document), "the sweep", Path())
            for index, override in zip(chunk.episodes, chunk.overrides, strict=True):
                problem = f"episode {index}: "
                run = simulate(episode_of(base, override, index, chunk.seed), on_compile=on_compile)
                rows[index] = flat_summary(run)
            problem = ""
        except TwinGaitError as error:
            problem += str(error).removeprefix(problem)
        wall = time.perf_counter() - began
    return ChunkResult(rows, problem, wall, _processor())


def _processor() -> str:
    """Name of this processor's type as the compiler has it: the same name, the same last bits."""
    return str(import_module("llvmlite.binding").get_host_cpu_name())
