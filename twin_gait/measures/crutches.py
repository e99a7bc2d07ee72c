"""What arms do on crutches."""

from __future__ import annotations

import numpy as np
import pandas as pd

from twin_gait.vocabulary import Side


def arm_work(log: pd.DataFrame, side: Side, shoulder_height: float) -> np.ndarray:
    r"""Work of an arm since the start, along the strut from shoulder to tip and about the shoulder.

    .. math::

        W = \int P\,d\ell + \int M\,d\varphi

    with the strut's length ℓ and its angle φ against the trunk, forwards positive.

    Args:
        log: One row per tick, with the columns of crutches and of a free trunk.
        side: The arm.
        shoulder_height: Of the shoulder above the hips, along the trunk, in [m].

    Returns:
        In [J], positive where the arm gives work to trunk and crutch, shape ``(n,)``.
    """
    lean = log["trunk_pitch_rad"].to_numpy()
    ahead = log[f"{side}_crutch_forward_m"] - log["pelvis_forward_m"] - shoulder_height * np.sin(lean)
    down = log["pelvis_height_m"] + shoulder_height * np.cos(lean) - log[f"{side}_crutch_height_m"]
    length, angle = np.hypot(ahead, down).to_numpy(), np.arctan2(ahead, down).to_numpy() + lean
    work = np.zeros(len(log))
    for force, way in (("arm_push_N", length), ("shoulder_moment_Nm", angle)):
        values = log[f"{side}_{force}"].to_numpy()
        work[1:] += np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(way))
    return work
