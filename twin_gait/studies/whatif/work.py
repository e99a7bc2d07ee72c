"""Many small tests, spread over processes, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import pandas as pd

from twin_gait.exceptions import TwinGaitError
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.whatif.rig import controlled, rig

Row = dict[str, Any]


class Interrupted(TwinGaitError):
    """The study was stopped before it was done."""


class Means(NamedTuple):
    """With what a study is worked off.

    Attributes:
        workers: Processes.
        progress: Called with rows done and in all.
        should_stop: Asked between results; True ends the study.
        on_compile: Called if the bench's loop has to be compiled.
    """

    workers: int = 1
    progress: Callable[[int, int], None] | None = None
    should_stop: Callable[[], bool] | None = None
    on_compile: Callable[[], None] | None = None


class Job(NamedTuple):
    """One row of a table to be.

    Attributes:
        function: Of a module; makes the row.
        item: Its argument.
    """

    function: Callable[[Any], Row]
    item: Any


def tables_of(parts: Sequence[Sequence[Job]], means: Means) -> list[pd.DataFrame]:
    """Work off jobs, each independent of the others, in one go.

    Args:
        parts: The jobs of each table.
        means: Processes, progress, interruption.

    Returns:
        One table per part, with one row per job, in order.

    Raises:
        Interrupted: If it was stopped.
    """
    rows = iter(_rows_of([job for part in parts for job in part], means))
    return [pd.DataFrame([next(rows) for _ in part]) for part in parts]


def _rows_of(jobs: Sequence[Job], means: Means) -> list[Row]:
    _compile_once(means)
    rows = run_jobs(
        _work, jobs, workers=means.workers, progress=means.progress, should_stop=means.should_stop
    )
    if len(rows) < len(jobs):
        raise Interrupted("interrupted; nothing was written")
    return rows


def _work(job: Job) -> Row:
    return job.function(job.item)


def _compile_once(means: Means) -> None:
    """Compile before the workers start, or each of them would."""
    simulate_bench(replace(rig(), control=controlled(), duration=0.001), on_compile=means.on_compile)
