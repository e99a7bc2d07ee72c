"""Four-point and two-point gait: order of crutches and steps, and the announcement of a step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from twin_gait.core.arms import Arm, Grip, set_grip_angle
from twin_gait.core.estimation import new_delay_line
from twin_gait.parameters.crutches import ArmParameters
from twin_gait.worlds.arm_policy import (
    LOWERING,
    PLANTED,
    SWINGING,
    ArmPolicy,
    Perception,
    announce_step,
    move_arm,
    new_perception,
    new_policy,
    plant_crutch,
)

ARMS = ArmParameters(pattern="four_point", announce_load=20.0, touch=15.0, planted=0.01, swing=0.02)
LOADED, UNLOADED = 80.0, 0.0
LEFT, RIGHT = 1.0, 2.0


def policy_of(pattern: str) -> ArmPolicy:
    return new_policy(replace(ARMS, pattern=pattern), 1000.0, 1.43)  # type: ignore[arg-type]


def arms_of(policy: ArmPolicy) -> tuple[Arm, Arm]:
    found = []
    for number in (LEFT, RIGHT):
        grip = Grip(80.0, -5.0, 1.4, 0.0, 4000.0, 400.0, 60.0, 12.0)
        set_grip_angle(grip, 0.2)
        arm = Arm(9, 0.5, 400.0, 100.0, 60.0, grip, new_delay_line(0), new_delay_line(0), number=number)
        arm.length = 1.4
        plant_crutch(policy, arm)
        arm.phase_ticks = 99
        found.append(arm)
    return found[0], found[1]


def act(policy: ArmPolicy, sense: Perception, arms: tuple[Arm, Arm], loads: tuple[float, float]) -> None:
    for arm, other, load in zip(arms, arms[::-1], loads, strict=True):
        move_arm(policy, sense, arm, other, 0.3, load)
    announce_step(policy, sense, *arms)


@pytest.mark.parametrize("turn", [LEFT, RIGHT])
def test_a_four_point_step_is_announced_after_its_crutch_has_been_moved_and_loaded(turn: float) -> None:
    policy, sense = policy_of("four_point"), new_perception(0, 0.1)
    arms = arms_of(policy)
    mover, stander = arms if turn == LEFT else arms[::-1]
    sense.turn = turn
    act(policy, sense, arms, (LOADED, LOADED))
    assert (mover.phase, stander.phase, sense.announcement) == (SWINGING, PLANTED, 0.0)
    for _ in range(25):
        act(
            policy,
            sense,
            arms,
            (LOADED if arms[0] is stander else 0.0, LOADED if arms[1] is stander else 0.0),
        )
    assert (mover.phase, stander.phase, sense.announcement) == (LOWERING, PLANTED, 0.0)
    act(policy, sense, arms, (16.0 if arms[0] is mover else LOADED, 16.0 if arms[1] is mover else LOADED))
    assert (mover.phase, sense.announcement) == (PLANTED, 0.0)  # touches, but carries too little
    act(policy, sense, arms, (LOADED, LOADED))
    assert sense.announcement == 1.0
    for _ in range(50):  # it is moved once only
        act(policy, sense, arms, (LOADED, LOADED))
    assert (mover.phase, stander.phase) == (PLANTED, PLANTED)


def test_each_four_point_step_moves_the_other_crutch() -> None:
    policy, sense = policy_of("four_point"), new_perception(0, 0.1)
    arms, lifted = arms_of(policy), list[float]()
    for step in range(6):
        sense.turn = LEFT if step % 2 == 0 else RIGHT
        for tick in range(300):
            sense.stepping = float(tick >= 200)
            before = [arm.phase for arm in arms]
            loads = [LOADED if arm.phase == PLANTED or tick > 60 else 0.0 for arm in arms]
            act(policy, sense, arms, (loads[0], loads[1]))
            moved = [
                arm.number for arm, phase in zip(arms, before, strict=True) if phase == PLANTED != arm.phase
            ]
            lifted += moved
            assert not (moved and sense.stepping)
            assert not (sense.announcement and sense.stepping)
    assert lifted == [LEFT, RIGHT] * 3


def test_a_two_point_step_is_announced_at_once_and_its_crutch_moves_with_the_leg() -> None:
    policy, sense = policy_of("two_point"), new_perception(0, 0.1)
    arms = arms_of(policy)
    sense.turn = RIGHT
    act(policy, sense, arms, (LOADED, LOADED))
    assert (arms[1].phase, sense.announcement) == (PLANTED, 1.0)
    sense.stepping = 1.0
    act(policy, sense, arms, (LOADED, LOADED))
    assert (arms[0].phase, arms[1].phase, sense.announcement) == (PLANTED, SWINGING, 0.0)


def test_a_tip_that_has_lost_its_load_is_put_down_again() -> None:
    policy, sense = policy_of("four_point"), new_perception(0, 0.1)
    arms = arms_of(policy)
    sense.turn = sense.moved = RIGHT
    before = arms[0].grip.length
    act(policy, sense, arms, (UNLOADED, LOADED))
    assert arms[0].phase == PLANTED and sense.announcement == 0.0
    assert arms[0].grip.length == pytest.approx(before + 0.25e-3)


@pytest.mark.parametrize(
    ("pattern", "turn", "announced"), [("as_needed", LEFT, 1.0), ("four_point", 0.0, 0.0)]
)
def test_a_step_is_free_as_needed_and_withheld_until_the_command_to_walk_is_perceived(
    pattern: str, turn: float, announced: float
) -> None:
    policy, sense = policy_of(pattern), new_perception(0, 0.1)
    arms = arms_of(policy)
    sense.turn = turn
    act(policy, sense, arms, (UNLOADED, UNLOADED))
    assert sense.announcement == announced
    assert arms[0].phase == arms[1].phase == PLANTED
