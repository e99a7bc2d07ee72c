"""The thesis's post-processing and its zero-phase alternative."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

ORDER = 2  # of the Butterworth filter; run forwards and backwards it acts twice


def zero_phase(values: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Low-pass filter without delay: Butterworth, forwards and backwards.

    Args:
        values: Evenly sampled, shape ``(n,)``.
        cutoff: Of one pass in [Hz]; half the amplitude is left there.
        rate: Samples per second in [Hz], above twice the cutoff.

    Returns:
        Shape ``(n,)``.
    """
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    padding = min(len(values) - 1, int(3.0 * rate / cutoff))
    return np.asarray(sosfiltfilt(sections, values, padlen=padding))


def decimate(values: np.ndarray, factor: int) -> np.ndarray:
    """Every so many samples, with no filter before it: the thesis's undersampling."""
    return values[::factor]


def moving_average(values: np.ndarray, window: int) -> np.ndarray:
    """Mean of the last samples, equation (2.9); of those there are at the beginning.

    Args:
        values: Shape ``(n,)``.
        window: How many.

    Returns:
        Shape ``(n,)``; late by (window - 1)/2 samples.
    """
    total = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - window, 0)
    return np.asarray((total[last] - total[first]) / (last - first))


def forward_difference(values: np.ndarray, period: float) -> np.ndarray:
    """Derivative by the sample after, equation (2.10); the last one is repeated.

    Args:
        values: Evenly sampled, shape ``(n,)``, at least two.
        period: Between the samples in [s].

    Returns:
        Shape ``(n,)``, per second.
    """
    steps = np.diff(values) / period
    return np.append(steps, steps[-1])
