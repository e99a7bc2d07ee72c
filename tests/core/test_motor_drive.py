"""Winding, current loop, inverter and gear against closed forms, scipy and the catalogue."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from twin_device import KNEE_ACTUATOR

from twin_gait.core.actuator import Motor
from twin_gait.core.motor_drive import (
    current_loop_gains,
    current_loop_step,
    drive_efficiency,
    inverter_voltage,
    link_load_torque,
    six_step_current,
    torsion_torque,
    winding_current_step,
)
from twin_gait.worlds.bench_control import CosinePath, DutyControl, cosine_path, transparency_duty
from twin_gait.worlds.bench_joint import CatalogueEfficiency

R, L = 0.343, 0.264e-3  # EC 90 flat, 24 V
KE = 0.0705 * 100.0  # back-EMF at the joint in V s/rad

# Data from Harmonic Drive's catalogue, CSD-25-100 at rated torque with grease: percent at 500, 1000, 2000 and
# 3500 1/min for each temperature in °C.
CATALOGUE = {
    -10: (52, 42, 31, 24),
    0: (63, 54, 44, 36),
    10: (72, 65, 55, 47),
    20: (76, 71, 64, 57),
    25: (78, 73, 67, 61),
    30: (79, 75, 70, 64),
    40: (81, 78, 74, 69),
}
SPEEDS = np.array([500, 1000, 2000, 3500]) * 2 * math.pi / 60


def test_voltage_step_gives_the_closed_form_at_every_period() -> None:
    period, current, times = 5e-5, 0.0, np.arange(1, 61) * 5e-5
    path = []
    for _ in times:
        current, _ = winding_current_step(current, 2.0, 0.5, R, L, period)
        path.append(current)
    assert_allclose(path, 1.5 / R * (1 - np.exp(-times * R / L)), rtol=1e-13)


@given(st.floats(-20, 20), st.floats(-30, 30), st.floats(-30, 30), st.floats(1e-6, 1e-2))
def test_flux_of_the_winding_balances(current: float, voltage: float, emf: float, period: float) -> None:
    after, mean = winding_current_step(current, voltage, emf, R, L, period)
    # ∫ (U − E − R I) dt = L ΔI, whatever the current does in between.
    assert math.isclose(
        (voltage - emf - R * mean) * period, L * (after - current), rel_tol=1e-9, abs_tol=1e-13
    )


def test_winding_agrees_with_radau() -> None:
    solution = solve_ivp(
        lambda t, i: (1.3 - 0.2 - R * i) / L, (0, 2e-3), [3.0], method="Radau", rtol=1e-12, atol=1e-12
    )
    assert_allclose(winding_current_step(3.0, 1.3, 0.2, R, L, 2e-3)[0], solution.y[0, -1], rtol=1e-9)


def current_step(period: float, limit: float = 1e3) -> tuple[np.ndarray, np.ndarray]:
    bandwidth = 2 * math.pi * 500
    gains = current_loop_gains(R, L, bandwidth)
    times = np.arange(1, round(1.5e-3 / period) + 1) * period
    current, integral, path = 0.0, 0.0, []
    for _ in times:
        voltage, integral = current_loop_step(2.0 - current, integral, *gains, period, limit)
        current, _ = winding_current_step(current, voltage, 0.0, R, L, period)
        path.append(current)
    return np.array(path), 2.0 * (1 - np.exp(-bandwidth * times))


def test_current_loop_cancels_the_pole_of_the_winding() -> None:
    errors = [np.abs(np.subtract(*current_step(period))).max() for period in (2e-6, 1e-6)]
    assert errors[0] < 0.02
    assert 1.8 < errors[0] / errors[1] < 2.2  # the sampled loop nears the continuous one to first order


def test_integral_does_not_wind_up_while_the_voltage_is_at_its_limit() -> None:
    gains, period, limit = current_loop_gains(R, L, 2 * math.pi * 500), 5e-5, 2.0
    current = integral = free_current = free_integral = 0.0
    after, free_after = [], []
    for step in range(2000):
        target = 20.0 if step < 1000 else 1.0  # 20 A would take 6.9 V
        voltage, integral = current_loop_step(target - current, integral, *gains, period, limit)
        assert abs(voltage) <= limit
        current, _ = winding_current_step(current, voltage, 0.0, R, L, period)
        free_integral += gains[1] * period * (target - free_current)
        free = min(max(gains[0] * (target - free_current) + free_integral, -limit), limit)
        free_current, _ = winding_current_step(free_current, free, 0.0, R, L, period)
        if 1000 + 120 <= step < 1000 + 300:  # some six time constants of the winding later
            after.append(abs(current - 1.0))
            free_after.append(abs(free_current - 1.0))
    assert max(after) < 0.01
    assert max(free_after) > 1.0


def test_six_step_ripple_has_six_periods_in_an_electrical_turn_and_no_mean() -> None:
    angles = np.linspace(0, 2 * math.pi, 7200, endpoint=False)
    samples = np.array([six_step_current(3.0, angle, 12, 0.05, 0.0) for angle in angles])
    spectrum = np.abs(np.fft.rfft(samples)) / len(samples)
    assert np.argmax(spectrum[1:]) + 1 == 72
    assert_allclose(samples.mean(), 3.0, rtol=1e-12)
    assert_allclose(np.ptp(samples), 2 * 3.0 * 0.05, rtol=1e-6)


MOTOR = Motor(0.0705, 100.0, R)


def test_resting_joint_gets_the_sine_of_equation_2_1a() -> None:
    duties = [transparency_duty(DutyControl(), MOTOR, tick, 0.05, 28.8, 6000) for tick in range(1000)]
    assert_allclose(max(duties), 170.0, rtol=1e-3)
    crossings = np.flatnonzero(np.diff(np.sign(duties)) > 0)
    assert len(crossings) in (2, 3)  # three periods in a second


@given(st.floats(0.11, 1.4), st.floats(10.0, 30.0))
def test_duty_that_cancels_the_back_emf_leaves_the_static_current(velocity: float, bus: float) -> None:
    law = DutyControl(transparency_gain=1.0, back_emf_share=1.0, braking_torque=0.0, duty_limit=1.0)
    duty = transparency_duty(law, MOTOR, 0, velocity, bus, 6000)
    voltage = duty / 6000 * bus
    assert math.isclose((voltage - KE * velocity) / R, 0.05 / R, rel_tol=1e-9)


@given(st.floats(0.11, 3.0), st.floats(0.5, 1.5))
def test_viscous_duty_is_odd_and_limited(velocity: float, gain: float) -> None:
    law = DutyControl(transparency_gain=gain, duty_limit=0.5)
    ahead = transparency_duty(law, MOTOR, 0, velocity, 28.8, 6000)
    assert transparency_duty(law, MOTOR, 0, -velocity, 28.8, 6000) == -ahead
    assert abs(ahead) <= 3000


@given(st.floats(-7000, 7000))
def test_inverter_rounds_to_counts_within_the_bus_voltage(duty: float) -> None:
    voltage = inverter_voltage(duty, 6000, 28.8)
    counts = voltage / 28.8 * 6000
    assert abs(counts - round(counts)) < 1e-9
    assert abs(voltage) <= 28.8
    if abs(duty) <= 6000:
        assert abs(counts - duty) <= 0.5 + 1e-9


def test_efficiency_fits_the_catalogue() -> None:
    coefficients = CatalogueEfficiency().coefficients
    fitted = np.array([[drive_efficiency(t, w, coefficients) for w in SPEEDS] for t in CATALOGUE])
    error = fitted - np.array(list(CATALOGUE.values())) / 100
    assert np.sqrt(np.mean(error**2)) < 0.013
    assert np.abs(error).max() < 0.025
    assert (np.diff(fitted, axis=0) > 0).all()  # warmer grease loses less
    assert (np.diff(fitted, axis=1) < 0).all()  # a faster wave generator more


@pytest.mark.parametrize("horizontal", [math.pi / 2, 0.0])
def test_load_is_the_slope_of_the_potential(horizontal: float) -> None:
    for angle in np.linspace(-1, 2.2, 9):
        lost = [0.6 * 9.81 * math.sin(angle + step - horizontal) for step in (1e-6, -1e-6)]
        slope = (lost[0] - lost[1]) / 2e-6
        assert_allclose(link_load_torque(angle, 0.6, 9.81, horizontal), slope, atol=1e-8)


def test_corrected_load_loses_18_percent_to_the_stop_where_the_printed_one_begins_at_zero() -> None:
    start, stop = math.radians(90), math.radians(125)
    corrected = [link_load_torque(angle, 0.9, 9.81, math.pi / 2) for angle in (start, stop)]
    assert_allclose(corrected[0], 0.9 * 9.81)
    assert_allclose(corrected[1] / corrected[0], 1 - 0.18, atol=0.002)
    assert abs(link_load_torque(start, 0.9, 9.81, 0.0)) < 1e-12


def test_path_velocity_and_acceleration_are_derivatives() -> None:
    path = CosinePath(start_angle=1.5, amplitude=-1.2, frequency=0.5)
    for time in np.linspace(0, 3, 13):
        before, now, after = (cosine_path(path, time + step) for step in (-1e-5, 0.0, 1e-5))
        assert_allclose(now[1], (after[0] - before[0]) / 2e-5, atol=1e-8)
        assert_allclose(now[2], (after[1] - before[1]) / 2e-5, atol=1e-8)


def test_torsion_stores_the_work_put_into_it() -> None:
    twists = np.linspace(0, 2e-3, 1001)
    torques = np.array([torsion_torque(twist, 0.0, 3.1e4, 5.0) for twist in twists])
    assert_allclose(np.trapezoid(torques, twists), 0.5 * 3.1e4 * 2e-3**2, rtol=1e-9)
    assert torsion_torque(0.0, 0.1, 3.1e4, 5.0) * 0.1 > 0.0  # the link follows, the motor is braked


def test_constants_of_the_tests_equal_the_knee() -> None:
    assert (KNEE_ACTUATOR.resistance, KNEE_ACTUATOR.torque_constant * KNEE_ACTUATOR.gear_ratio) == (R, KE)
