"""The wearer: translucent limbs and trunk, sized by height, mass and the segments of the model.

The shape of a limb is drawn by eye for a body of 1.75 m and 70 kg and scaled; it carries no data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from twin_gait.leg_model import LegJoints
from twin_gait.leg_model.wearer import FOOT_HEIGHT, FOOT_LENGTH, TRUNK_LENGTH
from twin_gait.parameters import Patient
from twin_gait.parameters.wearer import SHANK_LENGTH
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.shapes import Shape
from twin_gait.vocabulary import Side

SKIN = Material(colour=(0.80, 0.60, 0.50), opacity=0.42, roughness=0.75)
CLOTH = Material(colour=(0.58, 0.66, 0.77), opacity=0.60, roughness=0.9)
STRAP = Material(colour=(0.27, 0.31, 0.38), roughness=0.85)

_DRAWN_HEIGHT, _DRAWN_MASS = 1.75, 70.0  # of the body that the tables below describe
_HIP_CENTRE = 0.055  # half the distance between the hip centres, share of the body height
# How far the limb lies inside the device at knee and ankle, share of the distance at the hip.
_KNEE_INSIDE, _ANKLE_INSIDE = 0.62, 0.42

# Rings: share of the segment below its upper joint, centre forward, half axis forward and sideways [m].
_THIGH = (
    (-0.03, -0.004, 0.080, 0.074), (0.08, -0.002, 0.088, 0.080), (0.30, 0.006, 0.081, 0.075),
    (0.55, 0.009, 0.068, 0.064), (0.80, 0.007, 0.056, 0.053), (0.95, 0.006, 0.053, 0.050),
    (1.02, 0.004, 0.050, 0.047),
)  # fmt: skip
_SHANK = (
    (-0.02, 0.005, 0.047, 0.045), (0.08, 0.000, 0.050, 0.048), (0.28, -0.010, 0.056, 0.053),
    (0.50, -0.010, 0.048, 0.046), (0.75, -0.005, 0.036, 0.035), (0.93, -0.003, 0.033, 0.032),
    (1.00, -0.004, 0.034, 0.031),
)  # fmt: skip
# Share of the foot length from the heel, centre height over the sole, half height and half width, the
# last three as shares of the foot height.
_FOOT = (
    (0.10, 0.52, 0.48, 0.42), (0.24, 0.68, 0.64, 0.50), (0.36, 0.66, 0.64, 0.52), (0.52, 0.48, 0.46, 0.58),
    (0.70, 0.34, 0.33, 0.66), (0.84, 0.25, 0.24, 0.64), (0.92, 0.20, 0.19, 0.54),
)  # fmt: skip
# Height over the hips as a share of the trunk length, centre forward, half axes forward and sideways [m].
_TRUNK = (
    (-0.17, -0.006, 0.066, 0.095), (-0.06, -0.014, 0.106, 0.150), (0.06, -0.016, 0.112, 0.166),
    (0.20, -0.002, 0.098, 0.150), (0.36, 0.010, 0.090, 0.134), (0.55, 0.012, 0.104, 0.148),
    (0.72, 0.008, 0.115, 0.168), (0.86, -0.004, 0.106, 0.182), (0.95, -0.012, 0.082, 0.172),
    (1.02, -0.014, 0.060, 0.116), (1.08, -0.008, 0.052, 0.060), (1.20, 0.006, 0.050, 0.051),
)  # fmt: skip
_HEAD = (
    (1.16, 0.020, 0.046, 0.044), (1.22, 0.030, 0.070, 0.060), (1.33, 0.024, 0.092, 0.074),
    (1.46, 0.012, 0.099, 0.077), (1.55, 0.004, 0.086, 0.069), (1.59, 0.002, 0.066, 0.054),
)  # fmt: skip
_STRAPS = {"thigh": (0.46, 0.60), "shank": (0.32, 0.46)}  # cuffs around the limb


def draw_wearer(
    figure: Figure, legs: Mapping[Side, LegJoints], patient: Patient, *, trunk_joint: str | None
) -> None:
    """Draw the wearer on a figure.

    ``trunk_joint``: joint that carries the trunk, or None to draw the legs only.
    """
    for side, leg in legs.items():
        inside = _inside(figure, side, leg.hip, patient)
        thigh = figure.segment(leg.hip, leg)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
        else:
            shank = figure.segment(leg.knee, leg)
        steps = (inside, _KNEE_INSIDE * inside, _ANKLE_INSIDE * inside)
        _draw_segment(figure, leg.hip, "thigh", thigh, _THIGH, steps[0], steps[1], patient)
        _draw_segment(figure, leg.knee, "shank", shank, _SHANK, steps[1], steps[2], patient)
        if leg.ankle is not None:
            foot = shapes.moved(_foot(patient), _axes(-shank, steps[2]))
            figure.draw(leg.ankle, "wearer_foot", foot, SKIN)
    if trunk_joint is not None:
        axes = trunk_axes(figure)
        figure.draw(trunk_joint, "wearer_trunk", shapes.moved(_torso(_TRUNK, patient, rows=20), axes), CLOTH)
        figure.draw(trunk_joint, "wearer_head", shapes.moved(_torso(_HEAD, patient), axes), SKIN)


def trunk_axes(figure: Figure) -> np.ndarray:
    """Frame of the trunk in that of the joint that carries it: x forward, y left, z up.

    Returns homogeneous transform, shape ``(4, 4)``.
    """
    return _axes(figure.base[:3, :3].T @ np.array([0.0, 0.0, 1.0]), 0.0)


def girth(patient: Patient) -> float:
    """Scale of limb radii: the same density in a body of other height and mass.

    Returns 1 for the body that the tables describe.
    """
    return math.sqrt((patient.mass / _DRAWN_MASS) / (patient.height / _DRAWN_HEIGHT))


def _inside(figure: Figure, side: Side, hip: str, patient: Patient) -> float:
    """How far the wearer's hip centre lies to the left of the device's joint in [m]."""
    placement = figure.model.jointPlacements[figure.model.getJointId(hip)].translation
    lateral = abs(float((figure.base[:3, :3] @ np.asarray(placement))[1]))
    centre = _HIP_CENTRE * patient.height
    # A leg on the bench has no middle of the body: the device lies as far outside as on the average waist.
    distance = centre if lateral == 0.0 else max(0.0, lateral - centre)
    return -distance if side is Side.LEFT else distance


def _axes(up: np.ndarray, to_the_left: float) -> np.ndarray:
    """Frame with x forward, y left and z up along a segment, its origin shifted sideways."""
    forward = np.array([1.0, 0.0, 0.0])
    third = up / np.linalg.norm(up)
    forward = forward - (forward @ third) * third
    forward /= np.linalg.norm(forward)
    placement = np.eye(4)
    placement[:3, :3] = np.column_stack((forward, np.cross(third, forward), third))
    placement[:3, 3] = to_the_left * placement[:3, 1]
    return placement


def _draw_segment(
    figure: Figure,
    joint: str,
    name: str,
    segment: np.ndarray,
    rings: Sequence[Sequence[float]],
    upper: float,
    lower: float,
    patient: Patient,
) -> None:
    length = float(np.linalg.norm(segment))
    scale = girth(patient)
    table = [
        (-share * length, scale * x, upper + (lower - upper) * share, scale * a, scale * b)
        for share, x, a, b in rings
    ]
    axes = _axes(-segment, 0.0)
    figure.draw(joint, f"wearer_{name}", shapes.moved(shapes.limb(table), axes), SKIN)
    strap = band(np.array(table), -length * _STRAPS[name][0], -length * _STRAPS[name][1])
    figure.draw(joint, f"strap_{name}", shapes.moved(strap, axes), STRAP)


def band(table: np.ndarray, top: float, bottom: float, *, rings: int = 2, columns: int = 24) -> Shape:
    """Make a strap around a limb between two heights, 4 mm thick.

    ``table``: rings of the limb from the highest down, as :func:`twin_gait.viewer.shapes.limb` takes them;
    ``top``: height of the upper edge in [m]; ``bottom``: height of the lower edge in [m].
    """
    heights = np.linspace(top, bottom, rings)
    skin = np.array([np.interp(heights, table[::-1, 0], table[::-1, column]) for column in range(5)]).T
    outside = skin + np.array([0.0, 0.0, 0.0, 0.004, 0.004])
    angle = np.linspace(0.0, 2.0 * math.pi, columns + 1)
    rows = [
        np.column_stack((x + a * np.cos(angle), y + b * np.sin(angle), np.full_like(angle, z)))
        for z, x, y, a, b in (skin[0], *outside, skin[-1])
    ]
    row, column = np.meshgrid(np.arange(rings + 1), np.arange(columns), indexing="ij")
    first = (row * (columns + 1) + column).ravel()
    below = first + columns + 1
    faces = np.concatenate(
        (np.stack((first, below, below + 1), 1), np.stack((first, below + 1, first + 1), 1))
    )
    return shapes.creased(np.concatenate(rows), faces)


def _foot(patient: Patient) -> Shape:
    """Foot in a frame at the ankle: x forward, z up, sole a foot height below."""
    length, height = FOOT_LENGTH * patient.height, FOOT_HEIGHT * patient.height
    rings = [
        ((share - 0.25) * length, (centre - 1.0) * height, 0.0, a * height, b * height)
        for share, centre, a, b in _FOOT
    ]
    # The rings stand along x: turn the limb's z into x and its x into z.
    turn = np.eye(4)
    turn[:3, :3] = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return shapes.moved(shapes.limb(rings), turn)


def trunk_rings(patient: Patient) -> np.ndarray:
    """Rings of the trunk of a wearer.

    Returns height over the hips, centre forward, centre to the left, half axes forward and sideways, all in
    [m], from the lowest up, shape ``(n, 5)``.
    """
    return np.array(_rings(_TRUNK, patient))


def _rings(table: Sequence[Sequence[float]], patient: Patient) -> list[tuple[float, ...]]:
    length, scale = TRUNK_LENGTH * patient.height, girth(patient)
    return [(share * length, scale * x, 0.0, scale * a, scale * b) for share, x, a, b in table]


def _torso(table: Sequence[Sequence[float]], patient: Patient, rows: int = 12) -> Shape:
    return shapes.limb(_rings(table, patient), rows=rows, columns=24)
