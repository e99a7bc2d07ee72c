"""Wearer, scaled by height, mass and segments of the model, with harness, ropes and crutches.

The meshes show a body of 1.75 m and 70 kg, drawn by eye (``urdf/make_meshes.py``); they are not data.
"""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pinocchio as pin

from twin_gait.leg_model import anthropometry
from twin_gait.leg_model.anthropometry import SHOULDER_HEIGHT
from twin_gait.leg_model.joints import LegJoints
from twin_gait.parameters.crutches import CrutchParameters
from twin_gait.parameters.wearer import SHANK_LENGTH, Patient
from twin_gait.viewer import environment, shapes
from twin_gait.viewer.arrows import arrow_state, draw_arrow
from twin_gait.viewer.commands import CommandBuffer, SceneState, draw_mesh
from twin_gait.viewer.environment import MATERIALS
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.motion import Element, Motion
from twin_gait.vocabulary import Side

_DRAWN_HEIGHT, _DRAWN_MASS = 1.75, 70.0  # [m], [kg] of the body that the meshes show
_HIP_CENTRE = 0.055  # half the distance between the hip centres, as a share of the body height
# Distance of the limb from the device at knee and ankle, as a share of the distance at the hip.
_KNEE_INSIDE, _ANKLE_INSIDE = 0.62, 0.42

_HOOK = (0.0, 0.15, 1.12)  # hook of a rope: forward and left in [m], height as a share of the trunk length
ROPES = "/meshcat/ropes"
_ROPE = ((0.0, 0.0), (0.006, 0.0), (0.006, 1.0), (0.0, 1.0))  # (radius, height) [m]
ROOT = "/meshcat/crutches"
_COLUMNS = ("forward_m", "height_m", "friction_force_N", "normal_force_N")
LEFT = {Side.LEFT: 1.0, Side.RIGHT: -1.0}
_CRUTCH_TIP_OFFSET = 0.13  # [m], lateral distance of the crutch tip from the hip joint of the device
_ARROW_OFFSET = np.array([0.05, 0.0, 0.0])  # [m], offset of the arrow from the tip, clear of the shaft


def draw_wearer(
    figure: ArticulatedFigure,
    legs: Mapping[Side, LegJoints],
    patient: Patient,
    *,
    trunk_joint: str | None,
    strapped: Collection[Side],
) -> None:
    """Draw the wearer on a figure.

    ``trunk_joint``: joint to which the trunk is fixed, or None to draw the legs only; ``strapped``: legs that
    are strapped to the device.
    """
    for side, leg in legs.items():
        inside = _hip_offset(figure, side, leg.hip, patient)
        thigh = figure.segment(leg.hip)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
        else:
            shank = figure.segment(leg.knee)
        ends = (inside, _KNEE_INSIDE * inside, _ANKLE_INSIDE * inside)
        parts = ((leg.hip, "thigh", thigh), (leg.knee, "shank", shank))
        for (joint, name, segment), upper, lower in zip(parts, ends, ends[1:], strict=False):
            # The limb is scaled by girth and by segment length, and sheared towards the joint below.
            limb = _wearer_scaling(patient, float(np.linalg.norm(segment)))
            limb[1, 2:] = upper - lower, upper
            drawn = ((name, "skin"), (f"{name}_strap", "strap"))
            for part, look in drawn if side in strapped else drawn[:1]:
                shape = shapes.load_packaged_mesh(f"wearer_{part}", _axes(-segment) @ limb)
                figure.draw(joint, f"wearer_{part}", shape, MATERIALS[look])
        if leg.ankle is not None:
            foot = np.diag([*[patient.height / _DRAWN_HEIGHT] * 3, 1.0])
            foot[1, 3] = ends[2]
            shape = shapes.load_packaged_mesh("wearer_foot", _axes(-shank) @ foot)
            figure.draw(leg.ankle, "wearer_foot", shape, MATERIALS["skin"])
    if trunk_joint is not None:
        _draw_on_trunk(figure, trunk_joint, patient, {"trunk": "cloth", "head": "skin"})


def _draw_on_trunk(figure: ArticulatedFigure, joint: str, patient: Patient, parts: Mapping[str, str]) -> None:
    """Draw meshes that are scaled with the trunk. ``parts``: their materials by name."""
    placement = trunk_axes(figure) @ _wearer_scaling(patient, patient.height / _DRAWN_HEIGHT)
    for part, look in parts.items():
        figure.draw(
            joint, f"wearer_{part}", shapes.load_packaged_mesh(f"wearer_{part}", placement), MATERIALS[look]
        )


def trunk_axes(figure: ArticulatedFigure) -> np.ndarray:
    """Return the frame of the trunk in the frame of its joint: x forward, y left, z up.

    The result is a homogeneous transform, shape ``(4, 4)``.
    """
    return _axes(figure.base[:3, :3].T @ np.array([0.0, 0.0, 1.0]))


def _wearer_scaling(patient: Patient, length: float) -> np.ndarray:
    """Return the scaling of a mesh by ``length`` along z and by the girth of the wearer across; ``(4, 4)``.

    The girth is 1 for the body that the meshes show, and follows from equal density for other bodies.
    """
    girth = math.sqrt((patient.mass / _DRAWN_MASS) / (patient.height / _DRAWN_HEIGHT))
    return np.diag([girth, girth, length, 1.0])


def _hip_offset(figure: ArticulatedFigure, side: Side, hip: str, patient: Patient) -> float:
    """Compute the offset of the wearer's hip centre from the device's joint in [m], positive to the left."""
    placement = figure.model.jointPlacements[figure.model.getJointId(hip)].translation
    lateral = abs(float((figure.base[:3, :3] @ np.asarray(placement))[1]))
    centre = _HIP_CENTRE * patient.height
    # A leg on the bench has no body midline; the device is as far outside as on an average waist.
    distance = centre if lateral == 0.0 else max(0.0, lateral - centre)
    return -LEFT[side] * distance


def _axes(up: np.ndarray) -> np.ndarray:
    """Return the frame with z along a segment, x as close to forward as possible, and y left."""
    return shapes.frame(up, np.array([1.0, 0.0, 0.0]))


def draw_harness(figure: ArticulatedFigure, patient: Patient, trunk_joint: str) -> list[np.ndarray]:
    """Draw a harness on the wearer's chest.

    Returns the hooks of the ropes in the frame of the trunk's joint in [m], shape ``(3,)`` each.
    """
    _draw_on_trunk(figure, trunk_joint, patient, {"vest": "vest", "harness": "strap"})
    x, y, share = _HOOK
    hook = _wearer_scaling(patient, anthropometry.TRUNK_LENGTH * patient.height)[:3, :3] @ [x, y, share]
    return [trunk_axes(figure)[:3, :3] @ (hook * [1.0, side, 1.0]) for side in (1.0, -1.0)]


def draw_ropes(
    window: CommandBuffer,
    figure: ArticulatedFigure,
    joint: str,
    hooks: Sequence[np.ndarray],
    height: float,
    *,
    on_rail: bool,
) -> Element:
    """Draw vertical ropes from a harness to the bar of a mast or to rails, and the mast or the rails.

    Returns the function that moves the ropes. ``hooks``: lower ends of the ropes in the frame of the joint in
    [m]; ``height`` of their upper ends in [m].
    """
    ends = [figure.world_point(joint, hook) for hook in hooks]
    uppers = np.array([[x, y, height] for x, y, _ in ends])
    for number in range(len(hooks)):  # a mesh of 1 m along z, scaled to its length
        draw_mesh(window, f"{ROPES}/{number}", shapes.revolve(_ROPE, columns=8), MATERIALS["rope"])
    draw = environment.draw_rails if on_rail else environment.draw_mast
    draw(window, uppers)

    def state(motion: Motion, frame: int) -> SceneState:
        found: SceneState = {}
        for number, (hook, upper) in enumerate(zip(hooks, uppers, strict=True)):
            lower = figure.world_point(joint, hook)
            span = (np.array([lower[0], *upper[1:]]) if on_rail else upper) - lower
            found |= _stretched_state(f"{ROPES}/{number}", lower, span)
        return found

    return state


def _stretched_state(path: str, start: np.ndarray, span: np.ndarray) -> SceneState:
    """Return the state that makes a part of 1 m along z extend from ``start`` by ``span``, both in [m]."""
    return {
        (path, "position"): start.tolist(),
        (path, "quaternion"): pin.Quaternion(_axes(span)[:3, :3]).coeffs().tolist(),
        (path, "scale"): [1.0, 1.0, float(np.linalg.norm(span))],
    }


def bent_elbow(shoulder: np.ndarray, tip: np.ndarray, upper: float, lower: float) -> np.ndarray:
    r"""Compute the position of the elbow: the intersection of two circles behind the line shoulder–tip.

    With distance d of shoulder and tip, the projection of the elbow on their line is at
    :math:`a = (u^2 - l^2 + d^2) / 2d` from the shoulder, and the elbow at :math:`\sqrt{u^2 - a^2}` from the
    line. An arm that is too short is straight, with the gap between shoulder and elbow. ``shoulder`` and
    ``tip``: forward and upward in [m], shape ``(2,)`` each; ``upper``: length u from shoulder to elbow in
    [m]; ``lower``: length l from elbow to tip in [m]. Returns forward and upward in [m], shape ``(2,)``.
    """
    distance = float(np.linalg.norm(tip - shoulder))
    ahead = (tip - shoulder) / distance
    if not abs(upper - lower) < distance < upper + lower:
        return np.asarray(tip - lower * ahead)
    along = (upper * upper - lower * lower + distance * distance) / (2.0 * distance)
    behind = np.array([ahead[1], -ahead[0]])  # backwards for an arm that hangs down
    return np.asarray(shoulder + along * ahead + math.sqrt(upper * upper - along * along) * behind)


def draw_crutches(
    window: CommandBuffer, figure: ArticulatedFigure, crutches: CrutchParameters, patient: Patient, joint: str
) -> Element:
    """Draw both arms and crutches with the ground forces on them; the tips are next to the legs.

    Returns the function that moves them. The forearm points along the shaft. ``joint``: joint to which the
    shoulders are fixed.
    """
    aside = 0.5 * anthropometry.SHOULDER_BREADTH * patient.height
    # Lengths from shoulder to elbow and from elbow to tip in the sagittal plane in [m].
    upper = anthropometry.UPPER_ARM_LENGTH * patient.height
    lower = crutches.length * patient.height - upper
    outside = _CRUTCH_TIP_OFFSET + max(placement.translation[1] for placement in figure.model.jointPlacements)
    arrows = {side: draw_arrow(window, f"{side}_crutch") for side in Side}
    shoulders = {
        side: trunk_axes(figure)[:3, :3] @ [0.0, left * aside, SHOULDER_HEIGHT * patient.height]
        for side, left in LEFT.items()
    }
    for side in LEFT:
        for name, path, look in (  # meshes of 1 m along z
            ("wearer_upper_arm", "upper_arm/skin", "skin"),
            ("wearer_forearm", "forearm/skin", "skin"),
            ("crutch", "forearm/crutch", "plastic"),
        ):
            shape, casts = shapes.load_packaged_mesh(name, _wearer_scaling(patient, 1.0)), look == "plastic"
            draw_mesh(window, f"{ROOT}/{side}_{path}", shape, MATERIALS[look], casts=casts)

    def state(motion: Motion, frame: int) -> SceneState:
        found: SceneState = {}
        for side, left in LEFT.items():
            columns = (motion.columns[f"{side}_crutch_{name}"] for name in _COLUMNS)
            forward, upward, *force = (float(values[frame]) for values in columns)
            tip = np.array([forward, left * outside, upward])
            shoulder = figure.world_point(joint, shoulders[side])
            sagittal = bent_elbow(shoulder[[0, 2]], tip[[0, 2]], upper, lower)
            elbow = np.insert(sagittal, 1, shoulder[1] + upper / (upper + lower) * (tip[1] - shoulder[1]))
            found |= {
                **_stretched_state(f"{ROOT}/{side}_upper_arm", shoulder, elbow - shoulder),
                **_stretched_state(f"{ROOT}/{side}_forearm", tip, elbow - tip),
                **arrow_state(arrows[side], np.array(force), tip + _ARROW_OFFSET),
            }
        return found

    return state
