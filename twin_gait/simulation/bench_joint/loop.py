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
from twin_gait.simulation.bench_joint.episode import (
    COLUMNS,
    LOG_COLUMNS,
    BenchEpisode,
    BenchRow,
    BenchVariation,
)
from twin_gait.simulation.bench_joint.filling import bench_episode, bench_noise
from twin_gait.simulation.bench_joint.tick import CURRENT_NOISE, bench_at, run_ticks
from twin_gait.simulation.binding import bind
from twin_gait.simulation.engine import DIVERGED_VELOCITY
from twin_gait.simulation.episode import COMPLETED, DIVERGED
from twin_gait.simulation.keeping import kept_loop, source_key
from twin_gait.simulation.record import dtype_of, numbers_in, stored
from twin_gait.simulation.run import RunStatus
from twin_gait.worlds.bench_joint import BenchJoint

if TYPE_CHECKING:
    from twin_gait.simulation.compiling import CompiledLoop

CHUNK_TICKS = 5000  # between two looks at progress and interruption
_ROW = dtype_of(BenchRow())
Advance = Callable[[int, int], tuple[int, int]]  # from tick and to tick; ticks done and status


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What a test left behind."""

    test: BenchJoint  # The test.
    rows: np.ndarray  # Log, shape ``(n_ticks, n_columns)``.
    status: RunStatus  # Completed, diverged or interrupted.

    def column(self, name: str) -> np.ndarray:
        """A column by its name, shape ``(n_ticks,)``.

        ``name``: one of :class:`twin_gait.simulation.bench_joint.episode.BenchRow`, with its unit. Raises
        ParameterError if there is no such column.
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
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: The bench and what is done on it.
        seed: Of the noise of current and encoder.
        variation: What chance adds to this test.
        compiled: False runs the same loop as plain Python, some hundred times slower.
        progress: Called with ticks done and in all.
        should_stop: Asked between chunks; True ends the test there.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test do not go together.
    """
    ticks = max(1, round(test.duration / TICK))
    episode, noise = bench_episode(test, variation or BenchVariation()), bench_noise(test, ticks, seed)
    rows = np.zeros((ticks, len(COLUMNS)))
    advance = _compiled(episode, noise, rows, on_compile) if compiled else _plain(episode, noise, rows)
    done = end = ending = 0
    while done == end < ticks and ending == COMPLETED:
        if should_stop is not None and should_stop():
            return BenchRun(test, rows[:done], RunStatus.INTERRUPTED)
        end = min(done + CHUNK_TICKS, ticks)
        done, ending = advance(done, end)
        if progress is not None:
            progress(done, ticks)
    status = RunStatus.DIVERGED if ending == DIVERGED else RunStatus.COMPLETED
    return BenchRun(test, rows[:done], status)


def run_at(address: int, first: int, end: int) -> int:
    """:func:`~twin_gait.simulation.bench_joint.tick.run_ticks` of the test at an address."""
    return run_ticks(bench_at(address), first, end)


def _compiled(
    episode: BenchEpisode, noise: np.ndarray, rows: np.ndarray, on_compile: Callable[[], None] | None
) -> Advance:
    """The compiled loop of a test; the caller keeps noise and rows."""
    episode.log, episode.noise = rows.ctypes.data, noise.ctypes.data
    store, structure = stored(episode), _structure(episode)

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop

        return compile_loop(run_at, {**structure, **_compiled_rows(store.dtype)})

    loop = kept_loop(_key(store.dtype, str(structure)), make, on_compile)
    return lambda first, end: (loop(store.ctypes.data, first, end), int(store[0]["status"]))


@lru_cache(maxsize=8)
def _key(episode: np.dtype[Any], structure: str) -> str:
    """Key of the loop for tests of one layout; writing that out takes longer than a short test."""
    return source_key(repr((episode, _ROW, structure, TICK, DIVERGED_VELOCITY)), "bench_joint")


def _structure(episode: BenchEpisode) -> dict[str, int]:
    """Constants that a loop is bound to; the laws beside (3.1) slow the others down."""
    return {"OTHER_LAWS": episode.friction.law > ROTATIONAL}


@lru_cache(maxsize=8)
def _compiled_rows(episode: np.dtype[Any]) -> dict[str, Any]:
    """Functions of :mod:`.tick` that find what is behind addresses."""
    from twin_gait.simulation.compiling import jit, numbers_at, record_at, rows_at

    logs, numbers = rows_at(_ROW), numbers_at(1)

    def log_row(e: BenchEpisode, tick: int) -> Any:
        return logs(e.log, tick)

    def noise(e: BenchEpisode, tick: int, place: int) -> Any:
        return numbers(e.noise, tick * (CURRENT_NOISE + e.winding.periods) + place)[0]

    return {"bench_at": record_at(episode), "log_row": jit(log_row), "noise": jit(noise)}


def _plain(episode: BenchEpisode, noise: np.ndarray, rows: np.ndarray) -> Advance:
    """The same rooms as plain Python, tick by tick."""
    log, table = [BenchRow() for _ in rows], noise.tolist()
    names = {"log_row": lambda e, tick: log[tick], "noise": lambda e, tick, place: table[tick][place]}
    run = bind(run_ticks, {**names, **_structure(episode)})

    def advance(first: int, end: int) -> tuple[int, int]:
        done = run(episode, first, end)
        rows[first:done] = [numbers_in(row) for row in log[first:done]]
        return done, episode.status

    return advance
