"""Tests of the interface of worlds, and that no other module depends on a specific world."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import twin_gait
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.bench_leg import BenchLeg
from twin_gait.worlds.registry import find_world, world_kinds
from twin_gait.worlds.treadmill import Treadmill
from twin_gait.worlds.world import BELT_SPEED, SUPPORT_SHARE

# Their own modules.
MAY_NAME = {
    "worlds/treadmill.py",
    "worlds/bench_leg.py",
}


def test_no_stage_names_a_world():
    package = Path(twin_gait.__file__).parent
    naming = {
        str(path.relative_to(package))
        for path in package.rglob("*.py*")
        if path.suffix in (".py", ".pyi") and re.search(r"\b(Treadmill|BenchLeg)\b", path.read_text())
    }
    assert naming == MAY_NAME


def test_shipped_worlds_are_found_by_their_kind():
    assert {"bench_leg", "overground", "treadmill"} <= set(world_kinds())
    assert find_world("treadmill") is Treadmill and find_world("bench_leg") is BenchLeg


def test_an_adjusted_treadmill_is_one_with_that_number():
    world = Treadmill(slope=0.05)
    slower = world.replace_adjustment(BELT_SPEED, 0.3)
    assert slower == replace(world, belt_speed=0.3)
    assert slower.replace_adjustment(SUPPORT_SHARE, 0.2).support == replace(world.support, share=0.2)
    speed, share = slower.adjustments
    assert (speed.value, speed.minimum, speed.maximum) == pytest.approx((0.3, 0.54, 1.62))
    assert share.value == world.support.share


def test_only_adjustable_quantities_of_a_world_can_be_adjusted():
    assert Treadmill().has_adjustments(BELT_SPEED, SUPPORT_SHARE) and not Treadmill().has_adjustments(
        "gravity"
    )
    assert not BenchLeg().has_adjustments(BELT_SPEED)


def test_without_ground_there_is_no_load_and_the_belt_carries_the_rest_of_the_supported_weight():
    bench, belt = BenchLeg(), Treadmill(slope=0.05)
    assert bench.walking is None and not bench.grounded and bench.adjustments == ()
    walking = belt.walking
    assert belt.grounded and walking.speed == walking.belt.cruise == belt.belt_speed
    assert walking.carried_share == 1.0 - belt.support.share and walking.slope == 0.05


@pytest.mark.parametrize("leading", Side)
def test_legs_start_in_the_postures_that_they_are_given(leading):
    postures = {
        Side.LEFT: {JointName.HIP: 0.1, JointName.KNEE: 0.2},
        Side.RIGHT: {JointName.HIP: 0.3, JointName.KNEE: 0.4},
    }
    world = Treadmill(leading=leading).replace_postures(postures)
    trailing = next(side for side in Side if side is not leading)
    assert (world.leading_angles, world.trailing_angles) == (postures[leading], postures[trailing])
    right = {Side.RIGHT: postures[Side.RIGHT]}
    assert BenchLeg().replace_postures(right).start_angles == postures[Side.RIGHT]


def test_joints_without_a_device_start_as_before():
    belt = Treadmill(leading=Side.LEFT)
    changed = belt.replace_postures({Side.RIGHT: {JointName.KNEE: 0.4}})
    assert changed.leading_angles == belt.leading_angles
    assert changed.trailing_angles == {**belt.trailing_angles, JointName.KNEE: 0.4}
