"""Whether the books balance: energy of the leg against the work done on it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class EnergyBalance(NamedTuple):
    """Balance of a run.

    Attributes:
        residual: Change of energy less the work of all sources since the start in [J], shape ``(n,)``.
        largest_residual: Largest magnitude of it in [J].
        throughput: All work in and out: the sum over ticks and sources of its magnitude in [J].
        relative_residual: Largest residual over throughput.
    """

    residual: np.ndarray
    largest_residual: float
    throughput: float
    relative_residual: float


def energy_balance(energy: np.ndarray, works: np.ndarray) -> EnergyBalance:
    """Compare the change of energy with the work of all sources.

    Args:
        energy: Kinetic and potential energy in [J], shape ``(n,)``.
        works: Work done since some instant by every source in [J], shape ``(n_sources, n)``.

    Returns:
        The balance; NaN where the record is empty or nothing was done.
    """
    if len(energy) == 0:
        return EnergyBalance(np.zeros(0), math.nan, math.nan, math.nan)
    work = works.sum(axis=0)
    residual = (energy - energy[0]) - (work - work[0])
    largest = float(np.max(np.abs(residual)))
    throughput = float(np.sum(np.abs(np.diff(works, axis=1))))
    relative = largest / throughput if throughput > 0.0 else math.nan
    return EnergyBalance(residual, largest, throughput, relative)
