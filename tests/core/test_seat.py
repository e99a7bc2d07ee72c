"""The law of the seat against closed forms and finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin_gait.core.plant import (
    Pad,
    Seat,
    edge_stiffness_share,
    seat_force,
    seat_force_on_buttocks,
    seat_force_on_thigh,
)
from twin_gait.parameters.environment import ChairParameters


def seat(**changes) -> Seat:
    chair = ChairParameters()
    return Seat(
        height=0.45,
        front_edge=0.25,
        depth=0.4,
        rounding=0.03,
        friction_coefficient=0.7,
        transition_velocity=0.02,
        buttocks=Pad(changes.get("stiffness", 30e3), chair.dissipation, 0.1),
        thigh=Pad(7e3, chair.dissipation, 0.08, 0.2),
        hips=[3],
    )


def test_damping_of_the_default_is_the_published_one() -> None:
    chair, weight, rate = ChairParameters(), 550.0, 1e-6
    whole = seat(stiffness=chair.stiffness)
    height = whole.height - weight / chair.stiffness
    _, slow = seat_force(whole, whole.buttocks, 0.0, height, 0.0, 0.0)
    _, fast = seat_force(whole, whole.buttocks, 0.0, height, 0.0, -rate)
    assert slow == pytest.approx(weight)
    assert (fast - slow) / rate == pytest.approx(1340.0, rel=0.02)
    # 5 Hz and 0.475 of critical with 45 kg.
    assert math.sqrt(chair.stiffness / 45.0) / (2.0 * math.pi) == pytest.approx(5.0, rel=0.01)
    assert (fast - slow) / rate / (2.0 * math.sqrt(45.0 * chair.stiffness)) == pytest.approx(0.475, rel=0.02)


@pytest.mark.parametrize("rise", [-0.3, 0.0, 2.0])
def test_it_never_pulls(rise: float) -> None:
    for height in (0.40, 0.449, 0.451):
        _, normal = seat_force(seat(), seat().buttocks, 0.0, height, 0.1, rise)
        assert normal >= 0.0
        assert normal == 0.0 or height < 0.45


def test_force_acts_behind_both_edges_without_a_jump() -> None:
    positions = np.arange(-0.3, 0.4, 1e-4)
    shares = np.array([edge_stiffness_share(seat(), position) for position in positions])
    assert np.abs(np.diff(shares)).max() == pytest.approx(1e-4 / 0.03)
    assert shares[(positions > -0.12) & (positions < 0.22)].min() == 1.0
    assert shares[(positions < -0.15) | (positions > 0.25)].max() == 0.0


def skin(along: float, behind: float, q: np.ndarray) -> np.ndarray:
    """Point of a thigh in the world: forward, height, pitch and hip flexion as rotations, one by one."""
    forward, height, pitch, hip = q
    down = hip - pitch
    thigh = np.array([[math.cos(down), -math.sin(down)], [math.sin(down), math.cos(down)]])
    return np.array([forward, height]) + thigh @ [-behind, -along]


Q, V = np.array([0.03, 0.53, 0.2, 1.75]), np.array([-0.05, -0.2, 0.7, -0.4])


def rates_of(function) -> np.ndarray:
    """Jacobian of a place by central differences, shape ``(2, 4)``."""
    steps = 1e-6 * np.eye(4)
    return np.array([(function(Q + step) - function(Q - step)) / 2e-6 for step in steps]).T


def test_torque_on_the_thigh_is_the_transposed_jacobian_times_the_force() -> None:
    bench = seat()
    jacobian = rates_of(lambda q: skin(0.2, 0.08, q))
    (x, z), (speed, rise) = skin(0.2, 0.08, Q), jacobian @ V
    force = np.array(seat_force(seat(), bench.thigh, x, z, speed, rise))
    assert force[1] > 1.0
    sine, cosine = math.sin(Q[3] - Q[2]), math.cos(Q[3] - Q[2])
    fx, fz, lift = seat_force_on_thigh(bench, sine, cosine, *Q[:2], *V[:2], V[3] - V[2])
    np.testing.assert_allclose([fx, fz, -lift, lift], jacobian.T @ force, rtol=1e-7)
    assert bench.power == pytest.approx(force @ jacobian @ V)


def test_buttocks_roll_and_rub_below_the_hips() -> None:
    bench = seat()
    # The skin straight below the axis moves as a point of the pelvis.
    jacobian = np.array([[1.0, 0.0, -0.1, 0.0], [0.0, 1.0, 0.0, 0.0]])
    speed, rise = jacobian @ V
    force = np.array(seat_force(seat(), bench.buttocks, Q[0], Q[1] - 0.1, speed, rise))
    found = seat_force_on_buttocks(bench, *Q[:2], *V[:3])
    np.testing.assert_allclose([*found, 0.0], jacobian.T @ force, rtol=1e-12)
    assert abs(force[0]) < 0.7 * force[1]
    assert (bench.normal, bench.friction) == (force[1], force[0])
