"""The wearer, sized by height, mass and segments of the model, and what holds him: harness, ropes, crutches.

The shape of a limb is drawn by eye for a body of 1.75 m and 70 kg and scaled; it carries no data.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

from twin_gait.leg_model import SHOULDER_HEIGHT, LegJoints, wearer
from twin_gait.parameters import CrutchParameters, Patient
from twin_gait.parameters.wearer import SHANK_LENGTH
from twin_gait.viewer import shapes, surroundings
from twin_gait.viewer.arrows import arrow_state, draw_arrow
from twin_gait.viewer.commands import State, Window, draw_mesh
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.surroundings import MATERIALS
from twin_gait.vocabulary import Side

_DRAWN_HEIGHT, _DRAWN_MASS = 1.75, 70.0  # of the body that the tables below describe
_HIP_CENTRE = 0.055  # half the distance between the hip centres, share of the body height
# How far the limb lies inside the device at knee and ankle, share of the distance at the hip.
_KNEE_INSIDE, _ANKLE_INSIDE = 0.62, 0.42

# Rings of the limbs, see there.
RINGS = yaml.safe_load(Path(__file__).with_name("body.yaml").read_text(encoding="utf-8"))
_STRAPS = {"thigh": (0.46, 0.60), "shank": (0.32, 0.46)}  # cuffs around the limb

_VEST = (0.50, 0.80)  # around the chest, heights over the hips as shares of the trunk length
_HOOK = (0.0, 0.15, 1.12)  # forward and to the left [m] and height as above: where a rope meets its straps
ROPES = "/meshcat/ropes"
_ROPE = ((0.0, 0.0), (0.006, 0.0), (0.006, 1.0), (0.0, 1.0))  # (radius, height) [m]
ROOT = "/meshcat/crutches"
_COLUMNS = ("forward_m", "height_m", "friction_force_N", "normal_force_N")
LEFT = {Side.LEFT: 1.0, Side.RIGHT: -1.0}
_BESIDE = 0.13  # way of the tip to the outside of the hips of the device [m]
_BEFORE_SHAFT = np.array([0.05, 0.0, 0.0])  # from the tip to its arrow, which the shaft would hide [m]
_HANDLE = 0.045  # of its middle in front of the shaft [m]
_TIP = ((0.0, 0.0), (0.027, 0.0), (0.024, 0.012), (0.017, 0.05), (0.0, 0.05))  # (radius, height) [m]
_CUFF = (0.16, 0.34)  # around the forearm


def draw_wearer(
    figure: Figure, legs: Mapping[Side, LegJoints], patient: Patient, *, trunk_joint: str | None
) -> None:
    """Draw the wearer on a figure.

    ``trunk_joint``: joint that carries the trunk, or None to draw the legs only.
    """
    scale = girth(patient)
    for side, leg in legs.items():
        inside = _inside(figure, side, leg.hip, patient)
        thigh = figure.segment(leg.hip)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
        else:
            shank = figure.segment(leg.knee)
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
            figure.draw(joint, f"wearer_{name}", shapes.moved(shapes.limb(table), axes), MATERIALS["skin"])
            top, bottom = (-length * share for share in _STRAPS[name])
            strap = band(np.array(table), top, bottom)
            figure.draw(joint, f"strap_{name}", shapes.moved(strap, axes), MATERIALS["strap"])
        if leg.ankle is not None:
            foot = shapes.moved(_foot(patient), _axes(-shank, at_ankle))
            figure.draw(leg.ankle, "wearer_foot", foot, MATERIALS["skin"])
    if trunk_joint is not None:
        for name, look, rows in (("trunk", "cloth", 20), ("head", "skin", 12)):
            torso = shapes.limb(_rings(RINGS[name], patient), rows=rows, columns=24)
            shape = shapes.moved(torso, trunk_axes(figure))
            figure.draw(trunk_joint, f"wearer_{name}", shape, MATERIALS[look])


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
    return -LEFT[side] * distance


def _axes(up: np.ndarray, to_the_left: float) -> np.ndarray:
    """Frame with x forward, y left and z up along a segment, its origin shifted sideways."""
    placement = shapes.frame(up, np.array([1.0, 0.0, 0.0]))
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
    length, height = wearer.FOOT_LENGTH * patient.height, wearer.FOOT_HEIGHT * patient.height
    rings = [
        ((share - 0.25) * length, (centre - 1.0) * height, 0.0, a * height, b * height)
        for share, centre, a, b in RINGS["foot"]
    ]
    # The rings stand along x: turn the limb's z into x and its x into z.
    return shapes.moved(
        shapes.limb(rings), shapes.frame(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    )


def _rings(table: Sequence[Sequence[float]], patient: Patient) -> list[tuple[float, ...]]:
    length, scale = wearer.TRUNK_LENGTH * patient.height, girth(patient)
    return [(share * length, scale * x, 0.0, scale * a, scale * b) for share, x, a, b in table]


def draw_harness(figure: Figure, patient: Patient, trunk_joint: str) -> list[np.ndarray]:
    """Draw a harness on the wearer's chest.

    Returns where the ropes meet its straps, in the frame of that joint in [m], shape ``(3,)`` each.
    """
    axes, length = trunk_axes(figure), wearer.TRUNK_LENGTH * patient.height
    rings = np.array(_rings(RINGS["trunk"], patient))
    bottom, top = (share * length for share in _VEST)
    vest = band(rings[::-1], top, bottom, rings=6, columns=28)
    figure.draw(trunk_joint, "harness_vest", shapes.moved(vest, axes), MATERIALS["vest"])
    x, y, share = _HOOK
    hooks = [np.array([x, side * y, share * length]) for side in (1.0, -1.0)]
    straps = [_shoulder_strap(hook, front, rings, top) for hook in hooks for front in (1.0, -1.0)]
    figure.draw(trunk_joint, "harness_straps", shapes.moved(shapes.merged(straps), axes), MATERIALS["strap"])
    return [axes[:3, :3] @ hook for hook in hooks]


def _shoulder_strap(hook: np.ndarray, front: float, rings: np.ndarray, height: float) -> Shape:
    """From the hook of a rope to the front (1) or the back (-1) of the vest, over the shoulder."""
    x, _, half_x, half_y = (float(np.interp(height, rings[:, 0], rings[:, column])) for column in range(1, 5))
    angle = math.radians(52.0)
    end = [x + front * half_x * math.sin(angle), math.copysign(half_y * math.cos(angle), hook[1]), height]
    middle = 0.5 * (hook + end) + [front * 0.035, 0.0, 0.02]
    return shapes.tube(shapes.bend(hook, middle, np.array(end)), 0.007, columns=6)


class DrawnRopes:
    """Ropes that go straight up from a harness to a bar over the treadmill, or along rails.

    Attributes:
        upper: Their upper ends in the scene in [m], shape ``(n, 3)``.
    """

    def __init__(
        self, window: Window, figure: Figure, joint: str, hooks: Sequence[np.ndarray], height: float,
        *, on_rail: bool,
    ) -> None:  # fmt: skip
        """Draw them, and the mast or the rails; ``hooks``: lower ends in the frame of the joint in [m]."""
        self._joint, self._hooks, self._on_rail = joint, hooks, on_rail
        ends = [figure.world_point(pin.neutral(figure.model), joint, hook) for hook in hooks]
        self.upper = np.array([[x, y, height] for x, y, _ in ends])
        for number in range(len(hooks)):  # of 1 m along z; its length is the scale
            draw_mesh(window, f"{ROPES}/{number}", shapes.turned(_ROPE, columns=8), MATERIALS["rope"])
        draw = surroundings.draw_rails if on_rail else surroundings.draw_mast
        draw(window, self.upper)

    def state(self, figure: Figure, motion: Motion, frame: int) -> State:
        """Where they are in a frame."""
        state: State = {}
        for number, (hook, upper) in enumerate(zip(self._hooks, self.upper, strict=True)):
            lower = figure.world_point(motion.q[frame], self._joint, hook)
            span = (np.array([lower[0], *upper[1:]]) if self._on_rail else upper) - lower
            state |= _spanned(f"{ROPES}/{number}", lower, span)
        return state


def _spanned(path: str, start: np.ndarray, span: np.ndarray) -> State:
    """Of what is 1 m long along z, so that it spans a way from a start in [m]."""
    return {
        (path, "position"): start.tolist(),
        (path, "quaternion"): _pointing(span),
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


def _pointing(direction: np.ndarray) -> list[float]:
    """Quaternion (x, y, z, w) that turns z into a direction and leaves x as near to forwards as it can."""
    return list(pin.Quaternion(_axes(direction, 0.0)[:3, :3]).coeffs().tolist())


class DrawnCrutches:
    """Both arms and crutches with the forces of the ground on them, the tips beside the legs."""

    def __init__(
        self, window: Window, figure: Figure, crutches: CrutchParameters, patient: Patient, joint: str
    ) -> None:
        """Draw them; the forearm points along the shaft. ``joint`` carries the shoulders."""
        forearm = wearer.FOREARM_LENGTH * patient.height
        aside = 0.5 * wearer.SHOULDER_BREADTH * patient.height
        # From shoulder to elbow and from there to the tip, in the sagittal plane in [m].
        self._upper = wearer.UPPER_ARM_LENGTH * patient.height
        self._lower = crutches.length * patient.height - self._upper
        self._outside = _BESIDE + max(placement.translation[1] for placement in figure.model.jointPlacements)
        self._joint, self._shoulders = joint, dict[Side, np.ndarray]()
        self._arrows = {side: draw_arrow(window, f"{side}_crutch") for side in Side}
        # Longer than in the sagittal plane.
        longer = math.hypot(1.0, (self._outside - aside) / (self._upper + self._lower))
        for side, left in LEFT.items():
            shoulder = [0.0, left * aside, SHOULDER_HEIGHT * patient.height]
            self._shoulders[side] = trunk_axes(figure)[:3, :3] @ shoulder
            rings = _arm("upper_arm", patient, 0.0, 1.0)  # 1 m long, along z, thick as it is
            draw_mesh(window, f"{ROOT}/{side}_upper_arm/skin", shapes.limb(rings), MATERIALS["skin"])
            path, length = f"{ROOT}/{side}_forearm", self._lower * longer
            _draw_forearm(window, path, length, forearm * longer, patient)

    def state(self, figure: Figure, motion: Motion, frame: int) -> State:
        """Where they are in a frame; nothing of a log without crutches."""
        state: State = {}
        for side, left in LEFT.items():
            names = (f"{side}_crutch_{name}" for name in _COLUMNS)
            values = [float(motion.columns[name][frame]) for name in names if name in motion.columns]
            if len(values) < len(_COLUMNS):
                continue
            forward, upward, *force = values
            tip = np.array([forward, left * self._outside, upward])
            shoulder = figure.world_point(motion.q[frame], self._joint, self._shoulders[side])
            sagittal = bent_elbow(shoulder[[0, 2]], tip[[0, 2]], self._upper, self._lower)
            share = self._upper / (self._upper + self._lower)
            elbow = np.insert(sagittal, 1, shoulder[1] + share * (tip[1] - shoulder[1]))
            arm, rest = f"{ROOT}/{side}_upper_arm", f"{ROOT}/{side}_forearm"
            state |= {
                **_spanned(arm, shoulder, elbow - shoulder),
                (rest, "position"): tip.tolist(),
                (rest, "quaternion"): _pointing(elbow - tip),
                **arrow_state(self._arrows[side], np.array(force), tip + _BEFORE_SHAFT),
            }
        return state


def _arm(name: str, patient: Patient, start: float, length: float) -> list[list[float]]:
    """Rings of a part of an arm along z, from a height in [m] over a length in [m]."""
    scale = girth(patient)
    return [[start + share * length, 0.0, 0.0, scale * x, scale * y] for share, x, y in RINGS[name]]


def _draw_forearm(window: Window, path: str, length: float, forearm: float, patient: Patient) -> None:
    """Draw a forearm and a crutch from the tip at the origin to the elbow on z, handle forwards."""
    grip, scale = length - forearm, girth(patient)
    rings = np.array(_arm("forearm", patient, length, -forearm))
    rings[:, 1] = _HANDLE * (length - rings[:, 0]) / forearm  # the hand is at the handle
    fist = shapes.ellipsoid((0.040 * scale, 0.036 * scale, 0.046 * scale))
    hand = shapes.moved(fist, shapes.translation((_HANDLE, 0.0, grip + 0.005)))
    draw_mesh(window, f"{path}/skin", shapes.merged([shapes.limb(rings.tolist()), hand]), MATERIALS["skin"])
    # Behind the forearm up to the cuff.
    top, bottom = (length - share * forearm for share in _CUFF)
    at_cuff = np.array([-0.045 * scale, 0.0, 0.5 * (top + bottom)])
    line = np.array([[0.0, 0.0, 0.04], [0.0, 0.0, 0.4 * grip], [0.0, 0.0, grip - 0.02], at_cuff])
    handle = np.array([[x, 0.0, grip] for x in (-0.012, 0.05, 0.105)])
    crutch = [
        shapes.tube(line, 0.0115, columns=12), shapes.tube(handle, 0.0155, columns=12),
        band(rings, top, bottom, rings=3), shapes.turned(_TIP, columns=20),
    ]  # fmt: skip
    draw_mesh(window, f"{path}/crutch", shapes.merged(crutch), MATERIALS["plastic"], casts=True)
