r"""Which numbers of a table matter, and the search over those.

Screening: elementary effects after M. D. Morris, Factorial sampling plans for preliminary computational
experiments, Technometrics 33 (1991) 161-174, with the mean of the magnitudes (mu star) of Campolongo et al.
(2007), computed by SALib.

Search: CMA-ES, whose state is the populations that it has been told of. Nothing of the optimiser itself is
stored. Asked and told again with the same draws it comes to the same state, bit for bit, which is checked
on the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.studies.tune.parts import WORST
from twin_gait.studies.tune.space import Parameter

LEVELS = 4
# Of the unit cube, to either side of the start. Many numbers change at once: at 0.15 nearly all points fall
# or are forbidden, which tells nothing about the rest; at 0.04 143 of 204 walk (tried on the shipped table).
REACH = 0.04
TRAJECTORIES = 4
# The search gets the numbers that make up this share of all effects.
KEPT_SHARE = 0.95
FEWEST = 30


FIRST_STEP = 0.05  # standard deviation of the first population in the unit cube
POPULATION = 12


@dataclass(frozen=True)
class Effect:
    """What a number of the table does to the cost.

    Attributes:
        name: Of the parameter.
        mu_star: Mean magnitude of its elementary effects on log(1 + cost), with no cost above that of
            the worst walk.
        mu_star_conf: Half the 95 % interval of it.
        sigma: Standard deviation of the effects: interaction and curvature.
        kept: Whether the search changes it.
    """

    name: str
    mu_star: float
    mu_star_conf: float
    sigma: float
    kept: bool


def plan(parameters: Sequence[Parameter], seed: int, trajectories: int = TRAJECTORIES) -> np.ndarray:
    """Points to be walked: trajectories that change one number at a time.

    Returns:
        Coordinates from 0 to 1, shape ``(trajectories * (n + 1), n)``.

    Raises:
        MissingOptionalDependency: If SALib is not installed.
    """
    sample = _library("SALib.sample.morris", "SALib")
    return np.asarray(sample.sample(_problem(parameters), trajectories, num_levels=LEVELS, seed=seed))


def effects(
    parameters: Sequence[Parameter], points: np.ndarray, costs: Sequence[float], seed: int
) -> list[Effect]:
    """Effects of all numbers at the points of :func:`plan`, and which of them the search gets."""
    analysis = _library("SALib.analyze.morris", "SALib")
    # Falls and forbidden tables cost ten to a hundred times a walk: uncut they alone would rank the numbers.
    responses = np.log1p(np.minimum(np.asarray(costs, dtype=float), WORST))
    found = analysis.analyze(
        _problem(parameters), points, responses, num_levels=LEVELS, seed=seed, print_to_console=False
    )
    mu_star = [_number(value) for value in found["mu_star"]]
    kept = keep(mu_star)
    intervals, sigmas = ([_number(value) for value in found[name]] for name in ("mu_star_conf", "sigma"))
    rows = zip(parameters, mu_star, intervals, sigmas, strict=True)
    return [
        Effect(item.name, size, half_width, sigma, place in kept)
        for place, (item, size, half_width, sigma) in enumerate(rows)
    ]


def keep(mu_star: Sequence[float], fewest: int = FEWEST) -> set[int]:
    """Places of the fewest numbers that make up ``KEPT_SHARE`` of all effects, at least so many."""
    order = sorted(range(len(mu_star)), key=lambda i: (-mu_star[i], i))
    total, kept, share = sum(mu_star), set[int](), 0.0
    for position in order:
        if share >= KEPT_SHARE * total and len(kept) >= fewest:
            break
        kept.add(position)
        share += mu_star[position]
    return kept


def _problem(parameters: Sequence[Parameter]) -> dict[str, Any]:
    bounds = []
    for parameter in parameters:
        centre = parameter.start_coordinate
        low = min(max(0.0, centre - REACH), 1.0 - 2.0 * REACH)
        bounds.append([low, low + 2.0 * REACH])
    return {"num_vars": len(parameters), "names": [item.name for item in parameters], "bounds": bounds}


def _number(value: Any) -> float:
    return float(value) if math.isfinite(value) else 0.0


class Generation(NamedTuple):
    """One population and what it cost.

    Attributes:
        points: Coordinates from 0 to 1, one list per candidate.
        costs: One per candidate.
    """

    points: list[list[float]]
    costs: list[float]


def better_half(costs: Sequence[float]) -> list[int]:
    """Places of the cheaper half of a population, rounded up, the cheapest first; the older of two equals."""
    return sorted(range(len(costs)), key=lambda place: (costs[place], place))[: (len(costs) + 1) // 2]


class Search:
    """CMA-ES in the unit cube with draws of its own."""

    def __init__(self, start: Sequence[float], seed: int, population: int = POPULATION) -> None:
        """Begin.

        Raises:
            MissingOptionalDependency: If cma is not installed.
        """
        generator = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "seed": np.nan,  # it shall leave numpy's global generator alone
            "randn": lambda *shape: generator.standard_normal(shape),
            "verbose": -9,
            "verb_log": 0,
        }
        self._optimiser: Any = _library("cma", "cma").CMAEvolutionStrategy(list(start), FIRST_STEP, options)

    def ask(self) -> list[list[float]]:
        """Candidates of the next generation."""
        return [[float(value) for value in point] for point in self._optimiser.ask()]

    def tell(self, generation: Generation) -> None:
        """Learn what the candidates that were asked for cost."""
        points = [np.array(point) for point in generation.points]
        self._optimiser.tell(points, list(generation.costs))

    def replay(self, generations: Sequence[Generation]) -> None:
        """Come to the state after some generations.

        Raises:
            ParameterError: If the populations are not those that this search draws.
        """
        for number, generation in enumerate(generations):
            if self.ask() != generation.points:
                raise ParameterError(
                    f"generation {number} of the kept search cannot be drawn again (another version of cma "
                    "or numpy, or another machine); begin anew with --force"
                )
            self.tell(generation)


def best_so_far(start_cost: float, generations: Sequence[Generation]) -> np.ndarray:
    """Cost of the best candidate after each generation, the start's first, shape ``(n + 1,)``."""
    least = [start_cost, *(min(item.costs) for item in generations)]
    return np.minimum.accumulate(np.array(least))


def _library(module: str, package: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingOptionalDependency(package, "tune", "twin-gait tune") from error
