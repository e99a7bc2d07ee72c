"""Sweeps: an experiment over any of its parameters, resumable, on this machine or a cluster."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import converting
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.experiment.problem import build_problem
from twin_gait.files import write_atomically
from twin_gait.report.canvas import save
from twin_gait.report.pages import figures_page
from twin_gait.report.sweep import sweep_figures, values_of
from twin_gait.runs.summary import READ_IN_BRIEF
from twin_gait.simulation import RunStatus
from twin_gait.studies.batch import Base, Flat, Override, flat_summary, setting_columns
from twin_gait.studies.episodes import block_ahead, measured
from twin_gait.studies.jobs import Portion, Workers, one_by_one, portions
from twin_gait.studies.sweep.spec import Sweep
from twin_gait.studies.sweep.store import (
    FIGURES_FOLDER,
    REPORT_FILE,
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


class Episode(NamedTuple):
    """An episode: plain values only.

    Attributes:
        number: Its position in the design.
        override: What it changes.
        seed: Of the sweep.
        document: The experiment that all have in common, as JSON with the hash of its URDF.
    """

    number: int
    override: Override
    seed: int
    document: str

    def __str__(self) -> str:
        return f"episode {self.number}"

    def experiment(self) -> Experiment:
        """What is to be run, with draws of its own.

        Raises:
            ParameterFileError: If a change is wrong, naming episode and key.
        """
        base = _base(self.document)
        draws = np.random.SeedSequence(self.seed, spawn_key=(self.number,))
        seeded = {**base.document, "seed": int(draws.generate_state(1, np.uint64)[0])}
        return base._replace(document=seeded).changed(self.override, str(self))


@lru_cache(maxsize=1)
def _base(document: str) -> Base:
    return Base.of(experiment_from_mapping(json.loads(document), "the sweep", Path()))


def check_episode(episode: Episode) -> None:
    """Check the overrides of an episode.

    Raises:
        TwinGaitError: If one is wrong.
    """
    experiment = episode.experiment()
    # A text may name a joint or phase that is not there; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in episode.override.values())
    if episode.number == 0 or not plain:
        converting(str(episode), "", partial(_lay_out, experiment))


def _lay_out(experiment: Experiment) -> None:
    """Do what goes before the first tick, to find what does not fit together."""
    problem = build_problem(experiment)
    for phase in problem.world.initial_phases.values():
        if phase is not None:
            problem.table.phase_index(phase)


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
            write_pictures(sweep, table, directory)
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


def write_pictures(sweep: Sweep, table: pd.DataFrame, directory: Path) -> None:
    """Draw the table: ``figures/*.png``, and ``report.html`` with all of them."""
    folder = directory / FIGURES_FOLDER
    folder.mkdir(exist_ok=True)
    parameters = list(setting_columns(sweep.design.columns).values())
    title = sweep.name.replace("_", " ")
    figures = sweep_figures(table, parameters, sweep.measures, title)
    for name, figure in figures.items():
        save(figure, folder / f"{name}.png")
    counts = table["outcome"].value_counts().items()
    rows = [(str(outcome), str(count), f"{100.0 * count / len(table):.1f}") for outcome, count in counts]
    named = {name.replace("_", " "): figure for name, figure in figures.items()}
    subtitle = f"{len(table)} episodes, {len(parameters)} parameters"
    page = figures_page(f"Sweep: {title}", subtitle, named, ("outcome", "episodes", "share [%]"), rows)
    write_atomically(directory / REPORT_FILE, page)


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


def episodes_of(sweep: Sweep, indices: Iterable[int]) -> Iterator[Episode]:
    """Episodes of a sweep as jobs, one by one: a million of them at once would take memory."""
    document = json.dumps(sweep.document["experiment"])
    return (Episode(index, sweep.design[index], sweep.seed, document) for index in indices)


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
