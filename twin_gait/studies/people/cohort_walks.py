"""Whether a cohort walks a minute: with a shipped table and its scaling law, or tables tuned one by one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import DEFAULT_PRESET, load_experiment
from twin_gait.configuration.people import people
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.simulation import simulate
from twin_gait.studies.batch import overridden
from twin_gait.studies.jobs import Workers, run_jobs
from twin_gait.studies.people.cohort import cohort, overrides
from twin_gait.studies.people.trials import MASS_ALONE
from twin_gait.studies.tune.parts import part_values
from twin_gait.studies.tune.state import Settings
from twin_gait.studies.tune.tune import choose, tune
from twin_gait.studies.tune.walks import experiment_of as experiment_with
from twin_gait.vocabulary import Outcome

SPEEDS = (0.36, 0.42)  # [m/s]
SUPPORT = 0.6
DURATION = 60.0  # [s]
# Enough to bring a table closer; a whole tuning takes ten minutes.
GENERATIONS = 12


class Walker(NamedTuple):
    """Somebody of a cohort.

    Attributes:
        number: In the cohort.
        condition: A person that ships, or ``mass alone``.
        sizes: Stature, mass and sex by keys of an experiment.
        speed: Of the belt in [m] / [s].
    """

    number: int
    condition: str
    sizes: Mapping[str, float | str]
    speed: float


class Work(NamedTuple):
    """One walk to be done.

    Attributes:
        walker: Who.
        table: Name of a shipped table.
        tuned: Whether the table is tuned to the walker first.
    """

    walker: Walker
    table: str
    tuned: bool = False


class Walk(NamedTuple):
    """What came of it.

    Attributes:
        walker: Who.
        outcome: See :mod:`twin_gait.measures.verdict`.
        reason: Why, if they did not walk.
        lasted: In [s].
        parts: Of the walk, see :mod:`twin_gait.studies.tune.parts`.
    """

    walker: Walker
    outcome: str
    reason: str
    lasted: float
    parts: dict[str, float | None]


def draw_walkers(count: int, seed: int) -> tuple[Walker, ...]:
    """A cohort, each with a condition and a belt speed drawn evenly.

    Args:
        count: How many.
        seed: Of the draw; walker i is the same in a cohort of any size.

    Returns:
        The walkers.
    """
    conditions = [MASS_ALONE, *people()]
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    draws = generator.uniform(size=(count, 2))
    low, high = SPEEDS
    return tuple(
        Walker(number, conditions[int(which * len(conditions))], sizes, float(low + share * (high - low)))
        for number, (sizes, (which, share)) in enumerate(
            zip(overrides(cohort(count, seed)), draws, strict=True)
        )
    )


def experiment_for(walker: Walker, table: str) -> Experiment:
    """A minute on the treadmill with a shipped table.

    Args:
        walker: Who.
        table: Its name.

    Returns:
        The experiment.
    """
    settings = [f"table={table}", f"scenario.support.share={SUPPORT}", f"duration_s={DURATION}"]
    if walker.condition != MASS_ALONE:
        settings.insert(0, f"patient={walker.condition}")
    base = load_experiment(DEFAULT_PRESET, settings).experiment
    return overridden(base, {**walker.sizes, "scenario.belt_speed_m_per_s": walker.speed})


def do_walk(work: Work) -> Walk:
    """Tune if that is asked for, and walk."""
    experiment = experiment_for(work.walker, work.table)
    if work.tuned:
        experiment = replace(experiment, table=_tuned(experiment, work.walker.number))
    run = simulate(experiment)
    verdict = run.verdict
    return Walk(work.walker, str(verdict.outcome), verdict.reason, run.duration, part_values(run))


def _tuned(experiment: Experiment, seed: int) -> GaitTable:
    settings = Settings(generations=GENERATIONS, screening=False, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        chosen = choose(tune(experiment, Path(folder) / "tuning", settings), experiment)
    return experiment_with(experiment_document(experiment), chosen.finalist.table, {}).table


def walk_cohort(
    works: Sequence[Work],
    workers: int | Workers = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Walk, ...]:
    """Let everybody walk.

    Args:
        works: Who and how.
        workers: Who works.
        progress: Called with walks done and in all.

    Returns:
        In the order of the works.
    """
    return tuple(run_jobs(do_walk, works, workers=workers, progress=progress))


def walking_share(outcomes: Sequence[Walk]) -> float:
    """Share of those who walk."""
    return sum(item.outcome == Outcome.WALKED for item in outcomes) / len(outcomes)
