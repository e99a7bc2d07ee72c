"""The wearer, sized by height, mass and segments of the model, and what holds him: harness, ropes, crutches.

The meshes are of a body of 1.75 m and 70 kg, drawn by eye (``urdf/make_meshes.py``); they carry no data.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from twin_gait.leg_model import SHOULDER_HEIGHT, LegJoints, wearer
from twin_gait.parameters import CrutchParameters, Patient
from twin_gait.parameters.wearer import SHANK_LENGTH
from twin_gait.viewer import shapes, surroundings
from twin_gait.viewer.arrows import arrow_state, draw_arrow
from twin_gait.viewer.commands import State, Window, draw_mesh
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Element, Motion
from twin_gait.viewer.surroundings import MATERIALS
from twin_gait.vocabulary import Side

_DRAWN_HEIGHT, _DRAWN_MASS = 1.75, 70.0  # of the body that the meshes show
_HIP_CENTRE = 0.055  # half the distance between the hip centres, share of the body height
# How far the limb lies inside the device at knee and ankle, share of the distance at the hip.
_KNEE_INSIDE, _ANKLE_INSIDE = 0.62, 0.42

_HOOK = (0.0, 0.15, 1.12)  # forward and to the left [m], height over the trunk: where a rope meets its straps
ROPES = "/meshcat/ropes"
_ROPE = ((0.0, 0.0), (0.006, 0.0), (0.006, 1.0), (0.0, 1.0))  # (radius, height) [m]
ROOT = "/meshcat/crutches"
_COLUMNS = ("forward_m", "height_m", "friction_force_N", "normal_force_N")
LEFT = {Side.LEFT: 1.0, Side.RIGHT: -1.0}
_BESIDE = 0.13  # way of the tip to the outside of the hips of the device [m]
_BEFORE_SHAFT = np.array([0.05, 0.0, 0.0])  # from the tip to its arrow, which the shaft would hide [m]


def draw_wearer(
    figure: Figure, legs: Mapping[Side, LegJoints], patient: Patient, *, trunk_joint: str | None
) -> None:
    """Draw the wearer on a figure.

    ``trunk_joint``: joint that carries the trunk, or None to draw the legs only.
    """
    for side, leg in legs.items():
        inside = _inside(figure, side, leg.hip, patient)
        thigh = figure.segment(leg.hip)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
        else:
            shank = figure.segment(leg.knee)
        ends = (inside, _KNEE_INSIDE * inside, _ANKLE_INSIDE * inside)
        parts = ((leg.hip, "thigh", thigh), (leg.knee, "shank", shank))
        for (joint, name, segment), upper, lower in zip(parts, ends, ends[1:], strict=False):
            # Thick by girth, as long as the segment, and leaning to the joint below.
            limb = _sized(patient, float(np.linalg.norm(segment)))
            limb[1, 2:] = upper - lower, upper
            for part, look in ((name, "skin"), (f"{name}_strap", "strap")):
                shape = shapes.packaged(f"wearer_{part}", _axes(-segment) @ limb)
                figure.draw(joint, f"wearer_{part}", shape, MATERIALS[look])
        if leg.ankle is not None:
            foot = np.diag([*[patient.height / _DRAWN_HEIGHT] * 3, 1.0])
            foot[1, 3] = ends[2]
            shape = shapes.packaged("wearer_foot", _axes(-shank) @ foot)
            figure.draw(leg.ankle, "wearer_foot", shape, MATERIALS["skin"])
    if trunk_joint is not None:
        _draw_on_trunk(figure, trunk_joint, patient, {"trunk": "cloth", "head": "skin"})


def _draw_on_trunk(figure: Figure, joint: str, patient: Patient, parts: Mapping[str, str]) -> None:
    """Draw meshes that grow with the trunk. ``parts``: their materials by name."""
    placement = trunk_axes(figure) @ _sized(patient, patient.height / _DRAWN_HEIGHT)
    for part, look in parts.items():
        figure.draw(joint, f"wearer_{part}", shapes.packaged(f"wearer_{part}", placement), MATERIALS[look])


def trunk_axes(figure: Figure) -> np.ndarray:
    """Frame of the trunk in that of the joint that carries it: x forward, y left, z up.

    Returns homogeneous transform, shape ``(4, 4)``.
    """
    return _axes(figure.base[:3, :3].T @ np.array([0.0, 0.0, 1.0]))


def _sized(patient: Patient, length: float) -> np.ndarray:
    """Scales of a mesh along z, and across by the girth of the wearer; shape ``(4, 4)``.

    That is 1 for the body that the meshes show: the same density in a body of other height and mass.
    """
    girth = math.sqrt((patient.mass / _DRAWN_MASS) / (patient.height / _DRAWN_HEIGHT))
    return np.diag([girth, girth, length, 1.0])


def _inside(figure: Figure, side: Side, hip: str, patient: Patient) -> float:
    """How far the wearer's hip centre lies to the left of the device's joint in [m]."""
    placement = figure.model.jointPlacements[figure.model.getJointId(hip)].translation
    lateral = abs(float((figure.base[:3, :3] @ np.asarray(placement))[1]))
    centre = _HIP_CENTRE * patient.height
    # A leg on the bench has no middle of the body: the device lies as far outside as on the average waist.
    distance = centre if lateral == 0.0 else max(0.0, lateral - centre)
    return -LEFT[side] * distance


def _axes(up: np.ndarray) -> np.ndarray:
    """Frame with z along a segment, x as near to forward as it goes, and y left."""
    return shapes.frame(up, np.array([1.0, 0.0, 0.0]))


def draw_harness(figure: Figure, patient: Patient, trunk_joint: str) -> list[np.ndarray]:
    """Draw a harness on the wearer's chest.

    Returns where the ropes meet its straps, in the frame of that joint in [m], shape ``(3,)`` each.
    """
    _draw_on_trunk(figure, trunk_joint, patient, {"vest": "vest", "harness": "strap"})
    x, y, share = _HOOK
    hook = _sized(patient, wearer.TRUNK_LENGTH * patient.height)[:3, :3] @ [x, y, share]
    return [trunk_axes(figure)[:3, :3] @ (hook * [1.0, side, 1.0]) for side in (1.0, -1.0)]


def draw_ropes(
    window: Window, figure: Figure, joint: str, hooks: Sequence[np.ndarray], height: float, *, on_rail: bool
) -> Element:
    """Draw ropes that go straight up from a harness to the bar of a mast, or along rails, and those.

    ``hooks``: lower ends in the frame of the joint in [m]; ``height`` of the upper ones in [m].
    """
    ends = [figure.world_point(joint, hook) for hook in hooks]
    uppers = np.array([[x, y, height] for x, y, _ in ends])
    for number in range(len(hooks)):  # of 1 m along z; its length is the scale
        draw_mesh(window, f"{ROPES}/{number}", shapes.turned(_ROPE, columns=8), MATERIALS["rope"])
    draw = surroundings.draw_rails if on_rail else surroundings.draw_mast
    draw(window, uppers)

    def state(motion: Motion, frame: int) -> State:
        found: State = {}
        for number, (hook, upper) in enumerate(zip(hooks, uppers, strict=True)):
            lower = figure.world_point(joint, hook)
            span = (np.array([lower[0], *upper[1:]]) if on_rail else upper) - lower
            found |= _spanned(f"{ROPES}/{number}", lower, span)
        return found

    return state


def _spanned(path: str, start: np.ndarray, span: np.ndarray) -> State:
    """Of what is 1 m long along z, so that it spans a way from a start in [m]."""
    return {
        (path, "position"): start.tolist(),
        (path, "quaternion"): pin.Quaternion(_axes(span)[:3, :3]).coeffs().tolist(),
        (path, "scale"): [1.0, 1.0, float(np.linalg.norm(span))],
    }


def bent_elbow(shoulder: np.ndarray, tip: np.ndarray, upper: float, lower: float) -> np.ndarray:
    r"""Place of the elbow between shoulder and tip: the cut of two circles that lies behind their line.

    With d between the two, the foot of the elbow on the line lies at :math:`a = (u^2 - l^2 + d^2) / 2d` from
    the shoulder and the elbow :math:`\sqrt{u^2 - a^2}` beside it. An arm that does not reach is straight, and
    what is missing is between shoulder and elbow. ``shoulder``: forward and upward in [m], shape ``(2,)``;
    ``tip``: likewise, shape ``(2,)``; ``upper``: shoulder to elbow in [m]; ``lower``: elbow to tip in [m].
    Returns forward and upward in [m], shape ``(2,)``.
    """
    distance = float(np.linalg.norm(tip - shoulder))
    ahead = (tip - shoulder) / distance
    if not abs(upper - lower) < distance < upper + lower:
        return np.asarray(tip - lower * ahead)
    along = (upper * upper - lower * lower + distance * distance) / (2.0 * distance)
    behind = np.array([ahead[1], -ahead[0]])  # of an arm that hangs
    return np.asarray(shoulder + along * ahead + math.sqrt(upper * upper - along * along) * behind)


def draw_crutches(
    window: Window, figure: Figure, crutches: CrutchParameters, patient: Patient, joint: str
) -> Element:
    """Draw both arms and crutches with the forces of the ground on them, the tips beside the legs.

    The forearm points along the shaft. ``joint`` carries the shoulders.
    """
    aside = 0.5 * wearer.SHOULDER_BREADTH * patient.height
    # From shoulder to elbow and from there to the tip, in the sagittal plane in [m].
    upper = wearer.UPPER_ARM_LENGTH * patient.height
    lower = crutches.length * patient.height - upper
    outside = _BESIDE + max(placement.translation[1] for placement in figure.model.jointPlacements)
    arrows = {side: draw_arrow(window, f"{side}_crutch") for side in Side}
    shoulders = {
        side: trunk_axes(figure)[:3, :3] @ [0.0, left * aside, SHOULDER_HEIGHT * patient.height]
        for side, left in LEFT.items()
    }
    for side in LEFT:
        for name, path, look in (
            ("wearer_upper_arm", "upper_arm/skin", "skin"),
            ("wearer_forearm", "forearm/skin", "skin"),
            ("crutch", "forearm/crutch", "plastic"),
        ):  # each of 1 m along z
            shape, casts = shapes.packaged(name, _sized(patient, 1.0)), look == "plastic"
            draw_mesh(window, f"{ROOT}/{side}_{path}", shape, MATERIALS[look], casts=casts)

    def state(motion: Motion, frame: int) -> State:
        found: State = {}
        for side, left in LEFT.items():
            columns = (motion.columns[f"{side}_crutch_{name}"] for name in _COLUMNS)
            forward, upward, *force = (float(values[frame]) for values in columns)
            tip = np.array([forward, left * outside, upward])
            shoulder = figure.world_point(joint, shoulders[side])
            sagittal = bent_elbow(shoulder[[0, 2]], tip[[0, 2]], upper, lower)
            elbow = np.insert(sagittal, 1, shoulder[1] + upper / (upper + lower) * (tip[1] - shoulder[1]))
            found |= {
                **_spanned(f"{ROOT}/{side}_upper_arm", shoulder, elbow - shoulder),
                **_spanned(f"{ROOT}/{side}_forearm", tip, elbow - tip),
                **arrow_state(arrows[side], np.array(force), tip + _BEFORE_SHAFT),
            }
        return found

    return state
