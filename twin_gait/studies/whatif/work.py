"""Many small tests, spread over processes, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any, NamedTuple

import pandas as pd

from twin_gait.exceptions import TwinGaitError
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.whatif.rig import controlled, rig
from twin_gait.studies.workers import LocalRunner

CHUNK = 10  # rows handed over at a time: half a second of work

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


class _Chunk(NamedTuple):
    first: int
    jobs: tuple[Job, ...]

    def __str__(self) -> str:
        return f"rows {self.first} to {self.first + len(self.jobs) - 1}"


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
    rows: dict[int, Row] = {}
    with closing(LocalRunner(means.workers).run(_work, _chunks(jobs))) as results:
        for first, made in results:
            rows.update(enumerate(made, first))
            if means.progress is not None:
                means.progress(len(rows), len(jobs))
            if means.should_stop is not None and means.should_stop():
                raise Interrupted("interrupted; nothing was written")
    return [rows[place] for place in range(len(jobs))]


def _chunks(jobs: Sequence[Job]) -> Iterator[_Chunk]:
    for first in range(0, len(jobs), CHUNK):
        yield _Chunk(first, tuple(jobs[first : first + CHUNK]))


def _work(chunk: _Chunk) -> tuple[int, list[Row]]:
    return chunk.first, [job.function(job.item) for job in chunk.jobs]


def _compile_once(means: Means) -> None:
    """Compile before the workers start, or each of them would."""
    simulate_bench(replace(rig(), control=controlled(), duration=0.001), on_compile=means.on_compile)
