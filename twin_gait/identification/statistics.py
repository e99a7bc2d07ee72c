"""How well a fitted law describes its samples, in the numbers that the thesis gives and a few more."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Goodness:
    """Goodness of fit.

    Attributes:
        samples: n.
        parameter_count: p.
        sse: Sum of squared residuals in [N² m²].
        r_squared: 1 - SSE/SST about the mean; negative if the mean alone is better.
        adjusted_r_squared: The same per degree of freedom.
        rmse: sqrt(SSE/n) in [N m].
        residual_standard_error: sqrt(SSE/(n - p)) in [N m]: what MATLAB's fits call RMSE.
        mean_absolute_error: In [N m].
        aic: Akaike's criterion of normal residuals, up to a constant of the samples.
        bic: The Bayesian one. Both count every sample as independent, which samples of a filter are not.
    """

    samples: int
    parameter_count: int
    sse: float
    r_squared: float
    adjusted_r_squared: float
    rmse: float
    residual_standard_error: float
    mean_absolute_error: float
    aic: float
    bic: float


def goodness(measured: np.ndarray, residuals: np.ndarray, parameters: int) -> Goodness:
    """Compute the goodness of a fit.

    Args:
        measured: Torques in [N m], shape ``(n,)``, more than parameters.
        residuals: Measured less predicted torque in [N m], shape ``(n,)``.
        parameters: How many were fitted.

    Returns:
        The goodness.
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
        mean_absolute_error=float(np.abs(residuals).mean()),
        aic=deviance + 2.0 * (parameters + 1),
        bic=deviance + math.log(n) * (parameters + 1),
    )
