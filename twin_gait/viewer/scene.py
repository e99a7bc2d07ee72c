"""A scene that has been drawn, and what changes in it: posture, forces, colours of phases, belt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin_gait.leg_model import LegJoints
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import phase_colour
from twin_gait.viewer import shapes, surroundings
from twin_gait.viewer.commands import Material, Window, rgb, set_object, set_property
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.page import FORCE_COLOUR, METRES_PER_NEWTON
from twin_gait.viewer.visuals import Visuals
from twin_gait.vocabulary import Side

FORCE_ROOT = "/meshcat/forces"
_LONGEST_ARROW = 1.2  # [m]
_IDLE = (0.55, 0.60, 0.66)  # covers of motors before a phase is known
_FIELD_OF_VIEW = 24.0  # [deg]: narrow, so that both legs look the same length
RIGHT_SIDE = (0.13, -1.0, 0.10)  # direction from the figure to the eye

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
    direction: tuple[float, float, float] = RIGHT_SIDE
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
        material = Material(colour=_IDLE, roughness=0.4, glow=0.12)
        for joint in (leg.hip, leg.knee):
            default = 0.12 * float(np.linalg.norm(self.figure.segment(joint, leg)))
            motor = self.figure.motor(joint, visuals.discs, default)
            paths.append(self.figure.draw_cover(joint, motor, material))
        self.covers[side] = paths

    def draw_arrow(self, side: Side) -> None:
        """Draw the arrow of the ground force on a foot, hidden.

        Args:
            side: Which leg.
        """
        path = f"{FORCE_ROOT}/{side}"
        self._window.send(set_object(path, shapes.arrow(), Material(colour=rgb(FORCE_COLOUR), glow=0.15)))
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
                code = leg.phases.at(time)
                colour = rgb(phase_colour(motion.phase_names[code], code))
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
