"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import write_atomically
from twin_gait.report.sweep import values_of
from twin_gait.runs.summary import READ_IN_BRIEF
from twin_gait.simulation import RunStatus
from twin_gait.studies.batch import Flat, flat_summary
from twin_gait.studies.episodes import block_ahead, measured
from twin_gait.studies.jobs import Portion, Workers, one_by_one, portions
from twin_gait.studies.sweep.episode import Episode, check_episode, episodes_of
from twin_gait.studies.sweep.spec import Sweep
from twin_gait.studies.sweep.store import (
    SPEC_FILE,
    SUMMARY_FILE,
    SweepStore,
    check_directory,
    open_store,
    read_table,
)

# Work handed over at a time: long against the handing over, short against the loss of a worker.
CHUNK_SECONDS = 2.0
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
class _Effort:
    """What a call has cost."""

    slots: int
    episodes: int = 0
    wall_s: float = 0.0
    processors: set[str] = field(default_factory=set)

    def note(self, portion: Portion[Flat]) -> None:
        self.episodes += len(portion.results)
        self.wall_s += portion.wall_s
        self.processors.add(portion.processor)


def run_sweep(
    sweep: Sweep,
    directory: Path,
    *,
    workers: Workers | None = None,
    chunk_seconds: float = CHUNK_SECONDS,
    pictures: bool = True,
    checking: Callable[[int, int], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> SweepResult:
    """Run a sweep, or go on with it where it was stopped or killed.

    All episodes are checked before anything runs. Their results are kept in the folder chunk by chunk;
    neither the table nor the rows depend on the workers, the chunks or the number of resumptions. The engine
    is compiled in the calling process, so that no worker has to.

    Returns:
        The table and what became of the sweep.

    Raises:
        ParameterFileError: If an episode is wrong or cannot be run, naming it; what was done is kept.
        RunDirectoryError: If the folder holds something else or cannot be written.
        WorkersLost: If workers die again and again; what was done is kept.
    """
    workers = workers or Workers()
    began = time.perf_counter()
    check_directory(directory, sweep)
    if not (directory / SPEC_FILE).is_file():
        check_sweep(sweep, workers, checking, should_stop)
    effort = _Effort(workers.slots())
    with open_store(directory, sweep) as store:
        resumed = int(store.done.sum())
        try:
            _run(sweep, store, workers, chunk_seconds, effort, progress, should_stop, on_compile)
        finally:
            store.merge()
        table = read_table(directory)
        summary = _summary(sweep, table, effort, resumed, time.perf_counter() - began)
        write_atomically(directory / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
        if pictures and len(table) > 1:
            from twin_gait.studies.sweep.pictures import write_pictures

            write_pictures(sweep, table, directory, workers)
    without = (name for name in sweep.measures if not np.isfinite(values_of(table, name)).any())
    return SweepResult(directory, table, RunStatus(summary["status"]), resumed, summary, tuple(without))


def check_sweep(
    sweep: Sweep,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> None:
    """Check the overrides of every episode without running any.

    Raises:
        KeyboardInterrupt: If it was stopped.
        ParameterFileError: If one is wrong, naming episode, key and value.
    """
    total, checked = len(sweep.design), 0
    if workers is None or total <= CHECKED_HERE:
        workers = Workers()
    episodes = episodes_of(sweep, range(total))
    checks = portions(
        partial(one_by_one, check_episode), episodes, total, workers, chunk_seconds=CHUNK_SECONDS
    )
    with closing(checks):
        for portion in checks:
            checked += len(portion.results)
            if progress is not None:
                progress(checked, total)
            if portion.problem:
                raise ParameterFileError(sweep.source, "", portion.problem[1])
            if should_stop is not None and should_stop():
                raise KeyboardInterrupt


def _run(
    sweep: Sweep,
    store: SweepStore,
    workers: Workers,
    chunk_seconds: float,
    effort: _Effort,
    progress: Callable[[int, int], None] | None,
    should_stop: Callable[[], bool] | None,
    on_compile: Callable[[], None] | None,
) -> None:
    pending = np.flatnonzero(~store.done).tolist()
    tell = progress or (lambda done, total: None)
    tell(int(store.done.sum()), len(store.done))
    if not pending:
        return
    first = next(episodes_of(sweep, pending))
    coming = portions(
        partial(measured, Episode.experiment, flat_summary, READ_IN_BRIEF),
        episodes_of(sweep, pending),
        len(pending),
        workers,
        block=block_ahead(first.experiment, len(pending), on_compile),
        chunk_seconds=chunk_seconds,
        should_stop=should_stop,
    )
    with closing(coming):
        for portion in coming:
            store.append({pending[place]: flat for place, flat in portion.results.items()})
            effort.note(portion)
            if portion.problem:
                place, text = portion.problem
                named = f"episode {pending[place]}: "
                raise ParameterFileError(sweep.source, "", named + text.removeprefix(named))
            tell(int(store.done.sum()), len(store.done))


def _summary(sweep: Sweep, table: pd.DataFrame, effort: _Effort, resumed: int, wall: float) -> dict[str, Any]:
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
            "episodes": effort.episodes,
            "slots": effort.slots,
            "processors": sorted(effort.processors),
            "wall_s": wall,
            "worker_s": effort.wall_s,
            "worker_s_per_episode": effort.wall_s / effort.episodes if effort.episodes else None,
        },
    }
