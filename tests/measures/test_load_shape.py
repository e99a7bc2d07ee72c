"""Peaks and trough of the force under a foot: extrema, or no number."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.signal import find_peaks

from twin_gait.measures.load_shape import TWO_PEAKS, load_shape, prominent_peaks
from twin_gait.measures.walk import load_measures

# Mean stride of the left leg of person stroke_left with 62 kg and 1.63 m over 60 s; table treadmill_guided
# with the thresholds -2.0 deg from middle to late stance and 17 and 34 deg of clearance. Its load rises at
# 18 %.
STROKE_LEFT = [
    0.07, 0.36, 0.7, 0.91, 0.94, 0.9, 0.86, 0.81, 0.77, 0.73, 0.69, 0.67, 0.67, 0.67, 0.68, 0.7, 0.73, 0.77,
    0.81, 0.91, 1.11, 1.21, 1.21, 1.15, 1.07, 1.01, 0.97, 0.95, 0.95, 0.96, 0.97, 0.97, 0.95, 0.92, 0.89,
    0.85, 0.83, 0.82, 0.81, 0.82, 0.83, 0.85, 0.87, 0.89, 0.9, 0.91, 0.92, 0.92, 0.93, 0.94, 0.94, 0.85,
    0.67, 0.47, 0.34, 0.29, 0.29, 0.29, 0.3, 0.31, 0.31, 0.31, 0.31, 0.3, 0.28, 0.25, 0.22, 0.17, 0.12, 0.05,
    *[0.0] * 30, 0.07,
]  # fmt: skip


def bumps(*peaks: tuple[float, float], floor: float = 0.7, stance: int = 66) -> np.ndarray:
    """Load of a foot with peaks at some percents, each a bell of 4 % above the floor."""
    percent = np.arange(101.0)
    force = floor + sum((top - floor) * np.exp(-0.5 * ((percent - at) / 4.0) ** 2) for at, top in peaks)
    return np.where(percent < stance, force, 0.0)


def test_peaks_do_not_change_places_where_the_load_rises_at_the_edge_of_midstance() -> None:
    found = load_shape(np.array(STROKE_LEFT))
    assert found.pattern == TWO_PEAKS
    assert (found.loading_peak, found.trough, found.push_off_peak) == (1.21, 0.81, 0.94)


@pytest.mark.parametrize("shift", range(-6, 7))
def test_a_shift_of_the_curve_changes_no_number(shift: int) -> None:
    found = load_shape(bumps((18 + shift, 1.1), (48 + shift, 1.0)))
    assert found[:3] == pytest.approx((1.1, 0.7, 1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("cycle", "reason"),
    [
        (bumps((15, 1.1)), "no peak in the second half of stance"),
        (bumps((50, 1.1)), "no peak in the first half of stance"),
        (bumps((33, 1.1), (50, 1.0)), "a peak in midstance, at 33 % of the stride"),
        (bumps((12, 1.0), (31, 1.1), (50, 1.0)), "a peak in midstance, at 31 % of the stride"),
        # The load falls from the first peak to 43 %, and rises to a late second one.
        (np.interp(np.arange(101), [0, 12, 46, 52, 66, 100], [0, 1.1, 0.6, 0.9, 0, 0]), "no minimum in the"),
        (np.full(101, math.nan), "no stride counts"),
        (np.zeros(101), "no peak in the first half of stance"),
    ],
)
def test_without_the_pattern_there_is_a_reason_and_no_number(cycle: np.ndarray, reason: str) -> None:
    found = load_shape(cycle)
    assert found.pattern.startswith(reason)
    assert all(math.isnan(number) for number in found[:3])


def test_numbers_are_extrema_of_the_curve_at_every_position_of_three_peaks() -> None:
    """Where there are numbers they are local extrema in their order, wherever a third peak lies."""
    numbers = 0
    for at in range(4, 62):
        cycle = bumps((17, 1.05), (at, 1.15), (49, 1.0))
        shape = load_shape(cycle)
        if shape.pattern != TWO_PEAKS:
            continue
        numbers += 1
        loading, trough, push_off = (int(np.flatnonzero(cycle == number)[0]) for number in shape[:3])
        assert loading < 0.45 * 66 < trough or trough < 0.55 * 66 < push_off
        assert loading < trough < push_off
        assert cycle[loading] > max(cycle[loading - 1], cycle[loading + 1])
        assert cycle[push_off] > max(cycle[push_off - 1], cycle[push_off + 1])
        assert cycle[trough] < min(cycle[trough - 1], cycle[trough + 1])
    assert numbers > 30


def test_least_loads_are_there_without_two_peaks() -> None:
    found = load_measures(bumps((33, 1.1), (50, 1.0)))
    assert math.isnan(found["trough"])
    assert found["min_load"] == pytest.approx(0.7, abs=1e-3)
    assert found["min_midstance_load"] == pytest.approx(0.7, abs=1e-2)


@pytest.mark.parametrize("seed", range(20))
def test_prominent_peaks_equal_scipy(seed: int) -> None:
    curve = np.cumsum(np.random.default_rng(seed).normal(size=101))
    expected = find_peaks(curve, prominence=1.0)[0]
    assert len(expected) > 0
    assert_array_equal(prominent_peaks(curve, 1.0), expected)
