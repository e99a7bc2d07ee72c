"""Friction of a joint: equation (3.1) of the thesis with the parameters of its table 3.1."""

from __future__ import annotations

import math

import numpy as np
import pytest
from errors import raises
from hypothesis import given, reject
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar
from twin_device import HIP_FRICTION, KNEE_FRICTION

from twin_gait.core.friction import gear_loss_torque, loss_share, rotational_friction_torque
from twin_gait.core.friction_models import REFERENCE_TEMPERATURE
from twin_gait.exceptions import ParameterError
from twin_gait.identification.laws import array_laws
from twin_gait.parameters.friction import FrictionParameters

# Table 3.1 of the thesis as printed: a, b in [N·m], c in [rad/s], d in [N·m·s/rad].
PRINTED_KNEE = (-1.743, -3.193, -0.2031, 2.06)
PRINTED_HIP = (1.664, 4.2, 0.2252, 2.26)

# Recomputed from that table with equation (3.1); velocity in [rad/s], torque in [N·m].
KNEE_CURVE = {0.039: 2.51, 0.130: 2.02, 0.5: 4.20, 1.0: 5.25, 2.0: 7.31, 3.0: 9.37}
HIP_CURVE = {0.039: 3.04, 0.148: 2.01, 0.5: 5.24, 1.0: 6.46, 2.0: 8.72, 3.0: 10.98}

velocities = st.floats(-20.0, 20.0)


@st.composite
def accepted_sets(draw: st.DrawFn) -> FrictionParameters:
    """Any set that :class:`FrictionParameters` accepts."""
    sign = draw(st.sampled_from([1.0, -1.0]))
    try:
        return FrictionParameters(
            breakaway_torque=sign * draw(st.floats(0.0, 30.0)),
            coulomb_friction=sign * draw(st.floats(0.0, 30.0)),
            breakaway_velocity=sign * draw(st.floats(0.01, 2.0)),
            viscous_friction=draw(st.floats(0.0, 20.0)),
        )
    except ParameterError:
        reject()


friction_sets = accepted_sets()


def friction_torque(velocity: float, parameters: FrictionParameters) -> float:
    return rotational_friction_torque(
        velocity,
        parameters.breakaway_torque,
        parameters.coulomb_friction,
        parameters.breakaway_velocity,
        parameters.viscous_friction,
    )


def test_shipped_parameters_are_table_3_1_as_printed() -> None:
    for parameters, printed in ((KNEE_FRICTION, PRINTED_KNEE), (HIP_FRICTION, PRINTED_HIP)):
        assert printed == (
            parameters.breakaway_torque,
            parameters.coulomb_friction,
            parameters.breakaway_velocity,
            parameters.viscous_friction,
        )


@pytest.mark.parametrize(
    ("parameters", "curve"), [(KNEE_FRICTION, KNEE_CURVE), (HIP_FRICTION, HIP_CURVE)], ids=["knee", "hip"]
)
def test_table_3_1_reproduces_its_torques(parameters: FrictionParameters, curve: dict[float, float]) -> None:
    torques = [friction_torque(velocity, parameters) for velocity in curve]
    assert_allclose(torques, list(curve.values()), atol=0.005)  # printed with two decimals


@pytest.mark.parametrize(
    ("parameters", "maximum", "minimum"),
    [(KNEE_FRICTION, (0.039, 2.51), (0.130, 2.02)), (HIP_FRICTION, (0.039, 3.04), (0.148, 2.01))],
    ids=["knee", "hip"],
)
def test_friction_has_a_dip_between_a_peak_and_the_viscous_rise(
    parameters: FrictionParameters, maximum: tuple[float, float], minimum: tuple[float, float]
) -> None:
    """Break-away lies below Coulomb in table 3.1, so the exponential term is a dip."""
    peak = minimize_scalar(lambda v: -friction_torque(v, parameters), bounds=(0.005, 0.08), method="bounded")
    dip = minimize_scalar(lambda v: friction_torque(v, parameters), bounds=(0.08, 0.3), method="bounded")
    assert_allclose([peak.x, -peak.fun], maximum, atol=0.005)
    assert_allclose([dip.x, dip.fun], minimum, atol=0.005)


@given(velocity=velocities, parameters=friction_sets)
def test_friction_is_odd_in_the_velocity(velocity: float, parameters: FrictionParameters) -> None:
    assert friction_torque(-velocity, parameters) == -friction_torque(velocity, parameters)


@given(velocity=velocities)
def test_negative_printed_set_is_the_positive_law(velocity: float) -> None:
    a, b, c, d = PRINTED_KNEE
    positive = rotational_friction_torque(velocity, -a, -b, -c, d)
    assert_allclose(friction_torque(velocity, KNEE_FRICTION), positive, rtol=1e-14, atol=0.0)
    assert_allclose(friction_torque(velocity, KNEE_FRICTION.normalised()), positive, rtol=0.0, atol=0.0)


def test_normalised_set_has_positive_a_b_and_c() -> None:
    law = KNEE_FRICTION.normalised()
    assert (law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity) == (1.743, 3.193, 0.2031)
    assert law.normalised() is law


@given(velocity=velocities, parameters=friction_sets)
def test_friction_never_injects_power(velocity: float, parameters: FrictionParameters) -> None:
    """−T_fr acts on the plant, so its power is −T_fr·ω ≤ 0 for every accepted set."""
    assert -friction_torque(velocity, parameters) * velocity <= 0.0


def test_a_set_whose_dip_would_drive_the_joint_is_refused() -> None:
    """Without break-away and viscous friction the dip reaches through zero at ω = c/√2."""
    dip = min(rotational_friction_torque(v, 0.0, 5.0, 0.2, 0.0) for v in np.linspace(0.1, 0.2, 2001))
    assert dip < 0.0
    with raises(ParameterError, "breakaway_torque", "0.0"):
        FrictionParameters(
            breakaway_torque=0.0, coulomb_friction=5.0, breakaway_velocity=0.2, viscous_friction=0.0
        )


@given(a=st.floats(0.1, 30.0), share=st.floats(0.0, 0.99), c=st.floats(0.01, 2.0))
def test_stribeck_peak_is_a_minus_b_at_c_over_root_two(a: float, share: float, c: float) -> None:
    """√(2e)·x·exp(−x²) has the maximum 1 at x = 1/√2; with a > b it is a Stribeck peak."""
    b = share * a
    peak = c / math.sqrt(2.0)

    def stribeck(velocity: float) -> float:
        return rotational_friction_torque(velocity, a, b, c, 0.0) - b * math.tanh(10.0 * velocity / c)

    assert_allclose(stribeck(peak), a - b, rtol=1e-12)
    assert stribeck(0.95 * peak) < stribeck(peak) > stribeck(1.05 * peak)


@given(parameters=friction_sets)
def test_fast_joint_has_only_coulomb_and_viscous_friction(parameters: FrictionParameters) -> None:
    law = parameters.normalised()
    velocity = 10.0 * law.breakaway_velocity  # exp(−100) is far below double precision
    expected = law.coulomb_friction + law.viscous_friction * velocity
    assert_allclose(friction_torque(velocity, parameters), expected, rtol=1e-12, atol=1e-12)


def test_joint_at_rest_has_no_friction() -> None:
    assert friction_torque(0.0, KNEE_FRICTION) == 0.0


@given(velocity=velocities, ratio=st.floats(0.0, 3.0))
def test_scaled_friction_is_the_ratio_times_the_law(velocity: float, ratio: float) -> None:
    scaled = HIP_FRICTION.scaled(ratio)
    assert_allclose(
        friction_torque(velocity, scaled),
        ratio * friction_torque(velocity, HIP_FRICTION),
        rtol=1e-12,
        atol=1e-12,
    )


@pytest.mark.parametrize(
    "wrong",
    [
        {"breakaway_velocity": 0.0},
        {"breakaway_velocity": math.nan},
        {"breakaway_velocity": math.inf},
        {"viscous_friction": -0.1},
        {"viscous_friction": math.inf},
        {"breakaway_torque": -1.0},
        {"coulomb_friction": -1.0},
        {"breakaway_torque": math.nan},
    ],
    ids=str,
)
def test_a_set_that_would_drive_the_joint_is_refused(wrong: dict[str, float]) -> None:
    values = {
        "breakaway_torque": 1.7,
        "coulomb_friction": 3.2,
        "breakaway_velocity": 0.2,
        "viscous_friction": 2.0,
    }
    with pytest.raises(ParameterError) as caught:
        FrictionParameters(**{**values, **wrong})
    assert next(iter(wrong)) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_signs_of_a_b_and_c_must_agree() -> None:
    with raises(ParameterError, "breakaway_torque", "-1.7"):
        FrictionParameters(
            breakaway_torque=1.7, coulomb_friction=3.2, breakaway_velocity=-0.2, viscous_friction=2.0
        )


efficiencies = st.floats(0.5, 1.0)


@given(st.floats(0.5, 60.0), st.floats(0.2, 3.0), efficiencies)
def test_gear_has_its_efficiency_in_either_direction(torque: float, velocity: float, eta: float) -> None:
    """Driving, the joint gets η of the motor's power; driven backwards, the motor η of the joint's."""
    for way in (1.0, -1.0):
        driven = way * torque - gear_loss_torque(way * velocity, way * torque, eta, 1e-3)
        assert driven == pytest.approx(way * eta * torque, rel=1e-12)
        braked = way * torque - gear_loss_torque(-way * velocity, way * torque, eta, 1e-3)
        assert braked * eta == pytest.approx(way * torque, rel=1e-12)


def test_gear_loss_by_hand() -> None:
    """η 0.8 of 40 N·m: 8 lost driving, 10 driven; A 0.225, B 0.025, and tanh 1 = 0.761594 at ω_t."""
    assert gear_loss_torque(3.0, 40.0, 0.8, 0.02) == pytest.approx(8.0, rel=1e-12)
    assert gear_loss_torque(-3.0, 40.0, 0.8, 0.02) == pytest.approx(-10.0, rel=1e-12)
    assert gear_loss_torque(0.02, 40.0, 0.8, 0.02) == pytest.approx(6.274320, abs=1e-5)
    assert gear_loss_torque(-0.02, 40.0, 0.8, 0.02) == pytest.approx(-7.434372, abs=1e-5)
    assert gear_loss_torque(0.0, 40.0, 0.8, 0.02) == 0.0
    assert gear_loss_torque(3.0, 40.0, 1.0, 0.02) == 0.0


@given(velocities, st.floats(-60.0, 60.0), efficiencies, st.floats(0.001, 0.2))
def test_gear_loses_power_in_either_direction(
    velocity: float, load: float, eta: float, transition_velocity: float
) -> None:
    torque = gear_loss_torque(velocity, load, eta, transition_velocity)
    assert torque * velocity >= 0.0
    assert abs(torque) <= (1.0 / eta - 1.0) * abs(load) * (1.0 + 1e-12) + 1e-300
    assert gear_loss_torque(-velocity, -load, eta, transition_velocity) == -torque


@given(st.floats(-60.0, 60.0), efficiencies)
def test_gear_loss_turns_over_smoothly_and_only_grows_with_the_speed(load: float, eta: float) -> None:
    """One slope on either side of rest, (1/η - η)/2 |τ| / ω_t, and no hump before the gear surely turns."""
    step = 1e-9
    slopes = [gear_loss_torque(way * step, load, eta, 0.02) / (way * step) for way in (1.0, -1.0)]
    expected = 0.5 * (1.0 / eta - eta) * abs(load) / 0.02
    assert slopes == pytest.approx([expected, expected], rel=1e-6, abs=1e-6)
    losses = [gear_loss_torque(velocity, load, eta, 0.02) for velocity in np.linspace(-0.2, 0.2, 201)]
    assert (np.diff(losses) >= -1e-12).all()


@given(st.floats(-1.0, 1.0), efficiencies)
def test_share_of_the_load_leaves_the_rotor_a_positive_inertia(direction: float, eta: float) -> None:
    """From 1 - 1/η to 1 - η, and zero at rest: the inertia (1 - c) J stays above 0."""
    for sign in (-1.0, 1.0):
        assert 1.0 - 1.0 / eta - 1e-15 <= loss_share(direction, sign, eta) <= 1.0 - eta + 1e-15
        assert loss_share(sign, 1.0, eta) == pytest.approx(1.0 - eta**sign, abs=1e-15)
        assert loss_share(0.0, sign, eta) == 0.0


def test_gear_with_symmetric_losses_matches_the_identified_model_of_loaded_joints() -> None:
    """The mean of driving and driven is A |τ| t, the load term of the law for identification, ω_t = c/10."""
    velocity, load = np.meshgrid(np.linspace(-2.0, 2.0, 41), np.linspace(-50.0, 50.0, 11))
    eta = 0.85
    cold = np.full_like(velocity, REFERENCE_TEMPERATURE)
    term = array_laws.load_and_temperature_torque(
        velocity, load, cold, 0.0, 0.5 * (1.0 / eta - eta), 0.0, 0.0, 0.0, 0.02
    )
    ours = [
        0.5 * (gear_loss_torque(v, tau, eta, 0.02) + gear_loss_torque(v, -tau, eta, 0.02))
        for v, tau in zip(velocity.ravel().tolist(), load.ravel().tolist(), strict=True)
    ]
    assert_allclose(ours, term.ravel(), rtol=1e-12, atol=1e-12)
