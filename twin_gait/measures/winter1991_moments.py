"""Joint moments of healthy walking at slow cadence, after Winter (1991).

D. A. Winter: The biomechanics and motor control of human gait, 2nd edition, University of Waterloo Press,
1991: means over 19 subjects per body mass, every 2 % of the cycle from heel contact to the next. Winter
counts extensor moments positive; here flexor moments are, as everywhere in this package.
"""

from __future__ import annotations

import numpy as np

PERCENT_STEP = 2.0

# Extensor moments of hip and knee in [N m] / [kg].
_EXTENSOR_MOMENTS = (
    (0.179, -0.159),
    (0.385, -0.176),
    (0.252, 0.018),
    (0.208, 0.17),
    (0.19, 0.29),
    (0.169, 0.379),
    (0.125, 0.413),
    (0.07, 0.388),
    (0.025, 0.326),
    (0.02, 0.237),
    (0.032, 0.14),
    (0.013, 0.063),
    (-0.023, 0.002),
    (-0.055, -0.048),
    (-0.065, -0.096),
    (-0.059, -0.137),
    (-0.087, -0.143),
    (-0.118, -0.162),
    (-0.137, -0.184),
    (-0.144, -0.202),
    (-0.153, -0.219),
    (-0.171, -0.214),
    (-0.186, -0.233),
    (-0.197, -0.214),
    (-0.224, -0.168),
    (-0.244, -0.116),
    (-0.251, -0.054),
    (-0.231, 0.013),
    (-0.2, 0.066),
    (-0.178, 0.084),
    (-0.198, 0.096),
    (-0.169, 0.071),
    (-0.124, 0.039),
    (-0.104, 0.032),
    (-0.099, 0.031),
    (-0.097, 0.027),
    (-0.087, 0.015),
    (-0.072, -0.002),
    (-0.055, -0.018),
    (-0.031, -0.034),
    (-0.011, -0.047),
    (-0.01, -0.054),
    (-0.007, -0.062),
    (0.02, -0.074),
    (0.04, -0.084),
    (0.066, -0.102),
    (0.109, -0.132),
    (0.145, -0.158),
    (0.143, -0.161),
    (0.098, -0.13),
    (0.02, -0.073),
)
_JOINTS = ("hip", "knee")


def normative_moment(joint: str, percent: np.ndarray) -> np.ndarray:
    """Flexor moment of healthy slow walking per body mass.

    Args:
        joint: ``hip`` or ``knee``.
        percent: Of the gait cycle from foot contact, in [%], any shape.

    Returns:
        Moment in [N m] / [kg], the same shape.
    """
    table = -np.array(_EXTENSOR_MOMENTS)[:, _JOINTS.index(joint)]
    instants = PERCENT_STEP * np.arange(len(table))
    return np.asarray(np.interp(np.mod(percent, 100.0), instants, table))
