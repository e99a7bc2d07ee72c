"""Draw a leg model, or any URDF, with what belongs around it."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
import pinocchio as pin

from twin_gait.leg_model import LegJoints, LegModel
from twin_gait.parameters import ChairParameters, CrutchParameters, Patient
from twin_gait.viewer import surroundings
from twin_gait.viewer.arrows import FORCE_ROOT, draw_arrow
from twin_gait.viewer.body import DrawnCrutches, DrawnRopes, draw_harness, draw_wearer
from twin_gait.viewer.commands import Window, set_transform
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.scene import RIGHT_SIDE, Scene, View
from twin_gait.viewer.visuals import FIXED_JOINT
from twin_gait.vocabulary import JointName, Side, Surroundings

_BAR_ABOVE_HEAD = 0.08  # [m]
_TO_CRUTCHES = 0.12  # from the hips to the middle of wearer and crutches [m]
_FROM_THE_FRONT = (0.6, -1.0, 0.3)


class Setting(TypedDict, total=False):
    """What is drawn with a leg model.

    Attributes:
        around: What stands around it; a treadmill if nothing is said.
        patient: The wearer, or None.
        slope: By which the treadmill rises forwards in [rad].
        ropes: Whether a harness holds the wearer; on the ground it does if nothing is said.
        crutches: In the hands of the wearer, or None.
        chair: Behind the wearer, or None.
    """

    around: Surroundings
    patient: Patient | None
    slope: float
    ropes: bool
    crutches: CrutchParameters | None
    chair: ChairParameters | None


def build_scene(
    window: Window,
    model: LegModel,
    *,
    drives: Collection[str] = (JointName.HIP, JointName.KNEE),
    **setting: Unpack[Setting],
) -> Scene:
    """Draw a leg model with its wearer and its surroundings.

    Raises ModelError if the URDF, ViewerError if a mesh of it cannot be read.
    """
    scene = Scene(window, model.model, model.urdf_path, model.up_axis)
    for side, leg in model.legs.items():
        scene.draw_drives(side, leg, drives)
    patient, around = setting.get("patient"), setting.get("around", Surroundings.TREADMILL)
    trunk, walks = model.trunk_joint or FIXED_JOINT, len(model.legs) > 1
    if patient is not None:
        draw_wearer(scene.figure, model.legs, patient, trunk_joint=trunk if walks else None)
    top, bottom = _extent(scene.figure, model.legs)
    height = top - bottom
    if around is Surroundings.STAND:
        _surround_bench_leg(window, scene, model.legs, top, bottom)
        return scene
    if around is Surroundings.FLOOR:
        surroundings.draw_floor(window, bottom - 0.02)
        scene.view = View((0.0, 0.0, bottom + 0.62 * height), width=1.3 * height, height=1.5 * height)
        return scene
    if around is Surroundings.WALKWAY:
        assert model.forward_index is not None  # it walks
        scene.elements.append(surroundings.DrawnWalkway(window, model.forward_index))
    else:
        pose = surroundings.tilted(setting.get("slope", 0.0))
        window.send(set_transform(FORCE_ROOT, pose))
        scene.ground = pose[:3, :3]
        surroundings.draw_treadmill(window, setting.get("slope", 0.0))
    for side, leg in model.legs.items():
        if leg.contact_frames:
            scene.arrows[side] = draw_arrow(window, str(side))
    scene.view = View((0.0, 0.0, 0.60 * height), width=1.6 * height, height=1.6 * height)
    if patient is not None and walks:
        _equip_walker(window, scene, patient, trunk, setting)
    return scene


def build_urdf_scene(window: Window, model: pin.Model, urdf: Path, *, up_axis: str = "z") -> Scene:
    """Draw any URDF, with all coordinates at zero; one that shows nothing gets sticks from joint to joint.

    ``up_axis``: ``"x"``, ``"y"`` or ``"z"``: the vertical of the URDF. Raises ModelError if the URDF cannot
    be read. Raises ViewerError if a mesh of the URDF cannot be read.
    """
    scene = Scene(window, model, urdf, up_axis)
    points = scene.figure.points()
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float(np.linalg.norm(high - low)), 0.1)
    x, y, z = (0.5 * (low + high)).tolist()
    surroundings.draw_floor(window, float(low[2]) - 0.01 * size, radius=max(1.0, 1.6 * size))
    scene.view = View((x, y, z), width=1.1 * size, height=1.1 * size, direction=_FROM_THE_FRONT)
    return scene


def _equip_walker(window: Window, scene: Scene, patient: Patient, trunk: str, setting: Setting) -> None:
    """Draw harness, crutches and chair, and see all of it, from the treadmill's foot to the bar."""
    low, high = -0.13, _BAR_ABOVE_HEAD + patient.height + 0.07
    scene.view = View((0.0, 0.0, 0.5 * (low + high)), width=1.15 * (high - low), height=high - low)
    if setting.get("ropes", True):
        hooks = draw_harness(scene.figure, patient, trunk)
        on_rail = setting.get("around") is Surroundings.WALKWAY
        height = _BAR_ABOVE_HEAD + patient.height
        scene.elements.append(DrawnRopes(window, scene.figure, trunk, hooks, height, on_rail=on_rail))
    crutches, chair = setting.get("crutches"), setting.get("chair")
    if crutches is not None:
        scene.elements.append(DrawnCrutches(window, scene.figure, crutches, patient, trunk))
        scene.view = replace(scene.view, target=(_TO_CRUTCHES, *scene.view.target[1:]))
    if chair is not None:
        scene.elements.append(surroundings.DrawnChair(window, chair))


def _surround_bench_leg(
    window: Window, scene: Scene, legs: Mapping[Side, LegJoints], top: float, bottom: float
) -> None:
    """Hang the leg clear of the floor, its column on the far side of the camera."""
    ((side, leg),) = legs.items()
    right = side is Side.RIGHT
    height = top - bottom
    floor = bottom - 0.22 * height
    hip = scene.figure.world_point(pin.neutral(scene.figure.model), leg.hip)
    surroundings.draw_bench(window, floor, hip, far_side=1.0 if right else -1.0)
    x, y, z = RIGHT_SIDE
    scene.view = View(
        (float(hip[0]) + 0.10 * height, float(hip[1]), 0.5 * (top + floor) + 0.08 * height),
        width=1.5 * height,
        height=top - floor + 0.26 * height,
        direction=(x, y if right else -y, z),
    )


def _extent(figure: Figure, legs: Mapping[Side, LegJoints]) -> tuple[float, float]:
    """Height of the hips and of the lowest point of the legs in the neutral posture, in [m]."""
    neutral = pin.neutral(figure.model)
    tops, bottoms = [], []
    for leg in legs.values():
        last = leg.items()[-1][1]
        tops.append(float(figure.world_point(neutral, leg.hip)[2]))
        bottoms.append(float(figure.world_point(neutral, last, figure.segment(last))[2]))
    return max(tops), min(bottoms)
