r"""How a person uses two crutches: a law that sees what a person feels, late.

Felt are the lean of the trunk and its rate, how far each tip stands in front of the shoulder, the load on
each hand, and whether the device is taking a step, rising or sitting down, which it announces; all come later
by the delay of a reaction. An arm whose crutch is planted pushes with

.. math::

    P_0 = P + K\,(\theta - \theta^*) + D\,\dot\theta, \qquad M_0 = -M

and its muscles are stiff for a moment only: length and angle that they hold follow those of the arm with the
time constant of yielding. When both legs stand, a tip that has come near is lifted, swung to
where the person reaches, and lowered until it is felt to carry, nearer if the arm is too short; the other
stays planted meanwhile. Who has stood still for a while brings a tip that is elsewhere in the same way to
where they like it.

A chair asks for crutches behind. When the device announces that it is about to sit down, one is swung back to
a tilt φ against the vertical, and the other leant on; both, before rising, if they do not stand there.
While the person sits, the hands rest. While they rise or sit down, the arms do as the legs do: the muscles
push, with the stiffness of loaded arms, towards a length that goes by the minimum-jerk law to that of risen
or of seated arms,

.. math::

    P_0 = P_c, \qquad \ell_0(t) = \ell(0) + (\ell_c - \ell(0))\,s(t / T_c), \qquad M_0 = -M_c

and an arm that is longer than that gives way. When the person has risen, arms that still carry straighten
slowly and push against a trunk that tips backwards, :math:`P_0 = -D\,\dot\theta`; a hand that feels no load
brings its crutch forwards, one after the other. Until the second comes, the first has no push P of its own.
"""

import math
from dataclasses import dataclass

from twin_gait.core.arms import Arm, held, turn_grip
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.estimation import DelayLine, first_order_gain, new_delay_line
from twin_gait.gait.table import TICK
from twin_gait.parameters.crutches import ArmParameters

PLANTED, SWUNG, LOWERED, BEHIND = 0, 1, 2, 3
SITS, LEANS, RISES, REACHES, LOWERS = 1.0, 2.0, 3.0, 4.0, 5.0  # what is felt of a chair


@dataclass(slots=True)
class ArmPolicy:
    """How a person uses crutches, and what that comes to for a wearer.

    Attributes:
        arms: Parameters of the law.
        weight: Of wearer and device in [N].
        longest: Length of arm and crutch in [m].
        yielding: Share of the way that the muscles yield in a tick.
        swing_ticks: Length of the swing.
        planted_ticks: For so long at least a crutch stays.
        still_ticks: For how long no leg has swung where somebody stands.
        chair_ticks: For how long the struts go to the length of risen or of seated arms.
        stand_ahead: Way in front of the shoulder of a tip where who stands has it, in [m].
    """

    arms: ArmParameters
    weight: float
    longest: float
    yielding: float
    swing_ticks: int
    planted_ticks: int
    still_ticks: int
    chair_ticks: int
    stand_ahead: float


def new_policy(arms: ArmParameters, weight: float, longest: float) -> ArmPolicy:
    """What a person does who has some weight in [N], and arms and crutches of some length in [m]."""
    return ArmPolicy(
        arms,
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
class Sense:
    """What the person feels of the trunk and hears of the device, late.

    Attributes:
        lean: Of the trunk in [rad].
        lean_rate: In [rad] / [s].
        stepping: 1 while a leg swings.
        still: Ticks since the last one did.
        chair: ``SITS``, ``LEANS``, ``RISES``, ``REACHES``, ``LOWERS`` or 0.
        felt_lean: On its way to the mind.
        felt_rate: Likewise.
        felt_stepping: Likewise.
        felt_chair: Likewise.
    """

    felt_lean: DelayLine
    felt_rate: DelayLine
    felt_stepping: DelayLine
    felt_chair: DelayLine
    lean: float = 0.0
    lean_rate: float = 0.0
    stepping: float = 0.0
    still: int = 0
    chair: float = 0.0


def new_sense(delay: int, lean: float, chair: float = 0.0) -> Sense:
    """What a person feels who has leant for a while.

    Args:
        delay: In ticks.
        lean: In [rad].
        chair: What is felt of one.
    """
    rate, stepping = new_delay_line(delay), new_delay_line(delay)
    return Sense(new_delay_line(delay, lean), rate, stepping, new_delay_line(delay, chair))


def move_arm(policy: ArmPolicy, sense: Sense, arm: Arm, other: Arm, ahead: float, load: float) -> None:
    """What a person does with one arm in a tick.

    Args:
        arm: Changed in place.
        other: The other one.
        ahead: Felt way of the tip in front of the shoulder in [m].
        load: Felt load on the tip in [N].
    """
    arm.since += 1
    if arm.doing == SWUNG:
        share = blend_share(arm.since / policy.swing_ticks, BLEND_MINIMUM_JERK)
        turn_grip(arm.grip, blend(arm.first_angle, arm.reach, share) + sense.lean)
        if arm.since >= policy.swing_ticks:
            arm.doing, arm.since = LOWERED, 0
    elif arm.doing == LOWERED:
        _lower(policy, arm)
        if load > policy.arms.touch:
            plant_crutch(policy, arm)
    elif sense.chair > 0.0 or arm.doing == BEHIND:
        _use_behind(policy, sense, arm, other, ahead, load)
    else:
        _lean_on(policy, sense, arm, other)
        if not _may_lift(policy, sense, arm, other):
            return
        if ahead < policy.arms.lift_ahead:
            _lift(policy, sense, arm, policy.arms.reach)
        elif _stands(policy, sense, arm, other) and abs(ahead - policy.stand_ahead) > policy.arms.stand_slack:
            _lift(policy, sense, arm, policy.arms.stand_reach)


def _lower(policy: ArmPolicy, arm: Arm) -> None:
    """Lengthen the strut towards the ground; one that is too short for it is drawn nearer."""
    grip, way = arm.grip, policy.arms.lowering * TICK
    if grip.length < policy.longest:
        grip.length = min(grip.length + way, policy.longest)
    else:
        nearer = way / policy.longest
        turn_grip(grip, grip.angle - (nearer if arm.reach > 0.0 else -nearer))


def _may_lift(policy: ArmPolicy, sense: Sense, arm: Arm, other: Arm) -> bool:
    """Whether both crutches have stood for long enough that one may be lifted, and no leg swings."""
    return _rested(policy, arm) and _rested(policy, other) and sense.stepping == 0.0


def _rested(policy: ArmPolicy, arm: Arm) -> bool:
    return (arm.doing == PLANTED or arm.doing == BEHIND) and arm.since > policy.planted_ticks


def _stands(policy: ArmPolicy, sense: Sense, arm: Arm, other: Arm) -> bool:
    """Whether the person has stood still on both crutches, in front, for a while."""
    shortest = min(sense.still, arm.since, other.since)
    return other.doing == PLANTED and shortest > policy.still_ticks


def _use_behind(policy: ArmPolicy, sense: Sense, arm: Arm, other: Arm, ahead: float, load: float) -> None:
    """Bring a crutch behind for a chair, rest the hand, push, hold on, or bring the crutch forwards again."""
    # To sit down one is enough behind; the other one is leant on.
    readies = sense.chair == LEANS or (sense.chair == REACHES and other.doing == PLANTED)
    if readies and ahead > 0.0 and _may_lift(policy, sense, arm, other):
        _lift(policy, sense, arm, -policy.arms.chair_tilt)
        return
    if sense.chair == REACHES and arm.doing == PLANTED and ahead > 0.0:
        _lean_on(policy, sense, arm, other)  # until its turn comes
        return
    if sense.chair != arm.felt or arm.doing == PLANTED:
        arm.felt = sense.chair
        arm.doing, arm.since, arm.first_length = BEHIND, 0, arm.length
    if sense.chair > 0.0:
        _push_up(policy, sense, arm)
        return
    _push_forwards(policy, sense, arm, load)
    if load < policy.arms.touch and _may_lift(policy, sense, arm, other):
        _lift(policy, sense, arm, policy.arms.stand_reach)


def _lean_on(policy: ArmPolicy, sense: Sense, arm: Arm, other: Arm) -> None:
    """Push back on a crutch in front, with muscles that yield to what is slow."""
    habit, weight = policy.arms, policy.weight
    push = 0.0 if other.doing == BEHIND else habit.push * weight
    upright = habit.push_per_lean * weight * (sense.lean - habit.lean)
    wanted = push + upright + habit.push_per_rate * weight * sense.lean_rate
    arm.grip.push = held(wanted, 0.0, arm.push_limit)
    arm.grip.turn = -habit.turn
    _yield(policy, arm)


def _push_forwards(policy: ArmPolicy, sense: Sense, arm: Arm, load: float) -> None:
    """Straighten the arm on a crutch behind until the hand feels no load, as the weight is over the feet."""
    habit, grip = policy.arms, arm.grip
    grip.push = held(-habit.push_per_rate * policy.weight * sense.lean_rate, 0.0, arm.push_limit)
    grip.turn = -habit.turn
    grip.stiffness, grip.damping = habit.stiffness, habit.damping
    if load >= habit.touch:
        grip.length += habit.straightening * TICK
    _give_way(policy, arm)


def _give_way(policy: ArmPolicy, arm: Arm) -> None:
    """What would lift the tip gives way at once; what turns the arm, slowly."""
    arm.grip.length = max(arm.grip.length, arm.length)
    turn_grip(arm.grip, arm.grip.angle - policy.yielding * arm.aside / arm.length)


def _push_up(policy: ArmPolicy, sense: Sense, arm: Arm) -> None:
    """Rest the hand while sitting, push towards a length while rising or sitting down, else hold on."""
    habit, grip = policy.arms, arm.grip
    grip.push = grip.turn = grip.stiffness = 0.0
    if sense.chair == SITS:
        return
    grip.stiffness, grip.damping = habit.stiffness, habit.damping
    if sense.chair == RISES or sense.chair == LOWERS:
        grip.push, grip.turn = habit.chair_push * policy.weight, -habit.chair_turn
        share = blend_share(arm.since / policy.chair_ticks, BLEND_MINIMUM_JERK)
        wanted = habit.risen_length if sense.chair == RISES else habit.seated_length
        grip.length = blend(arm.first_length, wanted * policy.longest, share)
    _give_way(policy, arm)


def _yield(policy: ArmPolicy, arm: Arm) -> None:
    """Let the muscles give way to what is slow."""
    grip = arm.grip
    grip.length += policy.yielding * (arm.length - grip.length)
    turn_grip(grip, grip.angle - policy.yielding * arm.aside / arm.length)


def _lift(policy: ArmPolicy, sense: Sense, arm: Arm, reach: float) -> None:
    """Begin to swing a crutch to an angle from the vertical in [rad]."""
    grip = arm.grip
    arm.doing, arm.since, arm.reach = SWUNG, 0, reach
    arm.first_angle = grip.angle - sense.lean
    grip.push = grip.turn = 0.0
    grip.length = arm.length - policy.arms.clearance
    grip.stiffness = grip.turning_stiffness = policy.arms.swing_stiffness
    grip.damping = grip.turning_damping = policy.arms.swing_damping


def plant_crutch(policy: ArmPolicy, arm: Arm) -> None:
    """Lean on a crutch from now on; the arm is held as it is."""
    grip = arm.grip
    arm.doing, arm.since = PLANTED, 0
    grip.length = arm.length
    turn_grip(grip, grip.angle - arm.aside / arm.length)
    grip.stiffness, grip.damping = policy.arms.stiffness, policy.arms.damping
    grip.turning_stiffness, grip.turning_damping = policy.arms.turning_stiffness, policy.arms.turning_damping
