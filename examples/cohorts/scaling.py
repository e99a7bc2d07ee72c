r"""Fit of a table's scaling laws: the exponents with which a set of people walks best on the mean.

CMA-ES looks for the exponents that minimise the mean cost of one walk of each person
(:func:`twin_gait.studies.rate_walk`). Another set of people, who had no part in it, tells what the laws are
worth, all together and each left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import cma
import numpy as np
from cohorts.walkers import sizes_of

from twin_gait import Experiment, load_experiment, simulate
from twin_gait.studies import Workers, cohort, overridden, rate_walk, run_jobs

EXPONENTS = ("carried_mass_exponent", "speed_exponent", "height_exponent")
SUPPORTS = (0.4, 0.7)
SPEEDS = (0.33, 0.45)  # belt [m/s]
WALK = 14.0  # [s]
# For the search, a quarter of the time: errors of the walk are within 0.01° of those at the default step.
QUICK = ("integration={method: semi_implicit_euler, step_s: 0.00025}",)
LARGEST = 3.0  # exponent, to either side
POPULATION, FIRST_STEP = 8, 0.04  # of the unit cube: an exponent of 0.25
FALL = 30.0  # costs above it are falls

Law = Mapping[str, float]


class Worth(NamedTuple):
    """What a law is worth to a set of people: mean and median of the costs, and falls."""

    mean: float
    median: float
    falls: int


def draw_people(count: int, seed: int) -> list[dict[str, Any]]:
    """A cohort as changes of an experiment, supports and belt speeds drawn evenly."""
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    draws = generator.uniform((SUPPORTS[0], SPEEDS[0]), (SUPPORTS[1], SPEEDS[1]), size=(count, 2))
    return [
        {
            **sizes_of(person),
            "scenario.support.share": float(support),
            "scenario.belt_speed_m_per_s": float(speed),
        }
        for person, (support, speed) in zip(cohort(count, seed), draws, strict=True)
    ]


@cache
def base_of(table: str) -> Experiment:
    """The shipped walk with a table; its own wearer and belt are the reference of a law that is off."""
    base = load_experiment("treadmill", [f"table={table}", f"duration_s={WALK:g}", *QUICK]).experiment
    scaling = base.table.scaling
    scaling = replace(
        scaling,
        speed=scaling.speed or base.scenario.belt_speed,
        height=scaling.height or base.patient.height,
    )
    return replace(base, table=replace(base.table, scaling=scaling))


def stated_law(table: str) -> dict[str, float]:
    """Exponents that a table states."""
    return {name: getattr(base_of(table).table.scaling, name) for name in EXPONENTS}


def walk_of(table: str, law: Law, person: Mapping[str, Any]) -> Experiment:
    """Walk of a person with a table scaled by a law."""
    experiment = overridden(base_of(table), person)
    scaling = replace(experiment.table.scaling, **law)
    return replace(experiment, table=replace(experiment.table, scaling=scaling))


def cost_of(table: str, law: Law, person: Mapping[str, Any]) -> float:
    """Cost of the walk of a person."""
    return rate_walk(simulate(walk_of(table, law, person))).cost


def worth_of(table: str, people: Sequence[Mapping[str, Any]], law: Law, workers: int | Workers = 1) -> Worth:
    """Costs of a set of people with a law."""
    costs = np.array(run_jobs(partial(cost_of, table, law), people, workers=workers))
    return Worth(float(costs.mean()), float(np.median(costs)), int((costs > FALL).sum()))


def fitted_law(cost: Callable[[Law], float], start: Law, generations: int, seed: int = 0) -> dict[str, float]:
    """Exponents with the least cost, to one digit, searched for by CMA-ES.

    Args:
        cost: Of a law.
        start: Exponents to begin with.
        generations: Of the search.
        seed: Of its draws.
    """
    generator = np.random.default_rng(seed)
    options = {
        "bounds": [0.0, 1.0],
        "popsize": POPULATION,
        "seed": np.nan,  # it shall leave numpy's global generator alone
        "randn": lambda *shape: generator.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
    }
    shares = [0.5 + 0.5 * start[name] / LARGEST for name in EXPONENTS]
    search = cma.CMAEvolutionStrategy(shares, FIRST_STEP, options)
    known: dict[tuple[float, ...], float] = {}  # rounded exponents come again
    for _ in range(generations):
        points = search.ask()
        keys = [tuple(round(LARGEST * (2.0 * float(share) - 1.0), 1) for share in point) for point in points]
        for key in keys:
            if key not in known:
                known[key] = cost(dict(zip(EXPONENTS, key, strict=True)))
        search.tell(points, [known[key] for key in keys])
    best, _ = min(known.items(), key=lambda item: (item[1], item[0]))
    return dict(zip(EXPONENTS, best, strict=True))


def fit_rows(
    table: str,
    people: Sequence[Mapping[str, Any]],
    others: Sequence[Mapping[str, Any]],
    generations: int,
    workers: int | Workers,
) -> list[dict[str, Any]]:
    """Worth of no law, of the stated one, of the fitted one, and of that with each exponent left out."""
    fitted = fitted_law(
        lambda law: worth_of(table, people, law, workers).mean, stated_law(table), generations
    )
    laws = {"no law": dict.fromkeys(EXPONENTS, 0.0), "stated": stated_law(table), "fitted": fitted}
    laws |= {f"without {name}": {**fitted, name: 0.0} for name, value in fitted.items() if value != 0.0}
    rows = []
    for name, law in laws.items():
        seen, new = (worth_of(table, group, law, workers) for group in (people, others))
        rows.append(
            {
                "table": table,
                "law": name,
                **law,
                "mean cost, fitted": round(seen.mean, 3),
                "mean cost, others": round(new.mean, 3),
                "median, others": round(new.median, 3),
                "fall": seen.falls + new.falls,
            }
        )
    return rows


def gain_of(rows: Sequence[Mapping[str, Any]], table: str) -> float:
    """Share of the cost that the stated law saves the others."""
    costs = {row["law"]: row["mean cost, others"] for row in rows if row["table"] == table}
    return 1.0 - costs["stated"] / costs["no law"]
