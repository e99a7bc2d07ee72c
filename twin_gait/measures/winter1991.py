"""Healthy walking after Winter (1991): angles at natural cadence, moments at slow cadence.

D. A. Winter: The biomechanics and motor control of human gait, 2nd edition, University of Waterloo Press,
1991: means over 19 subjects, every 2 % of the cycle from heel contact to the next. Duration and speed at
natural cadence are those that public copies of the table carry (105.3 steps a minute).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from twin_gait.measures.reference import CYCLE

CYCLE_TIME = 1.1396  # [s]
SPEED = 1.325  # [m] / [s]
JOINTS = ("hip", "knee")


@lru_cache(maxsize=1)
def _table() -> np.ndarray:
    """Percent, angles of hip and knee in [deg], their extensor moments in [N m] / [kg], shape (51, 5)."""
    table = np.loadtxt(Path(__file__).with_name("winter1991.csv"), delimiter=",", skiprows=4)
    table.setflags(write=False)
    return table


def normative_angle(joint: str, percent: np.ndarray) -> np.ndarray:
    """Angle in healthy walking at natural cadence.

    The means at 0 and 100 % differ by up to 1.8 degrees; the last one is left out, so that the cycle closes.

    Args:
        joint: ``hip`` or ``knee``.
        percent: Of the gait cycle from foot contact, in [%], any shape; the cycle repeats.

    Returns:
        Angle in [rad], flexion positive, the same shape.
    """
    from scipy.interpolate import CubicSpline  # takes longer to import than a walk to simulate

    degrees = _table()[:, 1 + JOINTS.index(joint)]
    closed = np.append(degrees[:-1], degrees[0])
    spline = CubicSpline(_table()[:, 0], np.radians(closed), bc_type="periodic")
    return np.asarray(spline(np.mod(percent, CYCLE)))


def normative_moment(joint: str, percent: np.ndarray) -> np.ndarray:
    """Flexor moment of healthy slow walking per body mass.

    Winter counts extensor moments positive; here flexor moments are, as everywhere in this package.

    Args:
        joint: ``hip`` or ``knee``.
        percent: Of the gait cycle from foot contact, in [%], any shape.

    Returns:
        Moment in [N m] / [kg], the same shape.
    """
    moments = -_table()[:, 3 + JOINTS.index(joint)]
    return np.asarray(np.interp(np.mod(percent, CYCLE), _table()[:, 0], moments))
