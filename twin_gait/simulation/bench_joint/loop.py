"""Run a test on the joint bench: its loop compiled and kept, or the same rooms as plain Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from twin_gait.core.friction import ROTATIONAL
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import BENCH, COLUMNS, LOG_COLUMNS, BenchVariation
from twin_gait.simulation.bench_joint.filling import bench_episode, bench_noise
from twin_gait.simulation.bench_joint.tick import bench_at, run_ticks
from twin_gait.simulation.binding import bind, kernel_functions
from twin_gait.simulation.compiled_engine import compiled_rows
from twin_gait.simulation.episode import DIVERGED
from twin_gait.simulation.keeping import NativeFunction, kept_loop, source_key
from twin_gait.simulation.log import writer_of
from twin_gait.simulation.record import stored
from twin_gait.simulation.run import RunStatus
from twin_gait.worlds.bench_joint import BenchJoint

if TYPE_CHECKING:
    from twin_gait.simulation.compiling import CompiledLoop


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What a test left behind."""

    test: BenchJoint  # The test.
    rows: np.ndarray  # Log, shape ``(n_ticks, n_columns)``.
    status: RunStatus  # Completed or diverged.

    def column(self, name: str) -> np.ndarray:
        """A column by its name, shape ``(n_ticks,)``.

        ``name``: with its unit. Raises ParameterError if there is no such column.
        """
        if name not in COLUMNS:
            raise ParameterError(f"{name}: no such column; there are {', '.join(COLUMNS)}")
        return np.asarray(self.rows[:, COLUMNS.index(name)])

    def log(self, *, truth: bool = True) -> pd.DataFrame:
        """The log as a table.

        ``truth``: also what no bench can see: friction, true motion, true current. Returns one row per tick.
        """
        columns = COLUMNS if truth else LOG_COLUMNS
        return pd.DataFrame(self.rows[:, : len(columns)], columns=list(columns))


def simulate_bench(
    test: BenchJoint,
    *,
    seed: int = 0,
    variation: BenchVariation | None = None,
    compiled: bool = True,
    on_compile: Callable[[], None] | None = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: The bench and what is done on it.
        seed: Of the noise of current and encoder.
        variation: What chance adds to this test.
        compiled: False runs the same loop as plain Python, some hundred times slower.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test do not go together.
    """
    ticks = max(1, round(test.duration / TICK))
    episode, noise = bench_episode(test, variation or BenchVariation()), bench_noise(test, ticks, seed)
    rows = np.zeros((ticks, len(COLUMNS)))
    writer = kernel_functions(writer_of([(0, BENCH)]), {"TICK": TICK})
    # The laws beside (3.1) slow the others down.
    names = {"OTHER_LAWS": episode.friction.law > ROTATIONAL, **writer}
    if compiled:
        recording = episode.recording
        recording.log, recording.noise, recording.n_noise = rows.ctypes.data, noise.ctypes.data, noise.size
        store = stored(episode)
        done = _compiled(store.dtype, names, on_compile)(store.ctypes.data, 0, ticks)
        status = int(store[0]["status"])
    else:
        table = noise.reshape(-1, 1).tolist()
        found = {"log_row": lambda e, tick: rows[tick], "noise_row": lambda e, number: table[number]}
        done, status = bind(run_ticks, {**names, **found})(episode, 0, ticks), episode.status
    return BenchRun(test, rows[:done], RunStatus.DIVERGED if status == DIVERGED else RunStatus.COMPLETED)


def run_at(address: int, first: int, end: int) -> int:
    """:func:`~twin_gait.simulation.bench_joint.tick.run_ticks` of the test at an address."""
    return run_ticks(bench_at(address), first, end)


def _compiled(
    episode: np.dtype[Any], names: dict[str, Any], on_compile: Callable[[], None] | None
) -> NativeFunction:
    """The compiled loop of tests of one layout."""

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop, record_at

        rows = compiled_rows(len(COLUMNS), 1)
        return compile_loop(run_at, {**names, **rows, "bench_at": record_at(episode)})

    return kept_loop(_key(episode, names["OTHER_LAWS"]), make, on_compile)


@lru_cache(maxsize=8)
def _key(episode: np.dtype[Any], other_laws: bool) -> str:
    """Key of the loop for tests of one layout; writing that out takes longer than a short test."""
    return source_key(repr((episode, other_laws, TICK)), "compiled_engine", "bench_joint")
