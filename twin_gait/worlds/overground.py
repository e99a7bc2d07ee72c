"""Walking on the floor with a free trunk and two crutches, with or without a harness on a rail or a chair."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from twin_gait.core.arms import Arm, Grip, set_grip_angle
from twin_gait.core.belt import Belt
from twin_gait.core.estimation import PERCEPTION_CAPACITY, new_delay_line
from twin_gait.core.plant import Harness, Plant, Trunk
from twin_gait.gait.table import TICK
from twin_gait.leg_model.anthropometry import SHOULDER_HEIGHT
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters import quantities
from twin_gait.parameters.crutches import LEAN_ANGLES, ArmParameters, CrutchParameters
from twin_gait.parameters.environment import ATTACHMENTS, ChairParameters, Contact, ContactParameters
from twin_gait.vocabulary import Environment, PelvisGuide, Side
from twin_gait.worlds.arm_policy import SITTING, new_perception, new_policy, plant_crutch
from twin_gait.worlds.standing import (
    FALL_LEAN,
    FALL_SHARE,
    FallLean,
    FallShare,
    SeatedBalance,
    SplitStance,
    level_feet,
    new_seat,
)
from twin_gait.worlds.world import Adjustment, Posture, Walking, World, posture_field, start_posture

SHANKS = quantities.Range(-0.5, 0.5, words="-0.5 to 0.5 rad (29 deg either way)")
SPEEDS = quantities.Range(
    0.0, 2.0, exclusive_minimum=True, words="a speed above 0 and at most 2 m/s (7.2 km/h)"
)


@dataclass(frozen=True, kw_only=True)
class HarnessParameters(quantities.Parameters):
    """Harness at the trunk that hangs from a trolley on a rail overhead; the trolley follows freely.

    Attributes:
        share: Share of the weight of wearer and device that the harness carries.
        height: Height of its attachment above the hips, along the trunk, divided by the height of the wearer.
        damping: Damping of the winch in [N·s/m].
        lock_stiffness: Stiffness in [N/m] of the rope after a trip has locked it; 0 for a rope that does
            not lock.
        lock_dissipation: Dissipation of the locked rope in [s/m] (an assumption).
    """

    share: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    height: Annotated[quantities.Ratio, ATTACHMENTS] = 0.25
    damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 0.0
    lock_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 0.0
    lock_dissipation: Annotated[quantities.LinearDissipation, quantities.NOT_NEGATIVE] = 2.0


@dataclass(frozen=True, kw_only=True)
class Overground(SplitStance):
    """Level floor, trunk that may lean, and two crutches.

    Attributes:
        speed: Walking speed in [m/s] for which the gait table is scaled.
        crutches: Crutches and the limits of the arms; None for hands that hold nothing.
        arms: Use of the crutches.
        harness: Harness on a rail overhead.
        chair: Chair to sit on, or None.
        contact: Contact parameters of heels, toes and crutches.
        start: Whether the wearer begins standing, or sitting on the chair, in balance.
        lean: Lean of the trunk at the start in [rad], forwards positive.
        shank: Angle in [rad] by which the shanks of a wearer who begins sitting lean forward over the feet.
        crutch_ahead: Distance of the two tips in front of the shoulder at the start in [m].
        fall_lean: Lean of the trunk in [rad], in either direction, beyond which the wearer has fallen.
        fall_height_share: Share of the height of the pelvis at the start, or of the seat with a chair, below
            which the wearer has fallen and the run ends. A lower one lets a descent continue to the ground.
        leading: Leg that starts in front.
        leading_angles: Angles of the joints of the leading leg at the start in [rad].
        trailing_angles: Angles of the joints of the trailing leg at the start in [rad].
        leading_phase: Phase of the leading leg at the start.
        trailing_phase: Phase of the trailing leg at the start.
    """

    kind: ClassVar[str] = "overground"
    surroundings: ClassVar[Environment] = Environment.WALKWAY
    pelvis = PelvisGuide.FREE

    speed: Annotated[quantities.Speed, SPEEDS] = 0.3
    crutches: Annotated[CrutchParameters | None, quantities.LiteralAlias("none", "forearm")] = field(
        default_factory=CrutchParameters
    )
    arms: ArmParameters = field(default_factory=ArmParameters)
    harness: HarnessParameters = field(default_factory=HarnessParameters)
    chair: ChairParameters | None = None
    contact: Contact = field(default_factory=ContactParameters)
    start: Literal["standing", "sitting"] = "standing"
    lean: Annotated[quantities.Angle, LEAN_ANGLES] = math.radians(8.0)
    shank: Annotated[quantities.Angle, SHANKS] = 0.0
    crutch_ahead: Annotated[Mapping[Side, quantities.Length], quantities.UnitInKeys()] = field(
        default_factory=lambda: {Side.LEFT: 0.35, Side.RIGHT: 0.3}
    )
    fall_lean: FallLean = FALL_LEAN
    fall_height_share: FallShare = FALL_SHARE
    leading: Side = Side.LEFT
    leading_angles: Annotated[Posture, quantities.Key("leading_start")] = posture_field(26.0, 8.0)
    trailing_angles: Annotated[Posture, quantities.Key("trailing_start")] = posture_field(0.0, 10.0)
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    @property
    def step(self) -> float:
        """Default step in [s]: stiff contacts open and close; 0.125 ms errs by 0.07° within two seconds."""
        return 0.1e-3

    @property
    def walking(self) -> Walking:
        """Parameters of walking on the floor."""
        return Walking(speed=self.speed, support_share=self.harness.share, contact=self.contact, belt=Belt())

    def remove_aids(self) -> Self | None:
        """Return the same floor without crutches; None where there are none."""
        return None if self.crutches is None else replace(self, crutches=None)

    @property
    def adjustments(self) -> tuple[Adjustment, ...]:
        """Adjustment of the body-weight support."""
        return (Adjustment.create_support(self.harness.share, "harness.share", "harness carries"),)

    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Place a model with both legs on the floor, with a wearer if there are crutches."""
        self.require_feet(model, "the floor")
        height, pitch, weight = model.pelvis_index, model.pitch_index, model.total_mass * gravity
        assert height is not None and pitch is not None  # the pelvis is free
        tall = 0.0 if model.patient is None else model.patient.height
        seat = None if self.chair is None else new_seat(model, self.chair)
        if self.start == "sitting":
            quantities.require(seat is not None, "start", "standing, or a section chair", self.start)
            assert seat is not None
            still = replace(seat)  # a copy, because the sums of a seat change
            q = SeatedBalance(
                model, still, self.contact, plant, lean=self.lean, shank=self.shank
            ).solve_posture()
        else:
            q = start_posture(model, self.postures(), ankle_rest)
            q[pitch] = self.lean
            q[height] = level_feet(model, q, 0.0)
        rope = self.harness
        harness = Harness(rope.height * tall, rope.share * weight, rope.damping)
        trunk = Trunk(SHOULDER_HEIGHT * tall, harness)
        low = self.fall_height_share * (q[height] if seat is None else seat.height)
        more = {"fall_height": low, "fall_pitch": self.fall_lean, "trunk": trunk, "seat": seat}
        world = self.build_standing_world(model, plant, q, rope, weight, **more)
        return world if self.crutches is None else self._with_crutches(world, self.crutches)

    def _with_crutches(self, world: World, crutches: CrutchParameters) -> World:
        """Return a world in which the wearer has planted both crutches."""
        patient, pelvis = world.model.patient, world.model.pelvis_index
        expected = "a section patient, because a person holds the crutches"
        quantities.require(patient is not None, "crutches", expected, "none")
        assert patient is not None and world.trunk is not None and pelvis is not None
        longest, delay = crutches.length * patient.height, round(self.arms.delay / TICK)
        policy = new_policy(self.arms, world.body_weight, longest)
        up = world.start_q[pelvis] + world.trunk.shoulder * math.cos(self.lean)
        forward = world.trunk.shoulder * math.sin(self.lean)
        arms: list[Arm] = []
        tips: list[float] = []
        for ahead in self.crutch_ahead.values():
            arm = quantities.from_attributes(
                Arm,
                crutches,
                number=1.0 + len(arms),
                index=world.model.nv + len(tips),
                max_length=longest,
                anchor=forward + ahead,
                grip=Grip(self.arms.axial_force * world.body_weight, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                distance_delay=new_delay_line(delay, ahead, PERCEPTION_CAPACITY),
                load_delay=new_delay_line(delay, 0.0, PERCEPTION_CAPACITY),
                length=math.hypot(ahead, up),
            )
            set_grip_angle(arm.grip, math.atan2(ahead, up) + self.lean)
            plant_crutch(policy, arm)
            arms.append(arm)
            tips += [forward + ahead, 0.0]
        q = np.array([*world.start_q, *tips])
        return replace(
            world,
            plant=(*world.plant, *(Plant() for _ in tips)),
            start_q=q,
            start_v=np.zeros(len(q)),
            arms=tuple(arms),
            policy=policy,
            perception=new_perception(delay, self.lean, SITTING if self.start == "sitting" else 0.0),
            max_reach=longest + crutches.slack,
        )
