"""The whole scene of a leg model: figure, wearer, surroundings, forces and the colours of the phases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twin_gait.leg_model import LegJoints, LegModel, PelvisGuide
from twin_gait.leg_model.leg_model import PELVIS_JOINT
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import REDDISH_PURPLE, phase_colour
from twin_gait.parameters import PatientParameters
from twin_gait.viewer import shapes, surroundings
from twin_gait.viewer.body import draw_wearer
from twin_gait.viewer.commands import Colour, Material, Window, rgb, set_object, set_property
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.visuals import FIXED_JOINT, Visuals, load_visuals
from twin_gait.vocabulary import Side

FORCE_ROOT = "/meshcat/forces"
METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
_LONGEST_ARROW = 1.2  # [m]
_IDLE = (0.55, 0.60, 0.66)  # covers of motors before a phase is known
_FIELD_OF_VIEW = 24.0  # [deg]: narrow, so that both legs look the same length
_RIGHT_SIDE = (0.13, -1.0, 0.10)  # direction from the figure to the eye

State = dict[tuple[str, str], Any]


@dataclass(frozen=True)
class View:
    """Where the camera is to look.

    Attributes:
        target: Middle of what is to be seen in [m].
        direction: From there to the eye.
        width: Of what is to be seen in [m].
        height: Of what is to be seen in [m].
        field_of_view: Vertical, in [deg].
    """

    target: tuple[float, float, float]
    width: float
    height: float
    direction: tuple[float, float, float] = _RIGHT_SIDE
    field_of_view: float = _FIELD_OF_VIEW


class Scene:
    """A scene that has been drawn and can be moved.

    Attributes:
        figure: The articulated figure.
        view: Where the camera is to look.
        missing_meshes: Mesh files of the URDF that were not found.
        covers: Places of the coloured motor covers per leg.
        arrows: Place of the ground force per leg.
    """

    def __init__(self, window: Window, figure: Figure, visuals: Visuals) -> None:
        """Start a scene with a figure; :func:`build_scene` completes it.

        Args:
            window: Where commands go.
            figure: The articulated figure.
            visuals: What the URDF shows.
        """
        self.figure = figure
        self.missing_meshes = visuals.missing
        self.covers: dict[Side, list[str]] = {}
        self.arrows: dict[Side, str] = {}
        self.view = View(target=(0.0, 0.0, 0.0), width=1.0, height=1.0)
        self._window = window
        self._shown: State = {}

    def draw_covers(self, side: Side, leg: LegJoints, visuals: Visuals) -> None:
        """Draw the covers of the motors of a leg, which show its phase.

        Args:
            side: Which leg.
            leg: Its joint names.
            visuals: What the URDF shows.
        """
        paths = []
        for joint in (leg.hip, leg.knee):
            default = 0.12 * float(np.linalg.norm(self.figure.segment(joint, leg)))
            motor = self.figure.motor(joint, visuals.discs, default)
            paths.append(self.figure.draw_cover(joint, motor, Material(colour=_IDLE, roughness=0.4, glow=0.12)))
        self.covers[side] = paths

    def draw_arrow(self, side: Side) -> None:
        """Draw the arrow of the ground force on a foot, hidden.

        Args:
            side: Which leg.
        """
        path = f"{FORCE_ROOT}/{side}"
        self._window.send(set_object(path, shapes.arrow(), Material(colour=rgb(REDDISH_PURPLE), glow=0.35)))
        self._window.send(set_property(f"{path}/<object>", "castShadow", False))
        self._window.send(set_property(path, "visible", False))
        self.arrows[side] = path

    def posture_state(self, q: np.ndarray) -> State:
        """Positions and quaternions of all joint groups.

        Args:
            q: Coordinates, shape ``(nq,)``.

        Returns:
            Values by place and property.
        """
        state: State = {}
        for path, (position, quaternion) in self.figure.posture(q).items():
            state[path, "position"] = position
            state[path, "quaternion"] = quaternion
        return state

    def force_state(self, side: Side, force: np.ndarray, point: np.ndarray) -> State:
        """Arrow of the ground force on a foot.

        Args:
            side: Which leg.
            force: Forward and upward in [N], shape ``(2,)``.
            point: Where it acts in [m], shape ``(3,)``.

        Returns:
            Values by place and property.
        """
        path = self.arrows[side]
        forward, upward = float(force[0]), float(force[1])
        visible = upward > CONTACT_FORCE
        length = float(np.clip(np.hypot(forward, upward) * METRES_PER_NEWTON, 1e-3, _LONGEST_ARROW))
        width = float(np.clip(length / 0.2, 0.3, 1.0))
        half = 0.5 * np.arctan2(forward, upward) if visible else 0.0
        return {
            (path, "visible"): visible,
            (path, "position"): [float(value) for value in point],
            (path, "quaternion"): [0.0, float(np.sin(half)), 0.0, float(np.cos(half))],
            (path, "scale"): [width, width, length],
        }

    def state_at(self, motion: Motion, frame: int, belt_speed: float) -> State:
        """Everything that a frame of a motion shows.

        Args:
            motion: The motion.
            frame: Which frame.
            belt_speed: In [m] / [s].

        Returns:
            Values by place and property.
        """
        time = float(motion.times[frame])
        state = self.posture_state(motion.q[frame])
        for side, leg in motion.legs.items():
            if leg.footing is not None and side in self.arrows:
                state |= self.force_state(side, leg.footing.force[frame], leg.footing.point[frame])
            if leg.phases is not None:
                colour = phase_rgb(motion.phase_names, leg.phases.at(time))
                state |= {(path, "color"): [*colour, 1.0] for path in self.covers.get(side, ())}
        if belt_speed != 0.0:
            offset = surroundings.belt_offset(time, belt_speed)
            state[surroundings.BELT, "position"] = [offset, 0.0, 0.0]
        return state

    def apply(self, state: State) -> None:
        """Send what has changed since the last state.

        Args:
            state: Values by place and property.
        """
        for (path, name), value in state.items():
            if self._shown.get((path, name)) != value:
                self._window.send(set_property(path, name, value))
                self._shown[path, name] = value


def phase_rgb(names: Sequence[str], code: int) -> Colour:
    """Colour of a phase.

    Args:
        names: Names of all phases.
        code: Position of the phase among them.

    Returns:
        Red, green and blue from 0 to 1.
    """
    return rgb(phase_colour(names[code], code))


def build_scene(window: Window, model: LegModel, *, patient: PatientParameters | None = None) -> Scene:
    """Draw a leg model with its wearer and its surroundings.

    Args:
        window: Where commands go.
        model: The model; with a guided pelvis it stands on a treadmill, one leg alone hangs on a bench.
        patient: The wearer to draw, or None.

    Returns:
        The scene.

    Raises:
        ModelError: If the URDF cannot be read.
        ViewerError: If a mesh of the URDF cannot be read.
    """
    surroundings.set_studio(window)
    scene = _figure_scene(window, model.model, model.urdf_path, model.legs, model.up_axis)
    walks = model.pelvis is PelvisGuide.VERTICAL
    if patient is not None:
        trunk = PELVIS_JOINT if walks else FIXED_JOINT
        both = len(model.legs) > 1
        draw_wearer(scene.figure, list(model.legs.values()), patient, trunk_joint=trunk if both else None)
    top, bottom = _extent(scene.figure, model)
    if walks:
        for side, leg in model.legs.items():
            if leg.contact_frames:
                scene.draw_arrow(side)
        surroundings.draw_treadmill(window)
        height = top - bottom
        scene.view = View((0.0, 0.0, 0.60 * height), width=1.5 * height, height=1.50 * height)
        return scene
    _surround_fixed(window, scene, model, top, bottom)
    return scene


def build_urdf_scene(window: Window, model: pin.Model, urdf: Path) -> Scene:
    """Draw any URDF, in the posture with all coordinates at zero.

    Args:
        window: Where commands go.
        model: Pinocchio model of it.
        urdf: The file.

    Returns:
        The scene.

    Raises:
        ModelError: If the URDF cannot be read.
        ViewerError: If a mesh of the URDF cannot be read.
    """
    surroundings.set_studio(window)
    scene = _figure_scene(window, model, urdf, {}, "z")
    points = _all_points(scene.figure, load_visuals(model, urdf))
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low)) or 1.0
    middle = 0.5 * (low + high)
    surroundings.draw_floor(window, float(low[2]) - 0.01 * size, radius=max(1.0, 1.2 * size))
    scene.view = View(
        (float(middle[0]), float(middle[1]), float(middle[2])), width=1.1 * size, height=1.1 * size,
        direction=(0.6, -1.0, 0.3),
    )  # fmt: skip
    return scene


def _figure_scene(
    window: Window, model: pin.Model, urdf: Path, legs: Mapping[Side, LegJoints], up_axis: str
) -> Scene:
    visuals = load_visuals(model, urdf)
    figure = Figure(window, model, up_axis=up_axis)
    figure.draw_visuals(visuals)
    figure.draw_sticks(legs.values(), visuals)
    scene = Scene(window, figure, visuals)
    for side, leg in legs.items():
        scene.draw_covers(side, leg, visuals)
    return scene


def _surround_fixed(window: Window, scene: Scene, model: LegModel, top: float, bottom: float) -> None:
    """Bench for one leg, a floor for more; the leg hangs clear of both."""
    height = top - bottom
    if len(model.legs) > 1:
        surroundings.draw_floor(window, bottom - 0.02)
        scene.view = View((0.0, 0.0, bottom + 0.62 * height), width=1.3 * height, height=1.4 * height)
        return
    ((side, leg),) = model.legs.items()
    points = scene.figure.world_points(pin.neutral(model.model), {})
    del points
    hip = _joint_position(scene.figure, leg.hip)
    floor = bottom - 0.22 * height
    surroundings.draw_bench(window, floor, hip, far_side=1.0 if side is Side.RIGHT else -1.0)
    direction = _RIGHT_SIDE if side is Side.RIGHT else (_RIGHT_SIDE[0], -_RIGHT_SIDE[1], _RIGHT_SIDE[2])
    middle = 0.5 * (top + 0.16 * height + floor)
    scene.view = View(
        (float(hip[0]) + 0.10 * height, float(hip[1]), middle),
        width=1.5 * height,
        height=top + 0.26 * height - floor,
        direction=direction,
    )


def _joint_position(figure: Figure, joint: str) -> np.ndarray:
    data = figure.model.createData()
    pin.forwardKinematics(figure.model, data, pin.neutral(figure.model))
    position = np.asarray(data.oMi[figure.model.getJointId(joint)].translation)
    return np.asarray(figure.base[:3, :3] @ position)


def _extent(figure: Figure, model: LegModel) -> tuple[float, float]:
    """Height of the hips and of the lowest point of the legs in the neutral posture, in [m]."""
    heights = []
    for leg in model.legs.values():
        last = leg.items()[-1][1]
        data = figure.model.createData()
        pin.forwardKinematics(figure.model, data, pin.neutral(figure.model))
        end = data.oMi[figure.model.getJointId(last)].act(figure.segment(last, leg))
        heights += [float(_joint_position(figure, leg.hip)[2]), float((figure.base[:3, :3] @ end)[2])]
    return max(heights), min(heights)


def _all_points(figure: Figure, visuals: Visuals) -> np.ndarray:
    """Vertices of all visuals and origins of all joints in the neutral posture, shape ``(n, 3)``."""
    data = figure.model.createData()
    pin.forwardKinematics(figure.model, data, pin.neutral(figure.model))
    points = [np.asarray(placement.translation)[None, :] for placement in data.oMi]
    for part in visuals.parts:
        placement = data.oMi[figure.model.getJointId(part.joint) if part.joint != FIXED_JOINT else 0]
        points.append(part.shape.vertices @ np.asarray(placement.rotation).T + np.asarray(placement.translation))
    return np.concatenate(points) @ figure.base[:3, :3].T
