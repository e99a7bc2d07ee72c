"""The other leg of a one-legged log: the same, half a stride later."""

from __future__ import annotations

import math

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.gait.table import TICK
from twin_gait.replay.recording import Recording
from twin_gait.vocabulary import Side

SHORTEST_STRIDE, LONGEST_STRIDE = 0.6, 6.0  # [s]
LEAST_CORRELATION = 0.5  # of a walk with itself one stride later
NEARLY_BEST = 0.95


def mirrored(recording: Recording, period: float | None = None) -> Recording:
    """Make the leg that was not recorded: the recorded one half a stride earlier.

    The first half stride has no such partner and is cut off.

    Args:
        recording: A walk with one leg.
        period: Stride time in [s]; None finds it in the angles.

    Returns:
        The walk with both legs.

    Raises:
        ParameterFileError: If both legs are there, or the period does not fit the record.
    """
    if len(recording.sides) != 1:
        raise ParameterFileError(recording.source, "mirror", "both legs are in the log; leave --mirror out")
    (side,) = recording.sides
    period = stride_period(recording) if period is None else period
    longest = recording.n_ticks * TICK
    if not (math.isfinite(period) and 2 * TICK <= period <= longest):
        raise ParameterFileError(
            recording.source, "mirror", f"expected a stride time of at most {longest:g} s, got {period:g}"
        )
    half = round(0.5 * period / TICK)
    other = Side.RIGHT if side is Side.LEFT else Side.LEFT

    def both(values: np.ndarray) -> dict[Side, np.ndarray]:
        pair = {side: values[half:], other: values[:-half]}
        return {item: pair[item] for item in Side}

    angles: dict[Side, dict[str, np.ndarray]] = {item: {} for item in Side}
    for joint, values in recording.angles[side].items():
        for item, part in both(values).items():
            angles[item][joint] = part
    loads = both(recording.loads[side]) if recording.loads else {}
    phases = both(recording.phases[side]) if recording.phases else {}
    return Recording(recording.source, recording.start + half * TICK, angles, loads, phases)


def stride_period(recording: Recording) -> float:
    """Find the stride time: the shift at which the angles of a leg are most like themselves.

    Args:
        recording: A walk; its first leg is looked at.

    Returns:
        In [s].

    Raises:
        ParameterFileError: If the angles do not repeat between 0.6 and 6 s.
    """
    joints = next(iter(recording.angles.values()))
    signals = [values - values.mean() for values in joints.values()]
    total = sum(_autocorrelation(values) for values in signals if values.std() > 0.0)
    if isinstance(total, np.ndarray):
        first = round(SHORTEST_STRIDE / TICK)
        end = min(round(LONGEST_STRIDE / TICK), recording.n_ticks // 2)
        peaks = [
            lag
            for lag in range(first, end)
            if total[lag - 1] < total[lag] >= total[lag + 1] and total[lag] >= LEAST_CORRELATION * total[0]
        ]
        if peaks:
            # Two strides later a walk is just as much like itself: the first good peak is the stride.
            best = max(float(total[lag]) for lag in peaks)
            return next(lag for lag in peaks if total[lag] >= NEARLY_BEST * best) * TICK
    raise ParameterFileError(
        recording.source,
        "mirror",
        f"the angles do not repeat between {SHORTEST_STRIDE:g} and {LONGEST_STRIDE:g} s over two strides; "
        "state the stride time: --mirror SECONDS",
    )


def _autocorrelation(values: np.ndarray) -> np.ndarray:
    """Mean product of a signal with itself at every shift up to half its length, over that at none."""
    n = len(values)
    spectrum = np.fft.rfft(values, 2 * n)
    product = np.fft.irfft(spectrum * spectrum.conj())[: n // 2 + 1]
    mean = product / (n - np.arange(len(product)))
    return np.asarray(mean / mean[0])
