"""Support by crutches on one foot, on forces whose measures are known by hand."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from twin_gait.measures.crutches import FOOT_BREADTH, FOOT_SPACING, frontal_margins, single_support
from twin_gait.vocabulary import Side

TICK, RATE, FOOT, TIP, HALF = 1e-3, 3.0, 0.09, 0.3, 0.05


def stride(left_tip: float, right_tip: float, ticks: int = 1000, strides: int = 8) -> np.ndarray:
    """Return forces of strides of a left and a right step; a tip carries a load on the other leg's step."""
    left = np.repeat(np.tile([800.0, 0.0], strides), ticks)
    right = 800.0 - left
    return np.array([left, right, np.where(right > 0.0, left_tip, 0.0), np.where(left > 0.0, right_tip, 0.0)])


def test_a_foot_alone_leaves_the_middle_plane_outside() -> None:
    forces = stride(0.0, 0.0)
    single = np.ones(forces.shape[1], bool)
    static, _ = frontal_margins(forces, single, (FOOT, TIP), HALF, TICK, RATE)
    assert_allclose(static, -(FOOT - HALF))


def test_a_loaded_crutch_on_the_other_side_brings_it_inside() -> None:
    """The nearer edge is the outer side of the foot."""
    forces = stride(200.0, 200.0)
    single = np.ones(forces.shape[1], bool)
    static, _ = frontal_margins(forces, single, (FOOT, TIP), HALF, TICK, RATE)
    assert_allclose(static, FOOT + HALF)


def test_the_extrapolated_centre_of_mass_of_a_regular_gait_has_a_closed_form() -> None:
    """With the pressure ±u for T each, ξ is ±u tanh(ω T / 2) at first and then leaves u by e^(ω t)."""
    forces = stride(0.0, 0.0, strides=12)
    single = np.ones(forces.shape[1], bool)
    _, dynamic = frontal_margins(forces, single, (FOOT, TIP), HALF, TICK, RATE)
    start = 4000  # a left step in the middle of the run
    time = np.arange(1000) * TICK
    first = FOOT * math.tanh(0.5 * RATE * 1.0)
    point = FOOT + (first - FOOT) * np.exp(RATE * time)
    assert_allclose(dynamic[start : start + 1000], point - (FOOT - HALF), atol=1e-6)


def log_of(forces: np.ndarray) -> pd.DataFrame:
    names = [f"{side}_{part}_normal_force_N" for part in ("foot", "crutch") for side in Side]
    return pd.DataFrame({**dict(zip(names, forces, strict=True)), "pelvis_height_m": 0.9})


def test_time_on_one_foot_without_a_crutch_is_counted() -> None:
    forces = stride(100.0, 100.0, ticks=500, strides=4)
    forces[2:, 1100:1250] = 0.0
    forces[2:, 2100:2150] = 5.0  # carried, not loaded
    found = single_support(log_of(forces), TICK, height=1.75, tip_aside=0.15, gravity=9.81)
    assert found is not None
    assert found["share_without_crutch"] == pytest.approx(200.0 / 4000.0)
    assert found["longest_without_crutch_s"] == pytest.approx(0.15)
    assert found["static_margin_m"] == pytest.approx(-0.5 * (FOOT_SPACING - FOOT_BREADTH) * 1.75)


def test_without_crutches_or_single_support_nothing_is_stated() -> None:
    forces = stride(100.0, 100.0)
    arguments = {"height": 1.75, "tip_aside": 0.15, "gravity": 9.81}
    assert single_support(log_of(forces).iloc[:, :2], TICK, **arguments) is None
    forces[:2] = 400.0
    found = single_support(log_of(forces), TICK, **arguments)
    assert found is not None and all(map(math.isnan, found.values()))
