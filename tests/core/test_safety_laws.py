"""Tests of the laws of the safety monitor against closed forms, and of each of its bounds alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from twin_device import CONTROL, KNEE_ACTUATOR

from twin_gait.control.safety import TripCause
from twin_gait.core import faults, safety
from twin_gait.core.actuator import Motor, winding_voltage
from twin_gait.core.control_tick import new_encoder
from twin_gait.core.estimation import quantise
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.drives import SafetyParameters
from twin_gait.worlds.faults import FaultKind

PERIOD = 1e-3
NUMBERS = st.floats(-20.0, 20.0)


@given(angle=st.floats(-1.0, 2.0), velocity=st.floats(-5.0, 5.0), deceleration=st.floats(2.0, 50.0))
def test_stopping_angle_is_where_a_braked_joint_comes_to_rest(angle, velocity, deceleration):
    """Braked in 100 000 small steps."""
    duration = abs(velocity) / deceleration
    times = (np.arange(100_000) + 0.5) * duration / 100_000
    path = np.sign(velocity) * (abs(velocity) - deceleration * times)
    rest = angle + path.sum() * duration / 100_000
    assert safety.stopping_angle(angle, velocity, 0.5 / deceleration) == pytest.approx(rest, abs=1e-9)


@given(current=NUMBERS, velocity=st.floats(-5.0, 5.0))
def test_a_drive_with_the_right_resistance_infers_the_true_speed(current, velocity):
    constant = KNEE_ACTUATOR.torque_constant * KNEE_ACTUATOR.gear_ratio
    resistance = KNEE_ACTUATOR.resistance
    cold, warm = (Motor(constant, 1.0, ratio * resistance) for ratio in (1.0, 1.39))
    voltage = winding_voltage(cold, current, velocity)
    inferred = safety.motor_speed(voltage, current, constant, resistance)
    assert inferred == pytest.approx(velocity, abs=1e-12)
    voltage = winding_voltage(warm, current, velocity)
    faster = safety.motor_speed(voltage, current, constant, resistance)
    assert faster - velocity == pytest.approx(0.39 * resistance * current / constant, abs=1e-12)


def test_winding_heats_as_the_exponential_of_its_time_constant():
    time_constant, nominal = 52.6, 6.1
    cooling, heat = PERIOD / time_constant, 0.0
    for _ in range(20_000):
        heat = safety.winding_heat(heat, 2.0 * nominal, cooling / nominal**2, cooling)
    # First-order steps of 1 ms follow the exponential to T / (2 τ) in the exponent.
    assert heat == pytest.approx(4.0 * (1.0 - math.exp(-20.0 / time_constant)), rel=1e-4)


def test_residual_of_a_steady_drift_settles_at_drift_times_time_constant():
    residual = 0.0
    for _ in range(4000):
        residual = safety.model_residual(residual, (1.5 + 0.3) * PERIOD, 1.5, PERIOD, PERIOD / 0.2)
    assert residual == pytest.approx(0.3 * 0.2, rel=1e-6)


def test_support_fades_from_all_to_nothing():
    shares = [safety.hold_weight_share(tick, 3000) for tick in range(4000)]
    assert shares[0] == 1.0 and shares[3000] == 0.0 and min(shares) == 0.0
    assert np.diff(shares).max() <= 0.0
    assert shares[1500] == pytest.approx(0.5)


@given(speed=NUMBERS, damping=st.floats(0.0, 100.0))
def test_the_hold_never_drives(speed, damping):
    assert safety.hold_torque(speed, damping) * speed <= 0.0


# Wide enough for a joint of which everything is as it should be.
BOUNDS = safety.Bounds(
    lower=-0.1,
    upper=2.0,
    highest_speed=4.0,
    stop_distance_factor=0.05,
    angle_step=0.02,
    frozen_speed=0.3,
    frozen_ticks=10,
    model_gain=0.005,
    model_deviation=0.05,
    highest_torque=60.0,
    torque_ticks=500,
    highest_command=300.0,
    command_deviation=10.0,
    command_gain=0.05,
    highest_current=18.0,
    heating=0.0,
    cooling=0.0,
    drive_deviation=1.0,
    drive_ticks=20,
    emf_constant=7.05,
    model_resistance=0.343,
)


def watch(times: int = 1, *, angle=0.5, last=0.499, velocity=1.0, **remembered: float) -> list[TripCause]:
    """Return the causes of a number of ticks with constant measurements."""
    encoder = replace(new_encoder(0.0, angle, 1), last_angle=last, velocity_fast=velocity)
    watched = safety.MonitorState(**{"motor_speed": 1.0, **remembered})
    found = [safety.monitor_joint(BOUNDS, watched, encoder, PERIOD) for _ in range(times)]
    return [list(TripCause)[code] for code in found]


def test_a_healthy_joint_does_not_trip():
    assert set(watch(5000)) == {TripCause.NONE}


AT_ONCE = {
    TripCause.ENCODER_MISSING: {"angle": math.nan},
    TripCause.ENCODER_JUMP: {"angle": 0.53},
    TripCause.ENCODER_MODEL: {"residual": -0.06},
    TripCause.JOINT_SPEED: {"velocity": -4.1},
    TripCause.JOINT_RANGE: {"angle": 1.6, "last": 1.599, "velocity": 3.0},  # 1.6 + 9 / 20 is beyond 2
    TripCause.CURRENT: {"motor_current": -18.5, "motor_speed": 1.0},
    TripCause.WINDING_HEAT: {"heat": 1.01, "motor_speed": 1.0},
}


@pytest.mark.parametrize("cause", AT_ONCE)
def test_a_broken_bound_trips_at_once(cause):
    assert watch(**AT_ONCE[cause]) == [cause]


LASTING = {
    TripCause.ENCODER_FROZEN: (10, {"last": 0.5, "motor_speed": 0.4}),
    TripCause.TORQUE: (500, {"last_command": -61.0, "motor_speed": 1.0}),
    TripCause.DRIVE: (20, {"current_deviation": 1.2, "motor_speed": 1.0}),
}


@pytest.mark.parametrize("cause", LASTING)
def test_a_bound_that_may_be_broken_for_a_time_trips_after_just_that_time(cause):
    ticks, broken = LASTING[cause]
    causes = watch(ticks, **broken)
    assert set(causes[:-1]) == {TripCause.NONE}
    assert causes[-1] is cause


def test_a_slow_joint_near_a_stop_is_allowed_where_a_fast_one_trips():
    near = {"angle": 1.9, "last": 1.899}
    assert watch(velocity=1.0, **near) == [TripCause.NONE]
    assert watch(velocity=2.0, **near) == [TripCause.JOINT_RANGE]
    assert watch(velocity=-2.0, **near) == [TripCause.NONE]


@pytest.mark.parametrize("command", [math.nan, math.inf, -math.inf, 300.1, -1e9])
def test_a_nan_or_excessive_command_is_refused(command):
    assert not safety.command_is_plausible(command, 300.0)


def test_names_of_causes_and_kinds_have_the_numbers_of_the_laws():
    names = "MISSING JUMP FROZEN MODEL SPEED RANGE COMMAND TORQUE CURRENT HEAT DRIVE PHASE LOAD SUPPLY"
    in_order = f"{names} OPERATOR BUS SETPOINT"
    assert [getattr(safety, f"{name}_TRIP") for name in in_order.split()] == list(range(1, len(TripCause)))
    assert safety.NO_TRIP == TripCause.NONE.code == 0
    assert {kind.name: kind.code for kind in FaultKind} == {
        kind.name: getattr(faults, kind.name) for kind in FaultKind
    }


def test_a_missing_reading_passes_through_the_encoder():
    assert math.isnan(quantise(math.nan, 1e-5)) and math.isnan(quantise(math.nan, 0.0))


@given(
    voltage=st.floats(20.0, 30.0),
    drop=st.floats(0.0, 40.0),
    back_emf=st.floats(0.0, 30.0),
    resistance=st.floats(0.1, 1.0),
)
def test_no_diode_current_flows_in_a_dip(voltage, drop, back_emf, resistance):
    bus = faults.dipped_bus_voltage(voltage, drop, back_emf)
    assert bus >= faults.MIN_BUS_VOLTAGE
    assert bus <= max(voltage, back_emf)
    assert (back_emf - bus) / resistance <= 0.0


@pytest.mark.parametrize(
    "name", [name for name in SafetyParameters.__dataclass_fields__ if name != "enabled"]
)
def test_safety_parameters_must_be_positive_numbers(name):
    for wrong in (-1.0, math.nan, math.inf):
        with raises(ParameterError, name, wrong):
            replace(CONTROL.safety, **{name: wrong})
