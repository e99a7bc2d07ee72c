"""The search: CMA-ES, whose state is the populations that it has been told of.

Nothing of the optimiser itself is stored. Asked and told again with the same draws it comes to the same
state, bit for bit, which is checked on the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency, ParameterError

FIRST_STEP = 0.05  # standard deviation of the first population in the unit cube
POPULATION = 12


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

    def __init__(
        self,
        start: Sequence[float],
        seed: int,
        population: int = POPULATION,
        first_step: float = FIRST_STEP,
    ) -> None:
        """Begin.

        Args:
            start: Coordinates from 0 to 1.
            seed: Of all draws.
            population: Candidates of a generation.
            first_step: Standard deviation of the first population.

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
        self._optimiser: Any = _cma().CMAEvolutionStrategy(list(start), first_step, options)

    def ask(self) -> list[list[float]]:
        """Candidates of the next generation."""
        return [[float(value) for value in point] for point in self._optimiser.ask()]

    def tell(self, generation: Generation) -> None:
        """Learn what the candidates that were asked for cost."""
        points = [np.array(point) for point in generation.points]
        self._optimiser.tell(points, list(generation.costs))

    def replay(self, generations: Sequence[Generation]) -> None:
        """Come to the state after some generations.

        Args:
            generations: All from the first one on.

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


def _cma() -> Any:
    try:
        return import_module("cma")
    except ImportError as error:
        raise MissingOptionalDependency("cma", "tune", "twin-gait tune") from error
