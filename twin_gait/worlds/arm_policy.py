r"""Use of two crutches by a person: a control law on delayed perception.

The person perceives the lean of the trunk and its rate, the distance of each tip in front of the shoulder,
the load on each hand, and whether the device is taking a step, rising or sitting down, which it announces.
All signals arrive with the delay of a reaction. An arm whose crutch is planted pushes with

.. math::

    P_0 = P + K\,(\theta - \theta^*) + D\,\dot\theta, \qquad M_0 = -M

and its muscles are stiff against fast motions only: the length and angle that they hold follow those of the
arm with the time constant of yielding. When both legs are in stance, a tip that has come near is lifted,
swung to the person's reach, and lowered until it is perceived to carry load, nearer if the arm is too short;
the other crutch stays planted meanwhile. A person who has been standing still for a while brings a tip that
is elsewhere in the same way to the preferred distance.

That is the pattern ``as_needed``. In the other two each step of a walk has its crutch, the one on the side
of the foot in front, opposite to the leg that steps next. In ``four_point`` gait the person moves it while
both feet are on the ground: crutch, opposite foot, other crutch, other foot. In ``two_point`` gait the person
moves it together with the leg. In both the person puts a tip down again that has lost its load, and announces
a step to the device, which waits for it, only while both crutches are planted and carry a load, after the
crutch of a four-point step has been moved.

A chair requires crutches behind. When the device announces that it is about to sit down, one crutch is swung
back to a tilt φ against the vertical, while the person leans on the other one; before rising, both are swung
back unless they are there already. While the person sits, the hands rest. While the person rises or sits
down, the arms act as the legs do: the muscles push, with the stiffness of loaded arms, towards a length that
moves by the minimum-jerk law to the length of risen or of seated arms,

.. math::

    P_0 = P_c, \qquad \ell_0(t) = \ell(0) + (\ell_c - \ell(0))\,s(t / T_c), \qquad M_0 = -M_c

and an arm that is longer than this gives way. When the person has risen, arms that still carry load
straighten slowly and push against a trunk that tips backwards, :math:`P_0 = -D\,\dot\theta`. A hand without
load brings its crutch forwards, one after the other. Until the second crutch follows, the first has no push P
of its own.
"""

import math
from dataclasses import dataclass

from twin_gait.core.arms import Arm, clamp, set_grip_angle
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.estimation import PERCEPTION_CAPACITY, DelayLine, first_order_gain, new_delay_line
from twin_gait.gait.table import TICK
from twin_gait.parameters.crutches import PATTERNS, ArmParameters

PLANTED, SWINGING, LOWERING, PLANTED_BEHIND = 0, 1, 2, 3
AS_NEEDED, FOUR_POINT, TWO_POINT = range(len(PATTERNS))
# perceived states of sitting on a chair
SITTING, LEANING, RISING, REACHING_BACK, SITTING_DOWN = 1.0, 2.0, 3.0, 4.0, 5.0


@dataclass(slots=True)
class ArmPolicy:
    """Use of crutches by a person, with the quantities that depend on the wearer.

    Attributes:
        arms: Parameters of the law.
        pattern: ``AS_NEEDED``, ``FOUR_POINT`` or ``TWO_POINT``.
        weight: Weight of wearer and device in [N].
        max_length: Length of arm and crutch in [m].
        yielding: Share of the remaining distance that the muscles yield in a tick.
        swing_ticks: Duration of the swing in ticks.
        planted_ticks: Shortest time in ticks for which a crutch stays planted.
        still_ticks: Time in ticks without a swing of a leg after which a person counts as standing still.
        chair_ticks: Time in ticks in which the struts move to the length of risen or of seated arms.
        stand_ahead: Preferred distance of a tip in front of the shoulder of a person who stands, in [m].
    """

    arms: ArmParameters
    pattern: int
    weight: float
    max_length: float
    yielding: float
    swing_ticks: int
    planted_ticks: int
    still_ticks: int
    chair_ticks: int
    stand_ahead: float


def new_policy(arms: ArmParameters, weight: float, longest: float) -> ArmPolicy:
    """Return the policy of a person with a weight in [N], and arms and crutches of a length in [m]."""
    return ArmPolicy(
        arms,
        PATTERNS.index(arms.pattern),
        weight,
        longest,
        yielding=first_order_gain(TICK, arms.yielding),
        swing_ticks=max(1, round(arms.swing / TICK)),
        planted_ticks=round(arms.planted / TICK),
        still_ticks=round(arms.still / TICK),
        chair_ticks=max(1, round(arms.chair_time / TICK)),
        stand_ahead=longest * math.sin(arms.stand_reach),
    )


@dataclass(slots=True)
class Perception:
    """Delayed perception of the trunk and of the announcements of the device.

    Attributes:
        lean: Perceived lean of the trunk in [rad].
        lean_rate: Perceived rate of the lean in [rad/s].
        stepping: 1 while a leg swings.
        ticks_since_swing: Number of ticks since the last swing.
        chair_state: ``SITTING``, ``LEANING``, ``RISING``, ``REACHING_BACK``, ``SITTING_DOWN`` or 0.
        turn: Number, from 1 on, of the crutch that belongs to the present or next step; 0 while not walking.
        moved: Number of the crutch that has been lifted for this step, 0 for none.
        announcement: 1 while the person announces a step to the device, 0 while the device has to wait.
        lean_delay: Delay line of the lean.
        lean_rate_delay: Delay line of its rate.
        stepping_delay: Delay line of the announced steps.
        chair_delay: Delay line of the announced state of sitting on a chair.
        turn_delay: Delay line of the crutch of a step.
    """

    lean_delay: DelayLine
    lean_rate_delay: DelayLine
    stepping_delay: DelayLine
    chair_delay: DelayLine
    turn_delay: DelayLine
    lean: float = 0.0
    lean_rate: float = 0.0
    stepping: float = 0.0
    ticks_since_swing: int = 0
    chair_state: float = 0.0
    turn: float = 0.0
    moved: float = 0.0
    announcement: float = 1.0


def new_perception(delay: int, lean: float, chair: float = 0.0) -> Perception:
    """Return the perception of a person who has leant constantly for a while.

    Args:
        delay: Delay in ticks.
        lean: Lean in [rad].
        chair: Perceived state of sitting on a chair.
    """
    leans, rates, steps, chairs, turns = (
        new_delay_line(delay, value, PERCEPTION_CAPACITY) for value in (lean, 0.0, 0.0, chair, 0.0)
    )
    return Perception(leans, rates, steps, chairs, turns)


def move_arm(
    policy: ArmPolicy, perception: Perception, arm: Arm, other: Arm, ahead: float, load: float
) -> None:
    """Compute the action of a person with one arm in a tick.

    Args:
        policy: Use of the crutches.
        perception: Perception of the person.
        arm: Arm that acts; changed in place.
        other: The other arm.
        ahead: Perceived distance of the tip in front of the shoulder in [m].
        load: Perceived load on the tip in [N].
    """
    arm.phase_ticks += 1
    arm.perceived_load = load
    if arm.phase == SWINGING:
        share = blend_share(arm.phase_ticks / policy.swing_ticks, BLEND_MINIMUM_JERK)
        set_grip_angle(arm.grip, blend(arm.first_angle, arm.reach, share) + perception.lean)
        if arm.phase_ticks >= policy.swing_ticks:
            arm.phase, arm.phase_ticks = LOWERING, 0
    elif arm.phase == LOWERING:
        _lower(policy, arm)
        if load > policy.arms.touch:
            plant_crutch(policy, arm)
    elif perception.chair_state > 0.0 or arm.phase == PLANTED_BEHIND:
        _control_rear_crutch(policy, perception, arm, other, ahead, load)
    else:
        _push_on_front_crutch(policy, perception, arm, other)
        if policy.pattern != AS_NEEDED and perception.turn > 0.0:
            if load < policy.arms.touch:
                arm.reach = arm.grip.angle - perception.lean
                _lower(policy, arm)
            else:
                _lift_for_step(policy, perception, arm, other)
            return
        if not _may_lift(policy, perception, arm, other):
            return
        if ahead < policy.arms.lift_ahead:
            _lift(policy, perception, arm, policy.arms.reach)
        elif (
            _is_standing_still(policy, perception, arm, other)
            and abs(ahead - policy.stand_ahead) > policy.arms.stand_slack
        ):
            _lift(policy, perception, arm, policy.arms.stand_reach)


def announce_step(policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm) -> None:
    """Announce a step as soon as its crutch has been moved and both crutches carry a load.

    A person who moves the crutches as needed lets the device step at any time. With another pattern a person
    who has not yet perceived the command to walk announces no step.
    """
    if policy.pattern == AS_NEEDED:
        sense.announcement = 1.0
        return
    if sense.turn == 0.0:
        sense.announcement = 0.0
        return
    in_step = sense.stepping > 0.0
    if in_step == (policy.pattern == FOUR_POINT):
        sense.moved = 0.0  # The present step of a four-point gait, or the next one of a two-point gait.
    lowest_load = min(arm.perceived_load, other.perceived_load)
    ready = arm.phase == PLANTED and other.phase == PLANTED and lowest_load > policy.arms.announce_load
    prepared = policy.pattern == TWO_POINT or sense.moved == sense.turn
    sense.announcement = 1.0 if ready and prepared and not in_step else 0.0


def _lift_for_step(policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm) -> None:
    """Lift the crutch of a step once: before the step in four-point gait, with the leg in two-point gait."""
    due = arm.number == sense.turn and sense.moved != sense.turn
    in_step = sense.stepping > 0.0
    rested = _rested(policy, arm) and _rested(policy, other)
    if due and rested and in_step == (policy.pattern == TWO_POINT):
        sense.moved = sense.turn
        _lift(policy, sense, arm, policy.arms.reach)


def _lower(policy: ArmPolicy, arm: Arm) -> None:
    """Lengthen the strut towards the ground; draw the tip nearer if the strut is too short to reach it."""
    grip, way = arm.grip, policy.arms.lowering * TICK
    if grip.length < policy.max_length:
        grip.length = min(grip.length + way, policy.max_length)
    else:
        nearer = way / policy.max_length
        set_grip_angle(grip, grip.angle - (nearer if arm.reach > 0.0 else -nearer))


def _may_lift(policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm) -> bool:
    """Check that both crutches have been planted for long enough to lift one, and that no leg swings."""
    return _rested(policy, arm) and _rested(policy, other) and sense.stepping == 0.0


def _rested(policy: ArmPolicy, arm: Arm) -> bool:
    return (arm.phase == PLANTED or arm.phase == PLANTED_BEHIND) and arm.phase_ticks > policy.planted_ticks


def _is_standing_still(policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm) -> bool:
    """Check whether the person has been standing still on both crutches, in front, for a while."""
    shortest = min(sense.ticks_since_swing, arm.phase_ticks, other.phase_ticks)
    return other.phase == PLANTED and shortest > policy.still_ticks


def _control_rear_crutch(
    policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm, ahead: float, load: float
) -> None:
    """Bring a crutch behind for a chair, rest the hand, push, hold on, or bring the crutch forwards again."""
    # One crutch behind is enough to sit down; the person leans on the other one.
    readies = sense.chair_state == LEANING or (sense.chair_state == REACHING_BACK and other.phase == PLANTED)
    if readies and ahead > 0.0 and _may_lift(policy, sense, arm, other):
        _lift(policy, sense, arm, -policy.arms.chair_tilt)
        return
    if sense.chair_state == REACHING_BACK and arm.phase == PLANTED and ahead > 0.0:
        _push_on_front_crutch(policy, sense, arm, other)  # until the other crutch is behind
        return
    if sense.chair_state != arm.perceived_chair_state or arm.phase == PLANTED:
        arm.perceived_chair_state = sense.chair_state
        arm.phase, arm.phase_ticks, arm.first_length = PLANTED_BEHIND, 0, arm.length
    if sense.chair_state > 0.0:
        _push_on_rear_crutch(policy, sense, arm)
        return
    _push_forwards(policy, sense, arm, load)
    if load < policy.arms.touch and _may_lift(policy, sense, arm, other):
        _lift(policy, sense, arm, policy.arms.stand_reach)


def _push_on_front_crutch(policy: ArmPolicy, sense: Perception, arm: Arm, other: Arm) -> None:
    """Push back on a crutch in front, with muscles that yield to slow motions."""
    habit, weight = policy.arms, policy.weight
    push = 0.0 if other.phase == PLANTED_BEHIND else habit.axial_force * weight
    upright = habit.axial_force_per_lean * weight * (sense.lean - habit.lean)
    target = push + upright + habit.axial_force_per_lean_rate * weight * sense.lean_rate
    arm.grip.axial_force = clamp(target, habit.min_axial_force * weight, arm.push_limit)
    arm.grip.shoulder_moment = -habit.shoulder_moment
    _yield(policy, arm)


def _push_forwards(policy: ArmPolicy, sense: Perception, arm: Arm, load: float) -> None:
    """Straighten the arm on a crutch behind until the hand feels no load, as the weight is over the feet."""
    habit, grip = policy.arms, arm.grip
    grip.axial_force = clamp(
        -habit.axial_force_per_lean_rate * policy.weight * sense.lean_rate, 0.0, arm.push_limit
    )
    grip.shoulder_moment = -habit.shoulder_moment
    grip.stiffness, grip.damping = habit.stiffness, habit.damping
    if load >= habit.touch:
        grip.length += habit.straightening * TICK
    _yield_to_extension(policy, arm)


def _yield_to_extension(policy: ArmPolicy, arm: Arm) -> None:
    """Yield at once to a motion that would lift the tip, and slowly to one that turns the arm."""
    arm.grip.length = max(arm.grip.length, arm.length)
    set_grip_angle(arm.grip, arm.grip.angle - policy.yielding * arm.transverse_deflection / arm.length)


def _push_on_rear_crutch(policy: ArmPolicy, sense: Perception, arm: Arm) -> None:
    """Rest the hand while sitting, push towards a length while rising or sitting down, else hold on."""
    habit, grip = policy.arms, arm.grip
    grip.axial_force = grip.shoulder_moment = grip.stiffness = 0.0
    if sense.chair_state == SITTING:
        return
    grip.stiffness, grip.damping = habit.stiffness, habit.damping
    if sense.chair_state == RISING or sense.chair_state == SITTING_DOWN:
        grip.axial_force, grip.shoulder_moment = (
            habit.chair_axial_force * policy.weight,
            -habit.chair_shoulder_moment,
        )
        share = blend_share(arm.phase_ticks / policy.chair_ticks, BLEND_MINIMUM_JERK)
        target = habit.risen_length if sense.chair_state == RISING else habit.seated_length
        grip.length = blend(arm.first_length, target * policy.max_length, share)
    _yield_to_extension(policy, arm)


def _yield(policy: ArmPolicy, arm: Arm) -> None:
    """Let the muscles yield to slow motions."""
    grip = arm.grip
    grip.length += policy.yielding * (arm.length - grip.length)
    set_grip_angle(grip, grip.angle - policy.yielding * arm.transverse_deflection / arm.length)


def _lift(policy: ArmPolicy, sense: Perception, arm: Arm, reach: float) -> None:
    """Begin to swing a crutch to an angle from the vertical in [rad]."""
    grip = arm.grip
    arm.phase, arm.phase_ticks, arm.reach = SWINGING, 0, reach
    arm.first_angle = grip.angle - sense.lean
    grip.axial_force = grip.shoulder_moment = 0.0
    grip.length = arm.length - policy.arms.clearance
    grip.stiffness = grip.transverse_stiffness = policy.arms.swing_stiffness
    grip.damping = grip.transverse_damping = policy.arms.swing_damping


def plant_crutch(policy: ArmPolicy, arm: Arm) -> None:
    """Plant a crutch and lean on it from now on; the arm is held in its present state."""
    grip = arm.grip
    arm.phase, arm.phase_ticks = PLANTED, 0
    grip.length = arm.length
    set_grip_angle(grip, grip.angle - arm.transverse_deflection / arm.length)
    grip.stiffness, grip.damping = policy.arms.stiffness, policy.arms.damping
    grip.transverse_stiffness, grip.transverse_damping = (
        policy.arms.transverse_stiffness,
        policy.arms.transverse_damping,
    )
