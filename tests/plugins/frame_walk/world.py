"""Both legs in a frame that holds the pelvis, stepping in the air, as before somebody walks in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np

from twin_gait.configuration.scenario_section import AnglesEntry
from twin_gait.configuration.sections import Section
from twin_gait.configuration.validation import Number
from twin_gait.core.plant import Plant
from twin_gait.leg_model import LegModel
from twin_gait.parameters import require, require_non_negative
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds import Scenario, World, start_posture

_DEGREE = math.pi / 180.0


class FrameWalkEntry(Section):
    """The frame in a file."""

    renamed: ClassVar = {"front": "front_angles", "rear": "rear_angles"}
    kind: Literal["frame_walk"]
    front: AnglesEntry | None = None
    rear: AnglesEntry | None = None
    rear_phase: str | None = None
    resistance_Nms_per_rad: Number = 0.0

    @classmethod
    def document(cls, parameters):
        return {"kind": "frame_walk", **super().document(parameters)}


@dataclass(frozen=True, kw_only=True)
class FrameWalk(Scenario):
    """Both legs in a frame.

    Attributes:
        front_angles: Hip and knee of the first leg at time 0 in [rad]; it starts in the first phase.
        rear_angles: Hip and knee of the other leg in [rad].
        rear_phase: Phase in which the other leg starts; the first of the table if None.
        resistance: Of dampers at hip and knee in [N m s] / [rad], for legs to work against.
    """

    kind: ClassVar[str] = "frame_walk"
    section: ClassVar = FrameWalkEntry

    front_angles: tuple[float, float] = (20.0 * _DEGREE, 10.0 * _DEGREE)
    rear_angles: tuple[float, float] = (-10.0 * _DEGREE, 10.0 * _DEGREE)
    rear_phase: str | None = None
    resistance: float = 0.0

    def __post_init__(self) -> None:
        require_non_negative("resistance", self.resistance)

    @property
    def pelvis(self) -> PelvisGuide:
        return PelvisGuide.FIXED

    def starting_in(self, postures: Mapping[Side, tuple[float, float]]) -> Self:
        front, rear = postures.values()
        return replace(self, front_angles=front, rear_angles=rear)

    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        require(len(model.legs) == 2, "legs", "two legs in the frame", len(model.legs))
        front, rear = model.sides
        for side in model.sides:
            for joint in (JointName.HIP, JointName.KNEE):
                plant[model.index(side, joint)].spring.damping = self.resistance
        return World(
            model=model,
            plant=plant,
            start_q=start_posture(model, {front: self.front_angles, rear: self.rear_angles}, ankle_rest),
            start_v=np.zeros(model.nv),
            initial_phases={front: None, rear: self.rear_phase},
            body_weight=model.total_mass * gravity,
        )


FrameWalkEntry.parameters = FrameWalk
