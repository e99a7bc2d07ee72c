"""The path of a foot over its last stride, coloured by the phases of its leg."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin_gait.palette import phase_colour
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, rgb
from twin_gait.viewer.motion import PhaseSpells
from twin_gait.viewer.shapes import Shape

ROOT = "/meshcat/trail"
LONGEST_TRAIL = 60  # points; a stride with more frames is thinned
MOST_STRIDES = 20  # of a leg that are drawn, so that a page stays small
FEWEST_POINTS = 4
LOWEST = 0.008  # height of the path over the belt [m], so that it is seen
MATERIAL = Material(colour=(1.0, 1.0, 1.0), roughness=0.9)
_RADIUS = 0.006  # [m]
_COLUMNS = 5
_SHORTEST_STEP = 1e-3  # [m]


@dataclass(frozen=True)
class StrideTrail:
    """The path of a stride, shown until the next stride is complete."""

    path: str  # its place in the scene
    begin: float  # time at which the stride was complete in [s]
    end: float  # time at which the next one is, in [s]

    def state(self, time: float) -> dict[tuple[str, str], bool]:
        """Whether the path is shown at a time in [s], by place and property."""
        return {(self.path, "visible"): self.begin <= time < self.end}


def strides(phases: PhaseSpells | None, duration: float) -> list[tuple[float, float]]:
    """Strides from one entry into the first phase of the table to the next.

    ``phases``: phases of a leg, or None if they are not known; ``duration`` of the motion in [s]. Returns
    start and end of each complete stride in [s].
    """
    if phases is None:
        return []
    entries = [float(start) for start, code in zip(*phases, strict=True) if code == 0 and start > 0.0]
    return [(start, end) for start, end in pairwise(entries) if end <= duration]


def trail_shape(
    times: np.ndarray, points: np.ndarray, phases: PhaseSpells, names: Sequence[str]
) -> Shape | None:
    """Make the tube along a path.

    ``times`` of the frames in [s], shape ``(n,)``; ``points`` of the path in [m], shape ``(n, 3)``;
    ``names``: phases in the order of their codes. Returns the mesh with the colour of the phase at each
    point, or None if the point hardly moves.
    """
    keep = np.unique(np.linspace(0, len(times) - 1, min(len(times), LONGEST_TRAIL)).round().astype(int))
    keep = keep[_steps_apart(points[keep])]
    if len(keep) < FEWEST_POINTS:
        return None
    tube = shapes.tube(points[keep], _RADIUS, _COLUMNS)
    codes = [phases.at(float(time)) for time in times[keep]]
    colours = np.array([rgb(phase_colour(names[code], code)) for code in codes])
    rings = np.repeat(colours, _COLUMNS + 1, axis=0)
    ends = np.repeat(colours[[0, -1]], _COLUMNS + 2, axis=0)
    return tube._replace(colours=np.concatenate((rings, ends)))


def _steps_apart(points: np.ndarray) -> np.ndarray:
    """Positions of points that are not at the place of the one before."""
    kept = [0]
    for index in range(1, len(points)):
        if np.linalg.norm(points[index] - points[kept[-1]]) > _SHORTEST_STEP:
            kept.append(index)
    return np.array(kept)
