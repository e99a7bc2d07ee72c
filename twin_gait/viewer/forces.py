"""Arrows of the forces of the ground."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import GROUND_FORCE_COLOUR
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import METRES_PER_NEWTON, Material, Window, draw_lightly, rgb, set_property

FORCE_ROOT = "/meshcat/forces"
_LONGEST_ARROW = 1.2  # [m]


def draw_arrow(window: Window, name: str) -> str:
    """Draw an arrow, hidden."""
    path = f"{FORCE_ROOT}/{name}"
    material = Material(colour=rgb(GROUND_FORCE_COLOUR), roughness=0.8, glow=0.2)
    draw_lightly(window, path, shapes.arrow(), material)
    window.send(set_property(path, "visible", False))
    return path


def arrow_state(path: str, force: np.ndarray, point: np.ndarray) -> dict[tuple[str, str], Any]:
    """An arrow as long as its force, seen while there is contact.

    ``force``: forward and upward in [N], shape ``(2,)``; ``point``: where it begins in [m], shape ``(3,)``.
    """
    forward, upward = float(force[0]), float(force[1])
    visible = upward > CONTACT_FORCE
    length = float(np.clip(np.hypot(forward, upward) * METRES_PER_NEWTON, 1e-3, _LONGEST_ARROW))
    width = float(np.clip(length / 0.2, 0.3, 1.0))
    half = 0.5 * np.arctan2(forward, upward) if visible else 0.0
    return {
        (path, "visible"): visible,
        (path, "position"): [float(value) for value in point],
        (path, "quaternion"): [0.0, float(np.sin(half)), 0.0, float(np.cos(half))],
        (path, "scale"): [width, width, length],
    }
