"""Tests of ground contact and mechanical stops: they push, they dissipate, they never pull."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from twin_gait.core.arms import Arm, Grip, anchor_position, anchored_friction_force
from twin_gait.core.contact import (
    Ground,
    contact_friction_force,
    contact_normal_force,
    ground_contact_force,
    mechanical_stop_torque,
    resolve_along_slope,
    sloped_contact_force,
)
from twin_gait.core.estimation import new_delay_line
from twin_gait.parameters.environment import CONTACTS, ContactParameters

stiffnesses = st.floats(1e3, 1e6)
dissipations = st.floats(0.0, 5.0)
rates = st.floats(-5.0, 5.0)
LOWER, UPPER = -0.35, 1.9


@given(penetration=st.floats(-0.1, 0.1), rate=rates, stiffness=stiffnesses, dissipation=dissipations)
def test_ground_never_pulls(penetration: float, rate: float, stiffness: float, dissipation: float) -> None:
    assert contact_normal_force(penetration, rate, stiffness, dissipation) >= 0.0


@given(height=st.floats(0.0, 1.0), forward=rates, vertical=rates, belt=st.floats(0.0, 2.0))
def test_foot_in_the_air_has_no_force(height: float, forward: float, vertical: float, belt: float) -> None:
    assert ground_contact_force(Ground(belt, 3e5, 0.5, 0.8, 0.05), 3e5, 0.5, height, forward, vertical) == (
        0.0,
        0.0,
    )


@given(rate=rates, stiffness=stiffnesses, dissipation=dissipations)
def test_force_is_continuous_at_touch_down_for_any_speed(
    rate: float, stiffness: float, dissipation: float
) -> None:
    """A hard landing also starts without force: F ≤ k δ^1.5 (1 + 1.5 c |δ̇|) → 0 with δ."""
    for penetration in (1e-6, 1e-8, 1e-10):
        bound = stiffness * penetration**1.5 * (1.0 + 1.5 * dissipation * abs(rate))
        assert contact_normal_force(penetration, rate, stiffness, dissipation) <= bound * (1.0 + 1e-12)


@given(penetration=st.floats(1e-6, 0.05), stiffness=stiffnesses, dissipation=dissipations)
def test_static_force_is_the_hertz_spring(penetration: float, stiffness: float, dissipation: float) -> None:
    force = contact_normal_force(penetration, 0.0, stiffness, dissipation)
    assert_allclose(force, stiffness * penetration**1.5, rtol=1e-12)


@given(
    penetration=st.floats(1e-6, 0.05),
    rate=st.floats(0.0, 5.0),
    stiffness=stiffnesses,
    dissipation=dissipations,
)
def test_contact_returns_less_energy_than_it_takes(
    penetration: float, rate: float, stiffness: float, dissipation: float
) -> None:
    """Pushing in costs at least the spring force, coming out returns at most that."""
    static = contact_normal_force(penetration, 0.0, stiffness, dissipation)
    assert contact_normal_force(penetration, rate, stiffness, dissipation) >= static
    assert contact_normal_force(penetration, -rate, stiffness, dissipation) <= static


def restitution(dissipation: float, speed: float) -> float:
    """Root of x (1 + e) = ln((1 + x)/(1 − e x)) with x = 1.5 c v."""
    x = 1.5 * dissipation * speed
    highest = min(1.0, 1.0 / x) * (1.0 - 1e-15)
    return float(brentq(lambda e: x * (1.0 + e) - math.log((1.0 + x) / (1.0 - e * x)), 1e-9, highest))


@pytest.mark.parametrize("mass", [4.0, 90.0])
@pytest.mark.parametrize("speed", [0.05, 0.15, 0.3, 1.0])
@pytest.mark.parametrize("dissipation", [0.5, 2.0, 3.0])
def test_fall_has_the_restitution_and_the_loss_of_the_closed_form(
    dissipation: float, speed: float, mass: float
) -> None:
    def slope(_: float, state: np.ndarray) -> list[float]:
        force = contact_normal_force(-state[0], -state[1], 3e5, dissipation)
        return [state[1], force / mass, force * state[1]]

    def leaves(_: float, state: np.ndarray) -> float:
        return float(state[0])

    leaves.terminal, leaves.direction = True, 1.0  # type: ignore[attr-defined]
    impact = solve_ivp(
        slope, (0.0, 0.5), [0.0, -speed, 0.0], method="DOP853", rtol=1e-11, atol=1e-15, events=leaves
    )
    assert impact.status == 1  # it left the ground
    _, velocity, work = impact.y[:, -1]
    expected = restitution(dissipation, speed)
    assert_allclose(velocity / speed, expected, atol=1e-8)
    assert_allclose(work, -0.5 * mass * speed**2 * (1.0 - expected**2), rtol=1e-7)
    # Hunt and Crossley (1975): e = 1 - c v for a slow fall; the next term of the series is smaller than this.
    assert abs(expected - (1.0 - dissipation * speed)) < 1.5 * (dissipation * speed) ** 2


# c, ζ of 90 kg with 40 % of their weight on a heel, energy lost in a fall at 0.15 and 0.30 m/s [%].
QUOTED = [
    (0.5, 0.06, 13, 24),
    (1.5, 0.19, 33, 53),
    (2.0, 0.26, 41, 62),
    (2.5, 0.32, 47, 68),
    (3.0, 0.38, 53, 73),
]


@pytest.mark.parametrize(("dissipation", "damping_ratio", "slow", "fast"), QUOTED)
def test_damping_equals_the_documented_value(
    dissipation: float, damping_ratio: float, slow: int, fast: int
) -> None:
    """ζ = b / (2 √(k m)) of the law's derivatives at the load, against 3 c W / (4 m ω)."""
    mass, load, stiffness, small = 90.0, 0.4 * 90.0 * 9.81, 3e5, 1e-7
    depth = (load / stiffness) ** (2.0 / 3.0)

    def force(deeper: float, rate: float) -> float:
        return contact_normal_force(depth + deeper, rate, stiffness, dissipation)

    spring = (force(small, 0.0) - force(-small, 0.0)) / (2.0 * small)
    damper = (force(0.0, small) - force(0.0, -small)) / (2.0 * small)
    frequency = math.sqrt(1.5 * load / (mass * depth))
    ratio = 0.75 * dissipation * load / (mass * frequency)
    assert_allclose(math.sqrt(spring / mass), frequency, rtol=1e-6)
    assert_allclose(damper / (2.0 * math.sqrt(spring * mass)), ratio, rtol=1e-6)
    assert round(ratio, 2) == damping_ratio
    for speed, lost in ((0.15, slow), (0.3, fast)):
        assert round(100.0 * (1.0 - restitution(dissipation, speed) ** 2)) == lost


def test_calibrated_contact_is_fitted_to_published_feet() -> None:
    """Kinoshita et al. (1993): 5 kg at 0.93 m/s on heels; Ker (1996): isolated heel pads; Cavanagh (1999)."""
    soft, calibrated = CONTACTS["soft"], CONTACTS["calibrated"]
    force, deformation = 5.0 * 11.6 * 9.81, 11.3e-3
    # At the largest deformation there is no damping; the peak force comes a little earlier.
    assert_allclose(calibrated.stiffness, force / deformation**1.5, rtol=0.02)
    assert 0.30 <= 1.0 - restitution(calibrated.dissipation, 0.15) ** 2 <= 0.48
    assert 0.75 <= 1.0 - restitution(calibrated.dissipation, 0.93) ** 2 <= 0.89
    stiffness, dissipation = calibrated.forefoot
    compressed = (70.0 * 9.81 / stiffness) ** (2.0 / 3.0)
    assert_allclose(compressed, 0.457 * 15.2e-3, rtol=0.01)
    assert dissipation == calibrated.dissipation
    assert soft == ContactParameters()
    assert soft.forefoot == (soft.stiffness, soft.dissipation)


@given(slip=rates, normal=st.floats(0.0, 2000.0), friction=st.floats(0.0, 1.5))
def test_friction_stays_in_the_cone_and_opposes_slip(slip: float, normal: float, friction: float) -> None:
    force = contact_friction_force(slip, normal, friction, 0.05)
    assert abs(force) <= friction * normal
    assert force * slip <= 0.0


def test_sliding_foot_has_the_full_coulomb_friction() -> None:
    assert_allclose(contact_friction_force(1.0, 100.0, 0.8, 0.05), -80.0, rtol=1e-12)


@given(normal=st.floats(-100.0, 0.0), slip=rates)
def test_unloaded_foot_has_no_friction(normal: float, slip: float) -> None:
    assert contact_friction_force(slip, normal, 0.8, 0.05) == 0.0


@given(belt=st.floats(0.0, 2.0))
def test_foot_that_moves_with_the_belt_is_not_dragged(belt: float) -> None:
    """The belt runs backwards: standing on it means moving at minus its speed."""
    forward, upward = ground_contact_force(Ground(belt, 3e5, 0.5, 0.8, 0.05), 3e5, 0.5, -0.01, -belt, 0.0)
    assert forward == 0.0
    assert_allclose(upward, 3e5 * 0.01**1.5, rtol=1e-12)


def test_belt_carries_a_standing_foot_backwards() -> None:
    forward, _ = ground_contact_force(Ground(0.42, 3e5, 0.5, 0.8, 0.05), 3e5, 0.5, -0.01, 0.0, 0.0)
    assert forward < 0.0


# ------------------------------------------------------------------ a slope

slopes = st.floats(-0.2, 0.2)
positions = st.floats(-0.5, 0.5)


def sloping(slope: float, belt: float = 0.42, friction: float = 0.8) -> Ground:
    return Ground(belt, 3e5, 0.5, friction, 0.05, math.sin(slope), math.cos(slope))


def pressed(ground: Ground, x: float, z: float, vx: float, vz: float) -> tuple[float, float, float]:
    law = partial(ground_contact_force, ground, 3e5, 0.5)
    return sloped_contact_force(ground.slope_sine, ground.slope_cosine, (x, z), (vx, vz), law)


def in_its_axes(ground: Ground, forward: float, upward: float) -> tuple[float, float]:
    return resolve_along_slope(ground.slope_sine, ground.slope_cosine, forward, upward)


@given(x=positions, z=st.floats(-0.05, 0.05), forward=rates, upward=rates)
def test_a_slope_of_zero_equals_level_ground_bit_for_bit(
    x: float, z: float, forward: float, upward: float
) -> None:
    found = pressed(sloping(0.0), x, z, forward, upward)
    assert found == (*ground_contact_force(sloping(0.0), 3e5, 0.5, z, forward, upward), z)


@given(slope=slopes, x=positions, depth=st.floats(-0.05, 0.05), forward=rates, upward=rates)
def test_a_slope_is_level_ground_that_is_turned_about_the_origin(
    slope: float, x: float, depth: float, forward: float, upward: float
) -> None:
    """By a rotation matrix: the force of level ground on the rotated point, rotated back."""
    turn = np.array([[math.cos(slope), -math.sin(slope)], [math.sin(slope), math.cos(slope)]])
    level = np.array([x, -depth]), np.array([forward, upward])
    (px, pz), (vx, vz) = (turn @ item for item in level)
    ground = sloping(slope)
    fx, fz, height = pressed(ground, px, pz, vx, vz)
    expected = np.array(ground_contact_force(ground, 3e5, 0.5, -depth, forward, upward))
    assert_allclose(height, -depth, rtol=0.0, atol=1e-15)
    tolerance = 1e-6 * (1.0 + np.abs(expected).max())  # roundings of the depth, times the stiffness
    assert_allclose([fx, fz], turn @ expected, rtol=0.0, atol=tolerance)
    assert_allclose(in_its_axes(ground, fx, fz), expected, rtol=0.0, atol=tolerance)
    assert_allclose(fx * vx + fz * vz, expected @ level[1], rtol=0.0, atol=10.0 * tolerance)


@given(slope=slopes, belt=st.floats(0.0, 2.0), x=positions)
def test_the_belt_of_a_slope_runs_along_it(slope: float, belt: float, x: float) -> None:
    """A foot that moves with the belt has only a normal force and no friction."""
    ground = sloping(slope, belt)
    z = (x * ground.slope_sine - 0.01) / ground.slope_cosine
    velocity = -belt * ground.slope_cosine, -belt * ground.slope_sine
    friction, normal = in_its_axes(ground, *pressed(ground, x, z, *velocity)[:2])
    assert_allclose(normal, 3e5 * 0.01**1.5, rtol=1e-9)
    assert_allclose(friction, 0.0, atol=1e-9)


@pytest.mark.parametrize("degrees", [-8.0, 5.0])
def test_a_mass_on_a_slope_creeps_as_its_weight_is_split(degrees: float) -> None:
    r"""At rest :math:`F_n = m g \cos\alpha`, and :math:`\mu\tanh(v/v_t) = \tan\alpha` down the slope."""
    slope, mass, gravity = math.radians(degrees), 30.0, 9.81
    ground = sloping(slope, belt=0.0)

    def rate(_: float, state: np.ndarray) -> list[float]:
        x, z, vx, vz = state
        fx, fz, _ = pressed(ground, x, z, vx, vz)
        return [vx, vz, fx / mass, fz / mass - gravity]

    # Let down to where it rests, as light dissipation would let it bounce for long.
    depth = (mass * gravity * math.cos(slope) / ground.stiffness) ** (2.0 / 3.0)
    start = [depth * math.sin(slope), -depth * math.cos(slope), 0.0, 0.0]
    end = solve_ivp(rate, (0.0, 1.0), start, method="LSODA", rtol=1e-9, atol=1e-12).y[:, -1]
    friction, normal = in_its_axes(ground, *pressed(ground, *end)[:2])
    assert_allclose(normal, mass * gravity * math.cos(slope), rtol=1e-4)
    assert_allclose(friction, mass * gravity * math.sin(slope), rtol=1e-4)
    creep = end[2] * math.cos(slope) + end[3] * math.sin(slope)
    assert_allclose(creep, -0.05 * math.atanh(math.tan(slope) / 0.8), rtol=1e-4)


@pytest.mark.parametrize("degrees", [-8.0, 5.0])
def test_without_friction_a_mass_slides_down_by_the_share_of_gravity(degrees: float) -> None:
    slope = math.radians(degrees)
    ground = sloping(slope, friction=0.0)
    fx, fz, _ = pressed(ground, 0.3, 0.3 * math.tan(slope) - 0.004, 0.0, 0.0)
    mass = math.hypot(fx, fz) / (9.81 * math.cos(slope))  # that this force carries at right angles
    along, away = in_its_axes(ground, fx / mass, fz / mass - 9.81)
    assert_allclose(along, -9.81 * math.sin(slope), rtol=1e-12)
    assert_allclose(away, 0.0, atol=1e-12)


@given(angle=st.floats(-1.5, 3.0), velocity=rates, dissipation=dissipations)
def test_stop_pushes_towards_the_inside_and_never_sticks(
    angle: float, velocity: float, dissipation: float
) -> None:
    torque = mechanical_stop_torque(angle, velocity, LOWER, UPPER, 2000.0, dissipation)
    if angle < LOWER:
        assert torque >= 0.0
    elif angle > UPPER:
        assert torque <= 0.0
    else:
        assert torque == 0.0


@given(velocity=rates, dissipation=dissipations)
def test_stop_is_continuous_where_it_begins(velocity: float, dissipation: float) -> None:
    for stop, outwards in ((LOWER, -1e-9), (UPPER, 1e-9)):
        torque = mechanical_stop_torque(stop + outwards, velocity, LOWER, UPPER, 2000.0, dissipation)
        assert abs(torque) <= 2000.0 * 1.1e-9 * (1.0 + dissipation * abs(velocity))


@given(depth=st.floats(1e-6, 0.3), velocity=rates, dissipation=dissipations)
def test_both_stops_are_mirror_images(depth: float, velocity: float, dissipation: float) -> None:
    at_lower = mechanical_stop_torque(-1.0 - depth, velocity, -1.0, 1.0, 2000.0, dissipation)
    at_upper = mechanical_stop_torque(1.0 + depth, -velocity, -1.0, 1.0, 2000.0, dissipation)
    assert at_lower == -at_upper


def test_joint_bounces_off_its_stop_slower_than_it_came() -> None:
    inertia = 4.0

    def slope(_: float, state: np.ndarray) -> list[float]:
        return [state[1], mechanical_stop_torque(*state.tolist(), LOWER, UPPER, 2000.0, 0.5) / inertia]

    half_period = math.pi * math.sqrt(inertia / 2000.0)
    end = solve_ivp(slope, (0.0, 2.0 * half_period), [UPPER, 1.0], rtol=1e-9, atol=1e-12, max_step=1e-3)
    angle, velocity = end.y[:, -1]
    assert angle < UPPER
    assert -1.0 < velocity < -0.3


STIFF, DAMPED, COEFFICIENT, WEIGHT, MASS = 20e3, 100.0, 0.8, 50.0, 0.5  # the tip of a crutch under 50 N


def rubber(anchor: float) -> Arm:
    """Return an arm whose crutch sticks at a position."""
    limits, slack = (math.inf,) * 3, Grip(*(0.0,) * 8)
    delay_lines = new_delay_line(0), new_delay_line(0)
    return Arm(0, MASS, *limits, slack, *delay_lines, tip_stiffness=STIFF, tip_damping=DAMPED, anchor=anchor)


def pulled(force: float, seconds: float) -> tuple[float, float, float]:
    """Return position, speed and anchor of a tip that a force along the ground has pulled from rest."""
    position = speed = 0.0
    step, arm = 1e-5, rubber(0.0)
    for _ in range(round(seconds / step)):
        friction = anchored_friction_force(arm, position, speed, WEIGHT, COEFFICIENT)
        speed += step * (force + friction) / MASS
        position += step * speed
        arm.anchor = anchor_position(arm, position, WEIGHT, COEFFICIENT)
    return position, speed, arm.anchor


def test_tip_rests_under_less_than_friction_and_goes_back_no_farther_than_it_was_sheared() -> None:
    """Where regularised friction would creep: F / k, at rest."""
    position, speed, anchor = pulled(20.0, 0.5)
    assert_allclose(position, 20.0 / STIFF, rtol=1e-9)
    assert abs(speed) < 1e-12 and anchor == 0.0


def test_tip_slides_if_the_force_exceeds_friction() -> None:
    """(F - mu N) / m, over a time in which the rubber has sheared as far as it does."""
    early, late = pulled(60.0, 0.2), pulled(60.0, 0.4)
    assert_allclose((late[1] - early[1]) / 0.2, (60.0 - COEFFICIENT * WEIGHT) / MASS, rtol=1e-6)
    assert_allclose(late[0] - late[2], COEFFICIENT * WEIGHT / STIFF, rtol=1e-9)


@given(stretch=st.floats(-1.0, 1.0), slip=rates, normal=st.floats(0.0, 500.0))
def test_anchored_friction_stays_within_the_cone_and_is_reset_in_the_air(stretch, slip, normal) -> None:
    force = anchored_friction_force(rubber(0.0), stretch, slip, normal, COEFFICIENT)
    assert abs(force) <= COEFFICIENT * normal
    assert anchor_position(rubber(stretch), 0.3, 0.0, COEFFICIENT) == 0.3
