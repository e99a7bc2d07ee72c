"""Order and energy of the integrators, against the matrix exponential and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from twin_gait.core.integrators import RK4_STAGES, rk4_step, semi_implicit_euler_step

# A lightly damped pair of coupled oscillators: q̈ = −K q − B q̇.
STIFFNESS = np.array([[30.0, -8.0], [-8.0, 20.0]])
DAMPING = np.array([[1.2, -0.3], [-0.3, 0.8]])
START_Q, START_V = np.array([0.4, -0.1]), np.array([-0.5, 0.9])

Step = Callable[[np.ndarray, np.ndarray, float], None]


def damped(
    context: object, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray
) -> None:
    out[:] = -STIFFNESS @ q - DAMPING @ v


def spring(
    context: object, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray
) -> None:
    out[:] = -q


def exact(time: float) -> np.ndarray:
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])
    return np.asarray(expm(system * time) @ np.concatenate([START_Q, START_V]))


def euler(q: np.ndarray, v: np.ndarray, step: float) -> None:
    semi_implicit_euler_step(damped, None, q, v, step, np.zeros(2))


def runge_kutta(q: np.ndarray, v: np.ndarray, step: float) -> None:
    rk4_step(damped, None, q, v, step, np.zeros((5, 2)))


def error_after(advance: Step, steps: int, duration: float = 1.0) -> float:
    q, v = START_Q.copy(), START_V.copy()
    for _ in range(steps):
        advance(q, v, duration / steps)
    return float(np.linalg.norm(np.concatenate([q, v]) - exact(duration)))


def order_of(steps: list[int], errors: list[float]) -> float:
    """Slope of the error over the step on logarithmic axes."""
    return float(np.polyfit(np.log(1.0 / np.array(steps)), np.log(errors), 1)[0])


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
    assert lowest < order_of(steps, [error_after(advance, count) for count in steps]) < highest


def test_rk4_matches_the_textbook_step() -> None:
    """The classical tableau on the first-order system, written out."""

    def slope(state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[2:], -STIFFNESS @ state[:2] - DAMPING @ state[2:]])

    state, h = np.concatenate([START_Q, START_V]), 0.05
    k1 = slope(state)
    k2 = slope(state + 0.5 * h * k1)
    k3 = slope(state + 0.5 * h * k2)
    k4 = slope(state + h * k3)
    expected = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    q, v = START_Q.copy(), START_V.copy()
    runge_kutta(q, v, h)
    assert_allclose(np.concatenate([q, v]), expected, rtol=1e-14)


def test_semi_implicit_euler_moves_with_the_new_velocity() -> None:
    q, v = np.array([1.0]), np.array([0.0])
    semi_implicit_euler_step(spring, None, q, v, 0.1, np.zeros(1))
    assert_allclose([v[0], q[0]], [-0.1, 0.99], rtol=1e-14)


@pytest.mark.parametrize("step", [0.05, 0.01])
def test_semi_implicit_euler_keeps_the_energy_of_an_oscillator_within_bounds(step: float) -> None:
    """For q̈ = −q the modified energy q²/2 + v²/2 − h q v/2 is kept exactly."""
    q, v, a = np.array([1.0]), np.array([0.0]), np.zeros(1)
    energies, modified = [], []
    for _ in range(20_000):
        semi_implicit_euler_step(spring, None, q, v, step, a)
        energies.append(0.5 * (q[0] ** 2 + v[0] ** 2))
        modified.append(energies[-1] - 0.5 * step * q[0] * v[0])
    assert_allclose(modified, modified[0], rtol=1e-10)
    # |q v| ≤ energy, so the true energy can swing by h/2 of itself about the modified one, not drift.
    assert np.abs(np.array(energies) / 0.5 - 1.0).max() < 0.55 * step


def test_stages_come_in_order_with_the_shares_of_their_step() -> None:
    calls: list[tuple[float, float]] = []

    def counted(
        context: list[tuple[float, float]],
        offset: float,
        weight: float,
        q: np.ndarray,
        v: np.ndarray,
        out: np.ndarray,
    ) -> None:
        context.append((offset, weight))
        out[:] = -q

    rk4_step(counted, calls, START_Q.copy(), START_V.copy(), 0.01, np.zeros((5, 2)))
    assert len(calls) == RK4_STAGES
    assert_allclose(calls, [(0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)], rtol=1e-15)
    calls.clear()
    semi_implicit_euler_step(counted, calls, START_Q.copy(), START_V.copy(), 0.01, np.zeros(2))
    assert calls == [(0.0, 1.0)]


class Drive:
    """Time at the start of the step, its length, and the work done since the beginning."""

    def __init__(self, step: float) -> None:
        self.time, self.step, self.work = 0.0, step, 0.0


def driven(drive: Drive, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    """q̈ = cos 2t, and the work of that force."""
    force = math.cos(2.0 * (drive.time + offset * drive.step))
    drive.work += weight * drive.step * force * v[0]
    out[0] = force


def test_a_force_in_time_and_its_work_are_integrated_with_fourth_order() -> None:
    """From rest: v = sin(2t)/2, q = (1 − cos 2t)/4, and the work is v²/2."""
    steps, duration = [20, 40, 80, 160], 0.7
    motion, work = [], []
    for count in steps:
        q, v, drive = np.zeros(1), np.zeros(1), Drive(duration / count)
        for index in range(count):
            drive.time = index * drive.step
            rk4_step(driven, drive, q, v, drive.step, np.zeros((5, 1)))
        motion.append(abs(q[0] - 0.25 * (1.0 - math.cos(2.0 * duration))))
        work.append(abs(drive.work - 0.125 * math.sin(2.0 * duration) ** 2))
    assert 3.9 < order_of(steps, motion) < 4.1
    assert 3.9 < order_of(steps, work) < 4.1
