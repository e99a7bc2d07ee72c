"""Arrows: the forces of the ground, and the torque of a motor around its joint, longer for more."""

import math
from collections.abc import Mapping

import numpy as np

from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import EXTENSION_COLOUR, FLEXION_COLOUR, GROUND_FORCE_COLOUR
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, State, Window, draw_mesh, rgb, set_property
from twin_gait.viewer.shapes import Shape

# Scales of the arrows: the scene draws with them, the page explains them.
METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
FULL_TORQUE = 60.0  # [N m] of the longest arrow of a motor torque: about the largest of a step of the presets
FORCE_ROOT = "/meshcat/forces"
_LONGEST_ARROW = 1.2  # [m]
LEVELS = 6  # lengths of the arrow, each way
_FULL_SWEEP = math.radians(270.0)
_HEAD_LENGTH, _HEAD_RADIUS = 0.044, 0.019  # [m]
_RADIUS = 0.008  # of the arrow's shaft [m]
_STEP = math.radians(11.0)  # of the mesh along the arc


def draw_arrow(window: Window, name: str) -> str:
    """Draw an arrow, hidden."""
    path = f"{FORCE_ROOT}/{name}"
    material = Material(colour=rgb(GROUND_FORCE_COLOUR), roughness=0.8, glow=0.2)
    draw_mesh(window, path, shapes.arrow(), material)
    window.send(set_property(path, "visible", False))
    return path


def arrow_state(path: str, force: np.ndarray, point: np.ndarray) -> State:
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
        (path, "position"): point.tolist(),
        (path, "quaternion"): [0.0, float(np.sin(half)), 0.0, float(np.cos(half))],
        (path, "scale"): [width, width, length],
    }


def arc_state(arcs: Mapping[int, str], torque: float) -> State:
    """Which of the arrows of a joint is seen, if any.

    ``arcs``: place of each by its level, from ``-LEVELS`` to ``LEVELS`` without 0; ``torque`` of the motor on
    the joint in [N m], positive in increasing angle.
    """
    seen = level(torque)
    return {(path, "visible"): number == seen for number, path in arcs.items()}


def level(torque: float) -> int:
    """Length of the arrow for a torque.

    ``torque`` in [N m]. Returned from ``-LEVELS`` to ``LEVELS``; the sign is that of the torque, and 0 is
    less than half a level.
    """
    share = torque / FULL_TORQUE if math.isfinite(torque) else 0.0
    return round(LEVELS * min(max(share, -1.0), 1.0))


def arc_arrow(radius: float, number: int, axis: np.ndarray, start: np.ndarray) -> Shape:
    """Make an arrow around an axis.

    ``radius`` of the arc in [m]; ``number``: level; a positive one turns by the right-hand rule about the
    axis; ``axis``: unit vector, shape ``(3,)``; ``start``: unit vector across the axis at which the arrow
    begins, shape ``(3,)``.
    """
    sweep = _FULL_SWEEP * number / LEVELS
    # The shortest arrow is hardly longer than its head.
    size = max(abs(sweep) - _HEAD_LENGTH / radius, 0.3 * abs(sweep))
    at, aside = math.copysign(size, sweep), np.cross(axis, start)
    angle = np.linspace(0.0, at, max(4, round(size / _STEP)))[:, None]
    arc = radius * (np.cos(angle) * start + np.sin(angle) * aside)
    # The head goes along the arc's direction there and a little inward, as the arc goes on.
    out = arc[-1] / radius
    ahead = math.copysign(1.0, sweep) * np.cross(axis, out) - 0.5 * _HEAD_LENGTH / radius * out
    ahead /= np.linalg.norm(ahead)
    cone = shapes.turned([(0.0, 0.0), (_HEAD_RADIUS, 0.0), (0.0, _HEAD_LENGTH)], columns=12)
    head = shapes.moved(cone, shapes.frame(ahead, np.cross(axis, ahead), at=arc[-1]))
    return shapes.merged([shapes.tube(arc, _RADIUS, columns=6), head])


def arc_material(number: int) -> Material:
    """Surface of an arrow."""
    return Material(colour=rgb(FLEXION_COLOUR if number > 0 else EXTENSION_COLOUR), roughness=0.8, glow=0.35)
