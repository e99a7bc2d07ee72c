"""The wearer: translucent limbs and trunk, sized by height, mass and the segments of the model.

The shape of a limb is drawn by eye for a body of 1.75 m and 70 kg and scaled; it carries no data.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

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

# Rings of the limbs, see there.
RINGS = yaml.safe_load(Path(__file__).with_name("body.yaml").read_text(encoding="utf-8"))
_STRAPS = {"thigh": (0.46, 0.60), "shank": (0.32, 0.46)}  # cuffs around the limb


def draw_wearer(
    figure: Figure, legs: Mapping[Side, LegJoints], patient: Patient, *, trunk_joint: str | None
) -> None:
    """Draw the wearer on a figure.

    ``trunk_joint``: joint that carries the trunk, or None to draw the legs only.
    """
    scale = girth(patient)
    for side, leg in legs.items():
        inside = _inside(figure, side, leg.hip, patient)
        thigh = figure.segment(leg.hip, leg)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
        else:
            shank = figure.segment(leg.knee, leg)
        at_knee, at_ankle = _KNEE_INSIDE * inside, _ANKLE_INSIDE * inside
        for joint, name, segment, upper, lower in (
            (leg.hip, "thigh", thigh, inside, at_knee),
            (leg.knee, "shank", shank, at_knee, at_ankle),
        ):
            length, axes = float(np.linalg.norm(segment)), _axes(-segment, 0.0)
            table = [
                (-share * length, scale * x, upper + (lower - upper) * share, scale * a, scale * b)
                for share, x, a, b in RINGS[name]
            ]
            figure.draw(joint, f"wearer_{name}", shapes.moved(shapes.limb(table), axes), SKIN)
            top, bottom = (-length * share for share in _STRAPS[name])
            strap = band(np.array(table), top, bottom)
            figure.draw(joint, f"strap_{name}", shapes.moved(strap, axes), STRAP)
        if leg.ankle is not None:
            foot = shapes.moved(_foot(patient), _axes(-shank, at_ankle))
            figure.draw(leg.ankle, "wearer_foot", foot, SKIN)
    if trunk_joint is not None:
        axes = trunk_axes(figure)
        figure.draw(
            trunk_joint, "wearer_trunk", shapes.moved(_torso(RINGS["trunk"], patient, rows=20), axes), CLOTH
        )
        figure.draw(trunk_joint, "wearer_head", shapes.moved(_torso(RINGS["head"], patient), axes), SKIN)


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


def band(table: np.ndarray, top: float, bottom: float, *, rings: int = 2, columns: int = 24) -> Shape:
    """Make a strap around a limb between two heights, 4 mm thick.

    ``table``: rings of the limb from the highest down, as :func:`twin_gait.viewer.shapes.limb` takes them;
    ``top``: height of the upper edge in [m]; ``bottom``: height of the lower edge in [m].
    """
    heights = np.linspace(top, bottom, rings)
    skin = np.array([np.interp(heights, table[::-1, 0], table[::-1, column]) for column in range(5)]).T
    outside = skin + np.array([0.0, 0.0, 0.0, 0.004, 0.004])
    return shapes.surface(shapes.elliptic(np.array([skin[-1], *outside[::-1], skin[0]]), columns))


def _foot(patient: Patient) -> Shape:
    """Foot in a frame at the ankle: x forward, z up, sole a foot height below."""
    length, height = FOOT_LENGTH * patient.height, FOOT_HEIGHT * patient.height
    rings = [
        ((share - 0.25) * length, (centre - 1.0) * height, 0.0, a * height, b * height)
        for share, centre, a, b in RINGS["foot"]
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
    return np.array(_rings(RINGS["trunk"], patient))


def _rings(table: Sequence[Sequence[float]], patient: Patient) -> list[tuple[float, ...]]:
    length, scale = TRUNK_LENGTH * patient.height, girth(patient)
    return [(share * length, scale * x, 0.0, scale * a, scale * b) for share, x, a, b in table]


def _torso(table: Sequence[Sequence[float]], patient: Patient, rows: int = 12) -> Shape:
    return shapes.limb(_rings(table, patient), rows=rows, columns=24)
