"""Tests of blending: ends, slopes, and interrupted fades."""

from __future__ import annotations

import sys
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from twin_gait import load_experiment
from twin_gait.control import gait_controller
from twin_gait.control.device_schedule import apply_transition, is_blending
from twin_gait.core.blending import (
    BLEND_LINEAR,
    BLEND_MINIMUM_JERK,
    BLEND_NONE,
    blend,
    blend_share,
)
from twin_gait.core.control_tick import ImpedanceSetpoint, copy_setpoint
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.record import deep_copy
from twin_gait.simulation.simulation_setup import build_setup

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


SETPOINTS = (
    ImpedanceSetpoint(100.0, 5.0, 0.1, 0.2),
    ImpedanceSetpoint(300.0, 20.0, -0.2, 0.8),
    ImpedanceSetpoint(50.0, 12.0, 0.4, 0.5),
)
SHARES = (0.0, 1.0, 0.4)  # of the gravity compensation


@pytest.fixture(scope="module")
def legs() -> Episode:
    """Two legs that have long been in their first phase, with the parameters above."""
    _, e, _ = assemble(build_setup(load_experiment("treadmill_guided").experiment))
    e.recording.most_switches = 0  # no switch can be recorded
    for joint in e.controller.joints:
        joint.setpoints[:3] = SETPOINTS
        joint.blended, joint.blend_start = deep_copy(SETPOINTS[0]), deep_copy(SETPOINTS[0])
    for leg in e.controller.legs:
        leg.gravity_shares[:3] = SHARES
        leg.phase, leg.gravity, leg.gravity_start, leg.entry_tick = 0, SHARES[0], SHARES[0], -1000
    for number, rule in enumerate(e.controller.program.transitions[:3]):
        rule.target = number
    return e


def parameters(e: Episode, leg: int = 0) -> list[float]:
    """Present parameters of the hip and knee of a leg, and its share of the gravity compensation."""
    hip, knee = e.controller.joints[2 * leg : 2 * leg + 2]
    return [*astuple(hip.blended), *astuple(knee.blended), e.controller.legs[leg].gravity]


TARGETS = [
    np.array([*astuple(item), *astuple(item), share]) for item, share in zip(SETPOINTS, SHARES, strict=True)
]


def fade(legs: Episode, duration: int, law: int, switches: list[int], ticks: int) -> np.ndarray:
    """Parameters of one leg tick by tick, which enters the next phase at each switch."""
    e = deep_copy(legs)
    e.rates.blend_law = law
    e.controller.legs[0].blend_ticks[:3] = [1, duration, duration]
    rows = []
    for tick in range(ticks):
        if tick in switches:
            e.controller.legs[0].chosen = switches.index(tick) + 1
            apply_transition(e.controller, 0, tick)
        if is_blending(e.controller.legs[0], tick):
            gait_controller.blend_parameters(e.controller, e.rates, 0, tick)
        rows.append(parameters(e))
    assert parameters(e, 1) == parameters(legs, 1)  # the other leg is left alone
    return np.array(rows)


@pytest.mark.parametrize("law", FADING)
def test_interrupted_fade_continues_from_the_present_values(legs: Episode, law: int) -> None:
    """A second switch in the middle of a fade must not make the parameters jump."""
    duration, second = 60, 35
    rows = fade(legs, duration, law, [5, second], 150)
    largest_distance = np.abs(np.diff(np.array(TARGETS), axis=0)).max(axis=0)
    steepest = {BLEND_LINEAR: 1.0, BLEND_MINIMUM_JERK: 15.0 / 8.0}[law]
    assert np.all(np.abs(np.diff(rows, axis=0)) <= 1.001 * steepest * largest_distance / duration)
    assert_allclose(rows[:5], np.broadcast_to(TARGETS[0], (5, 9)), atol=1e-12)
    assert_allclose(
        rows[second + duration :], np.broadcast_to(TARGETS[2], (150 - second - duration, 9)), atol=1e-12
    )


def test_present_values_are_kept_in_the_tick_of_the_switch(legs: Episode) -> None:
    rows = fade(legs, 60, BLEND_MINIMUM_JERK, [5], 20)
    assert np.array_equal(rows[5], rows[4])
    assert not np.array_equal(rows[7], rows[5])


def test_fade_without_duration_is_a_switch(legs: Episode) -> None:
    assert_allclose(fade(legs, 0, BLEND_MINIMUM_JERK, [5], 6)[5], TARGETS[1])


def test_copied_setpoint_is_independent_of_its_source() -> None:
    source, target = deep_copy(SETPOINTS[1]), deep_copy(SETPOINTS[2])
    copy_setpoint(source, target)
    assert target == source
    source.stiffness = 0.0
    assert target == SETPOINTS[1]
