r"""The search: damped least squares over all numbers of the table at once.

A walk is :math:`r(x)`, numbers whose squares add up to its cost, including the deviations of the mean
strides (:func:`twin_gait.studies.tune.objective.residuals`). In each generation every number of the table is
moved by itself, which gives the slopes J, and all numbers are moved together by the steps

.. math::

    s_\mu = \arg\min_s |r + J s|^2 + \mu^2 |s|^2

for several dampings μ, each in full and in part (K. Levenberg, Quarterly of Applied Mathematics 2 (1944)
164-168; D. W. Marquardt, SIAM Journal on Applied Mathematics 11 (1963) 431-441). The search continues from
the best of all these points. The objective is rugged: slopes are therefore computed from moves of several
percent of a number's range, up and down in alternation, and slopes of earlier generations decay by halves.
A table that walks in several worlds has residuals and slopes in each, which are stacked with the weights of
the worlds. A world in which the table does not walk has no slopes; only the costs decide there.
The search is deterministic.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

REACH = 0.05  # move of a number for a slope, in the unit cube; about 1° for an equilibrium angle
LEAST_REACH = 0.01
DAMPING = 1.0  # μ, in units of the root of the cost over the unit cube
DAMPINGS = (0.05, 8.0)  # bounds of μ
FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # dampings that are tested, over the best one so far
PARTS_OF_STEPS = (1.0, 0.5)
MEMORY = 0.5  # weight of the earlier slopes
# If a move multiplies the cost by more than this, it leads to another kind of gait, whose slope is ignored.
OTHER_GAIT = 4.0
_BOUND_MARGIN = 1e-9
MAX_GENERATIONS_WITHOUT_GAIN = 8  # generations without a gain after which the search ends


class Generation(NamedTuple):
    """One generation."""

    point: list[float]  # point of the search after it, coordinates from 0 to 1
    cost: float  # cost at this point
    tried: list[list[float | None]]  # result of standing for each candidate that walked


@dataclass
class Descent:
    """State of a search."""

    point: list[float]  # coordinates from 0 to 1
    cost: float  # cost at the point
    residuals: list[np.ndarray]  # residuals at the point by world; empty where the table does not walk
    weights: tuple[float, ...] = (1.0,)  # weight of each world in the cost
    slopes: list[np.ndarray | None] = field(
        default_factory=list
    )  # J by world and number; None before the first
    reach: float = REACH  # move of a number for the slopes
    damping: float = DAMPING  # best damping so far
    generation: int = 0  # number of finished generations
    gained: int = 0  # last generation with a gain

    def __post_init__(self) -> None:
        """Start without slopes unless they are given."""
        self.slopes = self.slopes or [None] * len(self.residuals)

    @property
    def has_ended(self) -> bool:
        """Whether the search has ended without further gain."""
        return self.generation - self.gained >= MAX_GENERATIONS_WITHOUT_GAIN

    def neighbours(self) -> list[list[float]]:
        """Return the points with one number moved, up or down in alternation.

        A number at the end of its range is moved in the other direction.
        """
        reach = self.reach if self.generation % 2 == 0 else -self.reach
        found = []
        for index, coordinate in enumerate(self.point):
            moved = coordinate + reach if 0.0 <= coordinate + reach <= 1.0 else coordinate - reach
            found.append([*self.point[:index], moved, *self.point[index + 1 :]])
        return found

    def update_slopes(
        self, neighbours: Sequence[Sequence[float]], residuals: Sequence[Sequence[np.ndarray]]
    ) -> None:
        """Update the slopes from the neighbours; slopes to another kind of gait count as 0.

        ``residuals``: of each neighbour in each world.
        """
        for world, here in enumerate(self.residuals):
            slopes = np.zeros((len(neighbours), len(here)))
            for index, neighbour in enumerate(neighbours):
                there = residuals[index][world]
                if len(there) and len(here) and there @ there <= OTHER_GAIT * (here @ here):
                    slopes[index] = (there - here) / (neighbour[index] - self.point[index])
            before = self.slopes[world]
            self.slopes[world] = slopes if before is None else MEMORY * before + (1.0 - MEMORY) * slopes

    def candidate_steps(self) -> list[tuple[float, list[float]]]:
        """Return dampings, and the points to which their steps lead, in full and in part.

        Returns none before the table walks.
        """
        walked = [
            (math.sqrt(weight) * slopes.T, math.sqrt(weight) * here)
            for weight, slopes, here in zip(self.weights, self.slopes, self.residuals, strict=True)
            if slopes is not None and len(here)
        ]
        if not walked:
            return []
        slopes, residuals = (np.concatenate(parts) for parts in zip(*walked, strict=True))
        point, found = np.array(self.point), []
        target = np.append(-residuals, np.zeros(len(point)))
        for damping in (factor * self.damping for factor in FACTORS):
            damped = np.vstack((slopes, damping * np.eye(len(point))))
            # The solver needs a distance between the bounds, also for a number whose range is a single value.
            step = lsq_linear(damped, target, (-point - _BOUND_MARGIN, 1.0 - point + _BOUND_MARGIN)).x
            for part in PARTS_OF_STEPS:
                found.append((damping, np.clip(point + part * step, 0.0, 1.0).tolist()))
        return found

    def accept_step(
        self, point: list[float], cost: float, residuals: list[np.ndarray], damping: float | None
    ) -> None:
        """Continue from another point, for the gain of a step with some damping, or of a neighbour."""
        self.point, self.cost = point, cost
        for world, (before, after) in enumerate(zip(self.residuals, residuals, strict=True)):
            if len(after) != len(before):
                self.slopes[world] = None  # the table walks there now, or no more
        self.residuals = residuals
        if damping is not None:
            self.damping = float(np.clip(damping, *DAMPINGS))
        self.generation += 1
        self.gained = self.generation

    def reject_steps(self) -> None:
        """Continue without a gain: decrease the reach and increase the damping."""
        self.reach = max(LEAST_REACH, 0.6 * self.reach)
        self.damping = min(DAMPINGS[1], 2.0 * self.damping)
        self.generation += 1
