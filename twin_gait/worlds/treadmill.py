"""Both legs on a treadmill with body-weight support, the pelvis guided vertically or in a harness."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar

from twin_gait.core.belt import Belt
from twin_gait.core.plant import Harness, Plant, Trunk
from twin_gait.leg_model.anthropometry import SHOULDER_HEIGHT
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.crutches import LEAN_ANGLES
from twin_gait.parameters.environment import BeltProfile, Contact, ContactParameters, SupportParameters
from twin_gait.parameters.quantities import (
    KM_PER_H,
    Angle,
    Key,
    Range,
    Speed,
    Time,
    from_attributes,
    require,
)
from twin_gait.vocabulary import Environment, PelvisGuide, PelvisPitch, Side
from twin_gait.worlds.standing import FALL_LEAN, FALL_SHARE, FallLean, FallShare, SplitStance, level_feet
from twin_gait.worlds.world import (
    BELT_SPEED,
    Adjustment,
    Posture,
    Walking,
    World,
    posture_field,
    start_posture,
)

STEEPEST = math.radians(10.0)  # [rad], steepest slope; treadmills rise to 15 % (8.5 deg) as a rule
SPEEDS = Range(0.0, 2.0, exclusive_minimum=True, words="a belt speed above 0 and at most 2 m/s (7.2 km/h)")
RAMPS = Range(0.0, exclusive_minimum=True, allows_infinity=True, words="a time above 0")
SLOPES = Range(-STEEPEST, STEEPEST, words=f"{STEEPEST:.4f} rad (10 deg) at most, up or down")
# Steps in [s]; a whole number of each fills a tick of 1 ms.
STEPS = tuple(1e-3 / number for number in (4, 5, 8, 10, 20, 40, 50, 100))
RK4_LIMIT = 2.785  # Largest step over the time constant of a decay at which Runge-Kutta is stable.
# Peak load of a foot divided by the effective mass of the foot in [m/s²], for the shipped gait table: the
# largest of 300 random wearers (40 to 110 kg, 1.50 to 1.95 m, 0.8 to 2.6 km/h, support of 0 to 75 %; computed
# once on 2026-11-29), rounded up. examples/validation.py checks the resulting steps with 64 other wearers.
LOAD_PER_MASS = 1100.0
# The same in braces, in which the foot of the wearer is lighter: the friction was unstable in 17 of 32 random
# walks with calibrated feet at steps for which 1100 was assumed, in none of them at half of these steps, and
# at the limit for 1620 to 1740, the growth with the stiffness included (computed on 2026-11-30 with 50 to
# 110 kg, 1.50 to 1.95 m, 0.8 to 1.9 km/h and supports of 20 to 80 %).
BRACED_LOAD_PER_MASS = 1550.0
# It is proportional to the carried share of the weight up to SLOW in [m/s]. The load peaks of faster walks
# are higher: 2.8 times the carried weight at 1.5 km/h, 7 times at 2.4 km/h. Growth in [s/m].
SLOW, GROWTH_WITH_SPEED = 1.5 / 3.6, 5.8
# With heels that are stiffer than this one in [N/m^1.5], the largest friction rates of 64 random wearers grow
# by 1.16 (4.7e5), 1.50 (1e6) and 1.82 (2e6); a stiffer forefoot alone does not raise the load peak.
FITTED_STIFFNESS, GROWTH_WITH_STIFFNESS = 3.0e5, 1.0 / 3.0
BELT_RANGE = (0.5, 1.5)  # range of adjustment relative to the present speed; tables are made for one speed


@dataclass(frozen=True, kw_only=True)
class Treadmill(SplitStance):
    """Treadmill with body-weight support.

    The pelvis moves vertically, and in a harness fore-aft against a spring and a damper. It may pitch in the
    straps of the harness. Guide or harness take up the horizontal force and the pitching moment, which the
    log contains.

    Attributes:
        belt_speed: Speed of the belt in [m/s]; 1.5 km/h is the device's target speed (thesis, table 2.1).
        belt: Profile by which the belt starts and stops, and of the walk command; None for a belt that runs
            evenly under legs that always walk.
        stop_ramp: Time in [s] in which a trip of the monitor or the operator's Stop brings the belt to rest
            (an assumption: device and treadmill share one stop circuit); infinite for a belt that runs on.
        slope: Slope by which the belt rises forwards in [rad], about the point under the pelvis; negative
            downhill. Gravity, guide and support stay vertical.
        support: Body-weight support and guide.
        contact: Contact parameters of heels and toes.
        lean: Lean of the trunk at the start in [rad], forwards positive; 0 if the pitch is locked.
        fall_lean: Lean of the trunk in [rad], in either direction, beyond which the wearer has fallen.
        fall_height_share: Share of the height of the pelvis at the start, below which the wearer has fallen
            and the run ends. A lower one lets a descent continue to the ground.
        leading: Leg that starts in front.
        leading_angles: Angles of the joints of the leading leg at the start in [rad], on level ground. On a
            slope both legs are turned with it about the hips, so that they meet the belt as on level ground.
        trailing_angles: Angles of the joints of the trailing leg at the start in [rad].
        leading_phase: Phase of the leading leg at the start.
        trailing_phase: Phase of the trailing leg at the start.
    """

    kind: ClassVar[str] = "treadmill"
    surroundings: ClassVar[Environment] = Environment.TREADMILL

    belt_speed: Annotated[Speed, SPEEDS] = 1.5 / 3.6
    belt: BeltProfile | None = None
    stop_ramp: Annotated[Time, RAMPS] = 0.5
    slope: Annotated[Angle, SLOPES] = 0.0
    support: SupportParameters = field(default_factory=SupportParameters)
    contact: Contact = field(default_factory=ContactParameters)
    lean: Annotated[Angle, LEAN_ANGLES] = 0.0
    fall_lean: FallLean = FALL_LEAN
    fall_height_share: FallShare = FALL_SHARE
    leading: Side = Side.LEFT
    # Posture between two steps of the guided walk; both feet reach the belt, and the first swings clear it.
    leading_angles: Annotated[Posture, Key("leading_start")] = posture_field(18.0, 10.0)
    trailing_angles: Annotated[Posture, Key("trailing_start")] = posture_field(-8.0, 11.0)
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    def __post_init__(self) -> None:
        """Check the ranges, and that a trunk that leans may pitch."""
        super().__post_init__()
        upright = self.lean == 0.0 or self.support.pitch is not PelvisPitch.LOCKED
        require(upright, "lean", "0 while support.pitch is locked", self.lean)

    @property
    def step(self) -> float:
        """Default step in [s]: the largest at which the friction of the feet is stable."""
        return largest_stable_step(self.contact, self.belt_speed, 1.0 - self.support.share)

    @property
    def braced_step(self) -> float:
        """Default step in [s] in braces, by the same rule."""
        share = 1.0 - self.support.share
        return largest_stable_step(self.contact, self.belt_speed, share, BRACED_LOAD_PER_MASS)

    def _belt(self) -> Belt:
        return from_attributes(Belt, self.belt, cruise=self.belt_speed, stop_ramp=self.stop_ramp)

    @property
    def steady(self) -> tuple[float, float]:
        """Start and end in [s] of the time in which the belt runs evenly and the walk command is on."""
        belt = self.belt
        return (0.0, math.inf) if belt is None else (belt.start + belt.delay + belt.ramp, belt.stop)

    @property
    def pelvis(self) -> PelvisGuide:
        """Guide of the pelvis."""
        return self.support.pelvis

    @cached_property  # a summary reads it about ten times
    def walking(self) -> Walking:
        """Parameters of walking on the belt."""
        return Walking(
            speed=self.belt_speed,
            support_share=self.support.share,
            slope=self.slope,
            contact=self.contact,
            belt=self._belt(),
        )

    @property
    def adjustments(self) -> tuple[Adjustment, ...]:
        """Adjustments of belt speed and body-weight support."""
        speed = self.belt_speed / KM_PER_H
        return (
            Adjustment(
                name=BELT_SPEED,
                value=self.belt_speed,
                path="belt_speed",
                label="belt speed",
                unit="km/h",
                scale=KM_PER_H,
                minimum=BELT_RANGE[0] * speed,
                maximum=BELT_RANGE[1] * speed,
                step=0.05,
                help="The hip angles of the gait table are scaled with it by a law in the table.",
            ),
            Adjustment.create_support(self.support.share, "support.share", "ropes carry"),
        )

    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Place a model with both legs and a pelvis that moves on the treadmill."""
        self.require_feet(model, "a treadmill")
        ropes, pelvis, weight = self.support, model.pelvis_index, model.total_mass * gravity
        assert pelvis is not None  # the pelvis of this scenario moves
        trunk, force = None, ropes.share * weight
        if model.pitch_index is None:
            plant[pelvis].spring.damping, plant[pelvis].spring.force = ropes.damping, force
        else:
            tall = 0.0 if model.patient is None else model.patient.height
            rope = from_attributes(Harness, ropes, height=ropes.height * tall, force=force, lever=ropes.lever)
            trunk = Trunk(SHOULDER_HEIGHT * tall, rope)
        if model.forward_index is not None:
            harness = plant[model.forward_index].spring
            harness.stiffness, harness.damping = ropes.forward_stiffness, ropes.forward_damping
        q = start_posture(model, self.postures(self.slope), ankle_rest)
        if model.pitch_index is not None:
            q[model.pitch_index] = self.lean
        q[pelvis] = level_feet(model, q, math.tan(self.slope))
        more = {"belt": self._belt(), "slope": self.slope, "fall_height": self.fall_height_share * q[pelvis]}
        more |= {"fall_pitch": self.fall_lean, "trunk": trunk}
        return self.build_standing_world(model, plant, q, ropes, weight, **more)


def largest_stable_step(
    contact: ContactParameters,
    belt_speed: float,
    carried_share: float,
    load_per_mass: float = LOAD_PER_MASS,
) -> float:
    r"""Return the largest step of :data:`STEPS` at which the friction of the feet is stable.

    Near rest the regularised friction of a foot with load F is a damper :math:`\mu F / v_t`, and the slip of
    the foot decays with the rate :math:`\lambda = \mu F / (v_t m)`, where the effective mass m of the foot is
    :math:`1 / (J M^{-1} J^T)`. Runge-Kutta is stable for :math:`h \lambda < 2.785`. F/m is estimated from
    ``load_per_mass`` in [m/s²], and grows with the carried share, the speed and the stiffness of the heel. A
    walk with higher load peaks needs a smaller step; the energy balance of its summary then shows it.

    ``belt_speed`` in [m/s]; ``carried_share``: share of the weight that the legs carry. Returns the step
    in [s], and the smallest one if none is stable.
    """
    share = carried_share * (1.0 + GROWTH_WITH_SPEED * max(0.0, belt_speed - SLOW))
    peak = load_per_mass * max(1.0, contact.stiffness / FITTED_STIFFNESS) ** GROWTH_WITH_STIFFNESS
    rate = contact.friction_coefficient * peak * min(share, 1.0) / contact.transition_velocity
    return next((step for step in STEPS if step * rate < RK4_LIMIT), STEPS[-1])
