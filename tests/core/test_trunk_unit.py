"""Tests of the inertial unit of the trunk: measured quantities and filtered pitch in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from twin_device import SENSORS

from twin_gait.core.estimation import first_order_gain
from twin_gait.core.inertial import (
    TrunkUnit,
    tangential_specific_force,
    trunk_specific_force,
    update_pitch_estimate,
)

GRAVITY, T = 9.81, 1e-3


def unit_of(
    pitch: float = 0.0, tau: float = 0.5, gyroscope: float = 0.0, accelerometer: float = 0.0
) -> TrunkUnit:
    return TrunkUnit(0.2, 0.15, gyroscope, accelerometer, first_order_gain(T, tau), pitch)


def at_rest(pitch: float) -> tuple[float, float]:
    return -GRAVITY * math.sin(pitch), GRAVITY * math.cos(pitch)


def test_the_specific_force_is_the_acceleration_of_the_units_place_less_gravity() -> None:
    """By finite differences of its position on a path of the hips, in the axes of the trunk."""

    def hips(t: float) -> tuple[np.ndarray, float]:
        return np.array([0.3 * math.sin(2.0 * t), 0.9 + 0.05 * math.cos(5.0 * t)]), 0.2 + 0.4 * math.sin(
            3.0 * t
        )

    def axes(pitch: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([math.cos(pitch), -math.sin(pitch)]), np.array([math.sin(pitch), math.cos(pitch)])

    def position(t: float) -> np.ndarray:
        at, pitch = hips(t)
        forwards, upwards = axes(pitch)
        return np.asarray(at - 0.15 * forwards + 0.2 * upwards)

    t, h = 0.37, 1e-4
    felt = (position(t + h) - 2.0 * position(t) + position(t - h)) / h**2 + [0.0, GRAVITY]
    pitch = 0.2 + 0.4 * math.sin(3.0 * t)
    rate, turning = 1.2 * math.cos(3.0 * t), -3.6 * math.sin(3.0 * t)
    forward, upward = -1.2 * math.sin(2.0 * t), -1.25 * math.cos(5.0 * t)
    found = trunk_specific_force(unit_of(), pitch, rate, turning, forward, upward, GRAVITY)
    assert_allclose(found, [axis @ felt for axis in axes(pitch)], atol=1e-6)


def test_on_resting_hips_it_equals_the_law_of_a_link() -> None:
    """A trunk that hangs level from its hips where the link does: θ_h = 90 deg."""
    unit = unit_of()
    unit.behind = 0.0
    ahead, _ = trunk_specific_force(unit, 0.3, 1.5, 4.0, 0.0, 0.0, GRAVITY)
    assert_allclose(ahead, tangential_specific_force(4.0, 0.3, 0.2, GRAVITY, math.pi / 2.0), rtol=1e-14)


@pytest.mark.parametrize("lean", [-0.3, 0.0, 0.14, 0.5])
def test_biases_settle_where_the_law_balances(lean: float) -> None:
    r"""At the end :math:`(1-\alpha)\,T b = \alpha \sin(\text{off})` less the angle of the biased gravity.

    With small angles that is τ b of the gyroscope, and -b / g of the accelerometer.
    """
    tau, gyroscope, accelerometer = 0.5, math.radians(0.1), 0.05
    unit = unit_of(lean, tau, gyroscope, accelerometer)
    for _ in range(20000):
        update_pitch_estimate(unit, 0.0, *at_rest(lean), T)
    ahead, up = at_rest(lean)
    seen = math.atan2(-ahead - accelerometer, up)
    # The estimate before the correction is ahead of that after it by one step of the bias.
    after = math.asin(gyroscope * T / unit.gain) - gyroscope * T
    assert_allclose(unit.pitch, seen + after, atol=1e-12)
    assert_allclose(unit.pitch - lean, tau * gyroscope - accelerometer * math.cos(lean) / GRAVITY, atol=3e-5)


def test_a_wrong_start_fades_with_the_time_constant() -> None:
    r"""Of :math:`\dot e = -\sin(e) / \tau` the closed form is :math:`\tan(e/2) \propto e^{-t/\tau}`."""
    unit = unit_of(0.6, 0.5)
    for _ in range(1000):
        update_pitch_estimate(unit, 0.0, *at_rest(0.1), T)
    expected = 2.0 * math.atan(math.tan(0.25) * math.exp(-2.0))
    assert_allclose(unit.pitch - 0.1, expected, rtol=2e-3)


def test_a_trunk_that_turns_evenly_is_followed_without_lag() -> None:
    """A ramp: the gyroscope leads, the accelerometer agrees but for the centrifugal force (h ω² / g ≪ 1)."""
    unit, rate = unit_of(0.0), 0.5
    unit.height = unit.behind = 0.0
    for tick in range(1, 801):
        pitch = rate * tick * T
        update_pitch_estimate(unit, rate, *trunk_specific_force(unit, pitch, rate, 0.0, 0.0, 0.0, GRAVITY), T)
        assert_allclose(unit.pitch, pitch, atol=1e-12)


def test_an_acceleration_is_taken_for_gravity_by_the_share_of_the_time_constant() -> None:
    r"""1 m/s² for 0.5 s: the estimate goes towards :math:`-\arctan(a/g)` with :math:`1 - e^{-t/\tau}`."""
    unit, tau, found = unit_of(0.0, 0.5), 0.5, []
    for tick in range(1500):
        forward = 1.0 if tick < 500 else 0.0
        update_pitch_estimate(unit, 0.0, *trunk_specific_force(unit, 0.0, 0.0, 0.0, forward, 0.0, GRAVITY), T)
        found.append(unit.pitch)
    asymptote = -math.atan2(1.0, GRAVITY)
    assert_allclose(found[499], asymptote * (1.0 - math.exp(-0.5 / tau)), rtol=2e-3)
    assert_allclose(found[499], math.radians(-3.68), atol=1e-4)
    assert_allclose(found[-1], found[499] * math.exp(-1.0 / tau), rtol=2e-3)


def test_the_noise_equals_the_noise_of_the_filter() -> None:
    r"""White noise: :math:`\sigma^2 = [(1-\alpha)^2 T^2 \sigma_\omega^2 + \alpha^2 \sigma_a^2 / g^2]
    / [1 - (1-\alpha)^2]`."""
    sensor = SENSORS.trunk
    for share in (
        0.0,
        1.0,
    ):  # of the accelerometer; with the gyroscope a hundred times louder, which is else lost
        rng, unit, found = np.random.default_rng(5), unit_of(0.0, 0.05), []
        gyroscope, accelerometer = (
            100.0 * (1.0 - share) * sensor.gyroscope_noise,
            share * sensor.accelerometer_noise,
        )
        for rate, ahead, up in rng.standard_normal((60000, 3)) * [gyroscope, accelerometer, accelerometer]:
            update_pitch_estimate(unit, rate, ahead, GRAVITY + up, T)
            found.append(unit.pitch)
        kept = 1.0 - unit.gain
        variance = (kept * T * gyroscope) ** 2 + (unit.gain * accelerometer / GRAVITY) ** 2
        expected = math.sqrt(variance / (1.0 - kept**2))
        # 60 s are 600 samples of the filter's own time; their standard deviation is known to 3 %.
        assert_allclose(np.std(found), expected, rtol=0.1)


def test_free_fall_has_no_direction() -> None:
    unit = unit_of(0.2)
    update_pitch_estimate(unit, 0.0, 0.0, 0.0, T)
    assert unit.pitch == 0.2
