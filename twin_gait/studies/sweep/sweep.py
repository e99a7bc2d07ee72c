"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import write_atomically
from twin_gait.report.sweep import values_of, write_sweep_figures
from twin_gait.simulation import RunStatus
from twin_gait.studies.batch import setting_columns
from twin_gait.studies.sweep.chunk import ChunkResult, check_chunk, chunk_of, run_chunk
from twin_gait.studies.sweep.spec import Sweep
from twin_gait.studies.sweep.store import (
    FIGURES_FOLDER,
    SPEC_FILE,
    SUMMARY_FILE,
    SweepStore,
    check_directory,
    open_store,
    read_table,
)
from twin_gait.studies.workers import LocalRunner, Runner

# Work handed over at a time: long against the handing over, short against the loss of a worker.
CHUNK_SECONDS = 2.0
MOST_IN_CHUNK = 1000
# Checking one takes a few milliseconds, starting workers a few seconds: more than these are checked by them.
CHECKED_HERE = 2000


@dataclass(frozen=True)
class SweepResult:
    """What a sweep gives back.

    Attributes:
        directory: Where everything is.
        table: One row per finished episode, sorted by episode.
        status: ``COMPLETED``, or ``INTERRUPTED`` if it was stopped; the same call goes on with it.
        resumed: Episodes that were there before.
        summary: Content of ``summary.json``.
        not_drawn: Measures that were asked for and that no completed episode has.
    """

    directory: Path
    table: pd.DataFrame
    status: RunStatus
    resumed: int
    summary: dict[str, Any]
    not_drawn: tuple[str, ...] = ()


@dataclass
class _Pace:
    """Size of chunks, from the measured time of an episode."""

    seconds: float
    slots: int
    episodes: int = 0
    wall_s: float = 0.0
    processors: set[str] = field(default_factory=set)

    def note(self, result: ChunkResult) -> None:
        self.episodes += len(result.rows)
        self.wall_s += result.wall_s
        self.processors.add(result.processor)

    def size(self, left: int) -> int:
        """Episodes of the next chunk, with enough of them at the end for every worker."""
        if not self.episodes:
            return 1
        by_time = round(self.seconds * self.episodes / max(self.wall_s, 1e-9))
        return max(1, min(by_time, MOST_IN_CHUNK, left // (2 * self.slots)))


def run_sweep(
    sweep: Sweep,
    directory: Path,
    *,
    runner: Runner | None = None,
    chunk_seconds: float = CHUNK_SECONDS,
    pictures: bool = True,
    checking: Callable[[int, int], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> SweepResult:
    """Run a sweep, or go on with it where it was stopped or killed.

    All episodes are checked before anything runs. Their results are kept in the folder chunk by chunk;
    neither the table nor the rows depend on the runner, the chunks or the number of resumptions. The first
    episode runs in the calling process: it compiles the engine where no worker has to, and says how long an
    episode takes.

    Args:
        sweep: From :func:`twin_gait.studies.sweep.spec.load_sweep`.
        directory: Its folder: new, empty or begun by the same sweep.
        runner: Who does the work; the calling process if None.
        chunk_seconds: Work handed over at a time in [s], as far as it can be foretold.
        pictures: Whether to draw figures at the end.
        checking: Called with episodes checked and in all, before any of them runs.
        progress: Called with episodes done and in all.
        should_stop: Asked before each chunk; True lets those that run finish and ends the sweep.
        on_compile: Called if the engine has to be compiled for the first episode, which takes 10 to 20 s.

    Returns:
        The table and what became of the sweep.

    Raises:
        ParameterFileError: If an episode is wrong or cannot be run, naming it; what was done is kept.
        RunDirectoryError: If the folder holds something else or cannot be written.
        WorkersLost: If workers die again and again; what was done is kept.
    """
    runner = runner or LocalRunner()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, runner, checking, should_stop)
    pace = _Pace(chunk_seconds, runner.slots())
    with open_store(directory, sweep) as store:
        resumed = int(store.done.sum())
        try:
            _run(sweep, store, runner, pace, progress, should_stop, on_compile)
        finally:
            store.merge()
        table = read_table(directory)
        summary = _summary(sweep, table, pace, resumed, time.perf_counter() - began)
        write_atomically(directory / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
        if pictures and len(table) > 1:
            write_pictures(sweep, table, directory)
    without = (name for name in sweep.measures if not np.isfinite(values_of(table, name)).any())
    return SweepResult(directory, table, RunStatus(summary["status"]), resumed, summary, tuple(without))


def check_sweep(
    sweep: Sweep,
    runner: Runner | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> None:
    """Check the overrides of every episode without running any.

    Args:
        sweep: The sweep.
        runner: Who checks a long one.
        progress: Called with episodes checked and in all.
        should_stop: Asked now and then; True ends the check.

    Raises:
        KeyboardInterrupt: If it was stopped.
        ParameterFileError: If one is wrong, naming episode, key and value.
    """
    total = len(sweep.design)
    if runner is None or total <= CHECKED_HERE:
        runner = LocalRunner()
    starts = range(0, total, CHECKED_HERE)
    chunks = (chunk_of(sweep, range(start, min(start + CHECKED_HERE, total))) for start in starts)
    with closing(runner.run(check_chunk, chunks)) as problems:
        for number, problem in enumerate(problems, start=1):
            if progress is not None:
                progress(min(number * CHECKED_HERE, total), total)
            if problem:
                raise ParameterFileError(sweep.source, "", problem)
            if should_stop is not None and should_stop():
                raise KeyboardInterrupt


def write_pictures(sweep: Sweep, table: pd.DataFrame, directory: Path) -> list[Path]:
    """Draw the table.

    Args:
        sweep: The sweep.
        table: Its table.
        directory: Its folder.

    Returns:
        The files.
    """
    folder = directory / FIGURES_FOLDER
    folder.mkdir(exist_ok=True)
    parameters = list(setting_columns(sweep.design.columns).values())
    return write_sweep_figures(table, parameters, sweep.measures, sweep.name, folder)


def _run(
    sweep: Sweep,
    store: SweepStore,
    runner: Runner,
    pace: _Pace,
    progress: Callable[[int, int], None] | None,
    should_stop: Callable[[], bool] | None,
    on_compile: Callable[[], None] | None,
) -> None:
    pending = np.flatnonzero(~store.done)
    tell = progress or (lambda done, total: None)
    stopped = should_stop or (lambda: False)
    tell(int(store.done.sum()), len(store.done))
    if not len(pending) or stopped():
        return
    first = run_chunk(chunk_of(sweep, pending[:1].tolist()), on_compile)
    chunks = (chunk_of(sweep, episodes) for episodes in _portions(pending[1:], pace, stopped))
    _keep(sweep, store, pace, first)
    tell(int(store.done.sum()), len(store.done))
    with closing(runner.run(run_chunk, chunks)) as results:
        for result in results:
            _keep(sweep, store, pace, result)
            tell(int(store.done.sum()), len(store.done))


def _keep(sweep: Sweep, store: SweepStore, pace: _Pace, result: ChunkResult) -> None:
    store.append(result.rows)
    if result.problem:
        raise ParameterFileError(sweep.source, "", result.problem)
    pace.note(result)


def _portions(pending: np.ndarray, pace: _Pace, stopped: Callable[[], bool]) -> Iterator[list[int]]:
    """Episodes chunk by chunk; a chunk is cut when it is asked for, with what is known by then."""
    place = 0
    while place < len(pending) and not stopped():
        size = pace.size(len(pending) - place)
        yield pending[place : place + size].tolist()
        place += size


def _summary(sweep: Sweep, table: pd.DataFrame, pace: _Pace, resumed: int, wall: float) -> dict[str, Any]:
    total = len(sweep.design)
    status = RunStatus.COMPLETED if len(table) == total else RunStatus.INTERRUPTED
    outcomes = {
        str(name): int(count)
        for name, count in table.get("outcome", pd.Series(dtype=str)).value_counts().items()
    }
    return {
        "name": sweep.name,
        "sweep_sha256": sweep.sha256,
        "status": str(status),
        "episodes": total,
        "finished": len(table),
        "outcomes": dict(sorted(outcomes.items())),
        "last_call": {
            "resumed_with": resumed,
            "episodes": pace.episodes,
            "slots": pace.slots,
            "processors": sorted(pace.processors),
            "wall_s": wall,
            "worker_s": pace.wall_s,
            "worker_s_per_episode": pace.wall_s / pace.episodes if pace.episodes else None,
        },
    }
