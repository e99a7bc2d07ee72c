"""Order and energy of the integrators, against the matrix exponential."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from twin_gait.core.integrators import (
    RK4_STAGES,
    rk4_stage_weight,
    rk4_step,
    semi_implicit_euler_step,
)

# A lightly damped pair of coupled oscillators: q̈ = −K q − B q̇.
STIFFNESS = np.array([[30.0, -8.0], [-8.0, 20.0]])
DAMPING = np.array([[1.2, -0.3], [-0.3, 0.8]])
START_Q, START_V = np.array([0.4, -0.1]), np.array([-0.5, 0.9])

Step = Callable[[np.ndarray, np.ndarray, float], None]


def damped(q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    out[:] = -STIFFNESS @ q - DAMPING @ v


def exact(time: float) -> np.ndarray:
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])
    return np.asarray(expm(system * time) @ np.concatenate([START_Q, START_V]))


def euler(q: np.ndarray, v: np.ndarray, step: float) -> None:
    semi_implicit_euler_step(damped, q, v, step, np.zeros(2))


def runge_kutta(q: np.ndarray, v: np.ndarray, step: float) -> None:
    rk4_step(damped, q, v, step, np.zeros((5, 2)))


def error_after(advance: Step, steps: int, duration: float = 1.0) -> float:
    q, v = START_Q.copy(), START_V.copy()
    for _ in range(steps):
        advance(q, v, duration / steps)
    return float(np.linalg.norm(np.concatenate([q, v]) - exact(duration)))


@pytest.mark.parametrize(
    ("advance", "steps", "lowest", "highest"),
    [
        pytest.param(runge_kutta, [50, 100, 200, 400], 3.9, 4.1, id="rk4-is-of-fourth-order"),
        pytest.param(euler, [500, 1000, 2000, 4000], 0.97, 1.03, id="semi-implicit-euler-is-of-first-order"),
    ],
)
def test_error_shrinks_with_the_order_of_the_method(
    advance: Step, steps: list[int], lowest: float, highest: float
) -> None:
    errors = [error_after(advance, count) for count in steps]
    slope = np.polyfit(np.log(1.0 / np.array(steps)), np.log(errors), 1)[0]
    assert lowest < slope < highest


def test_rk4_matches_the_textbook_step() -> None:
    """The classical tableau on the first-order system, written out."""

    def slope(state: np.ndarray) -> np.ndarray:
        out = np.zeros(2)
        damped(state[:2], state[2:], out)
        return np.concatenate([state[2:], out])

    state, h = np.concatenate([START_Q, START_V]), 0.05
    k1 = slope(state)
    k2 = slope(state + 0.5 * h * k1)
    k3 = slope(state + 0.5 * h * k2)
    k4 = slope(state + h * k3)
    expected = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    q, v = START_Q.copy(), START_V.copy()
    runge_kutta(q, v, h)
    assert_allclose(np.concatenate([q, v]), expected, rtol=1e-14)


def test_rk4_weights_sum_to_one() -> None:
    assert_allclose(sum(rk4_stage_weight(stage) for stage in range(RK4_STAGES)), 1.0, rtol=1e-15)


def test_semi_implicit_euler_moves_with_the_new_velocity() -> None:
    q, v = np.array([1.0]), np.array([0.0])

    def pull(q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        out[0] = -q[0]

    semi_implicit_euler_step(pull, q, v, 0.1, np.zeros(1))
    assert_allclose([v[0], q[0]], [-0.1, 0.99], rtol=1e-14)


@pytest.mark.parametrize("step", [0.05, 0.01])
def test_semi_implicit_euler_keeps_the_energy_of_an_oscillator_within_bounds(step: float) -> None:
    """For q̈ = −q the modified energy q²/2 + v²/2 − h q v/2 is kept exactly."""
    q, v, a = np.array([1.0]), np.array([0.0]), np.zeros(1)

    def spring(q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        out[0] = -q[0]

    energies, modified = [], []
    for _ in range(20_000):
        semi_implicit_euler_step(spring, q, v, step, a)
        energies.append(0.5 * (q[0] ** 2 + v[0] ** 2))
        modified.append(energies[-1] - 0.5 * step * q[0] * v[0])
    assert_allclose(modified, modified[0], rtol=1e-10)
    # |q v| ≤ energy, so the true energy can swing by h/2 of itself about the modified one, not drift.
    assert np.abs(np.array(energies) / 0.5 - 1.0).max() < 0.55 * step


def test_acceleration_is_asked_for_once_a_stage() -> None:
    calls = []

    def counted(q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        calls.append(1)
        damped(q, v, out)

    rk4_step(counted, START_Q.copy(), START_V.copy(), 0.01, np.zeros((5, 2)))
    assert len(calls) == RK4_STAGES
    semi_implicit_euler_step(counted, START_Q.copy(), START_V.copy(), 0.01, np.zeros(2))
    assert len(calls) == RK4_STAGES + 1
