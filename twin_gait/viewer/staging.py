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
from twin_gait.viewer.visuals import FIXED_JOINT, Visuals, load_visuals
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
    surroundings.set_studio(window)
    visuals = load_visuals(model.model, model.urdf_path)
    scene = _start(window, model.model, visuals, model.up_axis)
    for side, leg in model.legs.items():
        scene.draw_drives(side, leg, drives)
    trunk, patient = model.trunk_joint or FIXED_JOINT, setting.get("patient")
    walks = len(model.legs) > 1
    if patient is not None:
        draw_wearer(scene.figure, model.legs, patient, trunk_joint=trunk if walks else None)
    top, bottom = _extent(scene.figure, model.legs)
    height, around = top - bottom, setting.get("around", Surroundings.TREADMILL)
    if around is Surroundings.STAND:
        _surround_bench_leg(window, scene, model.legs, top, bottom)
    elif around in (Surroundings.TREADMILL, Surroundings.WALKWAY):
        scene.view = View((0.0, 0.0, 0.60 * height), width=1.6 * height, height=1.6 * height)
        _surround_walker(window, scene, model, around, setting.get("slope", 0.0))
        if patient is not None and walks:
            _equip_walker(window, scene, patient, trunk, {**setting, "around": around})
    else:
        surroundings.draw_floor(window, bottom - 0.02)
        scene.view = View((0.0, 0.0, bottom + 0.62 * height), width=1.3 * height, height=1.5 * height)
    return scene


def _surround_walker(
    window: Window, scene: Scene, model: LegModel, around: Surroundings, slope: float
) -> None:
    """Draw the ground and its forces on the feet."""
    if around is Surroundings.WALKWAY:
        assert model.forward_index is not None  # it walks
        scene.elements.append(surroundings.DrawnWalkway(window, model.forward_index))
    else:
        pose = surroundings.tilted(slope)
        window.send(set_transform(FORCE_ROOT, pose))
        scene.ground = pose[:3, :3]
        surroundings.draw_treadmill(window, slope)
    for side, leg in model.legs.items():
        if leg.contact_frames:
            scene.arrows[side] = draw_arrow(window, str(side))


def build_urdf_scene(window: Window, model: pin.Model, urdf: Path, *, up_axis: str = "z") -> Scene:
    """Draw any URDF, with all coordinates at zero; one that shows nothing gets sticks from joint to joint.

    ``up_axis``: ``"x"``, ``"y"`` or ``"z"``: the vertical of the URDF. Raises ModelError if the URDF cannot
    be read. Raises ViewerError if a mesh of the URDF cannot be read.
    """
    surroundings.set_studio(window)
    visuals = load_visuals(model, urdf)
    scene = _start(window, model, visuals, up_axis)
    points = _all_points(model, visuals) @ scene.figure.base[:3, :3].T
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float(np.linalg.norm(high - low)), 0.1)
    x, y, z = (float(value) for value in 0.5 * (low + high))
    surroundings.draw_floor(window, float(low[2]) - 0.01 * size, radius=max(1.0, 1.6 * size))
    scene.view = View((x, y, z), width=1.1 * size, height=1.1 * size, direction=_FROM_THE_FRONT)
    return scene


def _start(window: Window, model: pin.Model, visuals: Visuals, up_axis: str) -> Scene:
    figure = Figure(window, model, up_axis=up_axis)
    figure.draw_visuals(visuals)
    if not visuals.parts:
        figure.draw_skeleton()
    return Scene(window, figure, visuals)


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


def _all_points(model: pin.Model, visuals: Visuals) -> np.ndarray:
    """Vertices of all visuals, or all frames, and origins of all joints at zero, shape ``(n, 3)``."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    placements = [*data.oMi, *(() if visuals.parts else data.oMf)]
    points = [np.asarray(placement.translation)[None, :] for placement in placements]
    for part in visuals.parts:
        placement = data.oMi[0 if part.joint == FIXED_JOINT else model.getJointId(part.joint)]
        turn, shift = np.asarray(placement.rotation), np.asarray(placement.translation)
        points.append(part.shape.vertices @ turn.T + shift)
    return np.concatenate(points)
