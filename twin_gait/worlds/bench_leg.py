"""The hip-femur-knee bench leg: pelvis fixed, leg in the air (thesis, sections 2.5 and 3.6)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

import numpy as np

from twin_gait.core.plant import ImposedMotion, Plant
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import Environment, JointName, PelvisGuide, Side
from twin_gait.worlds.world import Posture, Scenario, World, posture_field, start_posture


@dataclass(frozen=True, kw_only=True)
class ImposedMotionParameters(quantities.Parameters):
    """Imposed motion of one joint, as by a hand that guides it and then releases it.

    Attributes:
        joint: Joint that is moved.
        amplitude: Peak-to-peak amplitude of the path in [rad].
        frequency: Frequency of the path in [Hz].
        stiffness: Stiffness of the grip in [N·m/rad].
        damping: Damping of the grip in [N·m·s/rad].
        release_time: Time at which the grip is released in [s]; infinite for a motion that is imposed to the
            end.
    """

    joint: JointName = JointName.KNEE
    amplitude: quantities.Angle = math.radians(40.0)
    frequency: Annotated[quantities.Frequency, quantities.POSITIVE] = 0.25
    stiffness: Annotated[quantities.RotaryStiffness, quantities.NOT_NEGATIVE] = 400.0
    damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 40.0
    release_time: Annotated[
        quantities.Time, quantities.NON_NEGATIVE_OR_INFINITE, quantities.Key("release")
    ] = math.inf


@dataclass(frozen=True, kw_only=True)
class BenchLeg(Scenario):
    """One leg on a stand, stepping in the air.

    Attributes:
        start_angles: Angles of the joints at time 0 in [rad].
        initial_phase: Phase at time 0; the first of the table if None.
        imposed_motion: Imposed motion, or None.
    """

    kind: ClassVar[str] = "bench_leg"
    surroundings: ClassVar[Environment] = Environment.STAND
    pelvis = PelvisGuide.FIXED

    start_angles: Annotated[Posture, quantities.Key("start")] = posture_field(20.0, 10.0)
    initial_phase: Annotated[str | None, quantities.Key("start_phase")] = None
    imposed_motion: ImposedMotionParameters | None = None

    def replace_postures(self, postures: Mapping[Side, Posture]) -> Self:
        """Return the same stand with a leg that starts in another posture."""
        return replace(self, start_angles=next(iter(postures.values())))

    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Place a model of one leg on the stand."""
        require(len(model.legs) == 1, "legs", "one leg on the bench", len(model.legs))
        (side,) = model.sides
        q = start_posture(model, {side: self.start_angles}, ankle_rest)
        imposed_motion = None
        if self.imposed_motion is not None:
            index = model.index(side, self.imposed_motion.joint)
            imposed_motion = quantities.from_attributes(
                ImposedMotion, self.imposed_motion, index=index, start_angle=float(q[index])
            )
        return World(
            model=model,
            plant=plant,
            start_q=q,
            start_v=np.zeros(model.nv),
            initial_phases={side: self.initial_phase},
            body_weight=model.total_mass * gravity,
            imposed_motion=imposed_motion,
        )
