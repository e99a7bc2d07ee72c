r"""How a person uses two crutches: a law that sees what a person feels, late.

Felt are the lean of the trunk and its rate, how far each tip stands in front of the shoulder, the load on
each hand, and whether the device is taking a step, which it announces; all come later by the delay of a
reaction. An arm whose crutch is planted pushes with

.. math::

    P_0 = P + K\,(\theta - \theta^*) + D\,\dot\theta, \qquad M_0 = -M

and its muscles are stiff for a moment only: length and angle that they hold follow those of the arm with the
time constant of yielding. When both legs stand, a tip that has come near is lifted, swung to
where the person reaches, and lowered until it is felt to carry; the other stays planted meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin_gait.core.arms import Arm, held, turn_grip
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.estimation import DelayLine, new_delay_line

PLANTED, SWUNG, LOWERED = 0, 1, 2


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


@dataclass(slots=True)
class Sense:
    """What the person feels of the trunk and hears of the device, late.

    Attributes:
        lean: Of the trunk in [rad].
        lean_rate: In [rad] / [s].
        stepping: 1 while a leg swings.
        felt_lean: On its way to the mind.
        felt_rate: Likewise.
        felt_stepping: Likewise.
    """

    felt_lean: DelayLine
    felt_rate: DelayLine
    felt_stepping: DelayLine
    lean: float = 0.0
    lean_rate: float = 0.0
    stepping: float = 0.0


def new_sense(delay: int, lean: float) -> Sense:
    """What a person feels who has leant for a while.

    Args:
        delay: In ticks.
        lean: In [rad].
    """
    return Sense(new_delay_line(delay, lean), new_delay_line(delay), new_delay_line(delay))


def move_arm(habit: Habit, sense: Sense, arm: Arm, other: Arm, ahead: float, load: float) -> None:
    """What a person does with one arm in a tick.

    Args:
        arm: Changed in place.
        other: The other one.
        ahead: Felt way of the tip in front of the shoulder in [m].
        load: Felt load on the tip in [N].
    """
    arm.since += 1
    if arm.doing == PLANTED:
        _lean_on(habit, sense, arm)
        rested = arm.since > habit.planted_ticks
        free = other.doing == PLANTED and other.since > habit.planted_ticks
        if rested and free and sense.stepping == 0.0 and ahead < habit.lift_ahead:
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


def _lean_on(habit: Habit, sense: Sense, arm: Arm) -> None:
    """Push on a planted crutch, with muscles that yield to what is slow."""
    grip = arm.grip
    wanted = (
        habit.push + habit.push_per_lean * (sense.lean - habit.lean) + habit.push_per_rate * sense.lean_rate
    )
    grip.push = held(wanted, 0.0, arm.push_limit)
    grip.turn = -habit.turn
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
