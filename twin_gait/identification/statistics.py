"""Goodness of a fitted law, its prediction of tests to which it was not fitted, and its uncertainty.

Intervals come from a bootstrap over whole tests: residuals of one test share its errors (weight, temperature,
offset, the filter), so that samples are far from independent, but tests are. Each draw takes as many tests as
there are, with replacement, and moves the fit by one Gauss-Newton step with the normal equations of the tests
drawn. This needs no fit per draw and agrees with full fits as far as the law is linear over the interval.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import median_abs_deviation
from scipy.stats import t as student

from twin_gait.identification import fitting
from twin_gait.identification.fitting import Fit
from twin_gait.identification.models import FrictionTest, Samples


@dataclass(frozen=True, kw_only=True)
class Goodness:
    """Goodness of fit."""

    samples: int  # number of samples n
    parameter_count: int  # number of parameters p
    sse: float  # sum of squared residuals in [N² m²]
    r_squared: float  # 1 - SSE/SST about the mean; negative if the mean alone is better
    adjusted_r_squared: float  # the same per degree of freedom
    rmse: float  # sqrt(SSE/n) in [N·m]
    residual_standard_error: float  # sqrt(SSE/(n - p)) in [N·m], called RMSE in MATLAB's fits
    aic: float  # Akaike's criterion of normal residuals, up to a constant of the samples
    # Bayesian criterion. Both criteria treat the samples as independent, which filtered samples are not.
    bic: float


def goodness(measured: np.ndarray, residuals: np.ndarray, parameters: int) -> Goodness:
    """Compute the goodness of a fit from measured torques and residuals in [N·m], shape ``(n,)``.

    ``parameters``: number of parameters of the fit.
    """
    n, freedom = len(measured), max(len(measured) - parameters, 1)
    sse = float(residuals @ residuals)
    sst = float(np.sum((measured - measured.mean()) ** 2))
    r_squared = 1.0 - sse / sst if sst > 0.0 else 0.0
    deviance = n * math.log(max(sse / n, 1e-300))
    return Goodness(
        samples=n,
        parameter_count=parameters,
        sse=sse,
        r_squared=r_squared,
        adjusted_r_squared=1.0 - (1.0 - r_squared) * (n - 1) / freedom,
        rmse=math.sqrt(sse / n),
        residual_standard_error=math.sqrt(sse / freedom),
        aic=deviance + 2.0 * (parameters + 1),
        bic=deviance + math.log(n) * (parameters + 1),
    )


MOST_FOLDS = 12
_PIECES = 5  # number of pieces into which a single test is cut


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """Error on the samples that were left out."""

    left_out: str  # ``file``, ``files`` (several at a time), ``weight`` or ``piece`` of one file
    folds: int  # number of folds
    rmse: float  # error over all samples, each predicted by the fit without it, in [N·m]


def folds_of(tests: Sequence[FrictionTest], samples: Samples) -> dict[str, np.ndarray]:
    """Return the possible divisions into folds: the fold of each sample by the kind of CrossValidation."""
    kind, fold = "file" if len(tests) <= MOST_FOLDS else "files", samples.test % MOST_FOLDS
    if len(tests) == 1:
        kind, fold = "piece", np.arange(len(samples)) * _PIECES // max(len(samples), 1)
    found = {kind: fold}
    masses = [test.mass for test in tests]
    if None not in masses and 1 < len(set(masses)) < len(tests):
        _, index = np.unique(np.array(masses, dtype=float), return_inverse=True)
        found["weight"] = index[samples.test]
    return found


def cross_validate(fit: Fit, samples: Samples, by: str, folds: np.ndarray) -> CrossValidation:
    """Fit without each fold and predict it; ``folds``: fold of each sample, shape ``(n,)``.

    Each fit starts from that of all samples. A dynamic model is simulated over whole tests, in which the
    samples left out do not count in the fit.
    """
    if not fit.model.dynamic:
        samples, folds = samples.used_only(), folds[samples.used]
    left = []
    for label in np.unique(folds):
        out = folds == label
        inside, outside = _exclude(samples, out), _exclude(samples, ~out)
        if outside.used.any() and inside.used.sum() > 2 * fit.model.size:
            left.append(fitting.refit(fit, inside).residuals(outside))
    errors = np.concatenate([*left, np.empty(0)])
    rmse = math.sqrt(float(errors @ errors) / len(errors)) if left else math.nan
    return CrossValidation(left_out=by, folds=len(left), rmse=rmse)


def _exclude(samples: Samples, out: np.ndarray) -> Samples:
    """Return the same samples, of which some do not count; tests without any that count are removed."""
    used = samples.used & ~out
    return replace(samples, used=used).rows(np.isin(samples.test, np.unique(samples.test[used])))


DRAWS = 1000
LEVEL = 0.95
FEWEST_TESTS = 6  # number of tests below which they are cut into blocks
BLOCKS = 24  # number of blocks into which few tests are cut
_FURTHEST = 30.0
_FAR, _MOST_FAR = 10.0, 0.1  # robust standard deviations; share of the draws that may lie beyond
_RANK = 1e-11  # relative singular value below which parameters cannot be distinguished


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of the parameters of a fit."""

    # Lower and upper end of the 95 % interval by parameter; infinite where the samples do not determine it.
    intervals: Mapping[str, tuple[float, float]]
    correlations: np.ndarray  # correlations of the parameters, ``(p, p)``; NaN where one is not determined
    # Standard errors by ordinary theory with independent samples, for comparison with other programs.
    standard_errors: Mapping[str, float]
    blocks: int  # number of tests, or of blocks of few tests, from which the draws are made


def uncertainty(fit: Fit, samples: Samples, seed: int) -> Uncertainty:
    """Estimate intervals of the parameters of a fit from its samples, by bootstrap draws with a seed."""
    model = fit.model
    rows = fitting.rows_of(model, samples)  # more samples than were fitted would give too short intervals
    values, matrix = fit.residuals(rows), model.jacobian(fit.x, rows)
    free = np.setdiff1d(np.arange(model.size), fit.at_bound)
    scale = np.sqrt((matrix[:, free] ** 2).sum(axis=0))
    free, scale = free[scale > 0.0], scale[scale > 0.0]
    unit = matrix[:, free] / scale
    rank = int(np.linalg.matrix_rank(unit.T @ unit, tol=_RANK, hermitian=True)) if len(free) else 0
    block = block_indices(rows.test[rows.used])
    number = int(block[-1]) + 1
    if rank < max(len(free), 1) or number < 2:
        unknown, nothing = (-math.inf, math.inf), np.full((model.size, model.size), math.nan)
        wide, errors = dict.fromkeys(model.names, unknown), dict.fromkeys(model.names, math.inf)
        return Uncertainty(wide, nothing, errors, number)
    weights = fitting.huber_weights(values, fit.threshold)
    steps = _draws(unit, values, weights, block, number, seed) / scale
    steps = steps[_informative_draws(steps)]
    draws = np.tile(fit.x, (len(steps), 1))
    draws[:, free] += steps
    count = len(model.coefficients)
    # A shape that the samples hardly determine would overflow; a factor of e^±30 is wide enough.
    draws[:, count:] = np.clip(draws[:, count:], fit.x[count:] - _FURTHEST, fit.x[count:] + _FURTHEST)
    errors, reported = _standard_errors(fit, unit, scale, free, values), _public(fit, draws)
    with np.errstate(divide="ignore", invalid="ignore"):  # NaN for one that does not vary
        correlations = np.atleast_2d(np.corrcoef(reported))
    return Uncertainty(_intervals(fit, reported, number), correlations, errors, number)


def block_indices(test: np.ndarray) -> np.ndarray:
    """Return the number of the block of each sample: its test, or a part of it if there are few tests."""
    _, index, lengths = np.unique(test, return_inverse=True, return_counts=True)
    pieces = 1 if len(lengths) >= FEWEST_TESTS else -(-BLOCKS // len(lengths))
    position = np.arange(len(index)) - (np.cumsum(lengths) - lengths)[index]
    return np.asarray(index * pieces + position * pieces // lengths[index])


def _draws(
    unit: np.ndarray, values: np.ndarray, weights: np.ndarray, block: np.ndarray, number: int, seed: int
) -> np.ndarray:
    """Draw steps of the parameters, one row a draw, in units of the columns."""
    size = unit.shape[1]
    normal, gradient = np.zeros((number, size, size)), np.zeros((number, size))
    weighted = unit * weights[:, None]
    edges = np.flatnonzero(np.diff(block, prepend=-1))
    for start, end in zip(edges, [*edges[1:], len(block)], strict=True):
        normal[block[start]] += weighted[start:end].T @ unit[start:end]
        gradient[block[start]] += weighted[start:end].T @ values[start:end]
    gradient = _correct_leverage(normal, gradient)
    generator = np.random.default_rng(seed)
    times = generator.multinomial(number, np.full(number, 1.0 / number), size=DRAWS).astype(float)
    left, right = np.einsum("db,bij->dij", times, normal), times @ gradient
    # A draw without the tests that distinguish two parameters moves in the directions that it determines.
    return np.asarray((np.linalg.pinv(left, rcond=1e-9, hermitian=True) @ right[:, :, None])[:, :, 0])


def _informative_draws(steps: np.ndarray) -> np.ndarray:
    """Select the draws that are informative: a few may miss all samples that determine a parameter.

    Such draws step anywhere. If there are many, the parameter is not determined, and all draws count.
    """
    spread = median_abs_deviation(steps, scale="normal")
    far = (np.abs(steps - np.median(steps, axis=0)) > _FAR * spread).any(axis=1)
    return ~far if far.mean() <= _MOST_FAR else np.ones(len(steps), dtype=bool)


def _correct_leverage(normal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Compute the gradient of each block about the fit of the others (the jackknife's correction).

    A block that moves the fit has reduced its own residuals; without the correction intervals are too short.
    """
    total = normal.sum(axis=0)
    others = np.linalg.pinv(total - normal, rcond=1e-9, hermitian=True)
    adjusted = gradient + np.einsum("bij,bjk,bk->bi", normal, others, gradient)
    return np.asarray(adjusted - adjusted.mean(axis=0))


def _public(fit: Fit, draws: np.ndarray) -> np.ndarray:
    """Compute the reported parameters of each draw, shape ``(n_names, n_draws)``."""
    beta, eta = fit.model.split(draws.T)
    return np.array([np.broadcast_to(row, len(draws)) for row in fit.model.to_reported(beta, eta)])


def _intervals(fit: Fit, reported: np.ndarray, number: int) -> dict[str, tuple[float, float]]:
    """Compute Student's intervals with the bootstrap's standard error; logarithmic for a shape parameter.

    With few tests the bootstrap's spread is too small by sqrt((n-1)/n) and its tails too short.
    """
    reach = float(student.ppf(0.5 + LEVEL / 2.0, number - 1)) * math.sqrt(number / (number - 1))
    found, by_factor = {}, {item.name for item in fit.model.shape if item.log_interval}
    for (name, centre), row in zip(fit.model.parameters(fit.x).items(), reported, strict=True):
        if name in by_factor and (row > 0.0).all():
            half = min(reach * float(np.log(row).std()), 300.0)
            found[name] = (centre * math.exp(-half), centre * math.exp(half))
        else:
            half = reach * float(row.std())
            found[name] = (centre - half, centre + half)
    return found


def _standard_errors(
    fit: Fit, unit: np.ndarray, scale: np.ndarray, free: np.ndarray, values: np.ndarray
) -> dict[str, float]:
    """Compute the standard errors of ordinary least squares, propagated to the reported parameters.

    Those of x are the square roots of the diagonal of s² (JᵀJ)⁻¹.
    """
    freedom = max(len(values) - len(free), 1)
    covariance = np.linalg.inv(unit.T @ unit) / np.outer(scale, scale) * float(values @ values) / freedom
    names = fit.model.names
    moves = np.diag(1e-6 * np.maximum(np.abs(fit.x), 1e-3))[free]  # one parameter a row
    change = _public(fit, fit.x + moves) - _public(fit, fit.x - moves)
    derivative = change / (2.0 * moves.sum(axis=1))
    variance = np.einsum("ij,jk,ik->i", derivative, covariance, derivative)
    return {name: math.sqrt(max(float(item), 0.0)) for name, item in zip(names, variance, strict=True)}


_WIDE = 0.25  # half-width of an interval, relative to the parameter, beyond which a warning is given
_CORRELATED = 0.98


def fit_warnings(fit: Fit, uncertainty: Uncertainty, samples: Samples) -> list[str]:
    """Return warnings about a fit."""
    names, correlations, found = fit.model.names, uncertainty.correlations, []
    for name, value in fit.model.parameters(fit.x).items():
        low, high = uncertainty.intervals[name]
        half = 0.5 * (high - low)
        if not np.isfinite(half):
            found.append(f"{name} is not determined by these samples")
        elif half > _WIDE * abs(value):
            found.append(f"{name} is uncertain: {value:.3g}, and half of the interval {half:.2g}")
    found += [
        f"{names[i]} and {names[j]} are correlated ({correlations[i, j]:+.3f}): only a combination is known"
        for i in range(len(names))
        for j in range(i)
        if abs(correlations[i, j]) > _CORRELATED
    ]
    found += [f"{names[index]} is at its bound; its interval is not valid" for index in fit.at_bound]
    power = (fit.model.predict(fit.x, samples) * samples.velocity)[samples.used]
    if not fit.model.needs and (power < -1e-9).mean() >= 1e-3:  # friction must take power from the joint
        found.append("the law drives the joint in some of the samples; --physical excludes such parameters")
    return found
