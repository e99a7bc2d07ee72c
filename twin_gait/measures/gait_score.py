r"""How far a gait is from that of healthy people: the Gait Variable Score.

.. math::

    \mathrm{GVS}_i = \sqrt{\frac{1}{T} \sum_{t=1}^{T} (x_{i,t} - \bar x^{ref}_{i,t})^2}, \qquad
    \mathrm{mean} = \sqrt{\frac{1}{N} \sum_{i=1}^{N} \mathrm{GVS}_i^2}

after R. Baker, J. L. McGinley, M. H. Schwartz, S. Beynon, A. Rozumalski, H. K. Graham, O. Tirosh: The Gait
Profile Score and Movement Analysis Profile, Gait & Posture 30 (2009) 265-269. Theirs has nine variables; a
device that moves hips and knees has two a side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def gait_variable_score(cycles: np.ndarray, reference: np.ndarray) -> float:
    """Root mean square distance of the mean stride from a reference.

    The mean stride is compared, not each stride: what differs from stride to stride is no part of it.

    Args:
        cycles: One joint angle over the cycle, a row a stride, last sample that of the next stride, shape
            ``(n_strides, n_samples)``.
        reference: Curve at the same instants, shape ``(n_samples,)``, same unit.

    Returns:
        The score in the unit of the curves; NaN without strides.
    """
    if len(cycles) == 0:
        return math.nan
    difference = (cycles.mean(axis=0) - reference)[:-1]
    return float(np.sqrt(np.mean(difference * difference)))


def gait_profile_score(scores: Sequence[float]) -> float:
    """Root mean square of the scores of several joints.

    Args:
        scores: Gait Variable Scores in one unit.

    Returns:
        The score in the same unit; NaN without any.
    """
    if len(scores) == 0:
        return math.nan
    return math.sqrt(sum(score * score for score in scores) / len(scores))
