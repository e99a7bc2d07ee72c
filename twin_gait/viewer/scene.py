"""The scene: a leg model, or any URDF, with what belongs around it, and what changes in it."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
import pinocchio as pin

from twin_gait.leg_model import LegJoints, LegModel
from twin_gait.palette import phase_colour
from twin_gait.parameters import ChairParameters, CrutchParameters, Patient
from twin_gait.viewer import shapes, surroundings
from twin_gait.viewer.arrows import FORCE_ROOT, arc_state, arrow_state, draw_arrow
from twin_gait.viewer.body import LEFT, draw_crutches, draw_harness, draw_ropes, draw_wearer
from twin_gait.viewer.commands import Material, State, Window, draw_mesh, rgb, set_transform
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Element, Motion, PhaseSpells
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.visuals import FIXED_JOINT, load_visuals
from twin_gait.vocabulary import JointName, Side, Surroundings

_IDLE = (0.55, 0.60, 0.66)  # caps of motors before a phase is known
_CAP_SHARE = 0.16  # radius over the length of the segment; it hides the motors of the shipped device
_SMALLEST_CAP = 0.045  # [m]
RIGHT_SIDE = (0.95, -3.7, 0.62)  # direction from the figure to the eye
TRAILS = "/meshcat/trail"
MOST_STRIDES = 20  # of a leg that are drawn, so that a page stays small
FEWEST_POINTS = 4
LOWEST_TRAIL = 0.008  # height of the path over the belt [m], so that it is seen
_TRAIL = Material(colour=(1.0, 1.0, 1.0), roughness=0.9)
_RADIUS = 0.006  # [m]
_COLUMNS = 5
_SHORTEST_STEP = 1e-3  # [m]
_BAR_ABOVE_HEAD = 0.08  # [m]
_TO_CRUTCHES = 0.12  # from the hips to the middle of wearer and crutches [m]
_FROM_THE_FRONT = (0.6, -1.0, 0.3)


@dataclass(frozen=True)
class View:
    """Where the camera is to look."""

    target: tuple[float, float, float]  # middle of what is to be seen in [m]
    width: float  # of what is to be seen in [m]
    height: float  # of what is to be seen in [m]
    direction: tuple[float, float, float] = RIGHT_SIDE  # from there to the eye
    field_of_view: float = 26.0  # vertical, in [deg]: narrow, so that both legs look the same length


class Scene:
    """A scene that has been drawn and can be moved."""

    def __init__(self, window: Window, model: pin.Model, urdf: Path, up_axis: str) -> None:
        """Start a scene with what a URDF shows of a model, as :class:`Figure` draws it."""
        surroundings.set_studio(window)
        self.figure = Figure(window, model, load_visuals(model, urdf), up_axis=up_axis)
        self.caps: dict[Side, list[str]] = {}  # places of the coloured caps of motors
        self.arrows: dict[Side, str] = {}  # place of the ground force
        self.arcs: dict[Side, dict[str, dict[int, str]]] = {}  # of the motor torque, by joint and level
        self.elements: list[Element] = []  # what else moves
        self.trails: list[StrideTrail] = []  # paths of the feet per stride, once a motion is known
        self.legs: dict[Side, LegJoints] = {}
        self.ground = np.eye(3)  # its axes, column by column
        self.view = View(target=(0.0, 0.0, 0.0), width=1.0, height=1.0)
        self._window = window

    def draw_drives(self, side: Side, leg: LegJoints, drives: Collection[str]) -> None:
        """Draw the motors of a leg: caps, which show its phase, and arrows of their torques, hidden."""
        material = Material(colour=_IDLE, roughness=0.4, glow=0.12)
        self.legs[side], self.caps[side], self.arcs[side] = leg, [], {}
        for name, joint in leg.items():
            if name in drives:
                length = float(np.linalg.norm(self.figure.segment(joint)))
                radius = max(_CAP_SHARE * length, _SMALLEST_CAP)
                self.caps[side].append(self.figure.draw_cap(joint, radius, material))
                self.arcs[side][str(name)] = self.figure.draw_arc(joint, radius, LEFT[side])

    def draw_trails(self, motion: Motion) -> None:
        """Draw the path of each foot in every stride of a motion, hidden.

        A stride is from one entry into the first phase of the table to the next.
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

    def _force_state(self, side: Side, motion: Motion, frame: int) -> State:
        """Return the arrow of the force of the ground on a foot, in the axes of the ground."""
        names = [f"{side}_foot_{name}_force_N" for name in ("friction", "normal")]
        if side not in self.arrows or any(name not in motion.columns for name in names):
            return {}
        force = np.nan_to_num([motion.columns[name][frame] for name in names])
        share = float(motion.columns[f"{side}_foot_pressure_place"][frame])
        ends = [self.figure.frame_point(name) for name in self.legs[side].contact_frames]
        along, left, _ = (ends[0] + share * (ends[-1] - ends[0])) @ self.ground
        return arrow_state(self.arrows[side], force, np.array([along, left, 0.0]))

    def state_at(self, motion: Motion, frame: int) -> State:
        """Everything that a frame of a motion shows, but for the belt."""
        time = float(motion.times[frame])
        state: State = {**self.figure.posture(motion.q[frame])}
        for side, arcs in self.arcs.items():
            for joint, arc in arcs.items():
                torques = motion.columns.get(f"{side}_{joint}_motor_torque_Nm")
                state |= {} if torques is None else arc_state(arc, float(torques[frame]))
        for side, leg in motion.legs.items():
            state |= self._force_state(side, motion, frame)
            code = leg.phases.at(time)
            colour = rgb(phase_colour(motion.phase_names[code], code))
            state |= {(path, "color"): [*colour, 1.0] for path in self.caps.get(side, ())}
        for path, begin, end in self.trails:
            state[path, "visible"] = begin <= time < end
        for element in self.elements:
            state |= element(motion, frame)
        return state


class StrideTrail(NamedTuple):
    """The path of a stride, shown until the next stride is complete."""

    path: str  # its place in the scene
    begin: float  # time at which the stride was complete in [s]
    end: float  # time at which the next one is, in [s]


def trail_shape(
    times: np.ndarray, points: np.ndarray, phases: PhaseSpells, names: Sequence[str]
) -> Shape | None:
    """Make the tube along a path.

    ``times`` of the frames in [s], shape ``(n,)``; ``points`` of the path in [m], shape ``(n, 3)``;
    ``names``: phases in the order of their codes. Returns the mesh with the colour of the phase at each
    point, or None if the point hardly moves.
    """
    # Points at the place of the one before have no direction.
    keep = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0, prepend=np.inf), axis=1) > _SHORTEST_STEP)
    if len(keep) < FEWEST_POINTS:
        return None
    tube = shapes.tube(points[keep], _RADIUS, _COLUMNS)
    codes = [phases.at(float(time)) for time in times[keep]]
    colours = np.array([rgb(phase_colour(names[code], code)) for code in codes])
    nearest = np.linalg.norm(tube.vertices[:, None] - points[keep], axis=2).argmin(axis=1)
    return tube._replace(colours=colours[nearest])


class Setting(TypedDict, total=False):
    """What is drawn with a leg model.

    Attributes:
        around: What stands around it; a treadmill if nothing is said.
        drives: Joints with a motor; hip and knee if nothing is said.
        patient: The wearer, or None.
        slope: By which the treadmill rises forwards in [rad].
        ropes: Whether a harness holds the wearer; on the ground it does if nothing is said.
        crutches: In the hands of the wearer, or None.
        chair: Behind the wearer, or None.
    """

    around: Surroundings
    drives: Collection[str]
    patient: Patient | None
    slope: float
    ropes: bool
    crutches: CrutchParameters | None
    chair: ChairParameters | None


def build_scene(window: Window, model: LegModel, **setting: Unpack[Setting]) -> Scene:
    """Draw a leg model with its wearer and its surroundings.

    A mesh that cannot be read is left out with a warning. Raises ModelError if the URDF cannot be read.
    """
    scene = Scene(window, model.model, model.urdf_path, model.up_axis)
    for side, leg in model.legs.items():
        scene.draw_drives(side, leg, setting.get("drives", (JointName.HIP, JointName.KNEE)))
    patient, around = setting.get("patient"), setting.get("around", Surroundings.TREADMILL)
    trunk, walks = model.trunk_joint or FIXED_JOINT, len(model.legs) > 1
    if patient is not None:
        draw_wearer(scene.figure, model.legs, patient, trunk_joint=trunk if walks else None)
    first = next(iter(model.legs))
    hip, end = model.legs[first].hip, model.legs[first].items()[-1][1]
    top = scene.figure.world_point(hip)
    bottom = float(scene.figure.world_point(end, scene.figure.segment(end))[2])
    height = float(top[2]) - bottom
    if around is Surroundings.STAND:
        _surround_bench_leg(window, scene, first, top, height)
        return scene
    if around is Surroundings.FLOOR:
        surroundings.draw_floor(window, bottom - 0.02)
        scene.view = View((0.0, 0.0, bottom + 0.62 * height), width=1.3 * height, height=1.5 * height)
        return scene
    if around is Surroundings.WALKWAY:
        assert model.forward_index is not None  # it walks
        scene.elements.append(surroundings.draw_walkway(window, model.forward_index))
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
    be read.
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
        scene.elements.append(draw_ropes(window, scene.figure, trunk, hooks, height, on_rail=on_rail))
    if (crutches := setting.get("crutches")) is not None:
        scene.elements.append(draw_crutches(window, scene.figure, crutches, patient, trunk))
        scene.view = replace(scene.view, target=(_TO_CRUTCHES, *scene.view.target[1:]))
    if (chair := setting.get("chair")) is not None:
        scene.elements.append(surroundings.draw_chair(window, chair))


def _surround_bench_leg(window: Window, scene: Scene, side: Side, hip: np.ndarray, height: float) -> None:
    """Hang the leg clear of the floor, its column on the far side of the camera."""
    floor, away = float(hip[2]) - 1.22 * height, -LEFT[side]
    surroundings.draw_bench(window, floor, hip, far_side=away)
    x, y, z = RIGHT_SIDE
    scene.view = View(
        (float(hip[0]) + 0.10 * height, float(hip[1]), floor + 0.69 * height),
        width=1.5 * height,
        height=1.48 * height,
        direction=(x, away * y, z),
    )
