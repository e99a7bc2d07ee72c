"""Tests of inertia compensation: transition matrix against closed forms, simulated bench against it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import fsolve
from whatif.inertia import (
    InertiaLoop,
    Setting,
    Source,
    TickMatrix,
    apparent_inertia,
    growth_rate,
    largest_share,
    linear_bench,
    linear_run_is_unstable,
    loop_of,
    noise_row,
    sample_deviation,
    stability_row,
    torque_noise,
)
from whatif_inertia import settings_by_delay

from twin_gait.simulation.bench_joint.loop import simulate_bench

FREE = InertiaLoop(
    source=Source.ACCELEROMETER,
    share=0.8,
    delay=0,
    time_constant=0.0,
    motor_inertia=3.3,
    link_inertia=0.2,
    friction=0.0,
)


@pytest.mark.parametrize("delay", [0, 1, 5, 20])
def test_torque_of_a_free_joint_with_an_accelerometer_decays_as_a_power_of_the_share(delay: int) -> None:
    """τ(n) = α τ(n − 1 − d): eigenvalues of magnitude α^(1/(d + 1)), stable up to α = 1 for any delay."""
    values = np.abs(np.linalg.eigvals(TickMatrix(replace(FREE, delay=delay)).matrix))
    assert np.isclose(values, 0.8 ** (1.0 / (delay + 1)), atol=1e-6).sum() == delay + 1
    assert growth_rate(replace(FREE, delay=delay, share=1.01)) > 1e-4


@pytest.mark.parametrize("source", list(Source))
@pytest.mark.parametrize("time_constant", [0.001, 0.02])
def test_free_rigid_joint_is_stable_up_to_its_whole_inertia_behind_any_filter(
    source: Source, time_constant: float
) -> None:
    loop = replace(FREE, source=source, time_constant=time_constant, delay=3)
    # A free joint keeps its angle and its velocity: modes at 1, which rounding moves.
    assert growth_rate(replace(loop, share=0.98)) < 1e-3
    assert growth_rate(replace(loop, share=1.02)) > 0.1


@pytest.mark.parametrize("delay", [20, 60])
def test_largest_share_of_a_held_joint_follows_from_the_delay_margin(delay: int) -> None:
    """Edge of stability in continuous time, from the torque balance.

    The sample holds the hand's torque of the instant and the motor's of the tick before, and the answer is
    held for a tick: J s² q + (k + b s) q = τ, τ = α [e^{−(d + 1) T s} τ − e^{−(d + ½) T s} (k + b s) q].
    """
    setting = Setting(Source.ACCELEROMETER, 0.0, delay)
    loop = loop_of(setting)
    inertia = loop.motor_inertia + loop.link_inertia
    stiffness, damping = loop.hand_stiffness, loop.hand_damping + loop.friction

    def edge(unknown: np.ndarray) -> list[float]:
        share, w = unknown
        s, hand = 1j * w, stiffness + 1j * w * damping
        own, others = (share * np.exp(-late * 1e-3 * s) for late in (delay + 1.0, delay + 0.5))
        value = (inertia * s * s + hand) * (1.0 - own) + others * hand
        return [value.real, value.imag]

    found = []
    for start in np.linspace(5.0, 400.0, 80):
        (share, w), _, done, _ = fsolve(edge, [0.9, start], full_output=True)
        if done == 1 and w > 0.0 and share > 0.0:
            found.append(share)
    assert_allclose(largest_share(setting), min(found), rtol=0.002)


@pytest.mark.parametrize("compliant", [False, True])
@pytest.mark.parametrize(
    "source,time_constant,delay",
    [(Source.ENCODER, 0.005, 0), (Source.GYROSCOPE, 0.001, 3), (Source.ACCELEROMETER, 0.002, 2)],
)
def test_simulated_linear_joint_moves_as_the_transition_matrix_predicts(
    source: Source, time_constant: float, delay: int, compliant: bool
) -> None:
    setting = Setting(source, time_constant, delay, share=0.7, compliant=compliant, noise=0.0)
    bench = linear_bench(setting)
    # The gear swings at 64 Hz: 0.1 ms of a Runge-Kutta step follow it, 1 ms errs by 4e-4.
    drive = replace(bench.drive, rate=10_000.0)
    bench = replace(bench, drive=drive, gravity=0.0, start_velocity=1e-3, duration=0.3)
    run = simulate_bench(replace(bench, control=replace(bench.control, target_torque=0.0)))
    found = TickMatrix(loop_of(setting))
    state = np.zeros(len(found.matrix))
    joint = 5 if compliant else 3
    state[1 if not compliant else 2] = 1e-3
    if compliant:
        state[3] = 1e-3
    if source is Source.GYROSCOPE:
        state[joint + 3 :] = 1e-3  # it has been moving
    angles = []
    for _ in range(300):
        angles.append(state[0])
        state = found.matrix @ state
    if source is Source.ENCODER:
        # In its first tick the firmware has no difference yet.
        assert run.column("inertia_compensation_torque_Nm")[0] == 0.0
    seen = run.column("motor_angle_rad") - math.pi / 2
    assert_allclose(seen, angles, atol=1e-6 * np.abs(seen).max())


def test_noise_of_the_linear_loop_equals_a_monte_carlo_estimate() -> None:
    loop = loop_of(Setting(Source.GYROSCOPE, 0.005, 2, share=0.6))
    found, rng = TickMatrix(loop), np.random.default_rng(4)
    state = np.zeros((len(found.matrix), 400))
    for _ in range(1500):
        state = found.matrix @ state + 0.002 * np.outer(found.noise, rng.standard_normal(400))
    drawn = loop.command * np.sqrt(np.mean(state[found.estimate] ** 2))
    # 400 independent draws: a standard error of 3.5 %.
    assert_allclose(torque_noise(loop, 0.002), drawn, rtol=0.12)


@pytest.mark.parametrize("source", list(Source))
def test_simulated_noise_and_apparent_inertia_equal_the_linear_loop(source: Source) -> None:
    delay = 0 if source is Source.ENCODER else 2
    row = noise_row(Setting(source, 0.005, delay, share=0.5))
    assert_allclose(row["torque_noise_Nm"], row["linear_torque_noise_Nm"], rtol=0.06)
    assert_allclose(row["apparent_inertia"], row["closed_apparent_inertia"], atol=1e-3)


def test_ten_times_coarser_encoder_makes_ten_times_the_noise() -> None:
    fine, coarse = (sample_deviation(Setting(Source.ENCODER, 0.005, noise=factor)) for factor in (1.0, 10.0))
    assert_allclose(coarse / fine, 10.0, rtol=1e-2)


def test_slow_motion_has_the_residual_apparent_inertia() -> None:
    for source in Source:
        loop = replace(FREE, source=source, share=0.4, time_constant=0.005, delay=2)
        assert_allclose(apparent_inertia(loop, 0.01), 0.6, atol=1e-4)


@pytest.mark.parametrize("share,unstable", [(0.9, False), (1.1, True)])
def test_linear_run_is_unstable_where_the_eigenvalues_predict_it(share: float, unstable: bool) -> None:
    setting = Setting(Source.GYROSCOPE, 0.001, 5, share=share)
    assert (growth_rate(loop_of(setting)) > 0.0) == linear_run_is_unstable(setting) == unstable


def test_delayed_unit_on_the_link_of_a_compliant_gear_allows_less_than_the_encoder() -> None:
    unit, rigid = (
        Setting(Source.GYROSCOPE, 0.001, 10, compliant=compliant, held=False) for compliant in (True, False)
    )
    encoder = Setting(Source.ENCODER, 0.005, compliant=True, held=False)
    assert largest_share(unit) < 0.2
    assert largest_share(encoder) > 0.99 and largest_share(rigid) > 0.99
    # The unstable mode is that of the gear: √(K (1/J_m + 1/J_l)).
    loop = replace(loop_of(unit), share=0.2)
    values = np.linalg.eigvals(TickMatrix(loop).matrix)
    pulsation = abs(np.angle(values[np.argmax(np.abs(values))])) / 1e-3
    gear = math.sqrt(loop.gear_stiffness * (1 / loop.motor_inertia + 1 / loop.link_inertia))
    assert_allclose(pulsation, gear, rtol=0.05)
    assert stability_row(unit._replace(share=0.8, held=True))["ending"] == "limit cycle"


def test_quick_settings_are_a_part_of_all() -> None:
    whole, quick = settings_by_delay(), settings_by_delay(quick=True)
    assert set(quick) < set(whole) and len(set(whole)) == len(whole)
