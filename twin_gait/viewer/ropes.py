"""Ropes that carry the wearer: from the harness, which moves, to an overhead bar, which does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.shapes import Shape

ROOT = "/meshcat/ropes"
RADIUS = 0.006  # [m]
MATERIAL = Material(colour=(0.40, 0.45, 0.53), roughness=0.9)


@dataclass(frozen=True)
class Rope:
    """A rope.

    Attributes:
        path: Its place in the scene.
        joint: Joint that carries its lower end.
        lower: Lower end in the frame of that joint in [m], shape ``(3,)``.
        upper: Upper end in the scene in [m], shape ``(3,)``.
    """

    path: str
    joint: str
    lower: np.ndarray
    upper: np.ndarray

    def state(self, figure: Figure, q: np.ndarray) -> dict[tuple[str, str], Any]:
        """Where the rope is when the figure stands in a posture.

        Args:
            figure: The articulated figure.
            q: Coordinates, shape ``(nq,)``.

        Returns:
            Values by place and property.
        """
        lower = figure.world_point(q, self.joint, self.lower)
        span = self.upper - lower
        length = float(np.linalg.norm(span))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), span / length)
        return {
            (self.path, "position"): [float(value) for value in lower],
            (self.path, "quaternion"): [float(value) for value in turn.coeffs()],
            (self.path, "scale"): [1.0, 1.0, length],
        }


def rope_shape() -> Shape:
    """Make a rope of 1 m from the origin along z; its length is the scale along z."""
    return shapes.turned([(0.0, 0.0), (RADIUS, 0.0), (RADIUS, 1.0), (0.0, 1.0)], columns=8)
