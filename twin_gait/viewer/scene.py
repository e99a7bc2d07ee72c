"""Scene: a leg model or any URDF with its surroundings, and its state in each frame."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
import pinocchio as pin

from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.palette import phase_colour
from twin_gait.parameters.crutches import CrutchParameters
from twin_gait.parameters.environment import ChairParameters
from twin_gait.parameters.wearer import Patient
from twin_gait.viewer import environment, shapes
from twin_gait.viewer.arrows import FORCE_ROOT, arc_state, arrow_state, draw_arrow
from twin_gait.viewer.body import LEFT, draw_crutches, draw_harness, draw_ropes, draw_wearer
from twin_gait.viewer.commands import CommandBuffer, Material, SceneState, draw_mesh, rgb, set_transform
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.motion import Element, Motion, PhaseSpells
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.visuals import FIXED_JOINT, load_visuals
from twin_gait.vocabulary import Environment, JointName, Side

_IDLE = (0.55, 0.60, 0.66)  # caps of motors before a phase is known
_CAP_SHARE = 0.16  # radius of a cap as a share of the segment length; it covers the motors of the device
_SMALLEST_CAP = 0.045  # [m]
RIGHT_SIDE = (0.95, -3.7, 0.62)  # direction from the figure to the camera
TRAILS = "/meshcat/trail"
MOST_STRIDES = 20  # number of strides of a leg that are drawn, so that a page stays small
FEWEST_POINTS = 4
LOWEST_TRAIL = 0.008  # [m], minimum height of the path above the belt, so that it is visible
_TRAIL = Material(colour=(1.0, 1.0, 1.0), roughness=0.9)
_RADIUS = 0.006  # [m]
_COLUMNS = 5
_SHORTEST_STEP = 1e-3  # [m]
_BAR_ABOVE_HEAD = 0.08  # [m]
_CRUTCH_VIEW_SHIFT = 0.12  # [m], forward distance from the hips to the middle of wearer and crutches
_FRONT_VIEW = (0.6, -1.0, 0.3)


@dataclass(frozen=True)
class View:
    """View of the camera."""

    target: tuple[float, float, float]  # centre of the visible region in [m]
    width: float  # width of the visible region in [m]
    height: float  # height of the visible region in [m]
    direction: tuple[float, float, float] = RIGHT_SIDE  # direction from the target to the camera
    field_of_view: float = 26.0  # vertical angle in [deg]: small, so that both legs appear equally long


class Scene:
    """Drawn scene whose parts can be moved."""

    def __init__(self, window: CommandBuffer, model: pin.Model, urdf: Path, up_axis: str) -> None:
        """Start a scene with the figure of a model, which :class:`ArticulatedFigure` draws from its URDF."""
        environment.set_studio(window)
        self.figure = ArticulatedFigure(window, model, load_visuals(model, urdf), up_axis=up_axis)
        self.caps: dict[Side, list[str]] = {}  # paths of the coloured caps of the motors
        self.arrows: dict[Side, str] = {}  # path of the arrow of the ground force
        self.arcs: dict[Side, dict[str, dict[int, str]]] = {}  # paths of torque arrows by joint and level
        self.elements: list[Element] = []  # functions that move further parts
        self.trails: list[StrideTrail] = []  # paths of the feet in each stride; empty until draw_trails
        self.legs: dict[Side, LegJoints] = {}
        self.ground = np.eye(3)  # axes of the ground, one per column
        self.view = View(target=(0.0, 0.0, 0.0), width=1.0, height=1.0)
        self._window = window

    def draw_drives(self, side: Side, leg: LegJoints, drives: Collection[str]) -> None:
        """Draw the motors of a leg: caps that show its phase, and hidden arrows of their torques."""
        material = Material(colour=_IDLE, roughness=0.4, glow=0.12)
        self.legs[side], self.caps[side], self.arcs[side] = leg, [], {}
        for name, joint in leg.items():
            if name in drives:
                length = float(np.linalg.norm(self.figure.segment(joint)))
                radius = max(_CAP_SHARE * length, _SMALLEST_CAP)
                self.caps[side].append(self.figure.draw_cap(joint, radius, material))
                self.arcs[side][str(name)] = self.figure.draw_arc(joint, radius, LEFT[side])

    def draw_trails(self, motion: Motion) -> None:
        """Draw the hidden path of each foot in every stride of a motion.

        A stride is from one entry into the first phase of the table to the next entry.
        """
        self.trails = []
        for side, leg in motion.legs.items():
            entries = [float(start) for start, code in zip(*leg.phases, strict=True) if code == 0 and start]
            strides = zip(entries, entries[1:], [*entries[2:], math.inf], strict=False)
            for number, (start, end, following) in enumerate(islice(strides, MOST_STRIDES)):
                frames = np.flatnonzero((motion.times >= start) & (motion.times <= end))
                points = np.array([self._foot_point(side, q) for q in motion.q[frames]])
                shape = trail_shape(motion.times[frames], points, leg.phases, motion.phase_names)
                if shape is not None:
                    path = f"{TRAILS}/{side}_{number}"
                    draw_mesh(self._window, path, shape, _TRAIL)
                    self._window.apply({(path, "visible"): False})
                    self.trails.append(StrideTrail(path, end, following))

    def _foot_point(self, side: Side, q: np.ndarray) -> np.ndarray:
        """Move the figure, and return the middle of a sole, or the end of the last segment of a leg."""
        self.figure.move(q)
        leg = self.legs[side]
        if leg.contact_frames:
            point = np.mean([self.figure.frame_point(frame) for frame in leg.contact_frames], axis=0)
            return np.asarray(np.maximum(point, [-np.inf, -np.inf, LOWEST_TRAIL]))
        last = leg.items()[-1][1]
        return self.figure.world_point(last, self.figure.segment(last))

    def _force_state(self, side: Side, motion: Motion, frame: int) -> SceneState:
        """Return the arrow of the force of the ground on a foot, in the axes of the ground."""
        names = [f"{side}_foot_{name}_force_N" for name in ("friction", "normal")]
        if side not in self.arrows or any(name not in motion.columns for name in names):
            return {}
        force = np.nan_to_num([motion.columns[name][frame] for name in names])
        share = float(motion.columns[f"{side}_foot_cop_ratio"][frame])
        ends = [self.figure.frame_point(name) for name in self.legs[side].contact_frames]
        along, left, _ = (ends[0] + share * (ends[-1] - ends[0])) @ self.ground
        return arrow_state(self.arrows[side], force, np.array([along, left, 0.0]))

    def state_at(self, motion: Motion, frame: int) -> SceneState:
        """Return the state of the scene in a frame of a motion, without the belt."""
        time = float(motion.times[frame])
        state: SceneState = {**self.figure.posture(motion.q[frame])}
        for side, arcs in self.arcs.items():
            for joint, arc in arcs.items():
                torques = motion.columns.get(f"{side}_{joint}_motor_torque_Nm")
                state |= {} if torques is None else arc_state(arc, float(torques[frame]))
        for side, leg in motion.legs.items():
            state |= self._force_state(side, motion, frame)
            code = leg.phases.code_at(time)
            colour = rgb(phase_colour(motion.phase_names[code], code))
            state |= {(path, "color"): [*colour, 1.0] for path in self.caps.get(side, ())}
        for path, begin, end in self.trails:
            state[path, "visible"] = begin <= time < end
        for element in self.elements:
            state |= element(motion, frame)
        return state


class StrideTrail(NamedTuple):
    """Path of the foot in a stride, shown until the next stride is complete."""

    path: str  # path of the mesh in the scene
    begin: float  # end of the stride, at which its path appears, in [s]
    end: float  # end of the next stride, at which the path disappears, in [s]


def trail_shape(
    times: np.ndarray, points: np.ndarray, phases: PhaseSpells, names: Sequence[str]
) -> Shape | None:
    """Make the tube along a path.

    ``times`` of the frames in [s], shape ``(n,)``; ``points`` of the path in [m], shape ``(n, 3)``;
    ``names``: phases in the order of their codes. Returns the mesh with the colour of the phase at each
    point, or None if the point hardly moves.
    """
    # A point at the position of the previous one is removed, because it has no direction.
    keep = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0, prepend=np.inf), axis=1) > _SHORTEST_STEP)
    if len(keep) < FEWEST_POINTS:
        return None
    tube = shapes.tube(points[keep], _RADIUS, _COLUMNS)
    codes = [phases.code_at(float(time)) for time in times[keep]]
    colours = np.array([rgb(phase_colour(names[code], code)) for code in codes])
    nearest = np.linalg.norm(tube.vertices[:, None] - points[keep], axis=2).argmin(axis=1)
    return tube._replace(colours=colours[nearest])


class SceneOptions(TypedDict, total=False):
    """Options of the scene of a leg model.

    Attributes:
        environment: Surroundings; by default a treadmill.
        drives: Joints with a motor; by default hip and knee.
        driven_sides: Legs of the device; by default all.
        patient: The wearer, or None.
        slope: Angle by which the treadmill rises forwards in [rad].
        ropes: Whether the wearer has a harness on ropes; by default true.
        crutches: Crutches of the wearer, or None.
        chair: Chair behind the wearer, or None.
    """

    environment: Environment
    drives: Collection[str]
    driven_sides: Collection[Side]
    patient: Patient | None
    slope: float
    ropes: bool
    crutches: CrutchParameters | None
    chair: ChairParameters | None


def build_scene(window: CommandBuffer, model: LegModel, **setting: Unpack[SceneOptions]) -> Scene:
    """Draw a leg model with its wearer and its surroundings.

    A mesh that cannot be read is omitted with a warning. Raises ModelError if the URDF cannot be read.
    """
    scene = Scene(window, model.model, model.urdf_path, model.up_axis)
    driven_sides = setting.get("driven_sides", model.sides)
    for side, leg in model.legs.items():
        drives = setting.get("drives", (JointName.HIP, JointName.KNEE))
        scene.draw_drives(side, leg, drives if side in driven_sides else ())
    patient, around = setting.get("patient"), setting.get("environment", Environment.TREADMILL)
    trunk, walks = model.trunk_joint or FIXED_JOINT, len(model.legs) > 1
    if patient is not None:
        trunk_of_legs = trunk if walks else None
        draw_wearer(scene.figure, model.legs, patient, trunk_joint=trunk_of_legs, strapped=driven_sides)
    first = next(iter(model.legs))
    hip, end = model.legs[first].hip, model.legs[first].items()[-1][1]
    top = scene.figure.world_point(hip)
    bottom = float(scene.figure.world_point(end, scene.figure.segment(end))[2])
    height = float(top[2]) - bottom
    if around is Environment.STAND:
        _surround_bench_leg(window, scene, first, top, height)
        return scene
    if around is Environment.FLOOR:
        environment.draw_floor(window, bottom - 0.02)
        scene.view = View((0.0, 0.0, bottom + 0.62 * height), width=1.3 * height, height=1.5 * height)
        return scene
    if around is Environment.WALKWAY:
        assert model.forward_index is not None  # a walkway needs a model with a forward coordinate
        scene.elements.append(environment.draw_walkway(window, model.forward_index))
    else:
        pose = environment.belt_pose(setting.get("slope", 0.0))
        window.send(set_transform(FORCE_ROOT, pose))
        scene.ground = pose[:3, :3]
        environment.draw_treadmill(window, setting.get("slope", 0.0))
    for side, leg in model.legs.items():
        if leg.contact_frames:
            scene.arrows[side] = draw_arrow(window, str(side))
    scene.view = View((0.0, 0.0, 0.60 * height), width=1.6 * height, height=1.6 * height)
    if patient is not None and walks:
        _equip_walker(window, scene, patient, trunk, setting)
    return scene


def build_urdf_scene(window: CommandBuffer, model: pin.Model, urdf: Path, *, up_axis: str = "z") -> Scene:
    """Draw any URDF with all coordinates at zero; without visuals, sticks connect its joints.

    ``up_axis``: vertical axis of the URDF, ``"x"``, ``"y"`` or ``"z"``. Raises ModelError if the URDF cannot
    be read.
    """
    scene = Scene(window, model, urdf, up_axis)
    points = scene.figure.points()
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float(np.linalg.norm(high - low)), 0.1)
    x, y, z = (0.5 * (low + high)).tolist()
    environment.draw_floor(window, float(low[2]) - 0.01 * size, radius=max(1.0, 1.6 * size))
    scene.view = View((x, y, z), width=1.1 * size, height=1.1 * size, direction=_FRONT_VIEW)
    return scene


def _equip_walker(
    window: CommandBuffer, scene: Scene, patient: Patient, trunk: str, setting: SceneOptions
) -> None:
    """Draw harness, crutches and chair, and set the view from the foot of the treadmill to the bar."""
    low, high = -0.13, _BAR_ABOVE_HEAD + patient.height + 0.07
    scene.view = View((0.0, 0.0, 0.5 * (low + high)), width=1.15 * (high - low), height=high - low)
    if setting.get("ropes", True):
        hooks = draw_harness(scene.figure, patient, trunk)
        on_rail = setting.get("environment") is Environment.WALKWAY
        height = _BAR_ABOVE_HEAD + patient.height
        scene.elements.append(draw_ropes(window, scene.figure, trunk, hooks, height, on_rail=on_rail))
    if (crutches := setting.get("crutches")) is not None:
        scene.elements.append(draw_crutches(window, scene.figure, crutches, patient, trunk))
        scene.view = replace(scene.view, target=(_CRUTCH_VIEW_SHIFT, *scene.view.target[1:]))
    if (chair := setting.get("chair")) is not None:
        scene.elements.append(environment.draw_chair(window, chair))


def _surround_bench_leg(
    window: CommandBuffer, scene: Scene, side: Side, hip: np.ndarray, height: float
) -> None:
    """Draw the bench with the leg clear of the floor and its column on the far side, and set the view."""
    floor, away = float(hip[2]) - 1.22 * height, -LEFT[side]
    environment.draw_bench(window, floor, hip, far_side=away)
    x, y, z = RIGHT_SIDE
    scene.view = View(
        (float(hip[0]) + 0.10 * height, float(hip[1]), floor + 0.69 * height),
        width=1.5 * height,
        height=1.48 * height,
        direction=(x, away * y, z),
    )
