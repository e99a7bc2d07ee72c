"""The harness on the wearer's chest, and the ropes of the body-weight support that carry it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twin_gait.leg_model.wearer import TRUNK_LENGTH
from twin_gait.parameters import Patient
from twin_gait.viewer import shapes
from twin_gait.viewer.body import STRAP, band, trunk_axes, trunk_rings
from twin_gait.viewer.commands import Material
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.shapes import Shape

VEST = Material(colour=(0.40, 0.48, 0.60), opacity=0.92, roughness=0.9)
_VEST = (0.50, 0.80)  # around the chest, heights over the hips as shares of the trunk length
_HOOK = (0.0, 0.15, 1.12)  # forward and to the left [m] and height as above: where a rope meets its straps


def draw_harness(figure: Figure, patient: Patient, trunk_joint: str) -> list[np.ndarray]:
    """Draw a harness on the wearer's chest.

    Returns where the ropes meet its straps, in the frame of that joint in [m], shape ``(3,)`` each.
    """
    axes, rings, length = trunk_axes(figure), trunk_rings(patient), TRUNK_LENGTH * patient.height
    bottom, top = (share * length for share in _VEST)
    vest = band(rings[::-1], top, bottom, rings=6, columns=28)
    figure.draw(trunk_joint, "harness_vest", shapes.moved(vest, axes), VEST)
    x, y, share = _HOOK
    hooks = [np.array([x, side * y, share * length]) for side in (1.0, -1.0)]
    straps = [_shoulder_strap(hook, front, rings, top) for hook in hooks for front in (1.0, -1.0)]
    figure.draw(trunk_joint, "harness_straps", shapes.moved(shapes.merged(straps), axes), STRAP)
    return [axes[:3, :3] @ hook for hook in hooks]


def _shoulder_strap(hook: np.ndarray, front: float, rings: np.ndarray, height: float) -> Shape:
    """From the hook of a rope to the front (1) or the back (-1) of the vest, over the shoulder."""
    x, _, half_x, half_y = (float(np.interp(height, rings[:, 0], rings[:, column])) for column in range(1, 5))
    angle = math.radians(52.0)
    end = [x + front * half_x * math.sin(angle), math.copysign(half_y * math.cos(angle), hook[1]), height]
    middle = 0.5 * (hook + end) + [front * 0.035, 0.0, 0.02]
    share = np.linspace(0.0, 1.0, 9)[:, None]
    path = (1 - share) ** 2 * hook + 2 * share * (1 - share) * middle + share**2 * np.array(end)
    return shapes.tube(path, 0.007, columns=6)


ROPES = "/meshcat/ropes"
_ROPE_RADIUS = 0.006  # [m]
ROPE = Material(colour=(0.40, 0.45, 0.53), roughness=0.9)


@dataclass(frozen=True)
class Rope:
    """A rope."""

    path: str  # its place in the scene
    joint: str  # joint that carries its lower end
    lower: np.ndarray  # lower end in the frame of that joint in [m], shape ``(3,)``
    upper: np.ndarray  # upper end in the scene in [m], shape ``(3,)``
    on_rail: bool = False  # whether the upper end follows along x

    def state(self, figure: Figure, q: np.ndarray) -> dict[tuple[str, str], Any]:
        """Where the rope is when the figure stands in a posture. ``q``: coordinates, shape ``(nq,)``."""
        lower = figure.world_point(q, self.joint, self.lower)
        upper = np.array([lower[0], *self.upper[1:]]) if self.on_rail else self.upper
        span = upper - lower
        length = float(np.linalg.norm(span))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), span / length)
        return {
            (self.path, "position"): [float(value) for value in lower],
            (self.path, "quaternion"): [float(value) for value in turn.coeffs()],
            (self.path, "scale"): [1.0, 1.0, length],
        }


def rope_shape() -> Shape:
    """Make a rope of 1 m from the origin along z; its length is the scale along z."""
    return shapes.turned([(0.0, 0.0), (_ROPE_RADIUS, 0.0), (_ROPE_RADIUS, 1.0), (0.0, 1.0)], columns=8)
