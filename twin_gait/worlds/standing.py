"""How legs come to stand on the ground at the start."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from twin_gait.leg_model import LegModel
from twin_gait.parameters import require
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.scenario import Posture, Scenario

# A drop of the pelvis by this share of the leg length (hip to sole) at the start counts as a fall.
FALL_SHARE = 0.75


class SplitStance(Scenario):
    """A world in which two legs start on the ground, one in front of the other.

    What is declared here are fields that such a world has.
    """

    leading: Side  # Leg that starts in front.
    leading_angles: Posture  # Of its joints at the start in [rad].
    trailing_angles: Posture  # Of the joints of the other leg in [rad].
    leading_phase: str  # Of the leading leg at the start.
    trailing_phase: str  # Of the other one.

    def leading_of(self, sides: Sequence[Side]) -> Side:
        """Leg that starts in front."""
        return self.leading

    def starting_in(self, postures: Mapping[Side, Posture]) -> Self:
        """The same world under legs that start in other postures."""
        trailing = next(angles for side, angles in postures.items() if side is not self.leading)
        changed = {"leading_angles": postures[self.leading], "trailing_angles": trailing}
        return replace(self, **changed)

    def postures(self, slope: float = 0.0) -> dict[Side, Posture]:
        """Angles of both legs at the start, turned with the ground about the hips by a slope in [rad]."""
        found: dict[Side, Posture] = {}
        for side in Side:
            angles = self.leading_angles if side is self.leading else self.trailing_angles
            found[side] = {**angles, JointName.HIP: angles.get(JointName.HIP, 0.0) + slope}
        return found

    @property
    def phases(self) -> dict[Side, str]:
        """Phases of both legs at the start."""
        return {side: self.leading_phase if side is self.leading else self.trailing_phase for side in Side}


def soles_of(model: LegModel, ground: str) -> dict[Side, tuple[str, ...]]:
    """Frames of heels and toes of two legs that are put on some ground; ParameterError without them."""
    require(len(model.legs) == 2, "legs", f"two legs on {ground}", len(model.legs))
    require(model.up_axis == "z", "up_axis", f"z on {ground}", model.up_axis)
    frames = {side: leg.contact_frames for side, leg in model.legs.items()}
    require(all(frames.values()), "contact_frames", "heel and toe frames on both feet", frames)
    return frames


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
