"""Motor, gear and battery against numbers that were worked out by hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from twin_device import HIP_ACTUATOR, KNEE_ACTUATOR

from twin_gait.core.actuator import (
    Motor,
    battery_power,
    current_to_torque,
    motor_electrical_power,
    sagged_bus_voltage,
    saturate,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.core.control_tick import drive_motor, target_current

# maxon EC 90 flat, 24 V winding: K_t = 0.0705 Nm/A, R = 0.343 Ω; CSD-25 gear, 100:1.
K_T, R, RATIO = 0.0705, 0.343, 100.0
MOTOR = Motor(torque_constant=K_T, gear_ratio=RATIO, resistance=R)
BATTERY = 28.8  # [V], eight-cell pack of the thesis (2.2.1)

torques = st.floats(-150.0, 150.0)
speeds = st.floats(-6.0, 6.0)
currents = st.floats(-80.0, 80.0)
voltages = st.floats(1.0, 60.0)


def knee_current(current: float, velocity: float, voltage: float = BATTERY) -> float:
    return voltage_limited_current(MOTOR, current, velocity, voltage)


@given(torque=torques)
def test_torque_and_current_are_inverse(torque: float) -> None:
    current = torque_to_current(torque, K_T, RATIO)
    assert_allclose(current_to_torque(current, K_T, RATIO), torque, rtol=1e-12, atol=1e-300)


def test_one_ampere_gives_torque_constant_times_ratio() -> None:
    assert_allclose(current_to_torque(1.0, K_T, RATIO), 7.05, rtol=1e-12)
    assert_allclose(torque_to_current(60.0, K_T, RATIO), 8.5106, atol=5e-5)


@given(value=st.floats(-1e6, 1e6), limit=st.floats(1e-3, 1e3))
def test_saturation_keeps_the_sign_and_the_bound(value: float, limit: float) -> None:
    bounded = saturate(value, limit)
    assert abs(bounded) == min(abs(value), limit)
    assert bounded * value >= 0.0


def test_saturation_passes_nan_to_a_guard() -> None:
    assert math.isnan(saturate(math.nan, 60.0))


def test_knee_reaches_its_no_load_speed_at_full_battery() -> None:
    """28.8 V / (0.0705 · 100) = 4.085 rad/s = 234 deg/s, where no current can be driven."""
    no_load = brentq(lambda velocity: knee_current(1e3, velocity), 0.0, 10.0)
    assert_allclose(no_load, 4.0851, atol=5e-5)
    assert_allclose(math.degrees(no_load), 234.06, atol=0.01)
    assert_allclose(knee_current(5.0, no_load), 0.0, atol=1e-9)


def test_knee_at_24_volt_reaches_195_degrees_per_second() -> None:
    no_load = brentq(lambda velocity: knee_current(1e3, velocity, 24.0), 0.0, 10.0)
    assert_allclose(math.degrees(no_load), 195.05, atol=0.01)


@pytest.mark.parametrize(
    ("velocity", "highest", "lowest"),
    [
        (0.0, 83.965, -83.965),  # stall: 28.8 / 0.343
        (2.0, 42.857, -125.073),  # (±28.8 − 14.1) / 0.343
        (-3.0, 145.627, -22.303),  # (±28.8 + 21.15) / 0.343
        (5.0, -18.805, -186.735),  # above no-load speed the motor can only brake
    ],
)
def test_voltage_limit_of_the_knee_by_hand(velocity: float, highest: float, lowest: float) -> None:
    assert_allclose(knee_current(1e4, velocity), highest, atol=5e-4)
    assert_allclose(knee_current(-1e4, velocity), lowest, atol=5e-4)


@given(current=currents, velocity=speeds, voltage=voltages)
def test_limited_current_needs_no_more_than_the_bus_voltage(
    current: float, velocity: float, voltage: float
) -> None:
    driven = voltage_limited_current(MOTOR, current, velocity, voltage)
    terminal = R * driven + K_T * RATIO * velocity
    assert abs(terminal) <= voltage * (1.0 + 1e-9) + 1e-9  # rounding only
    wanted = R * current + K_T * RATIO * velocity
    if abs(wanted) < voltage:
        assert driven == current


@given(current=currents, velocity=speeds)
def test_electrical_power_is_copper_loss_plus_mechanical_power(current: float, velocity: float) -> None:
    mechanical = current_to_torque(current, K_T, RATIO) * velocity
    power = motor_electrical_power(MOTOR, current, velocity)
    assert_allclose(power, R * current**2 + mechanical, rtol=1e-12, atol=1e-9)


def test_motor_draws_power_when_it_drives_and_feeds_the_bus_when_it_brakes() -> None:
    assert motor_electrical_power(MOTOR, 5.0, 2.0) > 0.0
    assert motor_electrical_power(MOTOR, -5.0, 2.0) < 0.0
    # 0.343 · 25 W of copper loss at stall, whatever the direction.
    assert_allclose(motor_electrical_power(MOTOR, -5.0, 0.0), 8.575, rtol=1e-12)


def test_battery_feeds_the_electronics_and_takes_back_its_share() -> None:
    assert battery_power(20.0, 10.0, 0.7) == 30.0
    assert battery_power(-5.0, 10.0, 0.7) == 5.0  # the electronics live on what the motors feed
    assert_allclose(battery_power(-40.0, 10.0, 0.7), -21.0, rtol=1e-12)
    assert battery_power(-40.0, 10.0, 0.0) == 0.0  # a brake chopper burns all of it


@given(st.floats(-200.0, 200.0), st.floats(0.0, 50.0), st.floats(0.0, 1.0))
def test_a_bus_never_charges_the_battery_with_more_than_its_input(
    motors: float, constant: float, regeneration: float
) -> None:
    power = battery_power(motors, constant, regeneration)
    assert power >= motors + constant
    assert power * (motors + constant) >= 0.0


def test_bus_sags_under_load_and_rises_while_it_is_fed() -> None:
    """330 W at 28.8 V through 0.2 Ω: 28.8 − 0.2 · 11.458 = 26.508 V."""
    assert_allclose(sagged_bus_voltage(28.8, 0.2, 330.0, 28.8), 26.5083, atol=5e-5)
    assert sagged_bus_voltage(28.8, 0.2, -100.0, 28.8) > 28.8
    assert sagged_bus_voltage(28.8, 0.2, 0.0, 25.0) == 28.8


@given(power=st.floats(-400.0, 800.0))
def test_constant_load_settles_where_the_battery_equation_is_solved(power: float) -> None:
    """V = V_oc − R_i P / V has the root (V_oc + √(V_oc² − 4 R_i P)) / 2."""
    voltage = 28.8
    for _ in range(200):
        voltage = sagged_bus_voltage(28.8, 0.2, power, voltage)
    assert_allclose(voltage, 0.5 * (28.8 + math.sqrt(28.8**2 - 4.0 * 0.2 * power)), rtol=1e-9)


@given(command=st.floats(-300.0, 300.0), velocity=speeds)
def test_driven_motor_stays_within_torque_current_and_voltage_limits(command: float, velocity: float) -> None:
    target = target_current(MOTOR, command, 60.0, 8.0)
    current, torque = drive_motor(MOTOR, target, velocity, BATTERY)
    assert abs(target) <= 8.0
    assert_allclose(torque, 7.05 * current, rtol=1e-12, atol=1e-300)
    assert abs(R * current + 7.05 * velocity) <= BATTERY * (1.0 + 1e-9)
    assume(abs(command) < 8.0 * 7.05 and abs(R * command / 7.05 + 7.05 * velocity) < BATTERY)
    assert_allclose(torque, command, rtol=1e-12, atol=1e-300)


def test_torque_limit_binds_before_the_current_limit() -> None:
    target = target_current(MOTOR, 500.0, 60.0, 100.0)
    _, torque = drive_motor(MOTOR, target, 0.0, BATTERY)
    assert_allclose(torque, 60.0, rtol=1e-12)
    assert_allclose(target, 60.0 / 7.05, rtol=1e-12)


def test_hip_winding_has_the_same_motor_constant_as_the_knee() -> None:
    """The same motor with another winding: K_t/√R stays."""
    knee, hip = (item.torque_constant / math.sqrt(item.resistance) for item in (KNEE_ACTUATOR, HIP_ACTUATOR))
    assert_allclose(hip, knee, rtol=2e-3)  # R is stated with two digits


def test_armature_is_rotor_and_wave_generator_seen_through_the_gear() -> None:
    """(3.06e-4 + 0.282e-4) kg·m² · 100² = 3.342 kg·m²."""
    assert_allclose(KNEE_ACTUATOR.armature, 3.342, rtol=1e-12)
    assert_allclose(HIP_ACTUATOR.armature, 3.342, rtol=1e-12)
