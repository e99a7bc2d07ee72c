"""Both legs in a frame that holds the pelvis, stepping in the air, as before somebody walks in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Self

import numpy as np

from twin_gait.core.plant import Plant
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.quantities import NOT_NEGATIVE, Key, RotaryDamping, require
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.world import Posture, Scenario, World, start_posture

_DEGREE = math.pi / 180.0


def _posture(hip: float, knee: float) -> dict[JointName, float]:
    return {JointName.HIP: hip * _DEGREE, JointName.KNEE: knee * _DEGREE}


@dataclass(frozen=True, kw_only=True)
class FrameWalk(Scenario):
    """Both legs in a frame.

    Attributes:
        front_angles: Of the first leg at time 0 in [rad]; it starts in the first phase.
        rear_angles: Of the other leg in [rad].
        rear_phase: Phase in which the other leg starts; the first of the table if None.
        resistance: Of dampers at hip and knee in [N·m·s/rad], for legs to work against.
    """

    kind: ClassVar[str] = "frame_walk"

    front_angles: Annotated[Posture, Key("front")] = field(default_factory=lambda: _posture(20.0, 10.0))
    rear_angles: Annotated[Posture, Key("rear")] = field(default_factory=lambda: _posture(-10.0, 10.0))
    rear_phase: str | None = None
    resistance: Annotated[RotaryDamping, NOT_NEGATIVE] = 0.0

    @property
    def pelvis(self) -> PelvisGuide:
        return PelvisGuide.FIXED

    def replace_postures(self, postures: Mapping[Side, Posture]) -> Self:
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
