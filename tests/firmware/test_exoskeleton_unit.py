"""Tests of the image of the linked unit: time thresholds act in float as in double numbers."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait.core.guards import CompiledComparison, GuardProgram, is_above
from twin_gait.firmware.exoskeleton_unit import shift_time_thresholds
from twin_gait.gait.signals import OTHER_TIME, all_signal_names
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName

NAMES = all_signal_names((JointName.HIP, JointName.KNEE))
TIME, ANGLE = NAMES.index("time_in_phase_s"), NAMES.index("hip.angle_deg")
MILLISECONDS = np.arange(2000)


def parted(signal: int, factor: float, threshold: float) -> CompiledComparison:
    program = GuardProgram(0, [], [], [], [CompiledComparison(signal, 0, factor, 0.0, factor * threshold)])
    shift_time_thresholds(program, NAMES)
    return program.comparisons[0]


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_no_tick_changes_its_side_of_a_threshold(factor, rng):
    """Thresholds of whole ticks as a table writes them, neighbours of theirs, and any others."""
    whole = np.round(0.001 * MILLISECONDS, 3)
    thresholds = [*whole, *np.nextafter(whole, 9.0), *np.nextafter(whole, -9.0), *rng.uniform(0.0, 2.0, 500)]
    near_misses = 0
    for threshold in map(float, thresholds):
        moved = parted(TIME, factor, threshold)
        nearest = round(threshold / TICK)
        for ticks in range(max(0, nearest - 2), nearest + 3):
            before = is_above(CompiledComparison(TIME, 0, factor, 0.0, factor * threshold), ticks * TICK, 0.0)
            assert is_above(moved, ticks * TICK, 0.0) == before
            single = np.float32(factor) * (np.float32(ticks) * np.float32(TICK))
            assert bool(single > np.float32(moved.threshold)) == before
            near_misses += bool(single > np.float32(factor * threshold)) != before
    assert near_misses > 100  # what float would do without


def test_other_thresholds_are_unchanged():
    assert parted(ANGLE, 1.0, 0.0123).threshold == 0.0123
    program = GuardProgram(
        0, [], [], [], [CompiledComparison(TIME, NAMES.index(OTHER_TIME), 1.0, -1.0, 0.0005)]
    )
    shift_time_thresholds(program, NAMES)
    assert program.comparisons[0].threshold == 0.0005
