"""Endings of the motion of a released joint: rest, a limit cycle, or a runaway into its stops."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

STILL = math.radians(0.01)  # a motion smaller than this is rest
DIES_OUT = 0.8  # and so is one that has become smaller by this from one of two spans to the other


class Ending(StrEnum):
    """Ending of a motion."""

    REST = "rest"  # still, creeping or dying out
    LIMIT_CYCLE = "limit cycle"  # inside the stops
    RUNAWAY = "runaway"  # into a stop


def classify(before: np.ndarray, end: np.ndarray, *, at_stop: bool) -> tuple[Ending, float]:
    """Classify the ending of a motion from two spans of equal length at its end.

    Args:
        before: Angles in the span before the last in [rad], shape ``(n_ticks, n_joints)``.
        end: Angles in the last span.
        at_stop: Whether a stop was touched.

    Returns:
        The ending, and half the range of the joint that moves most in the last span in [rad].
    """
    joint = int(np.argmax(np.ptp(end, axis=0)))
    amplitude, earlier = 0.5 * float(np.ptp(end[:, joint])), 0.5 * float(np.ptp(before[:, joint]))
    if at_stop:
        return Ending.RUNAWAY, amplitude
    steps = np.diff(end[:, joint])
    creeps = bool((steps >= 0.0).all() or (steps <= 0.0).all())
    rests = amplitude < STILL or creeps or amplitude < DIES_OUT * earlier
    return (Ending.REST if rests else Ending.LIMIT_CYCLE), amplitude
