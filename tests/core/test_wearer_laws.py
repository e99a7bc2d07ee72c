"""Tests of the joint torques of the wearer against published numbers and independent arguments."""

from __future__ import annotations

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from errors import raises
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from twin_gait.core.wearer_torques import (
    find_grid_interval,
    passive_hip_torque,
    passive_knee_torque,
    spastic_torque,
)
from twin_gait.leg_model.anthropometry import SEGMENTS, SHANK_LENGTH, THIGH_LENGTH
from twin_gait.measures.reference import normative_moment, reference_curve, reference_cycle_time
from twin_gait.parameters.wearer import JointCondition, Patient
from twin_gait.vocabulary import JointName, Sex

# Hip flexion, knee flexion and ankle plantarflexion in whole degrees, over the ranges of walking and beyond.
POSTURES = [
    (0, 0, 0),
    (30, 5, 0),
    (20, 15, 5),
    (10, 20, -5),
    (0, 15, -10),
    (-10, 5, -12),
    (-15, 10, 0),
    (-5, 40, 20),
    (10, 60, 10),
    (25, 65, 0),
    (35, 40, -5),
    (30, 0, 0),
    (60, 90, 10),
    (90, 90, 0),
    (100, 120, -15),
    (45, 0, -20),
    (-20, 0, 30),
    (-25, 60, 15),
    (80, 10, -10),
    (5, -3, 0),
]


def power_of_e(*terms: str | int) -> Decimal:
    """e to a sum of coefficients times angles, given in turn after a constant."""
    constant, rest = Decimal(terms[0]), terms[1:]
    pairs = zip(rest[::2], rest[1::2], strict=True)
    return (constant + sum(Decimal(factor) * Decimal(angle) for factor, angle in pairs)).exp()


def published_hip(hip: int, knee: int) -> Decimal:
    """Table 1 of Riener and Edrich (1999), in decimals."""
    return (
        power_of_e("1.4655", "-0.0034", knee, "-0.0750", hip)
        - power_of_e("1.3403", "-0.0226", knee, "0.0305", hip)
        + Decimal("8.072")
    )


def published_knee(hip: int, knee: int, plantarflexion: int) -> Decimal:
    """The same for the knee; the paper counts plantarflexion positive."""
    return (
        power_of_e("1.800", "-0.0460", plantarflexion, "-0.0352", knee, "0.0217", hip)
        - power_of_e("-3.971", "-0.0004", plantarflexion, "0.0495", knee, "-0.0128", hip)
        - Decimal("4.820")
        + power_of_e("2.220", "-0.150", knee)
    )


@pytest.mark.parametrize("posture", POSTURES, ids=str)
def test_passive_torques_equal_riener_and_edrich(posture):
    getcontext().prec = 30
    hip, knee, plantarflexion = posture
    angles = math.radians(hip), math.radians(knee)
    assert passive_hip_torque(*angles) == pytest.approx(float(published_hip(hip, knee)), rel=1e-12, abs=1e-12)
    torque = passive_knee_torque(*angles, -math.radians(plantarflexion))
    assert torque == pytest.approx(float(published_knee(hip, knee, plantarflexion)), rel=1e-12, abs=1e-12)


def test_passive_torques_of_the_straight_leg_by_hand():
    """Hip: e^1.4655 = 4.3297, e^1.3403 = 3.8202. Knee: e^1.8 = 6.0496, e^-3.971 = 0.0189, e^2.22 = 9.2073."""
    assert passive_hip_torque(0.0, 0.0) == pytest.approx(4.3297 - 3.8202 + 8.072, abs=2e-4)
    assert passive_knee_torque(0.0, 0.0, 0.0) == pytest.approx(6.0496 - 0.0189 - 4.820 + 9.2073, abs=2e-4)


def test_passive_torques_resist_the_ends_of_the_range():
    """An extended joint is pulled into flexion and a flexed one into extension, the more the farther."""
    angles = np.radians(np.arange(-20.0, 121.0, 5.0))
    hip = np.array([passive_hip_torque(angle, 0.0) for angle in angles])
    knee = np.array([passive_knee_torque(0.0, angle, 0.0) for angle in angles[3:]])
    for torques in (hip, knee):
        assert (np.diff(torques) < 0.0).all()
        assert torques[0] > 0.0 > torques[-1]


@given(hip=st.floats(-0.4, 1.5), knee=st.floats(0.0, 1.5))
def test_hamstrings_bend_the_knee_of_a_flexed_hip_and_calves_that_of_a_dorsiflexed_ankle(hip, knee):
    """Muscles over two joints: these postures stretch them, and both flex the knee."""
    resting = passive_knee_torque(hip, knee, 0.0)
    assert passive_knee_torque(hip + 0.1, knee, 0.0) > resting
    assert passive_knee_torque(hip, knee, 0.1) > resting


speeds = st.floats(-20.0, 20.0)


@given(velocity=speeds, catch=st.floats(0.0, 5.0), gain=st.floats(0.0, 10.0))
def test_spastic_torque_is_odd_and_never_drives(velocity, catch, gain):
    torque = spastic_torque(velocity, catch, gain)
    assert torque == -spastic_torque(-velocity, catch, gain)
    assert torque * velocity <= 0.0
    if abs(velocity) <= catch:
        assert torque == 0.0


@given(velocity=speeds, change=st.floats(-1e-3, 1e-3), catch=st.floats(0.0, 5.0), gain=st.floats(0.0, 10.0))
def test_spastic_torque_has_no_jump(velocity, change, catch, gain):
    """Its slope is 0 or minus the gain everywhere, so it changes by no more than gain times change."""
    before, after = (spastic_torque(item, catch, gain) for item in (velocity, velocity + change))
    assert abs(after - before) <= gain * abs(change) + 1e-12


def test_spastic_torque_by_hand():
    """Caught at 1 rad/s, 2 N·m·s/rad: at 2.5 rad/s 3 N·m against the motion."""
    assert spastic_torque(2.5, 1.0, 2.0) == -3.0
    assert spastic_torque(-2.5, 1.0, 2.0) == 3.0


@example(angle=0.45, lowest=0.0, step=0.1, count=5)  # half a step beyond the last entry
@example(angle=-0.05, lowest=0.0, step=0.1, count=5)
@given(
    angle=st.floats(-3.0, 3.0),
    lowest=st.floats(-1.0, 0.0),
    step=st.floats(0.01, 0.2),
    count=st.integers(2, 60),
)
def test_place_in_a_table_interpolates_as_numpy_does(angle, lowest, step, count):
    values = np.random.default_rng(count).standard_normal(count)
    below, share = find_grid_interval(angle, lowest, step, count)
    assert 0 <= below <= count - 2
    assert 0.0 <= share <= 1.0
    looked_up = values[below] + share * (values[below + 1] - values[below])
    assert_allclose(looked_up, np.interp(angle, lowest + step * np.arange(count), values), atol=1e-9)


# ---------------------------------------------------------------- Winter's moments


def test_signs_of_winters_moments_match_his_description():
    """Winter (1991): both joints extend against the load of early stance (the knee after a first flexor
    moment), the hip pulls the leg forward at push-off, and extensors of the hip and flexors of the knee brake
    the leg before contact. Flexors are positive here."""
    assert (normative_moment("hip", np.arange(2.0, 17.0)) < 0.0).all()
    assert (normative_moment("knee", np.arange(6.0, 21.0)) < 0.0).all()
    assert (normative_moment("hip", np.arange(40.0, 65.0)) > 0.0).all()
    assert (normative_moment("hip", np.arange(90.0, 98.0)) < 0.0).all()
    assert (normative_moment("knee", np.arange(85.0, 98.0)) > 0.0).all()


def test_moments_repeat_with_the_cycle_and_pass_through_the_table():
    percent = np.array([0.0, 12.0, 50.0, 98.0])
    assert_allclose(normative_moment("knee", percent + 100.0), normative_moment("knee", percent), rtol=1e-12)
    assert_allclose(normative_moment("hip", np.array([2.0, 52.0])), [-0.385, 0.251], rtol=1e-12)
    between = normative_moment("knee", np.array([12.0, 13.0, 14.0]))
    assert between[1] == pytest.approx(0.5 * (between[0] + between[2]), rel=1e-12)


def swing_moments(speed: float, height: float, percent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments per body mass of a free leg on a hip that stands still, from Lagrange's equations.

    Thigh and shank with foot are two rods in a plane; their angles to the vertical, forward positive, are a,
    the hip's, and b, the hip's less the knee's. T = (I1 + m2 l²) a'²/2 + I2 b'²/2 + m2 l c2 a' b' cos(a - b).
    """
    thigh, shank, foot = (SEGMENTS[Sex.MALE][name] for name in ("thigh", "shank", "foot"))
    length, lower = THIGH_LENGTH * height, SHANK_LENGTH * height
    m1, m2 = thigh.mass, shank.mass + foot.mass
    c1 = thigh.centre_of_mass * length
    c2 = (shank.mass * shank.centre_of_mass + foot.mass) * lower / m2  # the foot as a point at the ankle
    i1 = m1 * (c1**2 + (thigh.transverse_radius * length) ** 2)
    i2 = lower**2 * (shank.mass * (shank.centre_of_mass**2 + shank.transverse_radius**2) + foot.mass)
    hip = reference_curve(JointName.HIP, percent, speed=speed, height=height)
    knee = reference_curve(JointName.KNEE, percent, speed=speed, height=height)
    dt = (percent[1] - percent[0]) / 100.0 * reference_cycle_time(speed, height)
    a, b = hip, hip - knee
    da, db = np.gradient(a, dt), np.gradient(b, dt)
    dda, ddb = np.gradient(da, dt), np.gradient(db, dt)
    coupling, g = m2 * length * c2, 9.81
    on_b = i2 * ddb + coupling * (dda * np.cos(a - b) - da**2 * np.sin(a - b)) + m2 * g * c2 * np.sin(b)
    on_a = (
        (i1 + m2 * length**2) * dda
        + coupling * (ddb * np.cos(a - b) + db**2 * np.sin(a - b))
        + (m1 * c1 + m2 * length) * g * np.sin(a)
    )
    return on_a + on_b, -on_b  # virtual work: b is hip less knee


def test_signs_of_winters_moments_swing_a_leg():
    """Inverse dynamics of a reference gait at Winter's slow speed, which shares nothing with his tables.

    The reference is a spline of few events with inaccurate accelerations, but it determines the sign.
    """
    percent = np.linspace(60.0, 102.0, 421)
    swing, braking = (percent >= 66.0) & (percent <= 97.0), (percent >= 93.0) & (percent <= 97.0)
    hip, knee = swing_moments(1.0, 1.75, percent)
    for name, moment in (("hip", hip), ("knee", knee)):
        winter = normative_moment(name, percent)
        assert np.corrcoef(moment[swing], winter[swing])[0, 1] > 0.5
        assert moment[braking].mean() * winter[braking].mean() > 0.0
    assert hip[swing][:60].mean() > 0.0 > hip[braking].mean()


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"passive": 3.5}, ("passive", "0", "3", "3.5")),
        ({"passive": math.nan}, ("passive", "0", "3")),
        ({"passive": 1.0, "contracture": 1.1}, ("contracture", "0", "1.047 rad", "60 deg", "1.1")),
        ({"contracture": 0.1}, ("contracture", "0")),
        ({"stretch_reflex_threshold": -1.0}, ("stretch_reflex_threshold", "0")),
        ({"stretch_reflex_gain": math.inf}, ("stretch_reflex_gain", "0")),
        ({"effort": 1.2}, ("effort", "0", "1")),
        ({"strength": -0.1}, ("strength", "0", "1")),
    ],
    ids=str,
)
def test_impossible_condition_is_refused(wrong, message):
    with raises(ValueError, *message):
        JointCondition(**wrong)


def test_wearer_without_torques_is_mass_alone():
    left_hip, right_knee = ("left", JointName.HIP), ("right", JointName.KNEE)
    idle = {
        left_hip: JointCondition(effort=1.0, strength=0.0),
        right_knee: JointCondition(effort=0.0),
    }
    assert Patient(conditions=idle).is_torque_free
    assert not Patient(conditions=idle | {left_hip: JointCondition(passive=0.1)}).is_torque_free


@pytest.mark.parametrize(
    ("idle", "needed"), [("strength", "effort"), ("stretch_reflex_threshold", "stretch_reflex_gain")]
)
def test_idle_conditions_have_no_effect(idle, needed):
    assert JointCondition(**{idle: 0.5}).is_torque_free
    assert not JointCondition(**{idle: 0.5, needed: 0.5}).is_torque_free
