"""What switches do, on parameters and motions whose energies, torques and jerks are known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad

from twin_gait.core.blending import BLEND_LINEAR, BLEND_MINIMUM_JERK, blend_share
from twin_gait.core.impedance import impedance_torque
from twin_gait.measures.switching import (
    JERK_CUT_OFF,
    blend_windows,
    dimensionless_jerk,
    joint_jerk,
    low_pass,
    spring_energy,
    switching_energy,
    torque_jumps,
)

TICK = 1e-3


def test_window_ends_with_the_blend_with_the_next_switch_or_with_the_record() -> None:
    windows = blend_windows(np.array([10, 30, 34, 98]), 5, 100)
    assert_array_equal(windows, [[10, 16], [30, 34], [34, 40], [98, 100]])
    assert_array_equal(blend_windows(np.array([10, 30]), 0, 100), [[10, 11], [30, 31]])
    assert_array_equal(blend_windows(np.array([10, 30]), np.array([3, 0]), 100), [[10, 14], [30, 31]])
    assert blend_windows(np.zeros(0, dtype=int), 5, 100).shape == (0, 2)


def test_torque_jump_is_the_largest_step_of_its_own_window() -> None:
    torque = np.array([0.0, 50.0, 50.0, 51.0, 48.0, 48.0, 90.0])
    # Into tick 3: 1; into tick 4: -3; the 50 before and the 42 after are outside.
    assert_allclose(torque_jumps(torque, np.array([[3, 6], [2, 4]])), [3.0, 1.0])
    assert torque_jumps(torque, np.zeros((0, 2), dtype=int)).shape == (0,)


def test_stiffer_spring_gains_half_the_change_times_the_deflection_squared() -> None:
    angle, stiffness = np.full(4, 0.5), np.array([100.0, 100.0, 260.0, 260.0])
    energy = switching_energy(angle, stiffness, np.full(4, 0.2))
    assert_allclose(energy, [0.0, 0.0, 0.5 * 160.0 * 0.3**2, 0.0])
    # And gives it back when it softens.
    assert_allclose(switching_energy(angle, stiffness[::-1], np.full(4, 0.2)).sum(), -0.5 * 160.0 * 0.3**2)


def test_equilibrium_moving_away_from_the_joint_loads_the_spring() -> None:
    angle, stiffness = np.full(3, 0.5), np.full(3, 100.0)
    away = switching_energy(angle, stiffness, np.array([0.4, 0.4, 0.1]))
    assert_allclose(away, [0.0, 0.0, 50.0 * (0.4**2 - 0.1**2)])
    towards = switching_energy(angle, stiffness, np.array([0.1, 0.1, 0.4]))
    assert_allclose(towards.sum(), -away.sum())


def test_step_of_both_parameters_is_exact_where_the_midpoint_rule_is_not() -> None:
    (old_k, new_k), (old_x, new_x) = (100.0, 500.0), (0.1, -0.6)
    energy = switching_energy(np.full(2, 0.3), np.array([old_k, new_k]), 0.3 - np.array([old_x, new_x]))
    assert_allclose(energy[1], 0.5 * 500.0 * 0.36 - 0.5 * 100.0 * 0.01)
    middle_k, middle_x = 0.5 * (old_k + new_k), 0.5 * (old_x + new_x)
    midpoint = 0.5 * (new_k - old_k) * middle_x**2 + middle_k * middle_x * (new_x - old_x)
    assert_allclose(energy[1] - midpoint, (new_k - old_k) * (new_x - old_x) ** 2 / 8.0)


def test_constant_parameters_add_no_energy_for_any_motion(rng: np.random.Generator) -> None:
    assert not switching_energy(rng.normal(size=50), np.full(50, 200.0), np.full(50, 0.1)).any()


@pytest.mark.parametrize("length", [0, 1])
def test_record_without_a_step_has_no_energy(length: int) -> None:
    values = np.full(length, 1.0)
    assert_array_equal(switching_energy(values, values, values), np.zeros(length))


def test_energy_converges_to_the_integral_of_its_rate() -> None:
    """Against quadrature of ½ k̇ (θ - θ0)² - k (θ - θ0) θ̇0, with a joint that swings during the blend."""
    length = 0.06

    def angle(t):
        return 0.2 + 0.2 * np.sin(20.0 * t)

    def stiffness(t):
        return 300.0 - 200.0 * t / length

    def equilibrium(t):
        return 0.1 + 0.6 * np.sin(0.5 * np.pi * t / length)

    def rate(t):
        deflection = angle(t) - equilibrium(t)
        equilibrium_rate = 0.3 * np.pi / length * np.cos(0.5 * np.pi * t / length)
        return 0.5 * (-200.0 / length) * deflection**2 - stiffness(t) * deflection * equilibrium_rate

    expected = quad(rate, 0.0, length, epsabs=1e-12)[0]
    errors = []
    for ticks in (60, 120, 240):
        time = np.linspace(0.0, length, ticks + 1)
        found = switching_energy(angle(time), stiffness(time), equilibrium(time)).sum()
        errors.append(found - expected)
    assert abs(expected) > 1.0
    # First order: halving the tick halves the error, and what is left without it is the integral.
    assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.02)
    assert_allclose(2.0 * errors[2] - errors[1], 0.0, atol=1e-4 * abs(expected))


@given(
    st.lists(
        st.tuples(st.floats(-2.0, 2.0), st.floats(0.0, 600.0), st.floats(-1.0, 1.0)), min_size=2, max_size=40
    )
)
def test_switching_and_the_work_of_the_controllers_torque_balance_the_energy(rows) -> None:
    """E_end - E_start is the energy of switching minus the work of the controller torque."""
    angle, stiffness, equilibrium = np.array(rows).T
    work = 0.0  # of the spring on the leg; its torque is linear in the angle, so that the trapezoid is exact
    for tick in range(len(angle) - 1):
        ends = (angle[tick], angle[tick + 1])
        torques = [impedance_torque(end, 0.0, stiffness[tick], 0.0, equilibrium[tick]) for end in ends]
        work += 0.5 * (torques[0] + torques[1]) * (ends[1] - ends[0])
    energy = spring_energy(angle, stiffness, equilibrium)
    injected = switching_energy(angle, stiffness, equilibrium).sum()
    assert_allclose(energy[-1] - energy[0], injected - work, atol=1e-9)


@pytest.mark.parametrize("frequency", [5.0, 50.0, 100.0])
def test_filter_has_the_gain_of_a_gaussian_and_no_delay(frequency: float) -> None:
    time = np.arange(1000) * TICK
    wave = np.sin(2.0 * np.pi * frequency * time)
    gain = 2.0 ** (-0.5 * (frequency / 50.0) ** 2)
    smooth = low_pass(wave, TICK, 50.0)
    assert len(smooth) == len(wave)
    # The kernel is cut at four standard deviations, which leaves less than 1e-3.
    assert_allclose(smooth[50:-50], gain * wave[50:-50], atol=1e-3)
    assert_allclose(low_pass(np.full(30, 4.2), TICK, 50.0), 4.2)


def test_jerk_of_a_sine_is_its_second_derivative() -> None:
    time, rate = np.arange(2000) * TICK, 2.0 * np.pi * 3.0
    jerk = joint_jerk(2.0 * np.sin(rate * time), TICK)
    gain = 2.0 ** (-0.5 * (3.0 / JERK_CUT_OFF) ** 2)
    expected = -2.0 * gain * rate**2 * np.sin(rate * time)
    assert_allclose(jerk[50:-50], expected[50:-50], atol=1e-3 * 2.0 * rate**2)
    assert_array_equal(joint_jerk(np.array([1.0, 5.0]), TICK), [0.0, 0.0])


def test_jerk_of_a_step_of_torque_does_not_depend_on_the_tick() -> None:
    """An acceleration that steps by 1 rad/s²: the jerk is a Gaussian with a known peak."""
    peaks = []
    for tick in (1e-3, 5e-4):
        time = np.arange(round(0.4 / tick)) * tick
        peaks.append(joint_jerk(np.maximum(0.0, time - 0.2), tick).max())
    deviation = math.sqrt(math.log(2.0)) / (2.0 * math.pi * JERK_CUT_OFF)
    assert_allclose(peaks, 1.0 / (deviation * math.sqrt(2.0 * math.pi)), rtol=0.02)


@pytest.mark.parametrize(("amplitude", "duration"), [(1.0, 1.0), (3.0, 1.0), (1.0, 2.0)])
def test_dimensionless_jerk_of_a_sine_depends_on_neither_size_nor_length(amplitude, duration) -> None:
    time = np.arange(-200, round(duration / TICK) + 200) * TICK
    velocity = amplitude * np.sin(2.0 * np.pi * time / duration)
    spans = np.array([[200, 200 + round(duration / TICK)]])
    found = dimensionless_jerk(velocity, joint_jerk(velocity, TICK), spans, TICK)
    assert_allclose(found, (2.0 * math.pi) ** 4 / 2.0, rtol=1e-3)


def test_dimensionless_jerk_of_the_smoothest_reach() -> None:
    """From rest to rest along the minimum-jerk curve: 720 over the square of a peak of 15/8."""
    share = np.clip(np.arange(-200, 2201) / 2000.0, 0.0, 1.0)
    velocity = 30.0 * (share * (1.0 - share)) ** 2 / 2.0
    found = dimensionless_jerk(velocity, joint_jerk(velocity, TICK), np.array([[200, 2200]]), TICK)
    # The jerk steps at both ends, and the filter carries half of each step's width out of the span.
    assert_allclose(found, 720.0 / (15.0 / 8.0) ** 2, rtol=0.01)


def test_joint_at_rest_has_no_dimensionless_jerk() -> None:
    rest = np.zeros(100)
    assert np.isnan(dimensionless_jerk(rest, joint_jerk(rest, TICK), np.array([[0, 100]]), TICK)).all()


def test_linear_fade_of_a_torque_has_the_least_jerk_and_minimum_jerk_more_by_a_known_factor() -> None:
    """A joint of constant inertia turns the slope of its torque into jerk; ∫ ṡ² is 1/T and 10/7 of that."""
    ticks = 1000
    squares = {}
    for law in (BLEND_LINEAR, BLEND_MINIMUM_JERK):
        share = np.array([blend_share(tick / ticks, law) for tick in range(ticks + 1)])
        squares[law] = np.sum(np.diff(share) ** 2) * ticks
    assert_allclose(squares[BLEND_LINEAR], 1.0)
    assert_allclose(squares[BLEND_MINIMUM_JERK], 10.0 / 7.0, rtol=1e-5)
