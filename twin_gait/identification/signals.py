"""Filters of recorded signals, and samples at a mechanical stop, which are no friction.

Hard stops show by their impact: an acceleration that no drive makes. A soft one brakes gently. It shows on
the way to the end of the range, where the balance of torques becomes larger than it was before at such
speeds, by more than a wrong inertia could explain.
"""

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation
from scipy.signal import butter, sosfiltfilt

ORDER = 2  # of the Butterworth filter; run forwards and backwards it acts twice


def zero_phase(values: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Low-pass filter without delay: Butterworth, forwards and backwards, of evenly sampled values.

    ``values``: shape ``(n,)``. ``cutoff``: of one pass in [Hz]; half the amplitude is left there. ``rate``:
    samples per second in [Hz], above twice the cutoff.
    """
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    padding = min(len(values) - 1, int(3.0 * rate / cutoff))
    return np.asarray(sosfiltfilt(sections, values, padlen=padding))


def moving_average(values: np.ndarray, window: int) -> np.ndarray:
    """Mean of the last ``window`` samples, equation (2.9); of those there are at the beginning.

    It is late by (window - 1)/2 samples.
    """
    return pd.Series(values).rolling(window, min_periods=1).mean().to_numpy()


_IMPACT = 25.0  # [rad] / [s²] beyond which the link has hit a stop
_MARGIN = 0.01  # [rad] before the place of a stop that count as at the stop
_APPROACH = 10  # samples over which the direction of an impact is taken
_LONGEST = 200  # samples of an approach, of which the fastest is the first
_FEWEST = 10  # samples before the approach that a comparison needs
_FASTER = 1.25  # speeds up to so many times the present one are compared
_SLOW = 0.02  # [rad] / [s] up to which all speeds are alike
_USUAL = 0.95  # share of the torques before that are usual
_LEAST = 0.5  # [N m] beyond the usual that a spring must add
_OF_INERTIA = 0.5  # and the share of the torque of inertia, of which parameters are wrong by less


def hard_stop(angle: np.ndarray, acceleration: np.ndarray, reach: int) -> np.ndarray:
    """Mask of samples around an impact, and wherever the joint is as far as it was then, shape ``(n,)``.

    ``angle``: in [rad], shape ``(n,)``. ``acceleration``: its size in [rad] / [s²], shape ``(n,)``.
    ``reach``: samples before and after an impact that the filter spreads it over.
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
    """Mask of samples at which a spring brakes the joint at an end of its range, shape ``(n,)``.

    ``angle``: in [rad], shape ``(n,)``. ``velocity``: in [rad] / [s]. ``torque``: balance of torques without
    the stop in [N m]. ``inertial``: what inertia takes of it in [N m].
    """
    stopped = np.zeros(len(angle), dtype=bool)
    for direction in (1.0, -1.0):
        place = direction * angle
        contact = _contact(place, direction * velocity, direction * torque, np.abs(inertial))
        if contact is not None:
            stopped |= place > place[contact] - _MARGIN
    return stopped


def _contact(place: np.ndarray, speed: np.ndarray, torque: np.ndarray, inertial: np.ndarray) -> int | None:
    """Sample at which a spring is touched on the way to the farthest place; None if there is none."""
    end = int(np.argmax(place))
    start = max(end - _LONGEST, 0)
    peak = start + int(np.argmax(speed[start : end + 1]))
    before = np.flatnonzero(speed[:peak] > 0.0)
    if end - peak < 2 or len(before) < _FEWEST:
        return None
    for sample in reversed(range(peak, end)):  # the last one that nothing brakes is soon found
        # What 95 % of the torques before were below, at such speeds if there were enough of them.
        alike = before[speed[before] < _FASTER * max(speed[sample], _SLOW)]
        usual = np.quantile(torque[alike if len(alike) >= _FEWEST else before], _USUAL)
        excess = float(torque[sample] - usual)
        if excess <= max(_LEAST, _OF_INERTIA * inertial[sample]):
            return sample + 1 if sample + 1 < end else None
    return peak


def widened(mask: np.ndarray, by: int) -> np.ndarray:
    """Mask that also covers so many samples before and after."""
    return np.asarray(binary_dilation(mask, iterations=by))
