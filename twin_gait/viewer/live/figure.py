"""The scene of the live page: one moment of a walk at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin_gait.leg_model import LegModel
from twin_gait.parameters import Patient
from twin_gait.viewer import surroundings
from twin_gait.viewer.live.window import LiveWindow
from twin_gait.viewer.motion import Footing, LegMotion, Motion, PhaseSpells, centre_of_pressure
from twin_gait.viewer.page import leg_entry, page_data
from twin_gait.viewer.staging import build_scene
from twin_gait.vocabulary import Side

_JOINTS = ("hip", "knee")
_PARTS = ("impedance", "friction_compensation", "gravity_compensation", "target")
_DEGREES = {joint: f"{joint}_angle_rad" for joint in _JOINTS}


class LiveFigure:
    """Draws a leg model and moves it after rows of a log.

    Attributes:
        window: Takes the drawing; pages get it from there.
        page: Description of the page.
    """

    def __init__(
        self,
        model: LegModel,
        *,
        title: str,
        subtitle: str = "",
        patient: Patient | None = None,
        phases: Sequence[str] = (),
    ) -> None:
        """Draw.

        Args:
            model: The model.
            title: Heading of the page.
            subtitle: Line below it.
            patient: The wearer to draw, or None.
            phases: Names of the phases in order.

        Raises:
            ModelError: If the URDF cannot be read.
            ViewerError: If a mesh cannot be read.
        """
        self.window = LiveWindow()
        self._model, self._phases = model, tuple(phases)
        self._scene = build_scene(self.window, model, patient=patient)
        self._time, self._travelled = 0.0, 0.0
        self._columns = _columns(forces=bool(self._scene.arrows))
        self.page = page_data(
            mode="live", title=title, subtitle=subtitle, missing_meshes=self._scene.missing_meshes,
            view=self._scene.view, phases=phases, arrows=bool(self._scene.arrows),
            legs=[leg_entry(side, ["phase", *self._columns]) for side in model.sides],
        )  # fmt: skip
        self.window.describe(self.page)

    def show(
        self, time: float, q: Sequence[float], row: Mapping[str, Any], *, belt_speed: float = 0.0
    ) -> None:
        """Move everything to a moment.

        Args:
            time: In [s].
            q: Coordinates of the model, shape ``(nv,)``.
            row: Row of the log of that moment, by column; a phase is a name.
            belt_speed: Of the treadmill since the last moment in [m] / [s].
        """
        posture = np.asarray(q, dtype=float)
        if not np.isfinite(posture).all():
            return  # a walk that diverged stays as it was last seen
        legs = {side: self._leg(side, time, posture, row) for side in self._model.sides}
        motion = Motion(np.array([time]), posture[None, :], legs, self._phases)
        self._scene.apply(self._scene.state_at(motion, 0, belt_speed) | self._belt(time, belt_speed))
        numbers = [self._numbers(side, row) for side in self._model.sides]
        self.window.sample({"time": time, "legs": numbers})

    def _leg(self, side: Side, time: float, q: np.ndarray, row: Mapping[str, Any]) -> LegMotion:
        footing = None
        if side in self._scene.arrows:
            force = [[row[f"{side}_foot_friction_force_N"], row[f"{side}_foot_normal_force_N"]]]
            point = centre_of_pressure(self._model, q, self._model.legs[side].contact_frames)
            footing = Footing(np.array(force), point[None, :])
        phase = PhaseSpells(np.array([time]), np.array([self._phases.index(row[f"{side}_phase"])]))
        torques = {joint: np.array([row[f"{side}_{joint}_motor_torque_Nm"]]) for joint in _JOINTS}
        return LegMotion(phases=phase, curves={}, footing=footing, torques=torques)

    def _numbers(self, side: Side, row: Mapping[str, Any]) -> dict[str, float]:
        values = {key: float(row[f"{side}_{column}"]) for key, column in self._columns.items()}
        values |= {key: float(np.degrees(values[key])) for key in _DEGREES}
        return values | {"phase": self._phases.index(row[f"{side}_phase"])}

    def _belt(self, time: float, speed: float) -> dict[tuple[str, str], Any]:
        # The way that the belt has gone, because its speed may change.
        self._travelled += speed * max(0.0, time - self._time)
        self._time = time
        if speed == 0.0:
            return {}
        offset = surroundings.belt_offset(self._travelled, 1.0)
        return {(surroundings.BELT, "position"): [offset, 0.0, 0.0]}


def _columns(*, forces: bool) -> dict[str, str]:
    """Column behind the side for everything that the page reads out."""
    columns = {}
    for joint in _JOINTS:
        columns[joint] = _DEGREES[joint]
        columns[f"{joint}_torque"] = f"{joint}_motor_torque_Nm"
        columns |= {f"{joint}_{part}": f"{joint}_{part}_torque_Nm" for part in _PARTS}
    return columns | ({"force": "foot_normal_force_N"} if forces else {})
