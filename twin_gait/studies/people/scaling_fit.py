r"""Fit of a table's scaling laws: the exponents with which a set of people walks best on the mean.

CMA-ES looks for the exponents of :class:`twin_gait.gait.table.Scaling` that minimise the mean cost
(:mod:`twin_gait.studies.tune.parts`) of one walk of each person. Another set of people, who had no part in
it, tells what the laws are worth, all together and each left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.experiment import Experiment
from twin_gait.gait.table import SCALING_EXPONENTS, Scaling
from twin_gait.parameters import Patient
from twin_gait.simulation import simulate
from twin_gait.studies.batch import overridden
from twin_gait.studies.jobs import Workers, run_jobs
from twin_gait.studies.people.cohort import cohort, overrides
from twin_gait.studies.tune.cases import check_walker
from twin_gait.studies.tune.parts import WORST, rate_walk
from twin_gait.studies.tune.search import Generation, Search
from twin_gait.studies.tune.walks import QUICK_INTEGRATION

SUPPORTS = (0.4, 0.7)
SPEEDS = (0.33, 0.45)  # [m/s]
WALK = 14.0  # [s]
POPULATION, GENERATIONS = 8, 6
LARGEST_EXPONENT = 3.0  # to either side
FIRST_STEP = 0.04  # of the unit cube: an exponent of 0.25


class Person(NamedTuple):
    """Somebody, and the belt and support that he walks with.

    Attributes:
        number: In the set.
        patient: Wearer.
        support: Supported share of the weight.
        speed: Of the belt in [m] / [s].
    """

    number: int
    patient: Patient
    support: float
    speed: float


class Trial(NamedTuple):
    """A walk of one person with a law.

    Attributes:
        base: Experiment whose table is scaled.
        person: Who.
        law: The scaling.
    """

    base: Experiment
    person: Person
    law: Scaling


class Worth(NamedTuple):
    """What a law is worth to a set of people.

    Attributes:
        mean: Of the costs.
        median: Of the costs.
        falls: How many fell.
    """

    mean: float
    median: float
    falls: int


def draw_people(count: int, seed: int) -> tuple[Person, ...]:
    """A cohort with supports and speeds drawn evenly from ``SUPPORTS`` and ``SPEEDS``.

    Args:
        count: How many.
        seed: Of the draw.

    Returns:
        The people.
    """
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    draws = generator.uniform((SUPPORTS[0], SPEEDS[0]), (SUPPORTS[1], SPEEDS[1]), size=(count, 2))
    return tuple(
        Person(number, patient, float(support), float(speed))
        for number, (patient, (support, speed)) in enumerate(zip(cohort(count, seed), draws, strict=True))
    )


def experiment_of(base: Experiment, person: Person) -> Experiment:
    """Walk of a person on a base experiment."""
    (sizes,) = overrides([person.patient])
    place = {"scenario.support.share": person.support, "scenario.belt_speed_m_per_s": person.speed}
    return replace(overridden(base, {**sizes, **place, "duration_s": WALK}), integration=QUICK_INTEGRATION)


def law_of(base: Experiment, exponents: Mapping[str, float]) -> Scaling:
    """Scaling of the base's table with other exponents.

    The base's own walk is the reference of a law that is off.

    Args:
        base: The experiment.
        exponents: By their names.

    Returns:
        The law.
    """
    scenario, patient = check_walker(base)
    law = base.table.scaling
    return replace(
        law,
        carried_mass_exponent=exponents["carried_mass_exponent"],
        speed=law.speed or scenario.belt_speed,
        speed_exponent=exponents["speed_exponent"],
        height=law.height or patient.height,
        height_exponent=exponents["height_exponent"],
    )


def cost_of(trial: Trial) -> float:
    """Cost of the walk."""
    experiment = experiment_of(trial.base, trial.person)
    run = simulate(replace(experiment, table=replace(experiment.table, scaling=trial.law)))
    return rate_walk(run).cost


def worth_of(base: Experiment, people: Sequence[Person], law: Scaling, workers: int | Workers = 1) -> Worth:
    """Costs of a set of people with a law.

    Args:
        base: Experiment whose table is scaled.
        people: Who walks.
        law: The scaling.
        workers: Who works.

    Returns:
        Mean, median and falls; they do not depend on the workers.
    """
    trials = [Trial(base, person, law) for person in people]
    costs = np.array(run_jobs(cost_of, trials, workers=workers))
    return Worth(float(costs.mean()), float(np.median(costs)), int((costs > WORST).sum()))


def fit_exponents(
    base: Experiment,
    people: Sequence[Person],
    *,
    generations: int = GENERATIONS,
    seed: int = 0,
    workers: int | Workers = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, float]:
    """Exponents with the least mean cost, searched for from those that the table states.

    Args:
        base: Experiment whose table is scaled.
        people: Who walks.
        generations: Of the search.
        seed: Of the search.
        workers: Who works.
        progress: Called with generations done and in all.

    Returns:
        By their names, to one digit.
    """

    def exponents_at(point: Sequence[float]) -> tuple[float, ...]:
        return tuple(round(LARGEST_EXPONENT * (2.0 * share - 1.0), 1) for share in point)

    stated = [getattr(base.table.scaling, name) for name in SCALING_EXPONENTS]
    start = [0.5 + 0.5 * value / LARGEST_EXPONENT for value in stated]
    search = Search(start, seed, POPULATION, FIRST_STEP)
    known: dict[tuple[float, ...], float] = {}  # rounded exponents come again
    for number in range(generations):
        points = search.ask()
        keys = [exponents_at(point) for point in points]
        for key in keys:
            if key not in known:
                law = law_of(base, dict(zip(SCALING_EXPONENTS, key, strict=True)))
                known[key] = worth_of(base, people, law, workers).mean
        costs = [known[key] for key in keys]
        search.tell(Generation(points, costs))
        if progress is not None:
            progress(number + 1, generations)
    best, _ = min(known.items(), key=lambda item: (item[1], item[0]))
    return dict(zip(SCALING_EXPONENTS, best, strict=True))
