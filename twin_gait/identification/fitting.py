"""Fit one friction model: robust non-linear least squares from many scaled starts.

The starts exploit that every model is linear in part of its parameters: for a shape drawn from a scrambled
Sobol sequence over its bounds, the best coefficients follow from one linear least squares. The best few are
polished on part of the samples by :func:`scipy.optimize.least_squares` (trust region reflective), the winner
on all of them by :mod:`twin_gait.identification.refining`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from twin_gait.identification.friction_model import FrictionModel
from twin_gait.identification.refining import (
    Bounds,
    best_coefficients,
    huber_cost,
    jacobian,
    refine,
    residuals,
)
from twin_gait.identification.samples import Samples, thinned, thinned_path

MAD_TO_SIGMA = 1.4826  # of a normal distribution
HUBER_SIGMAS = 3.0  # residuals beyond so many robust standard deviations count linearly
_STARTS_PER_SHAPE, _MOST_STARTS = 24, 96
_STATE_STARTS = 128  # of a model with a state, whose minima are narrow
_START_SAMPLES, _POLISH_SAMPLES, _STATE_SAMPLES = 1_500, 3_000, 4_000
_POLISHED, _STATE_POLISHED = 4, 6
_APART = 0.1  # of the span of the bounds
_REFIT_TOLERANCE = 1e-7  # of the loss: a fold's error is wanted to four digits, not to ten
_COARSE = 2_000  # samples of the descent before the last one
_CLOSEST, _EXACT_SAMPLES = 1e-15, 2_000  # tolerance of the loss; up to how many samples it holds
_NEGLIGIBLE = 1e-5  # of the loss per sample and variance: far below what noise moves the parameters by
MOST_SAMPLES = 40_000  # that a fit uses, evenly taken; statistics use all
_GROSS_SIGMAS = 6.0  # robust standard deviations beyond which a residual may be an outlier
_ALONE = 0.5  # share of such residuals with none beside them


class Loss(StrEnum):
    """How residuals are weighed."""

    AUTO = "auto"  # Huber's, if there are large residuals and they stand alone as outliers do; else linear
    HUBER = "huber"  # squared up to three robust standard deviations, linear beyond
    LINEAR = "linear"  # squared: ordinary least squares


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """How to fit."""

    loss: Loss = Loss.AUTO  # weighing of residuals
    # whether torques and coefficients must be 0 or more and break-away at least Coulomb
    physical: bool = False
    seed: int = 0  # of the starts


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model."""

    model: FrictionModel  # the model
    x: np.ndarray  # linear coefficients and logarithms of the shape, shape ``(size,)``
    bounds: Bounds  # of x
    sigma: float  # robust standard deviation of the residuals in [N m]
    threshold: float  # of Huber's loss in [N m]; infinite for least squares

    def residuals(self, samples: Samples) -> np.ndarray:
        """Measured less predicted torque of the samples that are used, in [N m]."""
        return residuals(self.model, self.x, samples)

    @property
    def at_bound(self) -> tuple[int, ...]:
        """Positions in x that lie on a bound."""
        low, high = self.bounds
        span = np.where(np.isfinite(high - low), high - low, 1.0)
        near = np.minimum(self.x - low, high - self.x) <= 1e-4 * span
        return tuple(int(place) for place in np.flatnonzero(near))


def bounds(model: FrictionModel, samples: Samples, *, physical: bool) -> Bounds:
    """Bounds of the parameter vector, scaled to the samples."""
    low = [0.0 if physical and sign == "+" else -math.inf for sign in model.coefficients]
    high = [math.inf for _ in model.coefficients]
    for item in model.shape:
        scale = item.scale(samples)
        lowest = item.physical_low if physical and item.physical_low is not None else item.low
        low.append(math.log(lowest * scale))
        high.append(math.log(item.high * scale))
    return Bounds(np.array(low), np.array(high))


def fit_model(
    model: FrictionModel, samples: Samples, options: FitOptions, *, seeds: Sequence[np.ndarray] = ()
) -> Fit:
    """Fit a model to samples with every column that it needs.

    ``seeds``: further starts beside the many: the fits of simpler models.
    """
    full = rows_of(model, samples)
    limits, threshold = bounds(model, full, physical=options.physical), math.inf
    x = _best_start(model, full, limits, seeds, options)
    x = _descended(model, samples, full, x, limits, threshold)
    values = residuals(model, x, full)
    sigma = _robust_sigma(values)
    if sigma > 0.0 and _wants_huber(options.loss, values, sigma):
        # The scale settles in two rounds: the first fit may itself be pulled by outliers.
        for _ in range(2):
            threshold = HUBER_SIGMAS * sigma
            x = _descended(model, samples, full, x, limits, threshold)
            sigma = _robust_sigma(residuals(model, x, full)) or sigma
    return Fit(model, x, limits, sigma, threshold)


def _wants_huber(loss: Loss, values: np.ndarray, sigma: float) -> bool:
    """Whether to weigh large residuals less.

    Errors of measurement stand alone. Residuals that stay large for many samples say that the law misses
    something there, and a law that is told to look away from it predicts worse.
    """
    if loss is not Loss.AUTO:
        return loss is Loss.HUBER
    beyond = np.abs(values) > _GROSS_SIGMAS * sigma
    beside = np.concatenate([[False], beyond[:-1]]) | np.concatenate([beyond[1:], [False]])
    return bool(beyond.any() and (beyond & ~beside).sum() >= _ALONE * beyond.sum())


def _descended(
    model: FrictionModel,
    samples: Samples,
    full: Samples,
    start: np.ndarray,
    limits: Bounds,
    threshold: float,
) -> np.ndarray:
    """The minimum near a start: first on few samples, where a step costs little, then on all."""
    number = int(full.used.sum())
    # Share of the loss that is worth another step: less than noise decides, exact for few samples.
    tolerance = _CLOSEST if number <= _EXACT_SAMPLES else _NEGLIGIBLE / number
    candidates = [start]
    coarse = rows_of(model, samples, _COARSE)
    if 2 * len(coarse) < len(full):
        candidates.append(refine(model, coarse, start, limits, threshold, tolerance=_REFIT_TOLERANCE))
    best = min(candidates, key=lambda x: huber_cost(residuals(model, x, full), threshold))
    return refine(model, full, best, limits, threshold, tolerance=tolerance)


def rows_of(model: FrictionModel, samples: Samples, limit: int | None = None) -> Samples:
    """Samples that a model is fitted to: at most so many count, and a state keeps its path."""
    limit = MOST_SAMPLES if limit is None else limit
    return thinned_path(samples, limit) if model.dynamic else thinned(samples.used_only(), limit)


def refit(fit: Fit, samples: Samples) -> Fit:
    """Fit to much the same samples, from a fit of them and with its loss."""
    full = rows_of(fit.model, samples)
    x = refine(fit.model, full, fit.x, fit.bounds, fit.threshold, tolerance=_REFIT_TOLERANCE)
    return replace(fit, x=x)


def _robust_sigma(values: np.ndarray) -> float:
    """Standard deviation of a normal distribution with the same median absolute deviation."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


def _best_start(
    model: FrictionModel,
    samples: Samples,
    limits: Bounds,
    seeds: Sequence[np.ndarray],
    options: FitOptions,
) -> np.ndarray:
    count, dimensions = len(model.coefficients), len(model.shape)
    if not dimensions:
        return limits.clip(best_coefficients(model, np.empty(0), samples)[0])
    few_samples, more_samples = (_STATE_SAMPLES,) * 2 if model.dynamic else (_START_SAMPLES, _POLISH_SAMPLES)
    few, more = _fewer(samples, model, few_samples), _fewer(samples, model, more_samples)
    number = _STATE_STARTS if model.dynamic else min(_STARTS_PER_SHAPE * dimensions, _MOST_STARTS)
    draws = qmc.Sobol(dimensions, seed=options.seed).random_base2(math.ceil(math.log2(number)))
    starts, costs = [], []
    for draw in limits.low[count:] + draws * (limits.high - limits.low)[count:]:
        beta, cost = best_coefficients(model, np.exp(draw), few)
        starts.append(limits.clip(np.concatenate([beta, draw])))
        costs.append(cost)
    kept = _apart(draws, np.array(costs), _STATE_POLISHED if model.dynamic else _POLISHED)
    inherited = [limits.clip(seed) for seed in seeds]
    polished = [_polish(model, more, x, limits) for x in [*(starts[i] for i in kept), *inherited]]
    # Compared on all samples, so that no model comes out worse than a simpler one that it contains.
    return min([*polished, *inherited], key=lambda x: float(np.sum(residuals(model, x, samples) ** 2)))


def _apart(places: np.ndarray, costs: np.ndarray, number: int) -> list[int]:
    """The best starts that do not lie beside a better one, in the unit cube of the shape."""
    chosen: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        if all(np.abs(places[index] - places[other]).max() > _APART for other in chosen):
            chosen.append(int(index))
        if len(chosen) == number:
            break
    return chosen


def _fewer(samples: Samples, model: FrictionModel, limit: int) -> Samples:
    """Fewer samples: evenly for a static law; the beginnings of the tests, unthinned, for a state."""
    if not model.dynamic or len(samples) <= limit:
        return thinned(samples, limit)
    tests = np.unique(samples.test)
    first = np.searchsorted(samples.test, tests)
    place = np.arange(len(samples)) - first[np.searchsorted(tests, samples.test)]
    chosen = samples.rows(place < max(limit // len(tests), 50))
    return chosen if chosen.used.sum() > 10 * model.size else samples


def _polish(model: FrictionModel, samples: Samples, start: np.ndarray, limits: Bounds) -> np.ndarray:
    def errors(x: np.ndarray) -> np.ndarray:
        return -residuals(model, x, samples)

    def derivative(x: np.ndarray) -> np.ndarray:
        return jacobian(model, x, samples)

    result = least_squares(
        errors,
        np.clip(start, limits.low + 1e-9, limits.high - 1e-9),
        jac=derivative,
        bounds=limits,
        x_scale="jac",
        tr_solver="lsmr",
        xtol=1e-5,
        ftol=1e-5,
        max_nfev=25,
    )
    return np.asarray(result.x)
