"""Arrows of ground forces and of motor torques around a joint; their lengths show the magnitudes."""

import math
from collections.abc import Mapping

import numpy as np

from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import EXTENSION_COLOUR, FLEXION_COLOUR, GROUND_FORCE_COLOUR
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import CommandBuffer, Material, SceneState, draw_mesh, rgb, set_property
from twin_gait.viewer.shapes import Shape

# Scales of the arrows, which the scene uses and the legend of the page states.
METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
FULL_TORQUE = 60.0  # [N·m], torque of the longest arrow: about the largest torque in a step of the presets
FORCE_ROOT = "/meshcat/forces"
_LONGEST_ARROW = 1.2  # [m]
LEVELS = 6  # number of meshes of different length for each sign of the torque
_ARC_RADIUS = 0.1  # [m], radius of these meshes
_ARROW = ((0.0, 0.0), (0.012, 0.0), (0.012, 0.8), (0.031, 0.8), (0.0, 1.0))  # (radius, height) for 1 m


def draw_arrow(window: CommandBuffer, name: str) -> str:
    """Draw a hidden arrow, and return its path in the scene."""
    path = f"{FORCE_ROOT}/{name}"
    material = Material(colour=rgb(GROUND_FORCE_COLOUR), roughness=0.8, glow=0.2)
    draw_mesh(window, path, shapes.revolve(_ARROW, columns=24), material)
    window.send(set_property(path, "visible", False))
    return path


def arrow_state(path: str, force: np.ndarray, point: np.ndarray) -> SceneState:
    """Return the state of an arrow whose length is proportional to its force; it is visible during contact.

    ``force``: forward and upward in [N], shape ``(2,)``; ``point``: its start in [m], shape ``(3,)``.
    """
    forward, upward = float(force[0]), float(force[1])
    visible = upward > CONTACT_FORCE
    length = float(np.clip(np.hypot(forward, upward) * METRES_PER_NEWTON, 1e-3, _LONGEST_ARROW))
    width = float(np.clip(length / 0.2, 0.3, 1.0))
    half = 0.5 * np.arctan2(forward, upward) if visible else 0.0
    return {
        (path, "visible"): visible,
        (path, "position"): point.tolist(),
        (path, "quaternion"): [0.0, float(np.sin(half)), 0.0, float(np.cos(half))],
        (path, "scale"): [width, width, length],
    }


def arc_state(arcs: Mapping[int, str], torque: float) -> SceneState:
    """Return the visibility of the arrows of a joint, of which at most one is visible.

    ``arcs``: path of each arrow by its level, from ``-LEVELS`` to ``LEVELS`` without 0; ``torque`` of the
    motor on the joint in [N·m], positive in the direction of increasing angle.
    """
    seen = level(torque)
    return {(path, "visible"): number == seen for number, path in arcs.items()}


def level(torque: float) -> int:
    """Return the level of the arrow for a torque.

    ``torque`` in [N·m]. The level is from ``-LEVELS`` to ``LEVELS`` and has the sign of the torque; 0 means
    less than half a level.
    """
    share = torque / FULL_TORQUE if math.isfinite(torque) else 0.0
    return round(LEVELS * min(max(share, -1.0), 1.0))


def arc_arrow(number: int, radius: float, placement: np.ndarray) -> tuple[Shape, Material]:
    """Make the arrow of a level.

    ``radius`` of the arc in [m]; ``placement``: frame of the arrow, shape ``(4, 4)``; the arrow of a positive
    level begins on its x axis and turns about its z axis by the right-hand rule.
    """
    size, colour = radius / _ARC_RADIUS, FLEXION_COLOUR if number > 0 else EXTENSION_COLOUR
    sized = np.diag([size, math.copysign(size, number), size, 1.0])
    shape = shapes.load_packaged_mesh(f"torque_{abs(number)}", placement @ sized)
    return shape, Material(colour=rgb(colour), roughness=0.8, glow=0.35)
