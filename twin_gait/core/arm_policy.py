r"""How a person uses two crutches: a law that sees what a person feels, late.

Felt are the lean of the trunk and its rate, how far each tip stands in front of the shoulder, the load on
each hand, and whether the device is taking a step, rising or sitting down, which it announces; all come later
by the delay of a reaction. An arm whose crutch is planted pushes with

.. math::

    P_0 = P + K\,(\theta - \theta^*) + D\,\dot\theta, \qquad M_0 = -M

and its muscles are stiff for a moment only: length and angle that they hold follow those of the arm with the
time constant of yielding. When both legs stand, a tip that has come near is lifted, swung to
where the person reaches, and lowered until it is felt to carry; the other stays planted meanwhile.

On a chair both stay planted. The hands rest while the person sits; while they rise or sit down they push,
with muscles that give way, less and less as the arms come to be straight, and so that the struts keep a tilt
φ against the vertical, the tips behind:

.. math::

    P_0 = P_h + P_c\,\min(1, (\ell_{max} - \ell) / \ell_c) - K_c\,(\varphi - \varphi^*), \qquad
    M_0 = -M_c + C_c\,(\varphi - \varphi^*)

Likewise they hold on to what stands behind when the person has risen, until it is brought forwards.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin_gait.core.arms import Arm, held, turn_grip
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.estimation import DelayLine, new_delay_line

PLANTED, SWUNG, LOWERED, BEHIND = 0, 1, 2, 3
SITS, RISES = 1.0, 2.0  # what is felt of a chair


@dataclass(slots=True)
class Habit:
    """Parameters of the law; see :class:`twin_gait.parameters.ArmParameters`.

    Attributes:
        lean: Of the trunk that the person keeps, in [rad].
        push: On each crutch in [N].
        push_per_lean: In [N] / [rad].
        push_per_rate: In [N s] / [rad].
        turn: Moment of each shoulder that draws the body forwards in [N m].
        stiffness: Of the arm along the strut for a moment in [N] / [m].
        damping: In [N s] / [m].
        turning_stiffness: Across it in [N] / [m].
        turning_damping: In [N s] / [m].
        swing_stiffness: Of an arm that carries its crutch, along and across, in [N] / [m].
        swing_damping: In [N s] / [m].
        yielding: Share of the way that the muscles yield in a tick.
        lift_ahead: Way of a tip in front of the shoulder at which it is lifted, in [m].
        reach: Angle from the vertical to which it is swung, in [rad].
        clearance: By which the strut is shortened meanwhile, in [m].
        swing_ticks: Length of the swing.
        planted_ticks: For so long at least a crutch stays.
        lowering: Way of a tick by which the strut grows as it is lowered, in [m].
        touch: Load at which a tip is felt to stand, in [N].
        longest: Length of arm and crutch in [m].
        chair_tilt: Of the struts from the vertical that the person keeps while they rise or sit down, the
            tips behind, in [rad].
        chair_push: On each crutch meanwhile in [N], beyond what holds.
        chair_push_per_tilt: In [N] / [rad].
        chair_turn: Moment of each shoulder that draws the body forwards meanwhile in [N m].
        chair_turn_per_tilt: In [N m] / [rad].
        chair_fading: Length short of the longest over which the push fades, in [m].
        chair_hold: Push that keeps each crutch on the ground then and afterwards in [N].
        chair_ticks: For so long both stay there.
    """

    lean: float
    push: float
    push_per_lean: float
    push_per_rate: float
    turn: float
    stiffness: float
    damping: float
    turning_stiffness: float
    turning_damping: float
    swing_stiffness: float
    swing_damping: float
    yielding: float
    lift_ahead: float
    reach: float
    clearance: float
    swing_ticks: int
    planted_ticks: int
    lowering: float
    touch: float
    longest: float
    chair_tilt: float
    chair_push: float
    chair_push_per_tilt: float
    chair_turn: float
    chair_turn_per_tilt: float
    chair_fading: float
    chair_hold: float
    chair_ticks: int


@dataclass(slots=True)
class Sense:
    """What the person feels of the trunk and hears of the device, late.

    Attributes:
        lean: Of the trunk in [rad].
        lean_rate: In [rad] / [s].
        stepping: 1 while a leg swings.
        chair: ``SITS``, ``RISES``, also for sitting down, or 0.
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
    chair: float = 0.0


def new_sense(delay: int, lean: float, chair: float = 0.0) -> Sense:
    """What a person feels who has leant for a while.

    Args:
        delay: In ticks.
        lean: In [rad].
        chair: What is felt of one.
    """
    return Sense(
        new_delay_line(delay, lean),
        new_delay_line(delay),
        new_delay_line(delay),
        new_delay_line(delay, chair),
    )


def move_arm(habit: Habit, sense: Sense, arm: Arm, other: Arm, ahead: float, load: float) -> None:
    """What a person does with one arm in a tick.

    Args:
        arm: Changed in place.
        other: The other one.
        ahead: Felt way of the tip in front of the shoulder in [m].
        load: Felt load on the tip in [N].
    """
    arm.since += 1
    if arm.doing == PLANTED or arm.doing == BEHIND:
        if sense.chair > 0.0 or arm.doing == BEHIND:
            _push_up(habit, sense, arm, ahead)
        else:
            _lean_on(habit, sense, arm)
        if sense.chair > 0.0:
            return
        if (
            _rested(habit, arm)
            and _rested(habit, other)
            and sense.stepping == 0.0
            and ahead < habit.lift_ahead
        ):
            _lift(habit, sense, arm)
    elif arm.doing == SWUNG:
        share = blend_share(arm.since / habit.swing_ticks, BLEND_MINIMUM_JERK)
        turn_grip(arm.grip, blend(arm.first_angle, habit.reach, share) + sense.lean)
        if arm.since >= habit.swing_ticks:
            arm.doing, arm.since = LOWERED, 0
    else:
        arm.grip.length = min(arm.grip.length + habit.lowering, habit.longest)
        if load > habit.touch:
            plant_crutch(habit, arm)


def _rested(habit: Habit, arm: Arm) -> bool:
    """Whether a crutch has been planted for long enough that it, or the other one, may be lifted."""
    if arm.doing == BEHIND:
        return arm.since > habit.chair_ticks
    return arm.doing == PLANTED and arm.since > habit.planted_ticks


def _lean_on(habit: Habit, sense: Sense, arm: Arm) -> None:
    """Push on a planted crutch, with muscles that yield to what is slow."""
    grip = arm.grip
    wanted = (
        habit.push + habit.push_per_lean * (sense.lean - habit.lean) + habit.push_per_rate * sense.lean_rate
    )
    grip.push = held(wanted, 0.0, arm.push_limit)
    grip.turn = -habit.turn
    _yield(habit, arm)


def _push_up(habit: Habit, sense: Sense, arm: Arm, ahead: float) -> None:
    """Rest the hand while sitting, push while rising or sitting down, then hold on to what stands behind."""
    grip, tonic = arm.grip, habit.chair_hold
    grip.stiffness, grip.damping = habit.stiffness, habit.swing_damping
    grip.length = max(grip.length, arm.length)  # what would lift the tip gives way at once
    if sense.chair > 0.0:
        arm.doing, arm.since = BEHIND, 0
        grip.stiffness = habit.swing_stiffness
        tonic += habit.chair_push * held((habit.longest - arm.length) / habit.chair_fading, 0.0, 1.0)
    excess = -ahead / arm.length - habit.chair_tilt
    grip.push = held(tonic - habit.chair_push_per_tilt * excess, 0.0, arm.push_limit)
    grip.turn = habit.chair_turn_per_tilt * excess - habit.chair_turn
    if sense.chair == SITS:
        grip.push = grip.turn = 0.0
    _yield(habit, arm)


def _yield(habit: Habit, arm: Arm) -> None:
    """Let the muscles give way to what is slow."""
    grip = arm.grip
    grip.length += habit.yielding * (arm.length - grip.length)
    turn_grip(grip, grip.angle - habit.yielding * arm.aside / arm.length)


def _lift(habit: Habit, sense: Sense, arm: Arm) -> None:
    grip = arm.grip
    arm.doing, arm.since = SWUNG, 0
    arm.first_angle = grip.angle - sense.lean
    grip.push = grip.turn = 0.0
    grip.length = arm.length - habit.clearance
    grip.stiffness = grip.turning_stiffness = habit.swing_stiffness
    grip.damping = grip.turning_damping = habit.swing_damping


def plant_crutch(habit: Habit, arm: Arm) -> None:
    """Lean on a crutch from now on; the arm is held as it is."""
    grip = arm.grip
    arm.doing, arm.since = PLANTED, 0
    grip.length = arm.length
    turn_grip(grip, grip.angle - arm.aside / arm.length)
    grip.stiffness, grip.damping = habit.stiffness, habit.damping
    grip.turning_stiffness, grip.turning_damping = habit.turning_stiffness, habit.turning_damping
