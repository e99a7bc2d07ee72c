"""Fit of one friction model: robust non-linear least squares from many scaled starts.

The starts exploit that every model is linear in part of its parameters: for a shape drawn from a scrambled
Sobol sequence over its bounds, the best coefficients follow from one linear least squares. The best few are
polished on part of the samples, the winner on all of them, by :func:`scipy.optimize.least_squares` (trust
region reflective).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import median_abs_deviation, qmc

from twin_gait.identification.laws import BRISTLE_DAMPING, SIGNED
from twin_gait.identification.models import FrictionModel, Samples, thinned, thinned_path

HUBER_SIGMAS = 3.0  # number of robust standard deviations beyond which residuals count linearly
_STARTS = 128
_START_SAMPLES = 4_000  # number of samples on which starts are compared and polished
_POLISHED, _POLISH_TOLERANCE, _POLISH_STEPS = 6, 1e-5, 50  # starts; share of the loss; evaluations
_APART = 0.1  # least distance of starts, as a share of the span of the bounds
_REFIT_TOLERANCE = 1e-7  # share of the loss: four digits of a fold's error are sufficient
_CLOSEST, _EXACT_SAMPLES = 1e-15, 2_000  # tolerance of the loss; largest number of samples with it
_NEGLIGIBLE = 1e-5  # share of the loss per sample and variance: noise moves the parameters by far more
_SMALLEST_MOVE = 1e-10  # relative change of the parameters in the last step
MAX_FIT_SAMPLES = 40_000  # largest number of samples of a fit, taken evenly; statistics use all
_GROSS_SIGMAS = 6.0  # number of robust standard deviations beyond which a residual may be an outlier
_ALONE = 0.5  # share of such residuals without another one next to them


Bounds = tuple[np.ndarray, np.ndarray]  # least and largest parameter vector, shape ``(size,)`` each


def huber_weights(values: np.ndarray, threshold: float) -> np.ndarray:
    """Compute the weight of each residual in the normal equations: 1 up to the threshold, falling beyond."""
    if math.isinf(threshold):
        return np.ones_like(values)
    return np.asarray(threshold / np.maximum(np.abs(values), threshold))


class Loss(StrEnum):
    """Loss function of the residuals."""

    # Huber's loss if there are large residuals and they are isolated like outliers; else linear.
    AUTO = "auto"
    HUBER = "huber"  # squared up to three robust standard deviations, linear beyond
    LINEAR = "linear"  # squared: ordinary least squares


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Options of a fit."""

    loss: Loss = Loss.AUTO  # loss function of the residuals
    # Whether torques and coefficients must be 0 or more and break-away at least Coulomb.
    physical: bool = False
    seed: int = 0  # seed of the starts


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted model."""

    model: FrictionModel  # friction model
    x: np.ndarray  # linear coefficients and logarithms of the shape, shape ``(size,)``
    bounds: Bounds  # bounds of x
    threshold: float  # threshold of Huber's loss in [N·m]; infinite for least squares

    def residuals(self, samples: Samples) -> np.ndarray:
        """Compute measured less predicted torque of the samples that are used, in [N·m]."""
        return -self.model.errors(self.x, samples)

    @property
    def at_bound(self) -> np.ndarray:
        """Indices of the elements of x that lie on a bound."""
        low, high = self.bounds
        span = np.where(np.isfinite(high - low), high - low, 1.0)
        return np.flatnonzero(np.minimum(self.x - low, high - self.x) <= 1e-4 * span)


def bounds(model: FrictionModel, samples: Samples, *, physical: bool) -> Bounds:
    """Return the bounds of the parameter vector, scaled to the samples.

    The damping of bristles is never negative: at every reversal they would release energy.
    """
    low = [
        0.0 if name == BRISTLE_DAMPING or (physical and name not in SIGNED) else -math.inf
        for name in model.coefficients
    ]
    high = [math.inf for _ in model.coefficients]
    for item in model.shape:
        scale = item.scale(samples)
        lowest = item.physical_low if physical and item.physical_low is not None else item.low
        low.append(math.log(lowest * scale))
        high.append(math.log(item.high * scale))
    return np.array(low), np.array(high)


def fit_model(
    model: FrictionModel, samples: Samples, options: FitOptions, *, seeds: Sequence[np.ndarray] = ()
) -> Fit:
    """Fit a model to samples with every column that it needs.

    ``seeds``: further starts in addition to the random ones, from the fits of simpler models.
    """
    full = rows_of(model, samples)
    limits, threshold = bounds(model, full, physical=options.physical), math.inf
    number = int(full.used.sum())
    # Tolerance of the loss: below the effect of noise, but exact for few samples.
    tolerance = _CLOSEST if number <= _EXACT_SAMPLES else _NEGLIGIBLE / number
    x = _best_start(model, full, limits, seeds, options)
    x = refine(model, full, x, limits, tolerance=tolerance)
    values = model.errors(x, full)
    sigma = median_abs_deviation(values, scale="normal")
    if sigma > 0.0 and _needs_huber(options.loss, values, sigma):
        # The scale settles in two rounds, because outliers may bias the first fit.
        for _ in range(2):
            threshold = HUBER_SIGMAS * sigma
            x = refine(model, full, x, limits, threshold, tolerance=tolerance)
            sigma = median_abs_deviation(model.errors(x, full), scale="normal") or sigma
    return Fit(model, x, limits, threshold)


def _needs_huber(loss: Loss, values: np.ndarray, sigma: float) -> bool:
    """Decide whether to reduce the weight of large residuals.

    Errors of measurement are isolated. Residuals that stay large for many samples mean that the law lacks
    something there, and a law that is fitted with less weight on them predicts worse.
    """
    if loss is not Loss.AUTO:
        return loss is Loss.HUBER
    beyond = np.abs(values) > _GROSS_SIGMAS * sigma
    beside = np.concatenate([[False], beyond[:-1]]) | np.concatenate([beyond[1:], [False]])
    return bool(beyond.any() and (beyond & ~beside).sum() >= _ALONE * beyond.sum())


def rows_of(model: FrictionModel, samples: Samples) -> Samples:
    """Return the samples of a fit: a limited number counts, and a model with a state keeps its path."""
    if model.dynamic:
        return thinned_path(samples, MAX_FIT_SAMPLES)
    return thinned(samples.used_only(), MAX_FIT_SAMPLES)


def refit(fit: Fit, samples: Samples) -> Fit:
    """Fit a model to similar samples, starting from an existing fit and with its loss."""
    full = rows_of(fit.model, samples)
    x = refine(fit.model, full, fit.x, fit.bounds, fit.threshold, tolerance=_REFIT_TOLERANCE)
    return replace(fit, x=x)


def _best_start(
    model: FrictionModel, samples: Samples, limits: Bounds, seeds: Sequence[np.ndarray], options: FitOptions
) -> np.ndarray:
    count, dimensions = len(model.coefficients), len(model.shape)
    if not dimensions:
        return np.asarray(np.clip(best_coefficients(model, np.empty(0), samples)[0], *limits))
    few = _fewer(samples, model, _START_SAMPLES)
    low, high = (limit[count:] for limit in limits)
    draws = qmc.Sobol(dimensions, seed=options.seed).random(_STARTS)
    shapes = low + draws * (high - low)
    found = [best_coefficients(model, np.exp(shape), few) for shape in shapes]
    kept = _apart(draws, np.array([cost for _, cost in found]))
    starts = [*(np.concatenate([found[index][0], shapes[index]]) for index in kept), *seeds]
    polished = [
        refine(model, few, x, limits, tolerance=_POLISH_TOLERANCE, steps=_POLISH_STEPS) for x in starts
    ]
    # Candidates are compared on all samples, so that no model is worse than a simpler one that it contains.
    candidates = [*polished, *(np.clip(seed, *limits) for seed in seeds)]
    return min(candidates, key=lambda x: float(np.sum(model.errors(x, samples) ** 2)))


def _apart(points: np.ndarray, costs: np.ndarray) -> list[int]:
    """Select the best starts that are not close to a better one, in the unit cube of the shape."""
    chosen: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        if all(np.abs(points[index] - points[other]).max() > _APART for other in chosen):
            chosen.append(int(index))
        if len(chosen) == _POLISHED:
            break
    return chosen


def _fewer(samples: Samples, model: FrictionModel, limit: int) -> Samples:
    """Reduce the samples: a random selection for a static law, the unthinned beginnings of tests for a state.

    Samples at even intervals would always hit the same few points of a periodic motion.
    """
    if len(samples) <= limit:
        return samples
    if not model.dynamic:
        return samples.rows(np.sort(np.random.default_rng(0).choice(len(samples), limit, replace=False)))
    tests = np.unique(samples.test)
    first = np.searchsorted(samples.test, tests)
    position = np.arange(len(samples)) - first[np.searchsorted(tests, samples.test)]
    chosen = samples.rows(position < max(limit // len(tests), 50))
    return chosen if chosen.used.sum() > 10 * model.size else samples


@np.errstate(over="ignore")  # a step in a direction that the samples do not determine may be as long as 1e157
def refine(
    model: FrictionModel,
    samples: Samples,
    start: np.ndarray,
    bounds: Bounds,
    threshold: float = math.inf,
    *,
    tolerance: float = 1e-12,
    steps: int = 200,
) -> np.ndarray:
    """Descend to the minimum near a start within the bounds, for a threshold of Huber's loss in [N·m].

    The descent ends after a step that reduces the loss by less than the share ``tolerance``.
    """
    robust = math.isfinite(threshold)
    result = least_squares(
        model.errors,
        np.clip(start, *bounds),
        jac=model.jacobian,
        args=(samples,),
        bounds=bounds,
        x_scale="jac",
        loss="huber" if robust else "linear",
        f_scale=threshold if robust else 1.0,
        ftol=tolerance,
        xtol=_SMALLEST_MOVE,
        gtol=None,
        max_nfev=steps,
    )
    return np.asarray(result.x)


def best_coefficients(model: FrictionModel, shape: np.ndarray, samples: Samples) -> tuple[np.ndarray, float]:
    """Compute the coefficients of a shape with the least sum of squares, and this sum.

    Returns zeros and infinity for a shape at which the law overflows.
    """
    basis = model.basis(shape, samples)[samples.used]
    torque = (samples.torque - model.constant(shape, samples))[samples.used]
    if not np.isfinite(basis).all():
        return np.zeros(basis.shape[1]), math.inf
    beta = np.asarray(np.linalg.lstsq(basis, torque, rcond=1e-12)[0])
    return beta, float(np.sum((torque - basis @ beta) ** 2))
