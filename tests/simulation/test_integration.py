"""The integrators of the loop on dynamics of closed form: order, energy, and the work of a force in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from twin_gait import load_experiment
from twin_gait.core.contact import contact_normal_force
from twin_gait.core.plant import ImposedMotion, Plant
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.record import deep_copy
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stages.motion import compute_accelerations, integrate

# A lightly damped pair of coupled oscillators: q̈ = −K q − B q̇.
STIFFNESS = np.array([[30.0, -8.0], [-8.0, 20.0]])
DAMPING = np.array([[1.2, -0.3], [-0.3, 0.8]])
START_Q, START_V = [0.4, -0.1], [-0.5, 0.9]

Law = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def damped(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return -STIFFNESS @ q - DAMPING @ v


def spring(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return -q


def exact(time: float) -> np.ndarray:
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])
    return np.asarray(expm(system * time) @ np.array([*START_Q, *START_V]))


@pytest.fixture(scope="module")
def free() -> Episode:
    """Two coordinates on which nothing acts, but that their work is summed up."""
    _, e, _ = assemble(build_setup(load_experiment("bench_leg").experiment))
    e.plant = [Plant(), Plant()]
    return e


def started(free: Episode, q: list[float], v: list[float], step: float, *, recording: bool = True) -> Episode:
    e = deep_copy(free)
    e.q, e.v, e.step, e.substeps, e.recording.on = list(q), list(v), step, 1, recording
    return e


def evaluated_and_integrated(e: Episode, tick: int) -> None:
    """A tick as with a log, whose row is evaluated where it begins."""
    if e.recording.on:
        compute_accelerations(e, tick * e.rates.period, False)
    integrate(e, tick)


def stepping(law: Law, *, rk4: bool, **names: Any) -> Callable[[Episode, int], None]:
    """The motion on dynamics of one's own."""

    def dynamics(
        q: list[float],
        v: list[float],
        torque: list[float],
        rotors: object,
        bodies: object,
        gravity: float,
        ground: object,
        a: list[float],
        points: object,
    ) -> float:
        a[:] = law(np.array(q), np.array(v), np.array(torque)).tolist()
        return 0.0

    function: Callable[[Episode, int], None] = specialize(
        evaluated_and_integrated, {"WITH_RK4": rk4, "dynamics": dynamics, **names}
    )
    return function


def error_after(free: Episode, rk4: bool, steps: int, duration: float = 1.0) -> float:
    e = started(free, START_Q, START_V, duration / steps)
    e.substeps = steps
    stepping(damped, rk4=rk4)(e, 0)
    return float(np.linalg.norm(np.array([*e.q, *e.v]) - exact(duration)))


def order_of(steps: list[int], errors: list[float]) -> float:
    """Slope of the error over the step on logarithmic axes."""
    return float(np.polyfit(np.log(1.0 / np.array(steps)), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("rk4", "steps", "lowest", "highest"),
    [
        pytest.param(True, [50, 100, 200, 400], 3.9, 4.1, id="rk4-is-of-fourth-order"),
        pytest.param(False, [500, 1000, 2000, 4000], 0.97, 1.03, id="semi-implicit-euler-is-of-first-order"),
    ],
)
def test_error_shrinks_with_the_order_of_the_method(
    free: Episode, rk4: bool, steps: list[int], lowest: float, highest: float
) -> None:
    assert lowest < order_of(steps, [error_after(free, rk4, count) for count in steps]) < highest


def bounce(free: Episode, rk4: bool, step: float, dissipation: float, phase: float) -> tuple[float, float]:
    """Speed after a fall of 4 kg at 0.5 m/s on the contact, over that before, and the work of the contact."""

    def dynamics(
        q: list[float],
        v: list[float],
        torque: list[float],
        rotors: object,
        bodies: object,
        gravity: float,
        ground: object,
        a: list[float],
        points: object,
    ) -> float:
        force = contact_normal_force(-q[0], -v[0], 3e5, dissipation)
        a[:] = [force / 4.0, 0.0]
        return force * v[0]

    e = started(free, [phase * 0.5 * step, 0.0], [-0.5, 0.0], step)
    advance = specialize(evaluated_and_integrated, {"WITH_RK4": rk4, "dynamics": dynamics})
    while e.q[0] <= 0.0 or e.v[0] <= 0.0:
        advance(e, 0)
    return e.v[0] / 0.5, e.work.contact


@pytest.mark.parametrize("dissipation", [0.5, 2.5])
@pytest.mark.parametrize(
    ("rk4", "step", "error", "residual"),
    # Euler's method counts the work of the ground at the velocity of a step's start: first order.
    [(True, 1e-4, 1e-7, 1e-9), (True, 2.5e-4, 1e-6, 1e-7), (False, 2.5e-4, 5e-6, 0.1)],
)
def test_bounce_on_the_ground_equals_the_closed_form(
    free: Episode, dissipation: float, rk4: bool, step: float, error: float, residual: float
) -> None:
    """Wherever in a step it lands: x (1 + e) = ln((1 + x)/(1 − e x)), and the work is what it lost."""
    x = 1.5 * dissipation * 0.5
    for phase in (0.1, 0.45, 0.9):
        left, work = bounce(free, rk4, step, dissipation, phase)
        assert_allclose(x * (1.0 + left), math.log((1.0 + x) / (1.0 - left * x)), atol=5.0 * error)
        assert_allclose(work, 0.5 * (left * left - 1.0), rtol=residual)


def test_rk4_matches_the_textbook_step(free: Episode) -> None:
    """The classical tableau on the first-order system, written out."""

    def slope(state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[2:], -STIFFNESS @ state[:2] - DAMPING @ state[2:]])

    state, h = np.array([*START_Q, *START_V]), 0.05
    k1 = slope(state)
    k2 = slope(state + 0.5 * h * k1)
    k3 = slope(state + 0.5 * h * k2)
    k4 = slope(state + h * k3)
    expected = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    e = started(free, START_Q, START_V, h)
    stepping(damped, rk4=True)(e, 0)
    assert_allclose([*e.q, *e.v], expected, rtol=1e-14)


def test_semi_implicit_euler_moves_with_the_new_velocity(free: Episode) -> None:
    e = started(free, [1.0, 0.0], [0.0, 0.0], 0.1)
    stepping(spring, rk4=False)(e, 0)
    assert_allclose([e.v[0], e.q[0]], [-0.1, 0.99], rtol=1e-14)


@pytest.mark.parametrize("step", [0.05, 0.01])
def test_semi_implicit_euler_keeps_the_energy_of_an_oscillator_within_bounds(
    free: Episode, step: float
) -> None:
    """For q̈ = −q the modified energy q²/2 + v²/2 − h q v/2 is kept exactly."""
    e, advance = started(free, [1.0, 0.0], [0.0, 0.0], step), stepping(spring, rk4=False)
    energies, modified = [], []
    for tick in range(20_000):
        advance(e, tick)
        energies.append(0.5 * (e.q[0] ** 2 + e.v[0] ** 2))
        modified.append(energies[-1] - 0.5 * step * e.q[0] * e.v[0])
    assert_allclose(modified, modified[0], rtol=1e-10)
    # |q v| ≤ energy, so the true energy can swing by h/2 of itself about the modified one, not drift.
    assert np.abs(np.array(energies) / 0.5 - 1.0).max() < 0.55 * step


@pytest.mark.parametrize(
    ("rk4", "stages"),
    [(True, [(0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)]), (False, [(0.0, 1.0)])],
)
def test_stages_come_in_order_with_the_shares_of_their_step(
    free: Episode, rk4: bool, stages: list[tuple[float, float]]
) -> None:
    """Each is evaluated once, also with a log, whose row is evaluated where the tick begins."""
    offsets, shares = [], []

    def compute_accelerations(e: Episode, time: float, staged: bool) -> None:
        offsets.append(time / e.step)

    def add_work(e: Episode, duration: float) -> None:
        shares.append(duration / e.step)

    step = stepping(spring, rk4=rk4, compute_accelerations=compute_accelerations, _add_work=add_work)
    step(started(free, START_Q, START_V, 0.01, recording=False), 0)
    assert offsets == [offset for offset, _ in stages] and shares == []
    offsets.clear()
    step(started(free, START_Q, START_V, 0.01, recording=True), 0)
    assert offsets == [offset for offset, _ in stages]
    assert_allclose(shares, [share for _, share in stages], rtol=1e-15)


def test_substeps_of_a_tick_follow_each_other(free: Episode) -> None:
    """Their times are the tick's and a whole number of steps, not a running sum."""
    times = []

    def compute_accelerations(e: Episode, time: float, staged: bool) -> None:
        times.append(time)

    e = started(free, START_Q, START_V, 0.25e-3, recording=False)
    e.substeps = 4
    stepping(spring, rk4=False, compute_accelerations=compute_accelerations)(e, 7)
    assert times == [7 * e.rates.period + number * e.step for number in range(4)]


def test_a_force_in_time_and_its_work_are_integrated_with_fourth_order(free: Episode) -> None:
    """A hand on a spring of 1 N·m/rad along cos 2t, whose pull on q the dynamics take back: q̈ = cos 2t.

    From rest: v = sin(2t)/2, q = (1 − cos 2t)/4; the hand pulls by cos 2t − q, and its work is (v² − q²)/2.
    """

    def unsprung(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return torque + q * [1.0, 0.0]

    steps, duration = [20, 40, 80, 160], 0.7
    motion, work = [], []
    q, v = 0.25 * (1.0 - math.cos(2.0 * duration)), 0.5 * math.sin(2.0 * duration)
    for count in steps:
        e = started(free, [0.0, 0.0], [0.0, 0.0], duration / count)
        e.imposed_motion = ImposedMotion(0, 1.0, -2.0, 1.0 / math.pi, 1.0, 0.0, math.inf)
        e.substeps = count
        stepping(unsprung, rk4=True)(e, 0)
        motion.append(abs(e.q[0] - q))
        work.append(abs(e.work.external - 0.5 * (v * v - q * q)))
    assert 3.9 < order_of(steps, motion) < 4.1
    assert 3.9 < order_of(steps, work) < 4.1
