"""How legs come to stand on the ground at the start."""

from collections.abc import Callable

import numpy as np

from twin_gait.leg_model import LegModel
from twin_gait.vocabulary import JointName, Side

# A drop of the pelvis by this share of the leg length (hip to sole) at the start counts as a fall.
FALL_SHARE = 0.75


def stand_on_both_feet(model: LegModel, q: np.ndarray, rise: float) -> float:
    """Bend the ankle of the foot that reaches lower until both feet stand on the ground.

    ``q``: coordinates with the hips in the origin, shape ``(nv,)``; the ankle is changed in place. ``rise``:
    of the ground, height over way. Returns the height of the hips in [m].
    """
    reach = {side: _lowest_point(model, side, q, rise) for side in model.sides}
    lower, higher = sorted(model.sides, key=lambda side: reach[side])
    if model.legs[lower].ankle is None:
        return -reach[lower]
    ankle = model.index(lower, JointName.ANKLE)
    rest = float(q[ankle])
    limit = model.position_limits(lower, JointName.ANKLE)[1]

    def gap(angle: float) -> float:
        bent = q.copy()
        bent[ankle] = angle
        return _lowest_point(model, lower, bent, rise) - reach[higher]

    # Dorsiflexion lifts the toe; if even the stop does not level the feet, one starts in the air.
    q[ankle] = _bisect(gap, rest, limit) if gap(rest) < 0.0 < gap(limit) else rest
    return -min(_lowest_point(model, side, q, rise) for side in model.sides)


def _bisect(rising: Callable[[float], float], low: float, high: float) -> float:
    """Root of a function that is negative at one end and positive at the other.

    Written out because importing scipy.optimize takes longer than a compiled run.
    """
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        low, high = (middle, high) if rising(middle) < 0.0 else (low, middle)


def _lowest_point(model: LegModel, side: Side, q: np.ndarray, rise: float) -> float:
    """Least height of a foot over ground through the origin, vertically."""
    points = (model.frame_position(q, name) for name in model.legs[side].contact_frames)
    return min(float(point[2] - rise * point[0]) for point in points)
