"""Filters of recorded signals, and detection of samples at a mechanical stop, which are not friction.

Hard stops are detected by their impact: an acceleration that no drive can produce. A soft stop brakes gently.
It is detected on the way to the end of the range, where the balance of torques becomes larger than it was
before at similar speeds, by more than a wrong inertia could explain.
"""

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation
from scipy.signal import butter, sosfiltfilt

ORDER = 2  # order of the Butterworth filter; running forwards and backwards doubles its effect


def zero_phase(values: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Filter evenly sampled values without delay: Butterworth low-pass, forwards and backwards.

    ``values``: shape ``(n,)``. ``cutoff``: cutoff frequency of one pass in [Hz]; half the amplitude is left
    there. ``rate``: samples per second in [Hz], above twice the cutoff. Returns shape ``(n,)``.
    """
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    padding = min(len(values) - 1, int(3.0 * rate / cutoff))
    return np.asarray(sosfiltfilt(sections, values, padlen=padding))


def moving_average(values: np.ndarray, window: int) -> np.ndarray:
    """Compute the mean of the last ``window`` samples, equation (2.9); of fewer samples at the beginning.

    The mean is late by (window - 1)/2 samples.
    """
    return pd.Series(values).rolling(window, min_periods=1).mean().to_numpy()


_IMPACT = 25.0  # [rad/s²], acceleration beyond which the link has hit a stop
_MARGIN = 0.01  # [rad], distance before a stop within which samples count as at the stop
_APPROACH = 10  # samples from which the direction of an impact is determined
_LONGEST = 200  # largest number of samples of an approach, whose first sample is the fastest
_FEWEST = 10  # least number of samples before the approach for a comparison
_FASTER = 1.25  # ratio to the present speed up to which speeds are compared
_SLOW = 0.02  # [rad/s], speed up to which all speeds are considered equal
_USUAL = 0.95  # share of the torques before that are usual
_LEAST = 0.5  # [N·m], least torque of a spring beyond the usual torque
_INERTIA_SHARE = 0.5  # least torque of a spring as a share of the torque of inertia, whose error is smaller


def hard_stop(angle: np.ndarray, acceleration: np.ndarray, reach: int) -> np.ndarray:
    """Mark samples around an impact, and those with the joint as far as at the impact; mask ``(n,)``.

    ``angle`` in [rad], shape ``(n,)``. ``acceleration``: its magnitude in [rad/s²], shape ``(n,)``.
    ``reach``: samples before and after an impact over which the filter spreads it.
    """
    hit = acceleration > _IMPACT
    around = widened(hit, max(reach, _APPROACH))
    for index in np.flatnonzero(hit).tolist():
        direction = np.sign(angle[index] - angle[max(index - _APPROACH, 0)])
        if direction:
            around |= direction * (angle - angle[index]) > -_MARGIN
    return around


def soft_stop(
    angle: np.ndarray, velocity: np.ndarray, torque: np.ndarray, inertial: np.ndarray
) -> np.ndarray:
    """Mark samples at which a spring brakes the joint at an end of its range; mask ``(n,)``.

    ``angle`` in [rad], shape ``(n,)``. ``velocity`` in [rad/s]. ``torque``: balance of torques without
    the stop in [N·m]. ``inertial``: torque of inertia in this balance in [N·m].
    """
    stopped = np.zeros(len(angle), dtype=bool)
    for direction in (1.0, -1.0):
        position = direction * angle
        contact = _contact(position, direction * velocity, direction * torque, np.abs(inertial))
        if contact is not None:
            stopped |= position > position[contact] - _MARGIN
    return stopped


def _contact(position: np.ndarray, speed: np.ndarray, torque: np.ndarray, inertial: np.ndarray) -> int | None:
    """Find the sample at which a spring is touched on the way to the farthest place; None without one."""
    end = int(np.argmax(position))
    start = max(end - _LONGEST, 0)
    peak = start + int(np.argmax(speed[start : end + 1]))
    before = np.flatnonzero(speed[:peak] > 0.0)
    if end - peak < 2 or len(before) < _FEWEST:
        return None
    for sample in reversed(range(peak, end)):  # the last sample without braking is found after a few steps
        # The usual torque is the 95 % quantile of the torques before, at similar speeds if there are enough.
        alike = before[speed[before] < _FASTER * max(speed[sample], _SLOW)]
        usual = np.quantile(torque[alike if len(alike) >= _FEWEST else before], _USUAL)
        excess = float(torque[sample] - usual)
        if excess <= max(_LEAST, _INERTIA_SHARE * inertial[sample]):
            return sample + 1 if sample + 1 < end else None
    return peak


def widened(mask: np.ndarray, by: int) -> np.ndarray:
    """Extend a mask by a number of samples before and after."""
    return np.asarray(binary_dilation(mask, iterations=by))
