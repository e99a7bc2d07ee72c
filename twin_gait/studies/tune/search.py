r"""The search: damped least squares over all numbers of the table at once.

A walk is :math:`r(x)`, numbers whose squares add up to what it costs, among them the deviations of the mean
strides (:func:`twin_gait.studies.tune.parts.residuals`). In each generation every number of the table is
moved by itself, which gives the slopes J, and so are all together by the steps

.. math::

    s_\mu = \arg\min_s |r + J s|^2 + \mu^2 |s|^2

for several dampings μ, each in full and in part (K. Levenberg, Quarterly of Applied Mathematics 2 (1944)
164-168; D. W. Marquardt, SIAM Journal on Applied Mathematics 11 (1963) 431-441). The search goes on from the
best of all these points. What a walk does is rugged: slopes come from moves of several percent of a number's
range, up and down in turn, and those of earlier generations fade out by halves. No chance is in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

REACH = 0.05  # of the unit cube, by which a number is moved for a slope; about 1° of an equilibrium
LEAST_REACH = 0.01
DAMPING = 1.0  # μ, in units of the cost's root over the unit cube
DAMPINGS = (0.05, 8.0)  # between which it stays
FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # dampings that are tried, over the one that did best
PARTS_OF_STEPS = (1.0, 0.5)
MEMORY = 0.5  # share of the earlier slopes
# Beyond so many times the cost a move has led to another kind of gait, whose slope tells nothing of this one.
OTHER_GAIT = 4.0
_ROOM = 1e-9
PATIENCE = 8  # generations without a gain, after which the search has come to its end


class Generation(NamedTuple):
    """One generation."""

    point: list[float]  # where the search stands after it, coordinates from 0 to 1
    cost: float  # there
    tried: list[list[float | None]]  # standing of each candidate that walked, see standing


@dataclass
class Descent:
    """Where a search stands."""

    point: list[float]  # coordinates from 0 to 1
    cost: float  # there
    residuals: np.ndarray  # there; empty if it does not walk
    slopes: np.ndarray | None = None  # J by number of the table; None before the first generation
    reach: float = REACH  # by which numbers are moved for the slopes
    damping: float = DAMPING  # that did best
    generation: int = 0  # generations that are over
    gained: int = 0  # the last of them that gained something

    @property
    def has_ended(self) -> bool:
        """Whether there is nothing more to gain."""
        return self.generation - self.gained >= PATIENCE

    def neighbours(self) -> list[list[float]]:
        """The point with one number moved, up and down in turn; the other way where the range ends."""
        reach = self.reach if self.generation % 2 == 0 else -self.reach
        found = []
        for place, own in enumerate(self.point):
            moved = own + reach if 0.0 <= own + reach <= 1.0 else own - reach
            found.append([*self.point[:place], moved, *self.point[place + 1 :]])
        return found

    def learn(self, neighbours: Sequence[Sequence[float]], residuals: Sequence[np.ndarray]) -> None:
        """Take in the slopes towards the neighbours; those to another kind of gait count as 0."""
        own = self.residuals
        slopes = np.zeros((len(neighbours), len(own)))
        for place, (neighbour, there) in enumerate(zip(neighbours, residuals, strict=True)):
            if len(there) and len(own) and there @ there <= OTHER_GAIT * (own @ own):
                slopes[place] = (there - own) / (neighbour[place] - self.point[place])
        self.slopes = slopes if self.slopes is None else MEMORY * self.slopes + (1.0 - MEMORY) * slopes

    def steps(self) -> list[tuple[float, list[float]]]:
        """Dampings, and the points where their steps lead, in full and in part; none before it walks."""
        if not len(self.residuals) or self.slopes is None:
            return []
        point, found = np.array(self.point), []
        wanted = np.append(-self.residuals, np.zeros(len(point)))
        for damping in (factor * self.damping for factor in FACTORS):
            damped = np.vstack((self.slopes.T, damping * np.eye(len(point))))
            # The solver wants room between the bounds, also for a number that is at both ends of its range.
            step = lsq_linear(damped, wanted, (-point - _ROOM, 1.0 - point + _ROOM)).x
            for part in PARTS_OF_STEPS:
                found.append((damping, np.clip(point + part * step, 0.0, 1.0).tolist()))
        return found

    def go_to(self, point: list[float], cost: float, residuals: np.ndarray, damping: float | None) -> None:
        """Go on from another point, for the gain of a step with some damping, or of a neighbour."""
        self.point, self.cost = point, cost
        if len(residuals) != len(self.residuals):
            self.slopes = None  # it walks now
        self.residuals = residuals
        if damping is not None:
            self.damping = float(np.clip(damping, *DAMPINGS))
        self.generation += 1
        self.gained = self.generation

    def stay(self) -> None:
        """Nothing was gained: look closer by, with more damping."""
        self.reach = max(LEAST_REACH, 0.6 * self.reach)
        self.damping = min(DAMPINGS[1], 2.0 * self.damping)
        self.generation += 1
