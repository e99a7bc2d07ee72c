"""Walking on the floor with a free trunk and two crutches, with or without a harness on a rail or a chair."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from twin_gait.core.arm_policy import SITS, Habit, new_sense, plant_crutch
from twin_gait.core.arms import Arm, Grip, turn_grip
from twin_gait.core.belt import Belt
from twin_gait.core.estimation import first_order_gain, new_delay_line
from twin_gait.core.plant import Plant, Stop, free_coordinate
from twin_gait.core.seat import Seat
from twin_gait.core.trunk import Harness, Trunk
from twin_gait.gait.table import TICK
from twin_gait.leg_model import SHOULDER_HEIGHT, LegModel
from twin_gait.parameters import (
    ArmParameters,
    ChairParameters,
    ContactParameters,
    CrutchParameters,
    require,
)
from twin_gait.parameters.crutches import LEANS
from twin_gait.parameters.quantities import (
    DEGREE,
    NOT_NEGATIVE,
    SHARE,
    Angle,
    Key,
    Length,
    LinearDamping,
    LinearDissipation,
    LinearStiffness,
    Parameters,
    Range,
    Ratio,
    Speed,
    UnitInside,
    Word,
)
from twin_gait.vocabulary import JointName, PelvisGuide, Side, Surroundings
from twin_gait.worlds.scenario import SUPPORT_SHARE, Adjustment, Posture, Scenario, Walking
from twin_gait.worlds.sitting import Sitting, seat_of
from twin_gait.worlds.standing import FALL_SHARE, stand_on_both_feet
from twin_gait.worlds.world import World, start_posture

SHANKS = Range(-0.5, 0.5, words="-0.5 to 0.5 rad (29 deg either way)")
SPEEDS = Range(0.0, 2.0, above=True, words="a speed above 0 and at most 2 m/s (7.2 km/h)")


@dataclass(frozen=True, kw_only=True)
class HarnessParameters(Parameters):
    """A harness at the trunk that hangs from a trolley on a rail overhead; the trolley follows freely.

    Attributes:
        share: Share of the weight of wearer and device that it carries.
        height: Of its attachment above the hips, along the trunk, over the height of the wearer.
        damping: Of the winch in [N s] / [m].
        catch_stiffness: Of the rope once a trip has locked it, in [N] / [m]; 0 for one that does not lock.
        catch_dissipation: Of that rope in [s] / [m] (an assumption).
    """

    share: Annotated[Ratio, SHARE] = 0.0
    height: Annotated[Ratio, Range(0.0, 0.4)] = 0.25
    damping: Annotated[LinearDamping, NOT_NEGATIVE] = 0.0
    catch_stiffness: Annotated[LinearStiffness, NOT_NEGATIVE] = 0.0
    catch_dissipation: Annotated[LinearDissipation, NOT_NEGATIVE] = 2.0


@dataclass(frozen=True, kw_only=True)
class Overground(Scenario):
    """A level floor, a trunk that may lean, and two crutches.

    Attributes:
        speed: In [m] / [s] for which the gait table is scaled.
        crutches: And the limits of the arms; None for hands that hold nothing.
        arms: How the crutches are used.
        harness: Over the head.
        chair: To sit on, or None.
        contact: Of heels, toes and crutches.
        start: Whether the wearer begins standing, or sitting on the chair, in balance.
        lean: Of the trunk at the start in [rad], forwards positive.
        shank: Of a wearer who begins sitting: angle by which the shanks lean forward over the feet in [rad].
        crutch_ahead: Way of the two tips in front of the shoulder at the start in [m].
        fall_lean: Of the trunk, either way, beyond which the wearer has fallen, in [rad].
        leading: Leg that starts in front.
        leading_angles: Of the joints of the leading leg at the start in [rad].
        trailing_angles: Of the trailing leg in [rad].
        leading_phase: Phase of the leading leg at the start.
        trailing_phase: Of the trailing leg.
    """

    kind: ClassVar[str] = "overground"
    step: ClassVar[float] = 0.1e-3  # stiff contacts open and close
    surroundings: ClassVar[Surroundings] = Surroundings.WALKWAY

    speed: Annotated[Speed, SPEEDS] = 0.3
    crutches: Annotated[CrutchParameters | None, Word("none", "forearm", implied=True)] = field(
        default_factory=CrutchParameters
    )
    arms: ArmParameters = field(default_factory=ArmParameters)
    harness: HarnessParameters = field(default_factory=HarnessParameters)
    chair: ChairParameters | None = None
    contact: ContactParameters = field(default_factory=ContactParameters)
    start: Literal["standing", "sitting"] = "standing"
    lean: Annotated[Angle, LEANS] = 8.0 * DEGREE
    shank: Annotated[Angle, SHANKS] = 0.0
    crutch_ahead: Annotated[Mapping[Side, Length], UnitInside()] = field(
        default_factory=lambda: {Side.LEFT: 0.35, Side.RIGHT: 0.3}
    )
    fall_lean: Annotated[Angle, Range(0.0, math.pi, above=True)] = 60.0 * DEGREE
    leading: Side = Side.LEFT
    leading_angles: Annotated[Posture, Key("leading_start")] = field(
        default_factory=lambda: {JointName.HIP: 26.0 * DEGREE, JointName.KNEE: 8.0 * DEGREE}
    )
    trailing_angles: Annotated[Posture, Key("trailing_start")] = field(
        default_factory=lambda: {JointName.HIP: 0.0, JointName.KNEE: 10.0 * DEGREE}
    )
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    @property
    def pelvis(self) -> PelvisGuide:
        """Nothing holds it."""
        return PelvisGuide.FREE

    @property
    def walking(self) -> Walking:
        """On the floor."""
        return Walking(speed=self.speed, support_share=self.harness.share, contact=self.contact, belt=Belt())

    def without_aids(self) -> Self | None:
        """The same floor without crutches."""
        return None if self.crutches is None else replace(self, crutches=None)

    @property
    def adjustments(self) -> tuple[Adjustment, ...]:
        """Support."""
        return (
            Adjustment(
                name=SUPPORT_SHARE,
                value=self.harness.share,
                place="harness.share",
                key="harness.share",
                label="body-weight support",
                least=0.0,
                largest=1.0,
                step=0.01,
                help="Share of the weight of wearer and device that the harness carries.",
            ),
        )

    def leading_of(self, sides: Sequence[Side]) -> Side:
        """Leg that starts in front."""
        return self.leading

    def starting_in(self, postures: Mapping[Side, Posture]) -> Self:
        """The same floor under legs that start in other postures."""
        trailing = next(angles for side, angles in postures.items() if side is not self.leading)
        return replace(self, leading_angles=postures[self.leading], trailing_angles=trailing)

    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Put a model on the floor; both legs, and a wearer if there are crutches."""
        require(len(model.legs) == 2, "legs", "two legs on the floor", len(model.legs))
        require(model.up_axis == "z", "up_axis", "z on the floor", model.up_axis)
        frames = {side: leg.contact_frames for side, leg in model.legs.items()}
        require(all(frames.values()), "contact_frames", "heel and toe frames on both feet", frames)
        forward, height, pitch = model.forward_index, model.pelvis_index, model.pitch_index
        assert forward is not None and height is not None and pitch is not None  # it is free
        tall = 0.0 if model.patient is None else model.patient.height
        postures, phases = {}, {}
        for side in model.sides:
            leads = side is self.leading
            postures[side] = self.leading_angles if leads else self.trailing_angles
            phases[side] = self.leading_phase if leads else self.trailing_phase
        seat = None if self.chair is None else seat_of(model, self.chair)
        sits = self.start == "sitting"
        require(seat is not None or not sits, "start", "standing, or a chair to sit on", self.start)
        if seat is not None and sits:
            q = self._sitting(model, seat, plant)
        else:
            q = start_posture(model, postures, ankle_rest)
            q[pitch] = self.lean
            q[height] = stand_on_both_feet(model, q, 0.0)
        weight = model.total_mass * gravity
        shoulder = SHOULDER_HEIGHT * tall
        arms: tuple[Arm, ...] = ()
        if self.crutches is not None:
            require(model.patient is not None, "crutches", "a patient who holds them", "none")
            where = q[height] + shoulder * math.cos(self.lean), shoulder * math.sin(self.lean)
            arms = self._arms(model.nv, self.crutches, self._habit(tall, weight), where)
            tips = [value for ahead in self.crutch_ahead.values() for value in (where[1] + ahead, 0.0)]
            q = np.array([*q, *tips])
        return World(
            model=model,
            plant=(*plant, *(free_coordinate() for _ in range(2 * len(arms)))),
            start_q=q,
            start_v=np.zeros(len(q)),
            initial_phases=phases,
            contact=self.contact,
            support_force=self.harness.share * weight,
            catch_stiffness=self.harness.catch_stiffness,
            catch_dissipation=self.harness.catch_dissipation,
            body_weight=weight,
            fall_height=FALL_SHARE * (q[height] if seat is None else seat.height),
            contact_frames=frames,
            trunk=Trunk(shoulder, self._harness(tall, weight)),
            arms=arms,
            habit=self._habit(tall, weight) if arms else None,
            sense=new_sense(self._delay_ticks, self.lean, self._felt_chair) if arms else None,
            seat=seat,
            fall_pitch=self.fall_lean,
            longest_reach=math.inf if self.crutches is None else self._longest(tall) + self.crutches.slack,
        )

    def _sitting(self, model: LegModel, seat: Seat, plant: tuple[Plant, ...]) -> np.ndarray:
        seat = replace(seat)  # its sums change
        return Sitting(model, seat, self.contact, plant, lean=self.lean, shank=self.shank).posture()

    def _harness(self, tall: float, weight: float) -> Harness:
        rope = self.harness
        return Harness(rope.height * tall, rope.share * weight, rope.damping, Stop(0.0, 0.0, 0.0, 0.0))

    @property
    def _felt_chair(self) -> float:
        return SITS if self.start == "sitting" else 0.0

    @property
    def _delay_ticks(self) -> int:
        return round(self.arms.delay / TICK)

    def _longest(self, tall: float) -> float:
        assert self.crutches is not None
        return self.crutches.length * tall

    def _arms(
        self, first: int, crutches: CrutchParameters, habit: Habit, shoulder: tuple[float, float]
    ) -> tuple[Arm, ...]:
        """Both arms, with planted crutches."""
        found = []
        for number, ahead in enumerate(self.crutch_ahead.values()):
            arm = Arm(
                place=first + 2 * number,
                mass=crutches.mass,
                push_limit=crutches.push_limit,
                pull_limit=crutches.pull_limit,
                moment_limit=crutches.moment_limit,
                longest=habit.longest,
                straight_stiffness=crutches.straight_stiffness,
                tip_stiffness=crutches.tip_stiffness,
                tip_damping=crutches.tip_damping,
                anchor=shoulder[1] + ahead,
                grip=Grip(habit.push, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                felt_ahead=new_delay_line(self._delay_ticks, ahead),
                felt_load=new_delay_line(self._delay_ticks),
                length=math.hypot(ahead, shoulder[0]),
            )
            turn_grip(arm.grip, math.atan2(ahead, shoulder[0]) + self.lean)
            plant_crutch(habit, arm)
            found.append(arm)
        return tuple(found)

    def _habit(self, tall: float, weight: float) -> Habit:
        arms = self.arms
        return Habit(
            lean=arms.lean,
            push=arms.push * weight,
            push_per_lean=arms.push_per_lean * weight,
            push_per_rate=arms.push_per_rate * weight,
            turn=arms.turn,
            stiffness=arms.stiffness,
            damping=arms.damping,
            turning_stiffness=arms.turning_stiffness,
            turning_damping=arms.turning_damping,
            swing_stiffness=arms.swing_stiffness,
            swing_damping=arms.swing_damping,
            yielding=first_order_gain(TICK, arms.yielding),
            lift_ahead=arms.lift_ahead,
            reach=arms.reach,
            clearance=arms.clearance,
            swing_ticks=max(1, round(arms.swing / TICK)),
            planted_ticks=round(arms.planted / TICK),
            lowering=arms.lowering * TICK,
            touch=arms.touch,
            longest=self._longest(tall),
            chair_tilt=arms.chair_tilt,
            stand_reach=arms.stand_reach,
            stand_ahead=self._longest(tall) * math.sin(arms.stand_reach),
            stand_slack=arms.stand_slack,
            still_ticks=round(arms.still / TICK),
            chair_push=arms.chair_push * weight,
            chair_turn=arms.chair_turn,
            risen=arms.risen_length * self._longest(tall),
            seated=arms.seated_length * self._longest(tall),
            chair_ticks=max(1, round(arms.chair_time / TICK)),
            straightening=arms.straightening * TICK,
        )
