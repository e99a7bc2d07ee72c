"""Friction map and temperature: bench, limits and gains against closed forms, the plant and energy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from twin_device import SENSORS
from whatif.bench import (
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    MODEL,
    PUSH,
    controlled,
    holding_torque,
    imposed_motion,
    knee,
    law_in,
    least_torque_ratio,
    mean_delay,
    push,
    torque_ratio,
    torques,
)
from whatif.endings import Ending
from whatif.friction import (
    FILTERS,
    Compensation,
    Law,
    Setting,
    bench_of,
    growth_rate_at_rest,
    linear_gain,
    map_row,
)
from whatif.temperature import (
    COULOMB_LOSS_PER_KELVIN,
    REFERENCE_TEMPERATURE,
    Case,
    Condition,
    best_row,
    closed_best_gain,
    friction_in,
    identified_law,
    lowest_of_parabola,
    true_law,
    viscous_loss_per_kelvin,
)
from whatif_friction_map import GAINS, RATIOS, map_settings

from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.worlds.bench_joint import BenchFriction
from twin_gait.worlds.bench_leg import ImposedMotionParameters

NO_FRICTION = FrictionParameters(
    breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=0.0
)


def table_friction(w: np.ndarray) -> np.ndarray:
    a, b, c, d = 1.743, 3.193, 0.2031, 2.06
    bump = math.sqrt(2 * math.e) * (a - b) * np.exp(-((w / c) ** 2)) * w / c
    return np.asarray(bump + b * np.tanh(10 * w / c) + d * w)


# ---------------------------------------------------------------------- bench


@pytest.mark.slow
@pytest.mark.parametrize("decimation,window", FILTERS)
def test_mean_delay_is_the_lag_of_the_slow_velocity_at_constant_acceleration(
    decimation: int, window: int
) -> None:
    bench = knee(
        sensors=replace(SENSORS, ideal=True, decimation=decimation, window=window),
        friction=BenchFriction(law=NO_FRICTION),
        gravity=0.0,
        duration=1.2,
    )
    control = controlled(friction_compensation_gain=0.0, target_torque=-2.0)
    run = simulate_bench(replace(bench, control=control))
    acceleration = run.column("motor_acceleration_rad_per_s2")[10]
    lag = run.column("motor_velocity_rad_per_s") - run.column("velocity_slow_rad_per_s")
    # Whole frames after the filter has filled.
    settled = slice(decimation * (window + 5), decimation * (window + 45))
    assert_allclose(lag[settled].mean() / acceleration, mean_delay(bench.sensors), rtol=1e-6)


@pytest.mark.parametrize("temperature,load", [(10.0, 0.0), (40.0, 0.0), (25.0, 3.0), (5.0, 2.0)])
def test_law_in_a_condition_is_the_friction_of_the_bench(temperature: float, load: float) -> None:
    friction = BenchFriction(
        law=MODEL,
        coulomb_per_load=0.1,
        coulomb_per_kelvin=-0.01,
        viscous_per_kelvin=-0.03,
        temperature=temperature,
    )
    # A light hand: the weight stays nearly level, where its torque does not change.
    bench = knee(
        load,
        friction=friction,
        imposed_motion=ImposedMotionParameters(amplitude=-0.02, frequency=4.0),
        duration=0.5,
    )
    run = simulate_bench(replace(bench, control=controlled(friction_compensation_gain=0.0)))
    velocity = run.column("motor_velocity_rad_per_s")
    loads = run.column("load_torque_Nm")
    expected = torques(law_in(friction, holding_torque(bench)), velocity)
    assert np.abs(velocity).max() > 0.1
    assert_allclose(-run.column("friction_torque_Nm"), expected, atol=0.2 * np.ptp(loads) + 1e-9)


def test_push_releases_at_the_requested_speed() -> None:
    test = replace(bench_of(Setting(spring=0.0)), imposed_motion=push(PUSH), duration=2.0)
    run = simulate_bench(test)
    hand = run.column("imposed_motion_torque_Nm")
    assert (hand[:999] != 0.0).any() and (hand[1001:] == 0.0).all()
    assert_allclose(-run.column("link_velocity_rad_per_s")[1000], PUSH, rtol=0.05)


def test_ratio_at_rest_is_the_limit_of_the_ratio_at_small_speeds() -> None:
    other = replace(MODEL, breakaway_torque=0.5)
    at_rest, near = torque_ratio(other, MODEL, np.array([0.0, 1e-6]))
    assert_allclose(at_rest, near, rtol=1e-6)


def test_least_ratio_of_one_law_scaled_is_the_scale() -> None:
    assert_allclose(least_torque_ratio(MODEL.scaled(0.7), MODEL, 0.5), 0.7, rtol=1e-9)


# ---------------------------------------------------------------------- G = s


@pytest.mark.parametrize("ratio", [0.35, 0.8])
@pytest.mark.parametrize("kept", FILTERS)
def test_linear_joint_without_a_spring_is_stable_up_to_g_equal_s_behind_any_filter(
    ratio: float, kept: tuple[int, int]
) -> None:
    assert_allclose(linear_gain(Setting(spring=0.0, ratio=ratio, filter=kept)), ratio, rtol=2e-3)


@pytest.mark.parametrize("kept", [FILTERS[0], FILTERS[2]])
@pytest.mark.parametrize("ratio", [0.55, 0.95])
def test_pushed_joint_rests_below_s_and_not_above(kept: tuple[int, int], ratio: float) -> None:
    rows = [map_row(Setting(gain=gain, ratio=ratio, filter=kept)) for gain in (ratio - 0.1, ratio + 0.1)]
    assert rows[0]["ending"] == Ending.REST and rows[0]["growth_rate_at_rest_per_s"] < 0.0
    assert rows[1]["ending"] != Ending.REST and rows[1]["growth_rate_at_rest_per_s"] > 0.0


@pytest.mark.slow
def test_late_torque_on_a_stiff_spring_raises_the_limit() -> None:
    stiff = Setting(spring=143.0, filter=FILTERS[3])
    assert linear_gain(stiff) > 1.1 * stiff.ratio
    resting = map_row(stiff._replace(gain=1.1 * stiff.ratio))
    assert resting["ending"] == Ending.REST


@pytest.mark.parametrize("law,ends", [(Law.NO_DIP, "rest"), (Law.DEEPER_DIP, "moves")])
def test_dip_moves_the_limit_to_the_least_ratio(law: Law, ends: str) -> None:
    """At G = s a joint without the dip rests, one with a deeper dip does not."""
    setting = Setting(law=law, gain=0.55, push=PUSH, filter=FILTERS[1])
    assert (map_row(setting)["ending"] == Ending.REST) == (ends == "rest")


def test_dead_zone_keeps_rest_and_not_motion() -> None:
    zone = Setting(compensation=Compensation.DEAD_ZONE, gain=0.75)
    small, large = map_row(zone._replace(push=0.04)), map_row(zone._replace(push=PUSH))
    assert small["ending"] == Ending.REST and large["ending"] != Ending.REST
    measured = map_row(Setting(gain=0.75, push=0.04))
    assert measured["ending"] != Ending.REST


def test_gain_has_no_effect_at_a_constant_reference() -> None:
    rows = [map_row(Setting(compensation=Compensation.REFERENCE, gain=gain)) for gain in (0.1, 1.3)]
    assert rows[0]["amplitude_deg"] == rows[1]["amplitude_deg"]
    assert rows[0]["growth_rate_at_rest_per_s"] == rows[1]["growth_rate_at_rest_per_s"] < 0.0


def test_growth_of_the_transition_matrix_equals_the_simulated_joint() -> None:
    """Slow growth about rest: the joint creeps away exponentially before friction saturates."""
    setting = Setting(gain=0.58, spring=143.0, filter=FILTERS[0])
    law = replace(NO_FRICTION, viscous_friction=1.0)
    slope = float((table_friction(np.array([1e-6])) / 1e-6)[0])
    test = bench_of(setting)
    linear = replace(
        test,
        friction=BenchFriction(law=law.scaled(setting.ratio * slope)),
        sensors=replace(test.sensors, ideal=True),
        control=replace(test.control, friction_model=law.scaled(slope), target_torque=0.0),
        start_velocity=1e-7,
        gravity=0.0,
        duration=16.0,
    )
    angle = simulate_bench(linear).column("link_angle_rad") - math.pi / 2
    early, late = (np.abs(angle[first : first + 4000]).max() for first in (4000, 12000))
    assert_allclose(math.log(late / early) / 8.0, growth_rate_at_rest(setting), rtol=0.05)


def test_no_gain_of_the_map_is_one_of_its_ratios_and_quick_is_a_part_of_it() -> None:
    assert not set(GAINS) & set(RATIOS)
    whole, quick = map_settings(), map_settings(quick=True)
    assert set(quick) <= set(whole) and len(set(whole)) == len(whole) > 10 * len(quick)


# ---------------------------------------------------------------------- imposed motion


@pytest.mark.parametrize("gain", [0.0, 0.5, 1.0])
def test_work_of_the_hand_equals_the_residual_friction_work(gain: float) -> None:
    setting = Setting(gain=gain, spring=0.0, filter=FILTERS[0])
    time = np.linspace(0.0, 1.0 / HAND_FREQUENCY, 20001)
    # The grip is a spring and damper: the joint swings a little further than the hand.
    w, grip = 2 * math.pi * HAND_FREQUENCY, ImposedMotionParameters()
    pull = grip.stiffness + 1j * w * grip.damping
    follows = abs(pull / (pull - (3.342 + 0.02) * w * w))
    velocity = follows * math.pi * HAND_FREQUENCY * HAND_AMPLITUDE * np.sin(w * time)
    whole = np.trapezoid(table_friction(velocity) * velocity, time)
    expected = (setting.ratio - gain) * whole
    found = imposed_motion(bench_of(setting))
    assert_allclose(found.work, expected, atol=0.01 * whole)
    left = abs(setting.ratio - gain) * np.sqrt(np.mean(table_friction(velocity) ** 2))
    assert_allclose(found.friction, left, atol=0.15)


# ---------------------------------------------------------------------- temperature


def test_viscous_loss_is_the_slope_of_the_catalogue_at_25_degrees() -> None:
    # The quadratic's derivative over its loss, at 25 °C and 105 rad/s.
    c0, c1, c2 = 0.688878205, 9.24475524e-3, -1.18764569e-4
    c3, c4, c5 = -1.47423702e-3, 1.06902515e-5, 1.57005966e-6
    efficiency = c0 + 25 * (c1 + 25 * c2 + 105 * c4) + 105 * (c3 + 105 * c5)
    slope = c1 + 50 * c2 + 105 * c4
    assert_allclose(viscous_loss_per_kelvin(), slope / (1 - efficiency), rtol=1e-3)


def test_warmer_joint_has_less_friction_by_the_stated_shares() -> None:
    warm = true_law(Condition("temperature", temperature=35.0))
    assert_allclose(warm.coulomb_friction, MODEL.coulomb_friction * (1 - 10 * COULOMB_LOSS_PER_KELVIN))
    assert_allclose(warm.viscous_friction, MODEL.viscous_friction * (1 - 10 * viscous_loss_per_kelvin()))


def test_age_scales_the_law_at_every_temperature() -> None:
    for temperature in (10.0, 40.0):
        aged = Condition("age", temperature=temperature, ageing=1.3)
        new, old = (law_in(friction_in(item)) for item in (aged._replace(ageing=1.0), aged))
        velocity = np.linspace(0.01, 2.0, 50)
        assert_allclose(torque_ratio(old, new, velocity), 1.3, rtol=1e-12)


def test_compensator_with_the_exact_model_is_best_at_gain_one() -> None:
    law = identified_law(REFERENCE_TEMPERATURE)
    assert_allclose(closed_best_gain(law, law), 1.0)
    assert_allclose(closed_best_gain(law.scaled(0.8), law), 0.8)


def test_best_and_largest_gain_after_running_in_are_near_the_closed_forms() -> None:
    row = best_row(Case(Condition("age", ageing=0.8)))
    assert row["closed_best_gain"] == 0.8 and row["least_torque_ratio"] == 0.8
    assert_allclose(row["best_gain"], 0.8, atol=0.02)
    assert_allclose(row["largest_resting_gain"], 0.8, atol=0.03)


def test_lowest_place_of_a_parabola() -> None:
    points = (0.0, 0.3, 0.6, 0.9)
    assert_allclose(lowest_of_parabola(points, 2.0 * (np.array(points) - 0.73) ** 2 + 1.0), 0.73)
