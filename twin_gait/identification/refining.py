"""Residuals, their derivative, and the last steps of a fit: Levenberg and Marquardt on all samples.

A warm start of thousands of samples and a handful of parameters suits normal equations, which take a tenth
of the time of a general solver; cross-validation does this hundreds of times.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import huber

from twin_gait.identification.friction_model import FrictionModel
from twin_gait.identification.samples import Samples

_DIFFERENCE = 1e-5  # step of the central differences in the logarithm of a shape parameter
_STEPS, _STEPS_OF_FEW, _FEW = 60, 600, 2_000  # a step over few samples costs little
_SMALLEST_MOVE = 1e-10  # of the parameters: the last step
_DAMPING, _LARGEST_DAMPING = 1e-4, 1e12


class Bounds(NamedTuple):
    """Limits of a parameter vector, shape ``(size,)`` each."""

    low: np.ndarray
    high: np.ndarray

    def clip(self, x: np.ndarray) -> np.ndarray:
        """The vector within the limits that is nearest."""
        return np.asarray(np.clip(x, self.low, self.high))


def residuals(model: FrictionModel, x: np.ndarray, samples: Samples) -> np.ndarray:
    """Measured less predicted torque of the samples that are used, in [N m], shape ``(n_used,)``."""
    return np.asarray((samples.torque - model.predict(x, samples))[samples.used])


def jacobian(model: FrictionModel, x: np.ndarray, samples: Samples) -> np.ndarray:
    """Derivative of the predicted torque by the parameter vector.

    Exact for the linear coefficients, by central differences for the logarithms of the shape.
    """
    count = len(model.coefficients)
    columns = [model.basis(np.exp(x[count:]), samples)[samples.used]]
    for place in range(count, model.size):
        step = np.zeros(model.size)
        step[place] = _DIFFERENCE
        ahead, behind = model.predict(x + step, samples), model.predict(x - step, samples)
        columns.append(((ahead - behind)[samples.used] / (2.0 * _DIFFERENCE))[:, None])
    return np.concatenate(columns, axis=1)


def huber_cost(values: np.ndarray, threshold: float) -> float:
    """Huber's loss: half the square up to a threshold (infinite for least squares), linear beyond."""
    return float(np.sum(huber(threshold, values)))


def huber_weights(values: np.ndarray, threshold: float) -> np.ndarray:
    """Weight of each residual in the normal equations: 1 up to the threshold, falling beyond."""
    if math.isinf(threshold):
        return np.ones_like(values)
    return np.asarray(threshold / np.maximum(np.abs(values), threshold))


def refine(
    model: FrictionModel,
    samples: Samples,
    start: np.ndarray,
    bounds: Bounds,
    threshold: float,
    *,
    tolerance: float = 1e-12,
) -> np.ndarray:
    """Descend to the minimum near a start within the bounds, for a threshold of Huber's loss in [N m].

    A step that lowers the loss by less than the share ``tolerance`` of it is the last.
    """
    (low, high), x, damping = bounds, start, _DAMPING
    # Along a curved valley coefficients that follow the shape at each step save hundreds of steps.
    few = int(samples.used.sum()) <= _FEW
    projected = few and math.isinf(threshold) and not np.isfinite(low[: len(model.coefficients)]).any()
    values = residuals(model, x, samples)
    cost = huber_cost(values, threshold)
    for _ in range(_STEPS_OF_FEW if few else _STEPS):
        matrix = jacobian(model, x, samples)
        weighted = matrix * huber_weights(values, threshold)[:, None]
        normal, gradient = matrix.T @ weighted, weighted.T @ values
        stuck = ((x <= low) & (gradient < 0.0)) | ((x >= high) & (gradient > 0.0))
        while True:
            trial = bounds.clip(x + _step(normal, gradient, damping, ~stuck))
            if projected:
                logarithms = trial[len(model.coefficients) :]
                beta, least = best_coefficients(model, np.exp(logarithms), samples)
                trial = np.concatenate([beta, logarithms]) if math.isfinite(least) else trial
            trial_values = residuals(model, trial, samples)
            trial_cost = huber_cost(trial_values, threshold)
            if trial_cost < cost or not damping <= _LARGEST_DAMPING:
                break
            damping *= 10.0
        if not trial_cost < cost:
            return x
        gain, moved = cost - trial_cost, np.abs(trial - x)
        x, values, cost, damping = trial, trial_values, trial_cost, max(0.1 * damping, 1e-14)
        if gain <= tolerance * cost or (moved <= _SMALLEST_MOVE * (np.abs(x) + _SMALLEST_MOVE)).all():
            return x
    return x


def best_coefficients(model: FrictionModel, shape: np.ndarray, samples: Samples) -> tuple[np.ndarray, float]:
    """Coefficients of a shape that leave the least sum of squares, and that sum.

    Zeros and infinity for a shape at which the law overflows.
    """
    basis = model.basis(shape, samples)[samples.used]
    torque = (samples.torque - model.constant(shape, samples))[samples.used]
    if not np.isfinite(basis).all():
        return np.zeros(basis.shape[1]), math.inf
    beta = np.asarray(np.linalg.lstsq(basis, torque, rcond=1e-12)[0])
    return beta, float(np.sum((torque - basis @ beta) ** 2))


def _step(normal: np.ndarray, gradient: np.ndarray, damping: float, free: np.ndarray) -> np.ndarray:
    """Step of the parameters that are free, scaled so that units do not matter."""
    step = np.zeros(len(gradient))
    scale = np.sqrt(np.diag(normal))
    free = free & (scale > 0.0)
    if free.any():
        unit = scale[free]
        matrix = normal[np.ix_(free, free)] / np.outer(unit, unit)
        matrix[np.diag_indices_from(matrix)] += damping
        step[free] = np.linalg.lstsq(matrix, gradient[free] / unit, rcond=None)[0] / unit
    return step
