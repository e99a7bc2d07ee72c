"""How well a fitted law describes its samples, and how well it predicts tests that it was not fitted to."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin_gait.identification.fitting import Fit, refit
from twin_gait.identification.samples import FrictionTest, Samples


@dataclass(frozen=True, kw_only=True)
class Goodness:
    """Goodness of fit."""

    samples: int  # n
    parameter_count: int  # p
    sse: float  # sum of squared residuals in [N² m²]
    r_squared: float  # 1 - SSE/SST about the mean; negative if the mean alone is better
    adjusted_r_squared: float  # the same per degree of freedom
    rmse: float  # sqrt(SSE/n) in [N m]
    residual_standard_error: float  # sqrt(SSE/(n - p)) in [N m]: what MATLAB's fits call RMSE
    mean_absolute_error: float  # in [N m]
    aic: float  # Akaike's criterion of normal residuals, up to a constant of the samples
    bic: float  # the Bayesian one. Both count every sample as independent, which samples of a filter are not


def goodness(measured: np.ndarray, residuals: np.ndarray, parameters: int) -> Goodness:
    """Goodness of a fit with so many parameters, of torques and residuals in [N m], shape ``(n,)``."""
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
        mean_absolute_error=float(np.abs(residuals).mean()),
        aic=deviance + 2.0 * (parameters + 1),
        bic=deviance + math.log(n) * (parameters + 1),
    )


MOST_FOLDS = 12
_PIECES = 5  # that a single test is cut into


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """Error on what was left out."""

    by: str  # what was left out: ``file``, ``files`` (several at a time), ``weight`` or ``piece`` of one file
    folds: int  # how often
    rmse: float  # over all samples, each predicted by the fit that did not see it, in [N m]


@dataclass(frozen=True, eq=False)
class Folds:
    """What is left out together."""

    by: str  # see CrossValidation
    labels: np.ndarray  # fold of each sample, shape ``(n,)``


def folds_of(tests: Sequence[FrictionTest], samples: Samples) -> list[Folds]:
    """The ways to leave something out of these tests."""
    found = []
    if len(tests) == 1:
        pieces = np.arange(len(samples)) * _PIECES // max(len(samples), 1)
        found.append(Folds("piece", pieces))
    elif len(tests) <= MOST_FOLDS:
        found.append(Folds("file", samples.test))
    else:
        found.append(Folds("files", samples.test % MOST_FOLDS))
    masses = [test.mass for test in tests]
    if None not in masses and 1 < len(set(masses)) < len(tests):
        _, index = np.unique(np.array(masses, dtype=float), return_inverse=True)
        found.append(Folds("weight", index[samples.test]))
    return found


def cross_validate(
    fit: Fit, samples: Samples, folds: Folds, step: Callable[[], None] = lambda: None
) -> CrossValidation:
    """Fit without each fold and predict it.

    Each fit starts from that of all samples. A dynamic model runs through whole tests, of which the samples
    left out do not count in the fit.
    """
    total, count, number = 0.0, 0, 0
    for label in np.unique(folds.labels):
        out = folds.labels == label
        inside, outside = _without(samples, out), _without(samples, ~out)
        if not outside.used.any() or inside.used.sum() <= 2 * fit.model.size:
            continue
        again = refit(fit, inside)
        left = again.residuals(outside)
        total, count, number = total + float(left @ left), count + len(left), number + 1
        step()
    return CrossValidation(by=folds.by, folds=number, rmse=math.sqrt(total / count) if count else math.nan)


def _without(samples: Samples, out: np.ndarray) -> Samples:
    """The same samples, of which some do not count; tests of which none counts are left out."""
    used = samples.used & ~out
    needed = np.isin(samples.test, np.unique(samples.test[used]))
    changed = samples.rows(needed)
    return Samples(**{**vars(changed), "used": used[needed]})
