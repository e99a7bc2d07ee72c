"""Friction with directions and bristles: closed forms of LuGre and Dahl, energy, an ODE solver."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from twin_device import HIP_FRICTION

from twin_gait.core.friction import (
    advance_deflection,
    friction_torque,
    gear_direction,
    loss_share,
    rotational_friction_and_share,
    rotational_friction_torque,
    steady_deflection,
)
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.friction import AsymmetricFriction, FrictionLaw, FrictionParameters, LuGreFriction

DAHL = LuGreFriction(coulomb_friction=3.0, bristle_stiffness=600.0)
LUGRE = LuGreFriction(
    coulomb_friction=3.0,
    breakaway_torque=4.5,
    stribeck_velocity=0.1,
    viscous_friction_forward=2.0,
    viscous_friction_backward=2.0,
    bristle_stiffness=3000.0,
    bristle_damping=20.0,
)
SKEWED = replace(
    LUGRE, viscous_friction_forward=2.0, viscous_friction_backward=1.2, viscous_exponent=0.7, offset=0.5
)
STATIC = AsymmetricFriction(
    coulomb_friction=3.0,
    breakaway_torque=4.5,
    stribeck_velocity=0.1,
    stribeck_exponent=1.5,
    viscous_friction_forward=2.0,
    viscous_friction_backward=1.2,
    viscous_exponent=0.7,
    offset=0.5,
    transition_velocity=0.01,
)
speeds = st.floats(0.01, 5.0)


def level(law: LuGreFriction, velocity: float) -> float:
    """g(ω), typed a second time."""
    if law.breakaway_torque is None or law.stribeck_velocity is None:
        return law.coulomb_friction
    fall = math.exp(-((abs(velocity) / law.stribeck_velocity) ** law.stribeck_exponent))
    return law.coulomb_friction + (law.breakaway_torque - law.coulomb_friction) * fall


def dragged(law: LuGreFriction, path: np.ndarray, time: np.ndarray, start: float = 0.0) -> np.ndarray:
    """Torques at the points of a path, from straight or bent bristles on."""
    friction, z = law.to_plant_friction(), start
    velocity = np.gradient(path, time)
    torques = []
    before = path[0]
    for angle, speed in zip(path.tolist(), velocity.tolist(), strict=True):
        z = advance_deflection(friction, angle - before, speed, z)
        before = angle
        torques.append(friction_torque(friction, speed, z))
    return np.array(torques)


# ---------------------------------------------------------------------- bristles: closed forms


@pytest.mark.parametrize("law", [DAHL, LUGRE], ids=["dahl", "lugre"])
def test_a_joint_that_sticks_is_a_spring(law: LuGreFriction) -> None:
    """σ0 about rest: over a thousandth of the way until it slides, to a thousandth."""
    way = 1e-3 * law.coulomb_friction / law.bristle_stiffness
    z = advance_deflection(law.to_plant_friction(), way, 1e-9, 0.0)
    torque = friction_torque(law.to_plant_friction(), 0.0, z)
    assert torque / way == pytest.approx(law.bristle_stiffness, rel=1e-3)


@given(speeds, st.booleans())
def test_steady_sliding_is_the_stribeck_curve(speed: float, forward: bool) -> None:
    velocity = speed if forward else -speed
    torque = friction_torque(
        SKEWED.to_plant_friction(), velocity, steady_deflection(SKEWED.to_plant_friction(), velocity)
    )
    viscous = 2.0 * speed**0.7 if forward else -1.2 * speed**0.7
    assert torque == pytest.approx(0.5 + math.copysign(level(SKEWED, speed), velocity) + viscous, rel=1e-12)


@given(speeds, st.floats(-0.0015, 0.0015))
def test_every_start_slides_into_the_steady_deflection(speed: float, start: float) -> None:
    friction = LUGRE.to_plant_friction()
    far = 40.0 * level(LUGRE, speed) / LUGRE.bristle_stiffness
    z = advance_deflection(friction, far, speed, start)
    assert z == pytest.approx(steady_deflection(friction, speed), rel=1e-12)


def test_a_slow_pull_breaks_away_at_the_breakaway_torque() -> None:
    time = np.linspace(0.0, 200.0, 20_001)
    path = 1e-4 * time  # 0.0001 rad/s
    torque = dragged(replace(LUGRE, bristle_damping=0.0), path, time)
    assert torque.max() == pytest.approx(4.5 + 2.0 * 1e-4, rel=1e-5)
    assert torque[-1] <= torque.max()
    fast = dragged(replace(LUGRE, bristle_damping=0.0), 1e4 * path, time)  # 1 rad/s
    assert fast[-1] == pytest.approx(3.0 + 2.0, rel=1e-9)


def test_the_torque_of_a_harder_pull_is_less_until_it_is_viscous() -> None:
    """The Stribeck effect, which lets a joint stick and slip: less friction at 0.1 than at 0.001 rad/s."""
    slow, medium, fast = (
        friction_torque(LUGRE.to_plant_friction(), speed, steady_deflection(LUGRE.to_plant_friction(), speed))
        for speed in (0.001, 0.15, 2.0)
    )
    assert medium < slow < fast


@given(st.lists(st.floats(1e-6, 0.01), min_size=1, max_size=30), st.floats(0.001, 9.0))
def test_dahls_torque_is_exponential_in_the_way_however_it_is_gone(ways: list[float], speed: float) -> None:
    """F = T_c (1 - exp(-σ0 x / T_c)) along any way in one direction, in any steps and at any speed."""
    friction, z = DAHL.to_plant_friction(), 0.0
    for way in ways:
        z = advance_deflection(friction, way, speed, z)
    expected = 3.0 * -math.expm1(-600.0 * math.fsum(ways) / 3.0)
    assert friction_torque(friction, speed, z) == pytest.approx(expected, rel=1e-12)


def test_lugre_without_damping_and_stribeck_effect_is_dahls_model() -> None:
    flat = replace(DAHL, breakaway_torque=3.0, stribeck_velocity=0.1)
    time = np.linspace(0.0, 1.0, 500)
    path = 0.02 * np.sin(9.0 * time)
    assert_allclose(dragged(flat, path, time), dragged(DAHL, path, time), rtol=1e-14)


@pytest.mark.parametrize("amplitude", [0.0005, 0.005, 0.05])
def test_dahls_loop_takes_the_energy_of_the_closed_form(amplitude: float) -> None:
    """A loop between ±A takes 4 T_c (A - T_c/σ0 tanh(σ0 A / T_c)), at any rate."""
    s = 600.0 * amplitude / 3.0
    expected = 4.0 * 3.0 * (amplitude - 3.0 / 600.0 * math.tanh(s))
    for rate in (0.1, 3.0):
        time = np.linspace(0.0, 1.0 / rate, 20_001)
        path = amplitude * np.cos(2.0 * math.pi * rate * time)
        torque = dragged(DAHL, path, time, start=3.0 / 600.0 * math.tanh(s))  # on the loop from the start
        work = np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(path))
        assert work == pytest.approx(expected, rel=1e-5)


@given(
    st.floats(0.0003, 0.5),
    st.floats(0.05, 5.0),
    st.floats(0.5, 8.0),
    st.floats(0.0, 0.9),
    st.floats(0.0, 30.0),
)
def test_friction_takes_energy_over_every_closed_cycle(
    amplitude: float, rate: float, breakaway: float, offset: float, damping: float
) -> None:
    law = replace(
        SKEWED, breakaway_torque=breakaway, offset=offset * min(3.0, breakaway), bristle_damping=damping
    )
    time = np.linspace(0.0, 3.0 / rate, 3001)
    path = amplitude * np.sin(2.0 * math.pi * rate * time)
    torque = dragged(law, path, time)[2000:]
    assert np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(path[2000:])) > 0.0


# ---------------------------------------------------------------------- bristles: numbers


def solved(law: LuGreFriction, velocity, end: float) -> float:
    """z after a time under a given velocity, by an adaptive ODE solver."""

    def rate(t: float, z: np.ndarray) -> list[float]:
        speed = float(velocity(t))
        return [speed - law.bristle_stiffness * abs(speed) / level(law, speed) * z[0]]

    found = solve_ivp(rate, (0.0, end), [0.0], method="LSODA", rtol=1e-11, atol=1e-14, max_step=1e-3)
    return float(found.y[0, -1])


def stepped(law: LuGreFriction, velocity, path, end: float, steps: int) -> float:
    friction, z = law.to_plant_friction(), 0.0
    for step in range(steps):
        t0, t1 = end * step / steps, end * (step + 1) / steps
        z = advance_deflection(friction, float(path(t1) - path(t0)), float(velocity(t1)), z)
    return z


@pytest.mark.parametrize("end", [0.02, 0.31, 0.5])
@pytest.mark.parametrize("amplitude", [0.001, 0.02])
def test_steps_equal_an_ode_solver(amplitude: float, end: float) -> None:
    """A step of 1 ms errs by less than 1 % of the way until the bristles slide; by half as much at 0.5 ms."""

    def path(t: float) -> float:
        return amplitude * math.sin(2.0 * math.pi * 2.0 * t)

    def velocity(t: float) -> float:
        return amplitude * 4.0 * math.pi * math.cos(4.0 * math.pi * t)

    exact = solved(LUGRE, velocity, end)
    slides = LUGRE.coulomb_friction / LUGRE.bristle_stiffness
    coarse, fine = (abs(stepped(LUGRE, velocity, path, end, round(end / h)) - exact) for h in (1e-3, 1e-4))
    assert coarse < 1e-2 * slides
    assert fine < max(0.15 * coarse, 1e-6 * slides)


def test_a_step_with_a_level_that_stays_is_exact() -> None:
    """One step through a whole swing of Dahl's model, in one direction."""
    exact = solved(DAHL, lambda t: 0.3 * math.sin(t), math.pi)
    assert advance_deflection(DAHL.to_plant_friction(), 0.6, 0.0, 0.0) == pytest.approx(exact, rel=1e-8)


@given(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5), st.floats(-0.0015, 0.0015))
def test_bristles_never_bend_farther_than_their_level(speed: float, way: float, start: float) -> None:
    z = advance_deflection(LUGRE.to_plant_friction(), way, speed, start)
    assert abs(z) <= max(abs(start), level(LUGRE, speed) / LUGRE.bristle_stiffness) * (1 + 1e-12)


# ---------------------------------------------------------------------- static laws and load


@given(st.floats(-5.0, 5.0))
def test_the_static_law_with_directions_is_its_formula(velocity: float) -> None:
    speed = abs(velocity)
    stribeck = 3.0 + 1.5 * math.exp(-((speed / 0.1) ** 1.5))
    viscous = 2.0 * speed**0.7 if velocity > 0.0 else -1.2 * speed**0.7
    expected = 0.5 + stribeck * math.tanh(velocity / 0.01) + viscous
    assert friction_torque(STATIC.to_plant_friction(), velocity, 0.0) == pytest.approx(expected, rel=1e-12)


@given(st.floats(-5.0, 5.0))
def test_the_rotational_law_in_the_plant_is_bit_for_bit_equation_3_1(velocity: float) -> None:
    table, friction = (1.664, 4.2, 0.2252, 2.26), HIP_FRICTION.to_plant_friction(0.85)
    expected = rotational_friction_torque(velocity, *table)
    assert friction_torque(friction, velocity, 0.0) == expected
    share = loss_share(gear_direction(friction, velocity), -1.0, 0.85)
    assert rotational_friction_and_share(velocity, *table, -1.0, 0.85) == (expected, share)


@pytest.mark.parametrize("law", [HIP_FRICTION, STATIC], ids=["rotational", "asymmetric"])
def test_laws_without_bristles_have_no_state(law: FrictionLaw) -> None:
    friction = law.to_plant_friction()
    assert advance_deflection(friction, 0.3, 1.0, 0.0) == 0.0 == steady_deflection(friction, 1.0)
    assert friction_torque(friction, 1.0, 7.0) == friction_torque(friction, 1.0, 0.0)


@pytest.mark.parametrize("law", [STATIC, SKEWED], ids=["asymmetric", "lugre"])
def test_gear_takes_its_loss_from_a_joint_that_slides(law: FrictionLaw) -> None:
    """η 0.8 of -40 N·m is 8 N·m where the motor drives and 10 N·m where it brakes, once the joint slides."""
    friction = law.to_plant_friction(0.8)
    for velocity, lost in ((0.8, 10.0), (-0.8, -8.0)):
        share = loss_share(gear_direction(friction, velocity), -1.0, friction.gear_efficiency)
        assert -40.0 * share == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize("law", [HIP_FRICTION, STATIC, SKEWED], ids=["rotational", "asymmetric", "lugre"])
def test_a_ratio_scales_every_law_and_ratio_zero_removes_it(law: FrictionLaw) -> None:
    whole, half = law.to_plant_friction(), law.scaled(0.5).to_plant_friction()
    for velocity in (-1.0, -0.02, 0.05, 2.0):
        torques = [
            friction_torque(item, velocity, steady_deflection(item, velocity)) for item in (whole, half)
        ]
        assert torques[1] == pytest.approx(0.5 * torques[0], rel=1e-12)
        assert friction_torque(law.scaled(0.0).to_plant_friction(), velocity, 0.0) == 0.0
    with raises(ParameterError, "friction ratio", "0", "-0.1"):
        law.scaled(-0.1)


def test_a_joint_without_friction_needs_no_law() -> None:
    free = FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=0.0
    )
    assert (
        friction_torque(free.to_plant_friction(), 1.0, 0.0)
        == gear_direction(free.to_plant_friction(), 1.0)
        == 0.0
    )
    loaded = free.to_plant_friction(0.9)
    assert friction_torque(loaded, 1.0, 0.0) == 0.0
    assert 10.0 * loss_share(gear_direction(loaded, 1.0), 1.0, 0.9) == pytest.approx(1.0, rel=1e-7)  # tanh 10


# ---------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"coulomb_friction": 0.0}, ("coulomb_friction", "0", "0.0")),
        ({"breakaway_torque": -1.0}, ("breakaway_torque", "0", "-1.0")),
        ({"stribeck_velocity": None}, ("stribeck_velocity", "breakaway_torque")),
        ({"breakaway_torque": None}, ("stribeck_velocity", "breakaway_torque")),
        ({"stribeck_velocity": math.nan}, ("stribeck_velocity", "0", "nan")),
        ({"stribeck_exponent": 0.0}, ("stribeck_exponent", "0", "0.0")),
        ({"viscous_exponent": -1.0}, ("viscous_exponent", "0", "-1.0")),
        ({"viscous_friction_backward": -0.1}, ("viscous_friction_backward", "0", "-0.1")),
        ({"offset": 3.0}, ("offset", "3 N·m", "3.0")),
        ({"offset": -2.0, "breakaway_torque": 1.0}, ("offset", "1 N·m", "-2.0")),
        ({"offset": math.nan}, ("offset", "-1000")),
        ({"bristle_stiffness": 0.0}, ("bristle_stiffness", "0", "0.0")),
        ({"bristle_damping": math.inf}, ("bristle_damping", "0", "inf")),
    ],
    ids=str,
)
def test_a_law_that_would_drive_the_joint_is_refused(
    wrong: dict[str, float | None], message: tuple[object, ...]
) -> None:
    with raises(ParameterError, *message) as caught:
        replace(SKEWED, **wrong)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_static_law_needs_a_transition_velocity() -> None:
    with raises(ParameterError, "transition_velocity", "0"):
        replace(STATIC, transition_velocity=0.0)
