"""The thesis's controller figures made again, against closed forms, a second loop and energy balances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from thesis import bench, control, velocity
from thesis.bench import PRINTED_DELAY, STIFFNESS
from thesis.claims import OUT_OF_BAND, rows_of
from thesis.control import (
    SLOPE_SHARE,
    SLOW,
    Hand,
    closed_slope,
    current_errors,
    expected_rmse,
    geometric_mean_and_spread,
    off_line_current,
    old_model_test,
    overshoot,
    seen_steepness,
    velocity_of_slope,
)
from thesis.friction import rms
from thesis.leg import Pair, hanging_experiment, leg_keeps_swinging, linear_limit, weight_torque
from thesis.limits import bisect, growth, keeps_swinging, linear_radius, pushed, released, runs_on
from thesis.velocity import closed_delay, delay_between, log_filter

from twin_gait import JointName, simulate
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.worlds.bench_joint import BenchJoint

KNEE_INERTIA = (3.06e-4 + 0.282e-4) * 1e4 + 0.02  # rotor and wave generator behind 1:100, and the link
PER_AMPERE = 7.05  # [N·m/A] at the knee
DELAY = closed_delay(window=10, decimation=10)


def table_friction(w: float) -> float:
    """Equation (3.1) with table 3.1 of the knee, written out again."""
    a, b, c, d = 1.743, 3.193, 0.2031, 2.06
    dip = math.sqrt(2 * math.e) * (a - b) * math.exp(-((w / c) ** 2)) * w / c
    return dip + b * math.tanh(10 * w / c) + d * w


def rigidly(test: BenchJoint) -> BenchJoint:
    """The same test with a hand that hardly gives way."""
    assert test.imposed_motion is not None
    return replace(test, imposed_motion=replace(test.imposed_motion, stiffness=4e4, damping=1e3))


# ---------------------------------------------------------------------- all claims


@pytest.mark.slow
def test_predictions_of_the_controllers_hold_with_other_noise() -> None:
    seed, controls = 2, [bench.torque_control(gain, stiffness=STIFFNESS) for gain in bench.GAINS]
    released = [simulate_bench(bench.pushed_and_let_go(each), seed=seed) for each in controls]
    slopes = control.simulated_slopes(seed=seed)
    found = {
        "fig_3_5": control.current_numbers([current_errors(hand, seed) for hand in control.HANDS]),
        "fig_3_6": control.impedance_numbers(control.spring_test(bench.GAINS[0], seed), slopes),
        "fig_3_7": control.gain_numbers([control.loop_areas(s, seed) for s in (0.6, 0.5)], released),
        "filter_delay": velocity.delay_numbers(velocity.filter_delay(seed)),
    }
    rows = list(rows_of("thesis_control", found))
    assert len(rows) == 14
    assert [row for row in rows if row["verdict"] == OUT_OF_BAND] == []


# ---------------------------------------------------------------------- delay


def test_cross_correlation_finds_a_delay_between_the_samples() -> None:
    phase = 2 * math.pi * np.arange(2000) / 1000
    assert delay_between(np.sin(phase), np.sin(phase - 2 * math.pi * 54.5 / 1000)) == pytest.approx(
        54.5, abs=1e-2
    )


def test_filters_of_firmware_and_log_have_the_delay_of_their_phase_response() -> None:
    hand = bench.moved_by_hand(bench.torque_control(0.0), reach=bench.SHORT_REACH, fastest=0.6)
    run = simulate_bench(rigidly(bench.with_ideal_current(hand)))
    rows = bench.last_period(run)
    true = run.column("motor_velocity_rad_per_s")[rows]
    held = log_filter(run.column("velocity_rad_per_s"), 10, 10)
    # The second line of the spectrum of one period is the fundamental; its phase is the delay.
    fundamental = np.fft.rfft(true)[1]
    for late, expected in ((run.column("velocity_slow_rad_per_s")[rows], 54.5), (held[rows], 50.0)):
        angle = np.angle(fundamental / np.fft.rfft(late)[1])
        by_phase = angle / (2 * math.pi) * len(true)
        assert by_phase == pytest.approx(expected, abs=0.5)
        assert delay_between(true, late) == pytest.approx(by_phase, abs=0.5)
    assert pytest.approx(54.5e-3) == DELAY


# ---------------------------------------------------------------------- currents


@pytest.mark.parametrize("ratio", [0.6, 1.0])
def test_target_current_is_recovered_from_the_log_for_any_friction(
    ratio: float,
) -> None:
    test = bench.moved_by_hand(bench.torque_control(0.35), reach=bench.SHORT_REACH, ratio=ratio)
    run = simulate_bench(test, seed=3)
    # The firmware's filter written again with pandas, from the angles of every tenth row.
    angles = pd.Series(run.column("position_rad")[::10])
    slow = (angles.diff() / 0.01).fillna(0.0).rolling(10).mean().fillna(0.0)
    current = np.array([0.35 * table_friction(velocity) / PER_AMPERE for velocity in slow])
    again = np.repeat(current, 10)[: len(run.log)]
    filled = slice(200, None)
    assert_allclose(again[filled], run.column("target_current_A")[filled], atol=1e-9)
    # From the log's velocity it does not: that is the error of figure 3.5.
    error = rms(off_line_current(run, 0)[filled] - run.column("target_current_A")[filled])
    assert error > 1e-3


def test_measured_current_differs_from_its_target_by_noise_and_back_emf_lag() -> None:
    quick = current_errors(Hand(bench.SHORT_REACH, 0.6), seed=1)
    assert quick.measured == pytest.approx(expected_rmse(quick.run), rel=0.1)


def test_current_loop_lags_behind_the_back_emf_by_the_closed_form() -> None:
    # A spring alone, whose target current has no steps, and an inverter without any.
    test = bench.moved_by_hand(bench.torque_control(0.0, stiffness=STIFFNESS), fastest=0.6)
    silent = replace(test, drive=replace(test.drive, noise=0.0, ripple=0.0, counts=0))
    run = simulate_bench(rigidly(silent))
    missed = rms((run.column("current_A") - run.column("target_current_A"))[bench.last_period(run)])
    integral_gain = 2 * math.pi * 500 * 0.343  # ω_b R
    acceleration = 0.6**2 / bench.REACH / math.sqrt(2)
    assert missed == pytest.approx(PER_AMPERE * acceleration / integral_gain, rel=0.05)


def test_spread_reaches_from_the_mean_to_both_ends() -> None:
    mean, spread = geometric_mean_and_spread((1.0, 3.0, 4.0))
    assert (mean / spread, mean * spread) == pytest.approx((1.0, 4.0))


# ---------------------------------------------------------------------- impedance and gain


def led(gain: float, *, ratio: float = 0.6, fastest: float = 0.3) -> BenchRun:
    control = bench.torque_control(gain, stiffness=STIFFNESS)
    return simulate_bench(
        rigidly(bench.with_ideal_current(bench.moved_by_hand(control, ratio=ratio, fastest=fastest)))
    )


@pytest.mark.parametrize("fastest", [0.3, 0.6])
def test_slope_on_the_bench_equals_the_closed_form_for_a_rigid_hand(fastest: float) -> None:
    run = led(0.35, fastest=fastest)
    slope = bench.slope_per_deg(run)
    assert slope == pytest.approx(closed_slope(0.35, bench.REACH, fastest, DELAY), abs=3e-5)


def test_closed_slope_is_the_first_harmonic_of_the_late_compensation() -> None:
    reach, fastest = bench.REACH, 0.3
    late = fastest / reach * DELAY
    in_phase, _ = quad(
        lambda t: table_friction(-fastest * math.sin(t - late)) * math.cos(t), 0, 2 * math.pi, limit=400
    )
    lost = 0.35 * in_phase / (math.pi * reach)
    expected = 0.05 - math.radians(lost)
    assert closed_slope(0.35, reach, fastest, DELAY) == pytest.approx(expected, abs=1e-7)
    assert closed_slope(0.35, reach, fastest, 0.0) == pytest.approx(0.05, abs=1e-12)


def test_band_of_the_slope_excludes_the_printed_delay() -> None:
    late = closed_slope(0.35, bench.REACH, bench.HAND_VELOCITIES[0], PRINTED_DELAY)
    assert late < (1.0 - SLOPE_SHARE) * 0.05


def test_velocity_of_a_slope_is_interpolated_and_nothing_beyond_the_bench() -> None:
    slopes = (0.0499, 0.0497, 0.0493, 0.0491, 0.0489, 0.0487)
    assert velocity_of_slope(0.0495, slopes) == pytest.approx(0.25)
    assert math.isnan(velocity_of_slope(0.05, slopes))
    assert math.isnan(velocity_of_slope(0.04, slopes))


def test_loop_of_a_viscous_compensation_is_an_ellipse() -> None:
    viscous = FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=2.0
    )
    control = bench.torque_control(0.4, stiffness=STIFFNESS)
    control = replace(control, friction_model=viscous)
    run = simulate_bench(rigidly(bench.with_ideal_current(bench.moved_by_hand(control))))
    rate = 2 * math.pi * bench.frequency_of(bench.REACH)
    ellipse = math.pi * 0.4 * 2.0 * bench.REACH**2 * rate * math.cos(rate * DELAY)
    area = bench.work(run, bench.electromechanical_torque(run))
    assert area == pytest.approx(ellipse, rel=2e-3)


@pytest.mark.parametrize("ratio", [0.5, 0.6])
@pytest.mark.parametrize("gain", [0.35, 0.45, 0.7])
def test_motor_supplies_g_of_the_friction_and_the_hand_the_rest(gain: float, ratio: float) -> None:
    run = led(gain, ratio=ratio)
    # All of the model's friction over a cosine path: one integral, whatever G and s are.
    fastest, reach = 0.3, bench.REACH
    whole, _ = quad(
        lambda t: table_friction(fastest * math.sin(t)) * reach * math.sin(t), 0, 2 * math.pi, limit=400
    )
    motor = bench.work(run, bench.electromechanical_torque(run))
    hand = bench.work(run, run.column("imposed_motion_torque_Nm"))
    assert motor == pytest.approx(gain * whole, rel=3e-3)
    assert hand == pytest.approx((ratio - gain) * whole, abs=3e-3 * whole)


def test_released_knee_swings_farther_with_more_compensation() -> None:
    swings = [
        overshoot(
            simulate_bench(
                bench.with_ideal_current(
                    bench.pushed_and_let_go(bench.torque_control(gain, stiffness=STIFFNESS))
                )
            )
        )
        for gain in (0.0, *bench.GAINS)
    ]
    assert swings == sorted(swings)
    assert swings[0] < 0.0 < swings[1]  # without compensation it does not even come back to θ0


# ---------------------------------------------------------------------- limits


def own_push(gain: float, ratio: float, duration: float) -> float:
    """Velocity of a pushed knee after a while, from a loop of its own: 1 ms steps, mean of ten by ten ms."""
    velocity, angle, last, samples, slow = 0.3, 0.0, 0.0, [0.0] * 10, 0.0
    for tick in range(round(duration * 1000)):
        if tick and tick % 10 == 0:
            samples = [*samples[1:], (angle - last) / 0.01]
            last, slow = angle, sum(samples) / 10
        step = 1e-4
        for _ in range(10):
            push = gain * table_friction(slow) - ratio * table_friction(velocity)
            velocity += step * push / KNEE_INERTIA
            angle += step * velocity
    return velocity


@pytest.mark.parametrize("gain", [0.5, 0.7])
def test_pushed_knee_moves_as_in_a_loop_written_by_hand(gain: float) -> None:
    run = simulate_bench(pushed(gain, 0.6))
    assert run.column("motor_velocity_rad_per_s")[1500] == pytest.approx(own_push(gain, 0.6, 1.5), rel=5e-3)


@pytest.mark.parametrize("ratio", [0.5, 0.8])
def test_joint_is_stable_below_s_and_unstable_above_with_and_without_a_spring(ratio: float) -> None:
    for share, unstable in ((0.97, False), (1.03, True)):
        gain = share * ratio
        assert runs_on(simulate_bench(pushed(gain, ratio))) is unstable
        assert keeps_swinging(simulate_bench(released(gain, ratio))) is unstable
        assert (linear_radius(gain, ratio, STIFFNESS) > 1.0) is unstable


def test_linear_limit_equals_the_limit_of_the_continuous_loop() -> None:
    # M p² + (s - G F(jω)) f p + k = 0 on the edge p = jω: two real equations, F a delay and a mean of 100 ms.
    slope = 10 * 3.193 / 0.2031 + math.sqrt(2 * math.e) * (1.743 - 3.193) / 0.2031 + 2.06
    limit = bisect(lambda gain: linear_radius(gain, 0.6, STIFFNESS) > 1.0 + 1e-7, 0.5, 0.7, steps=20)

    def edge(rate: float) -> tuple[float, complex]:
        mean = np.sinc(rate * 0.1 / (2 * math.pi)) * np.exp(-1j * rate * DELAY)
        gain = 0.6 / mean.real
        return gain, STIFFNESS - KNEE_INERTIA * rate**2 - 1j * rate * slope * (gain * mean - 0.6)

    rates = np.linspace(0.01, 2.0, 20_000)
    crossing = int(np.argmin([abs(edge(rate)[1].real) for rate in rates]))
    assert limit == pytest.approx(edge(rates[crossing])[0], abs=2e-4)


def test_full_compensation_drives_the_joint_from_stop_to_stop() -> None:
    run = simulate_bench(released(1.0, bench.RATIO))
    assert run.column("stop_torque_Nm").any()
    assert growth(run) > 1.3
    assert growth(simulate_bench(released(0.45, bench.RATIO))) == pytest.approx(1.0)


# ---------------------------------------------------------------------- the leg


def test_compensation_returns_g_over_s_of_the_friction_energy() -> None:
    gains = Pair(0.3, 0.4)
    log = simulate(hanging_experiment(gains, duration=10.0)).log
    for joint, gain in zip(("hip", "knee"), gains, strict=True):
        velocity = log[f"right_{joint}_velocity_rad_per_s"]
        given = (log[f"right_{joint}_friction_compensation_torque_Nm"] * velocity).sum()
        taken = -(log[f"right_{joint}_friction_torque_Nm"] * velocity).sum()
        # Less by the delay, which the first 0.1 s of the filter and slow reversals make a few per cent.
        assert 0.9 * gain / bench.RATIO < given / taken <= gain / bench.RATIO


def test_leg_comes_to_rest_below_s_and_keeps_swinging_above() -> None:
    assert not leg_keeps_swinging(simulate(hanging_experiment(Pair(0.5, 0.5))))
    assert leg_keeps_swinging(simulate(hanging_experiment(Pair(0.7, 0.0))))
    assert leg_keeps_swinging(simulate(hanging_experiment(Pair(0.0, 0.7))))


def test_coupled_eigenvalues_reach_one_at_s_whichever_gain_is_raised() -> None:
    for way in (Pair(1.0, 0.0), Pair(0.0, 1.0), Pair(1.0, 1.0)):
        assert linear_limit(way) == pytest.approx(bench.RATIO, rel=0.01)


def test_weight_torque_of_the_hanging_leg_equals_a_pendulum_and_loads_the_hip_more() -> None:
    for joint in (JointName.HIP, JointName.KNEE):
        ratio = weight_torque(joint, math.radians(20.0)) / weight_torque(joint, math.radians(5.0))
        # Not quite a sine: the centre of mass lies beside the line through the axis.
        assert ratio == pytest.approx(math.sin(math.radians(20)) / math.sin(math.radians(5)), rel=0.05)
    assert weight_torque(JointName.HIP, 0.1) > 3.0 * weight_torque(JointName.KNEE, 0.1)


# ---------------------------------------------------------------------- models


def test_motor_has_the_steepness_of_the_old_model_except_for_the_lag_of_the_fast_filter() -> None:
    assert seen_steepness(old_model_test(*SLOW, seed=1)) == pytest.approx(40.0, rel=0.05)
