"""Encoder and the two velocity estimates, driven tick by tick as the firmware drives them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from twin_device import SENSORS

from twin_gait.core.control_tick import measure_joint, new_encoder
from twin_gait.core.estimation import (
    delayed_sample,
    first_order_gain,
    first_order_step,
    new_delay_line,
    quantise,
)
from twin_gait.parameters.drives import SensorParameters

ANGLE, VELOCITY_FAST, VELOCITY_SLOW = range(3)  # columns of the measurements below
TICK = 1e-3


def measurements(
    angle_at: Callable[[float], float],
    ticks: int,
    *,
    resolution: float = 0.0,
    sensors: SensorParameters = SENSORS,
) -> np.ndarray:
    """Measure a path of one joint; columns angle, fast and slow velocity, one row a tick."""
    gain = first_order_gain(TICK, sensors.fast_time_constant)
    encoder = new_encoder(resolution, 0.0, sensors.window)
    rows = []
    for tick in range(ticks):
        measure_joint(encoder, tick, angle_at(tick * TICK), TICK, gain, sensors.decimation)
        rows.append([encoder.angle, encoder.velocity_fast, encoder.velocity_slow])
    return np.array(rows)


@given(angle=st.floats(-10.0, 10.0), resolution=st.floats(1e-7, 0.1))
def test_encoder_errs_by_at_most_half_a_count(angle: float, resolution: float) -> None:
    read = quantise(angle, resolution)
    assert abs(read - angle) <= 0.5 * resolution * (1.0 + 1e-9) + 1e-14  # rounding only
    counts = read / resolution
    assert_allclose(counts, round(counts), rtol=1e-12, atol=1e-9)


@given(angle=st.floats(-10.0, 10.0))
def test_ideal_encoder_is_exact(angle: float) -> None:
    assert quantise(angle, 0.0) == angle


@given(counts=st.integers(-100_000, 100_000), resolution=st.floats(1e-7, 0.1))
def test_encoder_reads_its_own_reading_again(counts: int, resolution: float) -> None:
    once = quantise(counts * resolution, resolution)
    assert quantise(once, resolution) == once


def test_motor_encoder_resolves_a_tenth_of_a_milliradian_at_most() -> None:
    """8192 counts a motor turn behind a 100:1 gear: 2π/819 200 = 7.67 µrad at the joint."""
    resolution = 2.0 * math.pi / (SENSORS.encoder_counts * 100)
    assert_allclose(resolution, 7.67e-6, rtol=1e-3)
    measured = measurements(lambda t: 0.5 * math.sin(2.0 * t), 500, resolution=resolution)[:, ANGLE]
    true = 0.5 * np.sin(2.0 * TICK * np.arange(500))
    assert 0.0 < np.abs(measured - true).max() <= 0.5 * resolution * (1.0 + 1e-9)


@pytest.mark.parametrize("velocity", [2.0, -0.7])
def test_slow_estimate_of_a_ramp_becomes_its_slope(velocity: float) -> None:
    filled = SENSORS.window * SENSORS.decimation
    slow = measurements(lambda t: 0.3 + velocity * t, filled + 50)[:, VELOCITY_SLOW]
    assert_allclose(slow[filled:], velocity, rtol=1e-10)
    assert abs(slow[filled - 1]) < 0.95 * abs(velocity)


@pytest.mark.parametrize(("decimation", "window"), [(10, 10), (1, 10), (5, 4)])
def test_slow_estimate_lags_by_the_mean_age_of_its_differences(decimation: int, window: int) -> None:
    """On a velocity ramp ω = αt a filter of delay T_d shows α(t − T_d).

    The difference that is i samples old spans ``decimation`` ticks and is on average
    (i + 1/2)·decimation ticks old: 50 ms in the mean with the firmware's 10 and 10. Between two
    samples the estimate is held and ages by one tick a tick.
    """
    alpha = 3.0
    sensors = replace(SENSORS, decimation=decimation, window=window)
    ticks = 3 * decimation * window
    slow = measurements(lambda t: 0.5 * alpha * t * t, ticks, sensors=sensors)[:, VELOCITY_SLOW]
    settled = np.arange(decimation * window, ticks)
    lag = settled * TICK - slow[settled] / alpha
    age_at_sample = float(np.mean([(i + 0.5) * decimation for i in range(window)])) * TICK
    held = (settled % decimation) * TICK
    assert_allclose(lag, age_at_sample + held, atol=1e-9)


def test_slow_estimate_of_the_firmware_is_about_50_ms_late() -> None:
    """Ten samples at 100 Hz: 45 ms of average, 5 ms of difference and 0 to 9 ms of holding."""
    slow = measurements(lambda t: 0.5 * t * t, 400)[:, VELOCITY_SLOW]
    lag = TICK * np.arange(200, 400) - slow[200:]
    assert_allclose([lag.min(), lag.mean(), lag.max()], [0.050, 0.0545, 0.059], atol=1e-9)


def test_fast_estimate_answers_a_step_in_velocity_as_a_first_order_filter() -> None:
    """After n ticks of a constant slope: ω (1 − e^{−nT/τ})."""
    velocity = 1.5
    fast = measurements(lambda t: velocity * t, 60)[:, VELOCITY_FAST]
    expected = velocity * (1.0 - np.exp(-np.arange(60) * TICK / SENSORS.fast_time_constant))
    assert_allclose(fast, expected, atol=1e-10)


def test_fast_estimate_follows_much_sooner_than_the_slow_one() -> None:
    measured = measurements(lambda t: max(0.0, t - 0.2), 400)
    delays = []
    for column in (VELOCITY_FAST, VELOCITY_SLOW):
        half = np.flatnonzero(measured[:, column] >= 0.5)[0]
        delays.append(half * TICK - 0.2)
    assert delays[0] < 0.006
    assert delays[1] > 0.045


def test_filter_without_time_constant_passes_its_input() -> None:
    assert first_order_gain(TICK, 0.0) == 1.0
    assert first_order_step(0.3, 0.9, first_order_gain(TICK, 0.0)) == pytest.approx(0.9, rel=1e-15)


@given(sample=st.floats(-10.0, 10.0), estimate=st.floats(-10.0, 10.0), tau=st.floats(1e-4, 1.0))
def test_filter_moves_towards_its_input_without_overshoot(sample: float, estimate: float, tau: float) -> None:
    after = first_order_step(estimate, sample, first_order_gain(TICK, tau))
    low, high = min(sample, estimate), max(sample, estimate)
    assert low - 1e-14 <= after <= high + 1e-14  # rounding only


def test_first_tick_reads_the_angle_and_claims_no_velocity() -> None:
    first = measurements(lambda t: 0.4, 1)[0]
    assert first[ANGLE] == 0.4
    assert first[VELOCITY_FAST] == first[VELOCITY_SLOW] == 0.0


def test_joint_at_rest_shows_no_velocity() -> None:
    measured = measurements(lambda t: 0.4, 300)
    assert np.all(measured[:, [VELOCITY_FAST, VELOCITY_SLOW]] == 0.0)


@pytest.mark.parametrize("delay", [0, 1, 15, 16, 40])
def test_delayed_sample_is_the_one_of_so_many_before(delay: int) -> None:
    line, samples = new_delay_line(delay), [math.sin(number) for number in range(100)]
    late = [delayed_sample(line, number, sample) for number, sample in enumerate(samples)]
    assert late == ([0.0] * delay + samples)[:100]


def test_windows_and_delays_of_similar_length_share_a_buffer_length() -> None:
    lengths = [len(new_encoder(0.0, 0.0, window).ring) for window in (1, 10, 16, 17)]
    assert lengths == [16, 16, 16, 32]
    assert [len(new_delay_line(delay).samples) for delay in (0, 15, 16)] == [16, 16, 32]
