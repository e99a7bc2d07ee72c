"""Tests of the transition matrix of a frame against functions of the firmware and closed forms."""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from loop_stability import UNDECIDED, Case, linear_run_is_unstable, predicted_radius
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from twin_device import HIP_FRICTION, KNEE_FRICTION

from twin_gait.checking.check import build_case
from twin_gait.checking.hanging_leg import (
    friction_slope,
    friction_torque,
    hanging_legs,
)
from twin_gait.checking.linear_loop import (
    RING,
    LinearLoop,
    effective_damping_ratio,
    exponential,
    leg_motion,
    spectral_radius,
    transition_matrix,
)
from twin_gait.configuration.experiments import load_experiment
from twin_gait.core.control_tick import EQUILIBRIUM, measure_joint, new_encoder
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.impedance import impedance_torque
from twin_gait.gait.table import TICK
from twin_gait.parameters.friction import LuGreFriction

MASS = np.array([[4.7, -0.4], [-0.4, 3.5]])
GRAVITY = np.array([[30.0, 4.0], [4.0, 9.0]])  # slope of the weight's torques [N·m/rad]
DAMPING = np.array([60.0, 45.0])
MODEL = np.array([110.0, 90.0])


def loop(**changes) -> LinearLoop:
    values = {
        "motion": leg_motion(MASS, GRAVITY, DAMPING),
        "stiffness": np.array([140.0, 90.0]),
        "damping": np.array([36.0, 12.0]),
        "gain": np.array([0.35, 0.8]),
        "modelled_friction": MODEL,
        "feed_forward": 0.6 * GRAVITY,
        "fast_gain": first_order_gain(TICK, 0.005),
        "decimation": 10,
        "window": 10,
    }
    return LinearLoop(**{**values, **changes})


def run_firmware(item: LinearLoop, start: np.ndarray, frames: int) -> np.ndarray:
    """Return angles and velocities before each frame from the firmware functions and a fine integrator.

    The first tick that is measured is one of a slow sample, as in the matrix; before it all is still.
    """
    encoders = [new_encoder(0.0, 0.0, item.window) for _ in range(2)]
    on_the_way = deque([np.zeros(2)] * item.delay)
    q, v = start[:2].copy(), start[2:].copy()
    inverse = np.linalg.inv(MASS)
    seen = []
    for tick in range(item.decimation, item.decimation * (frames + 1)):
        if tick % item.decimation == 0:
            seen.append(np.concatenate([q, v]))
        for encoder, angle in zip(encoders, q.tolist(), strict=True):
            measure_joint(encoder, tick, angle, TICK, item.fast_gain, item.decimation)
        torque = item.feed_forward @ [encoder.angle for encoder in encoders]
        for joint, encoder in enumerate(encoders):
            # A viscous law of coefficient d is linear: d stands for the slope of the model.
            spring, fast = (item.stiffness[joint], item.damping[joint], 0.0), encoder.velocity_fast
            friction = rotational_friction_torque(encoder.velocity_slow, 0.0, 0.0, 1.0, MODEL[joint])
            torque[joint] += impedance_torque(encoder.angle, fast, *spring) + item.gain[joint] * friction

        on_the_way.append(torque)
        arrived = on_the_way.popleft()

        def slope(_: float, state: np.ndarray, held: np.ndarray = arrived) -> np.ndarray:
            pull = held - GRAVITY @ state[:2] - DAMPING * state[2:]
            return np.concatenate([state[2:], inverse @ pull])

        state = np.concatenate([q, v])
        end = solve_ivp(slope, (0.0, TICK), state, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
        q, v = end[:2], end[2:]
    return np.array(seen)


@pytest.mark.parametrize(
    "changes", [{}, {"decimation": 4, "window": 3}, {"fast_gain": 1.0}, {"delay": 1}, {"delay": 12}]
)
def test_the_matrix_moves_the_state_as_the_firmware_and_a_fine_integrator_do(changes):
    item = loop(**changes)
    start = np.array([0.01, -0.02, 0.3, -0.1])
    expected = run_firmware(item, start, frames=25)
    matrix = transition_matrix(item)
    state = np.zeros(len(matrix))
    state[:4] = start
    moved = []
    for _ in range(25):
        moved.append(state[:4].copy())
        state = matrix @ state
    np.testing.assert_allclose(moved, expected, atol=1e-10, rtol=0)
    assert np.abs(expected[-1] - expected[0]).max() > 0.01  # it did move


def test_states_are_angle_velocity_fast_last_decimated_the_ring_and_torques_on_their_way():
    assert transition_matrix(loop()).shape == (2 * (RING + 10), 2 * (RING + 10))
    assert transition_matrix(loop(delay=3)).shape == (2 * (RING + 13), 2 * (RING + 13))


def test_without_a_controller_the_modes_equal_the_modes_of_the_pendulum():
    off = {name: np.zeros(2) for name in ("stiffness", "damping", "gain")}
    item = loop(**off, feed_forward=np.zeros((2, 2)))
    rates = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(MASS, GRAVITY), np.zeros((2, 2))]])
    rates[2:, 2:] = -np.linalg.solve(MASS, np.diag(DAMPING))
    modes = np.linalg.eigvals(rates)
    assert spectral_radius(transition_matrix(item)) == pytest.approx(
        math.exp(modes.real.max() * item.frame), abs=1e-9
    )


def oscillator(mass: float, stiffness: float, damping: float, delay: int = 0) -> LinearLoop:
    """Return one joint without weight under stiffness and damping alone."""
    one = np.ones(1)
    return LinearLoop(
        motion=leg_motion(mass * np.eye(1), np.zeros((1, 1)), np.zeros(1)),
        stiffness=stiffness * one,
        damping=damping * one,
        gain=0.0 * one,
        modelled_friction=one,
        feed_forward=np.zeros((1, 1)),
        fast_gain=1.0,
        decimation=10,
        window=10,
        delay=delay,
    )


def test_fast_sampling_gives_the_damping_ratio_of_the_continuous_oscillator():
    # One joint, hardly any delay: ζ = b / (2 √(k I)) but for half a tick of hold and half of difference.
    mass, stiffness, ratio = 4.0, 100.0, 0.3
    item = oscillator(mass, stiffness, 2.0 * ratio * math.sqrt(stiffness * mass))
    delayed = ratio - 0.5 * TICK * math.sqrt(stiffness / mass) / 2.0  # the hold costs k T / 2 of damping
    found = effective_damping_ratio(transition_matrix(item), item.frame)
    assert found == pytest.approx(delayed, abs=0.002)
    assert found < ratio


@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2])
def test_a_delayed_loop_is_stable_as_long_as_its_phase_margin_lasts(ratio):
    r"""The gain crosses 1 at :math:`I\omega^2 = |k + i b \omega|`; φ there is used up by ω times the delay.

    The hold and the difference of the damper are late by half a tick each; of the latter only the damper's
    share of the feedback, the square of the sine of φ, is late.
    """
    mass, stiffness = 1.0, 400.0
    damping = 2.0 * ratio * math.sqrt(stiffness * mass)
    square = damping * damping
    crossing = math.sqrt((square + math.hypot(square, 2.0 * stiffness * mass)) / (2.0 * mass * mass))
    margin = math.atan2(damping * crossing, stiffness)
    lasts = margin / crossing - 0.5 * TICK * (1.0 + math.sin(margin) ** 2)
    stable = [
        spectral_radius(transition_matrix(oscillator(mass, stiffness, damping, delay))) < 1.0
        for delay in range(40)
    ]
    assert stable.index(False) == math.ceil(lasts / TICK) > 1
    assert not any(stable[stable.index(False) :])


def test_an_unstable_oscillation_has_a_negative_damping_ratio_and_a_free_joint_has_no_ratio():
    unstable = loop(gain=np.array([1.0, 1.0]), damping=np.zeros(2))
    assert spectral_radius(transition_matrix(unstable)) > 1.0
    assert effective_damping_ratio(transition_matrix(unstable), unstable.frame) < 0.0
    off = {name: np.zeros(2) for name in ("stiffness", "damping", "gain")}
    free = loop(**off, feed_forward=np.zeros((2, 2)), motion=leg_motion(MASS, np.zeros((2, 2)), DAMPING))
    assert effective_damping_ratio(transition_matrix(free), free.frame) == 1.0
    assert spectral_radius(transition_matrix(free)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("law", [HIP_FRICTION, KNEE_FRICTION])
@pytest.mark.parametrize("velocity", [0.0, 0.13, 1.0, -1.0])
def test_friction_slope_is_the_derivative_of_equation_3_1(law, velocity):
    a, b, c, d = (
        law.breakaway_torque,
        law.coulomb_friction,
        law.breakaway_velocity,
        law.viscous_friction,
    )
    x = velocity / c
    dip = math.sqrt(2.0 * math.e) * (a - b) * math.exp(-x * x) * (1.0 - 2.0 * x * x) / c
    expected = dip + 10.0 * b / c / math.cosh(10.0 * x) ** 2 + d
    assert friction_slope(law, velocity) == pytest.approx(expected, rel=1e-6)
    assert friction_torque(law, -velocity) == -friction_torque(law, velocity)


def test_the_loop_of_a_phase_takes_its_numbers_from_leg_and_table():
    experiment = load_experiment("bench_leg", ["plant.friction_ratio={hip: 0.5, knee: 0.7}"]).experiment
    (leg,) = hanging_legs(build_case(experiment.table, experiment))
    phase = leg.phases.index("swing_flexion")
    found = leg.linear_loop(phase, 0.0)
    model = experiment.build_world().model
    posture = np.radians([32.0, 62.0])
    np.testing.assert_allclose(found.stiffness, [math.degrees(2.5)] * 2)
    np.testing.assert_allclose(found.gain, [0.35, 0.40])
    np.testing.assert_allclose(
        found.modelled_friction, [friction_slope(law, 0.0) for law in (HIP_FRICTION, KNEE_FRICTION)]
    )
    # M, the slope of gravity and the true friction, by way of the acceleration that each of them gives.
    free = found.motion.free
    rates = (free[2:] - np.eye(4)[2:]) / TICK
    slopes = [0.5 * friction_slope(HIP_FRICTION, 0.0), 0.7 * friction_slope(KNEE_FRICTION, 0.0)]
    expected = -np.linalg.solve(model.mass_matrix(posture), np.diag(slopes))
    np.testing.assert_allclose(rates[:, 2:], expected, rtol=0.02, atol=0.05)
    step = 1e-3 * np.array([1.0, -2.0])
    weight = model.gravity_torque(posture + step) - model.gravity_torque(posture - step)
    np.testing.assert_allclose(found.feed_forward @ (2.0 * step), weight, rtol=1e-4)


# Slopes of friction at rest, and k, b and G on both sides of the limit.
CASES = [
    Case(math.degrees(k), b, gain) for k, b, gain in itertools.product((1.0, 6.0), (0.0, 30.0), (0.2, 1.0))
]


@pytest.mark.parametrize(
    "case", CASES, ids=lambda case: f"{case.stiffness:.0f}-{case.damping:g}-{case.gain:g}"
)
def test_the_spectral_radius_predicts_whether_the_engine_s_linear_run_is_unstable(case):
    radius = predicted_radius(case, 0.0)
    assert abs(radius - 1.0) >= UNDECIDED
    assert linear_run_is_unstable(case, 0.0) is (radius > 1.0)


def test_cases_include_stable_and_unstable_loops():
    unstable = [predicted_radius(case, 0.0) > 1.0 for case in CASES]
    assert 2 <= sum(unstable) <= len(CASES) - 2


@pytest.mark.parametrize("window", [1, 5, 10, 20])
def test_undamped_stable_gain_is_true_over_modelled_friction_for_any_delay(window):
    slow = {"stiffness": np.array([6.0, 4.0]), "feed_forward": np.zeros((2, 2))}
    motion = leg_motion(MASS, np.zeros((2, 2)), DAMPING)
    item = loop(**slow, motion=motion, damping=np.zeros(2), window=window, modelled_friction=2.0 * DAMPING)
    gains = np.linspace(0.0, 1.0, 101)
    radii = [spectral_radius(transition_matrix(replace(item, gain=gain * np.ones(2)))) for gain in gains]
    limit = float(gains[np.argmax(np.array(radii) > 1.0)])
    # The unstable mode is slow, so that the delay hardly counts.
    assert limit == pytest.approx(0.5, abs=0.02)


# ---------------------------------------------------------------------- friction with bristles or directions


BRISTLES = LuGreFriction(
    coulomb_friction=3.0,
    breakaway_torque=4.5,
    stribeck_velocity=0.05,
    viscous_friction_forward=2.0,
    viscous_friction_backward=1.2,
    bristle_stiffness=1800.0,
    bristle_damping=50.0,
    offset=0.3,
)


def test_bristles_at_rest_are_a_spring_and_sliding_ones_a_damper():
    """At rest σ0 with σ1 and the lesser d; far beyond the Stribeck velocity the lesser d alone."""
    assert friction_slope(BRISTLES, 0.0) == pytest.approx(50.0 + 0.5 * (2.0 + 1.2), rel=1e-9)
    assert friction_slope(BRISTLES, 1.0) == pytest.approx(1.2, rel=1e-9)
    assert friction_torque(BRISTLES, -1.0) == pytest.approx(0.3 - 3.0 - 1.2, rel=1e-12)


def test_stiffness_of_a_sticking_leg_is_the_stiffness_of_its_bristles():
    """Posture and torque at rest, by the acceleration that a small angle gives within a tick."""
    experiment = load_experiment("bench_leg", ["plant.friction_ratio={hip: 1, knee: 1}"]).experiment
    sticking = replace(experiment.plant, friction=dict.fromkeys(experiment.plant.friction, BRISTLES))
    (leg,) = hanging_legs(build_case(experiment.table, replace(experiment, plant=sticking)))
    (free,) = hanging_legs(build_case(experiment.table, experiment))
    phase = leg.phases.index("swing_flexion")
    mass = leg.mass(leg.column(EQUILIBRIUM)[phase])
    moved = [item.linear_loop(phase, 0.0).motion.free[2:, :2] / TICK for item in (leg, free)]
    expected = -np.linalg.solve(mass, np.diag([1800.0, 1800.0]))
    np.testing.assert_allclose(moved[0] - moved[1], expected, rtol=0.05, atol=2.0)


@pytest.mark.parametrize("norm", [0.0, 1e-9, 0.3, 0.5, 4.0, 30.0])
def test_matrix_exponential_equals_scipy(norm: float) -> None:
    for seed in range(20):
        matrix = np.random.default_rng(seed).normal(size=(6, 6))
        matrix *= norm / np.abs(matrix).sum(axis=0).max()
        expected = expm(matrix)
        # Squaring loses as many digits as the norm has bits (Moler and Van Loan 2003, section 2).
        assert np.abs(exponential(matrix) - expected).max() < 1e-14 * (1.0 + norm) * np.abs(expected).max()
