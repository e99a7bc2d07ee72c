"""Samples at a mechanical stop, which are no friction: hard stops by their impact, soft ones by their spring.

A hard stop shows as an acceleration that no drive makes. A soft one brakes gently. It shows on the way to the
end of the range, where the balance of torques becomes larger than it was anywhere before at such speeds, by
more than a wrong inertia could explain.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

_LONGEST = 200  # samples of an approach, of which the fastest is the first
_FEWEST = 10  # samples before the approach that a comparison needs
_FASTER = 1.25  # speeds up to so many times the present one are compared
_SLOW = 0.02  # [rad] / [s] up to which all speeds are alike
_USUAL = 0.95  # share of the torques before that are usual
_LEAST = 0.5  # [N m] beyond the usual that a spring must add
_OF_INERTIA = 0.5  # and the share of the torque of inertia, of which parameters are wrong by less


def hard_stop(
    angle: np.ndarray, acceleration: np.ndarray, *, limit: float, reach: int, window: int, margin: float
) -> np.ndarray:
    """Samples around an impact, and wherever the joint is as far as it was then.

    Args:
        angle: In [rad], shape ``(n,)``.
        acceleration: Its size in [rad] / [s²], shape ``(n,)``.
        limit: Beyond it the link has hit something.
        reach: Samples before and after an impact.
        window: Samples over which the direction of motion is taken.
        margin: Samples so near to where the stop was hit count too, in [rad].

    Returns:
        Mask, shape ``(n,)``.
    """
    hit = acceleration > limit
    around = widened(hit, max(reach, window))
    for index in np.flatnonzero(hit).tolist():
        direction = np.sign(angle[index] - angle[max(index - window, 0)])
        if direction:
            around |= direction * (angle - angle[index]) > -margin
    return around


def soft_stop(
    angle: np.ndarray, velocity: np.ndarray, torque: np.ndarray, inertial: np.ndarray, *, margin: float
) -> np.ndarray:
    """Samples at which a spring brakes the joint at an end of its range.

    Args:
        angle: In [rad], shape ``(n,)``.
        velocity: In [rad] / [s], shape ``(n,)``.
        torque: Balance of torques without the stop in [N m], shape ``(n,)``.
        inertial: What inertia takes of it in [N m], shape ``(n,)``.
        margin: As far before the contact count too, in [rad].

    Returns:
        Mask, shape ``(n,)``; empty if nothing at either end looks like a spring.
    """
    stopped = np.zeros(len(angle), dtype=bool)
    for direction in (1.0, -1.0):
        place = direction * angle
        contact = _contact(place, direction * velocity, direction * torque, np.abs(inertial))
        if contact is not None:
            stopped |= place > place[contact] - margin
    return stopped


def _contact(place: np.ndarray, speed: np.ndarray, torque: np.ndarray, inertial: np.ndarray) -> int | None:
    """Sample at which a spring is touched on the way to the farthest place; None if there is none."""
    end = int(np.argmax(place))
    start = max(end - _LONGEST, 0)
    peak = start + int(np.argmax(speed[start : end + 1]))
    before = np.flatnonzero(speed[:peak] > 0.0)
    if end - peak < 2 or len(before) < _FEWEST:
        return None
    excess = np.array(
        [
            torque[index] - _usual_torque(torque[before], speed[before], speed[index])
            for index in range(peak, end)
        ]
    )
    quiet = np.flatnonzero(excess <= np.maximum(_LEAST, _OF_INERTIA * inertial[peak:end]))
    first = int(quiet[-1]) + 1 if len(quiet) else 0
    return peak + first if first < len(excess) else None


def _usual_torque(torque: np.ndarray, speed: np.ndarray, present: float) -> float:
    """What 95 % of the torques before were below, at such speeds if there were enough of them."""
    alike = torque[speed < _FASTER * max(present, _SLOW)]
    return float(np.quantile(alike if len(alike) >= _FEWEST else torque, _USUAL))


def widened(mask: np.ndarray, by: int) -> np.ndarray:
    """Mask that also covers so many samples before and after.

    Args:
        mask: Shape ``(n,)``.
        by: Samples.

    Returns:
        Shape ``(n,)``.
    """
    if not mask.any() or by < 1:
        return mask
    return np.asarray(binary_dilation(mask, iterations=by))
