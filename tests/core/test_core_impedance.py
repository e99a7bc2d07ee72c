"""The virtual spring and damper, and its damped oscillation in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from twin_gait.core.impedance import damping_from_ratio, impedance_torque, ratio_from_damping

angles = st.floats(-3.0, 3.0)
speeds = st.floats(-10.0, 10.0)
stiffnesses = st.floats(0.1, 1000.0)


@given(equilibrium=angles, stiffness=stiffnesses, damping=st.floats(0.0, 100.0))
def test_joint_at_rest_at_its_equilibrium_has_no_torque(
    equilibrium: float, stiffness: float, damping: float
) -> None:
    assert impedance_torque(equilibrium, 0.0, stiffness, damping, equilibrium) == 0.0


@given(offset=st.floats(1e-6, 3.0), stiffness=stiffnesses, equilibrium=angles)
def test_spring_pulls_back_to_the_equilibrium(offset: float, stiffness: float, equilibrium: float) -> None:
    """Positive torque is towards increasing angle: a joint that is too far flexed is extended."""
    assert impedance_torque(equilibrium + offset, 0.0, stiffness, 0.0, equilibrium) < 0.0
    assert impedance_torque(equilibrium - offset, 0.0, stiffness, 0.0, equilibrium) > 0.0


@given(velocity=speeds, damping=st.floats(0.0, 100.0), equilibrium=angles)
def test_damper_never_injects_power(velocity: float, damping: float, equilibrium: float) -> None:
    assert impedance_torque(equilibrium, velocity, 50.0, damping, equilibrium) * velocity <= 0.0


def test_torque_of_a_hand_computed_case() -> None:
    """100 Nm/rad stretched by 0.1 rad and 10 Nms/rad at 2 rad/s: −(10 + 20) Nm."""
    assert_allclose(impedance_torque(0.3, 2.0, 100.0, 10.0, 0.2), -30.0, rtol=1e-12)


@given(ratio=st.floats(0.01, 5.0), stiffness=stiffnesses, inertia=st.floats(0.01, 20.0))
def test_damping_ratio_survives_the_round_trip(ratio: float, stiffness: float, inertia: float) -> None:
    damping = damping_from_ratio(ratio, stiffness, inertia)
    assert_allclose(ratio_from_damping(damping, stiffness, inertia), ratio, rtol=1e-12)


def test_damping_ratio_one_is_the_border_of_oscillation() -> None:
    """At ζ = 1 the poles of I s² + b s + k meet; just below they are complex."""
    stiffness, inertia = 150.0, 4.0
    for ratio, discriminant_sign in ((0.99, -1.0), (1.01, 1.0)):
        damping = damping_from_ratio(ratio, stiffness, inertia)
        assert math.copysign(1.0, damping**2 - 4.0 * stiffness * inertia) == discriminant_sign
    critical = damping_from_ratio(1.0, stiffness, inertia)
    assert_allclose(critical**2, 4.0 * stiffness * inertia, rtol=1e-12)


def moved(
    angle: float,
    velocity: float,
    duration: float,
    stiffness: float,
    damping: float,
    equilibrium: float,
    inertia: float,
) -> np.ndarray:
    """Angle and velocity of one inertia on the law after a time."""

    def slope(_: float, state: np.ndarray) -> list[float]:
        torque = impedance_torque(*state.tolist(), stiffness, damping, equilibrium)
        return [state[1], torque / inertia]

    end = solve_ivp(slope, (0.0, duration), [angle, velocity], method="DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(end.y[:, -1])


@pytest.mark.parametrize("ratio", [0.1, 0.7, 1.0, 1.5])
def test_joint_on_an_impedance_is_a_damped_oscillator(ratio: float) -> None:
    """One inertia on the law, integrated for a second, against the matrix exponential."""
    stiffness, inertia, equilibrium = 150.0, 4.0, 0.3
    damping = damping_from_ratio(ratio, stiffness, inertia)

    end = moved(-0.2, 1.5, 1.0, stiffness, damping, equilibrium, inertia)
    start = np.array([-0.2 - equilibrium, 1.5])
    system = np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])
    offset, velocity = expm(system) @ start
    assert_allclose([end[0] - equilibrium, end[1]], [offset, velocity], atol=1e-10)


@pytest.mark.parametrize("ratio", [0.05, 0.3])
def test_successive_peaks_shrink_by_the_logarithmic_decrement(ratio: float) -> None:
    """ln(x₁/x₂) = 2πζ/√(1−ζ²) one damped period apart."""
    stiffness, inertia = 100.0, 6.5
    damping = damping_from_ratio(ratio, stiffness, inertia)
    damped_frequency = math.sqrt(stiffness / inertia) * math.sqrt(1.0 - ratio**2)
    period = 2.0 * math.pi / damped_frequency
    angle, _ = moved(0.4, 0.0, period, stiffness, damping, 0.0, inertia)
    assert_allclose(math.log(0.4 / angle), 2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2), rtol=1e-9)
