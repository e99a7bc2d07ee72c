"""The search for a table that walks: covariance matrix adaptation over all numbers at once.

In each generation the candidates are drawn from a normal distribution. All walk the nominal case; the better
half also walks random worlds, which are the same for all candidates of a generation and new in each, so that
the mean of the distribution moves to tables that are good in worlds that they have not walked in before. Only
the order of the candidates counts. In a robust tuning it precedes :mod:`twin_gait.studies.tune.search`, whose
slopes need a table that walks. It needs the package ``cma`` (extra ``robust``).
"""

from collections.abc import Callable, Sequence

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency


class Evolution:
    """State of the search: a normal distribution over the unit cube.

    Attributes:
        generation: Number of finished generations.
    """

    def __init__(self, start: Sequence[float], *, spread: float, population: int, seed: int) -> None:
        """Start at a point.

        ``start``: coordinates from 0 to 1. ``spread``: standard deviation of every coordinate in the first
        generation. ``population``: number of candidates of a generation. ``seed``: seed of the candidates.
        Raises MissingOptionalDependency if ``cma`` is not installed.
        """
        try:
            import cma
        except ModuleNotFoundError as error:
            raise MissingOptionalDependency("cma", "robust", "a robust tuning") from error
        self.generation = 0
        self._asked: list[np.ndarray] = []
        random = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "randn": lambda *shape: random.standard_normal(shape),
            "seed": np.nan,  # the global generator of NumPy is left alone
            "verbose": -9,
        }
        margin = 1e-6  # the transformation of the bounds has no slope at them
        self._search = cma.CMAEvolutionStrategy(np.clip(start, margin, 1.0 - margin), spread, options)

    @property
    def mean(self) -> list[float]:
        """Mean of the distribution, the best estimate so far."""
        return self._inside(self._search.result.xfavorite)

    def candidates(self) -> list[list[float]]:
        """Return the candidates of the next generation."""
        self._asked = self._search.ask()
        return [self._inside(point) for point in self._asked]

    def update(self, costs: Sequence[float]) -> None:
        """Move the distribution to the better candidates; ``costs`` are in their order."""
        self._search.tell(self._asked, list(costs))
        self.generation += 1

    @staticmethod
    def _inside(point: np.ndarray) -> list[float]:
        return [float(value) for value in np.clip(point, 0.0, 1.0)]


def rank_in_two_rounds(
    first: Sequence[float], second_round: Callable[[list[int]], dict[int, float]]
) -> list[float]:
    """Return costs by which candidates are ranked, of which only the better half walks the second round.

    Args:
        first: Costs of the first round.
        second_round: Function of the numbers of the better half that returns their costs.

    Returns:
        The costs of the second round; candidates without one follow in the order of the first round.
    """
    order = sorted(range(len(first)), key=first.__getitem__)
    half = (len(first) + 1) // 2
    costs = second_round(order[:half])
    last = max(costs.values())
    behind = {index: last + rank for rank, index in enumerate(order)}
    return [costs.get(index, behind[index]) for index in range(len(first))]
