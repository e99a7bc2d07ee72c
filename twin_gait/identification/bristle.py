"""The state of the dynamic friction models along recorded tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numba
import numpy as np

from twin_gait.core.friction_models import bristle_step
from twin_gait.simulation.compiling import register_core


def bristle_deflection(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Deflection of the bristles at every sample.

    The velocity holds from the sample before to the sample. A test starts with straight bristles; what is
    left of another start is :func:`remembered_start`.

    Args:
        velocity: In [rad] / [s], shape ``(n,)``.
        period: Since the sample before in [s], shape ``(n,)``.
        fresh: Where a test starts, shape ``(n,)``; true at the first sample.
        level: g of :func:`twin_gait.core.friction_models.bristle_rate` in [N m], shape ``(n,)``.
        stiffness: σ0 in [N m] / [rad].

    Returns:
        Deflection in [rad], shape ``(n,)``.
    """
    return np.asarray(_loop()(velocity, period, fresh, level, stiffness))


def remembered_start(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Share of the deflection at the start of a test that is left at every sample: the law is linear in it.

    Args:
        velocity: In [rad] / [s], shape ``(n,)``.
        period: Since the sample before in [s], shape ``(n,)``.
        fresh: Where a test starts, shape ``(n,)``; true at the first sample.
        level: In [N m], shape ``(n,)``.
        stiffness: σ0 in [N m] / [rad].

    Returns:
        From 1 at the start towards 0, shape ``(n,)``.
    """
    travelled = np.cumsum(np.where(fresh, 0.0, stiffness * np.abs(velocity) * period / level))
    return np.asarray(np.exp(-(travelled - travelled[start_of(fresh)])))


def start_of(fresh: np.ndarray) -> np.ndarray:
    """Index of the first sample of the test of each sample."""
    return np.asarray(np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0)))


@lru_cache(maxsize=1)
def _loop() -> Callable[..., np.ndarray]:
    register_core()
    compiled: Callable[..., np.ndarray] = numba.njit(_deflections)
    return compiled


def _deflections(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    deflection = np.empty(len(velocity))
    z = 0.0
    for i in range(len(velocity)):
        if fresh[i]:
            z = 0.0
        else:
            z = bristle_step(velocity[i], z, level[i], stiffness, period[i])
        deflection[i] = z
    return deflection
