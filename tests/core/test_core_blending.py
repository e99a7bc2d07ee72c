"""How parameters fade: ends, slopes, and what happens when a fade is interrupted."""

from __future__ import annotations

import sys
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from twin_gait.core.blending import (
    BLEND_LINEAR,
    BLEND_MINIMUM_JERK,
    BLEND_NONE,
    blend,
    blend_share,
)
from twin_gait.core.control_tick import Setpoint, blend_setpoint, copy_setpoint

LAWS = [BLEND_NONE, BLEND_LINEAR, BLEND_MINIMUM_JERK]
FADING = [BLEND_LINEAR, BLEND_MINIMUM_JERK]


@pytest.mark.parametrize("law", LAWS)
def test_fade_ends_at_the_new_value_and_stays_there(law: int) -> None:
    assert [blend_share(progress, law) for progress in (1.0, 1.5, 100.0)] == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("law", FADING)
def test_fade_starts_at_the_old_value(law: int) -> None:
    assert [blend_share(progress, law) for progress in (-1.0, 0.0)] == [0.0, 0.0]


def test_no_blending_switches_at_once() -> None:
    assert blend_share(0.0, BLEND_NONE) == 1.0


@pytest.mark.parametrize("law", FADING)
@given(first=st.floats(0.0, 1.0), second=st.floats(0.0, 1.0))
def test_share_grows_and_stays_within_0_and_1(law: int, first: float, second: float) -> None:
    low, high = sorted((first, second))
    shares = blend_share(low, law), blend_share(high, law)
    rounding = 31.0 * sys.float_info.epsilon  # of the three terms, 10 + 15 + 6 at the end
    assert -rounding <= shares[0] <= shares[1] + rounding
    assert shares[1] <= 1.0 + rounding


@pytest.mark.parametrize("law", FADING)
@given(progress=st.floats(0.0, 1.0))
def test_fade_is_symmetric_about_its_middle(law: int, progress: float) -> None:
    assert_allclose(blend_share(progress, law) + blend_share(1.0 - progress, law), 1.0, atol=1e-14)


def test_minimum_jerk_fade_starts_and_ends_smoothly() -> None:
    """Zero velocity and acceleration at both ends, by finite differences."""
    h = 1e-4
    for end, inwards in ((0.0, h), (1.0, -h)):
        values = [blend_share(end + k * inwards, BLEND_MINIMUM_JERK) for k in range(3)]
        # The share grows as 10 s³ from either end: 10 h² and 60 h are what is left.
        assert abs(values[1] - values[0]) / h < 11.0 * h**2
        assert abs(values[2] - 2.0 * values[1] + values[0]) / h**2 < 61.0 * h


def test_minimum_jerk_fade_has_its_known_steepest_slope() -> None:
    """15/8 in the middle (Flash and Hogan, 1985)."""
    h = 1e-5
    slope = (blend_share(0.5 + h, BLEND_MINIMUM_JERK) - blend_share(0.5 - h, BLEND_MINIMUM_JERK)) / (2.0 * h)
    assert_allclose(slope, 15.0 / 8.0, rtol=1e-8)


@given(old=st.floats(-100.0, 100.0), new=st.floats(-100.0, 100.0))
def test_blended_value_goes_from_old_to_new(old: float, new: float) -> None:
    assert blend(old, new, 0.0) == old
    assert_allclose(blend(old, new, 1.0), new, atol=1e-13)
    assert_allclose(blend(old, new, 0.5), 0.5 * (old + new), atol=1e-13)


TARGETS = (Setpoint(100.0, 5.0, 0.1, 0.3), Setpoint(300.0, 2.0, -0.2, 0.5), Setpoint(50.0, 9.0, 0.4, 0.0))


def fade(duration: int, law: int, switches: list[int], ticks: int) -> np.ndarray:
    """Blend a joint through the targets as an engine does: at each switch start from the present values."""
    blended, start = replace(TARGETS[0]), replace(TARGETS[0])
    rows, entered, phase = [], 0, 0
    for tick in range(ticks):
        if tick in switches:
            phase, entered = switches.index(tick) + 1, tick
            copy_setpoint(blended, start)
        blend_setpoint(start, TARGETS[phase], blend_share((tick - entered) / duration, law), blended)
        rows.append(astuple(blended))
    return np.array(rows)


@pytest.mark.parametrize("law", FADING)
def test_interrupted_fade_goes_on_from_the_present_values(law: int) -> None:
    """A second switch in the middle of a fade must not make the parameters jump."""
    duration, second = 60, 35
    rows = fade(duration, law, [5, second], 150)
    targets = np.array([astuple(target) for target in TARGETS])
    assert_allclose(rows[second], rows[second - 1], rtol=0.05)  # one tick of the first fade, no more
    largest_distance = np.abs(np.diff(targets, axis=0)).max(axis=0)
    steepest = {BLEND_LINEAR: 1.0, BLEND_MINIMUM_JERK: 15.0 / 8.0}[law]
    assert np.all(np.abs(np.diff(rows, axis=0)) <= 1.001 * steepest * largest_distance / duration)
    settled = rows[second + duration :]
    assert_allclose(settled, np.broadcast_to(targets[2], settled.shape), atol=1e-12)


@pytest.mark.parametrize("law", FADING)
def test_present_values_are_kept_in_the_tick_of_the_switch(law: int) -> None:
    rows = fade(60, law, [5], 7)
    assert np.array_equal(rows[5], astuple(TARGETS[0]))
    assert np.all(rows[6] != rows[5])


def test_copied_setpoint_is_no_second_name_of_its_source() -> None:
    source, target = replace(TARGETS[1]), replace(TARGETS[2])
    copy_setpoint(source, target)
    assert target == source
    source.stiffness = 0.0
    assert target == TARGETS[1]
