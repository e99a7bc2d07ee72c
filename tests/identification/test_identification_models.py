"""Friction laws against published forms and closed solutions; every model's derivative by differences."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from twin_gait.core.friction import advance_deflection, friction_torque, rotational_friction_torque
from twin_gait.core.friction_models import bristle_rate, bristle_step
from twin_gait.identification.fitting import bounds
from twin_gait.identification.identify import inherited_starts
from twin_gait.identification.laws import MODELS, array_laws, bristle_deflection, initial_deflection_share
from twin_gait.identification.models import FrictionTest, Samples, join_tests
from twin_gait.identification.writing import PARAMETER_FILES, PLANT_FILE, law_of

SPEEDS = np.linspace(-3.0, 3.0, 241)


def samples(number: int = 200) -> Samples:
    time = 0.01 * np.arange(number)
    velocity = 2.0 * np.sin(3.0 * time + 0.3) + 0.4 * np.cos(11.0 * time)
    return join_tests(
        [
            FrictionTest(
                name="synthetic",
                velocity=velocity,
                torque=np.sign(velocity) + velocity,
                used=np.ones(number, dtype=bool),
                time=time,
                angle=1.2 * time,
                load=5.0 * np.cos(time),
                temperature=25.0 + 3.0 * time,
            )
        ]
    )


def vector(name: str, seed: int, rows: Samples) -> np.ndarray:
    """Random parameters well inside the bounds of a model."""
    model, rng = MODELS[name], np.random.default_rng(seed)
    low, high = bounds(model, rows, physical=False)
    count = len(model.coefficients)
    x = rng.uniform(0.5, 3.0, model.size)
    x[count:] = low[count:] + rng.uniform(0.4, 0.6, model.size - count) * (high - low)[count:]
    return x


def test_rotational_law_equals_the_law_of_the_plant():
    expected = [rotational_friction_torque(w, 1.743, 3.193, 0.2031, 2.06) for w in SPEEDS]
    assert_allclose(
        array_laws.two_velocity_torque(SPEEDS, 1.743, 3.193, 2.06, 0.2031, 0.02031),
        expected,
        rtol=1e-12,
        atol=1e-12,
    )


def test_simscape_form_reaches_the_breakaway_torque_at_its_velocity():
    """Without viscous friction the documented block passes T_brk + (tanh 10 - 1) T_C at ω_brk."""
    brk, coulomb, speed = 25.0, 20.0, 0.1
    torque = array_laws.two_velocity_torque(
        np.array([speed]), brk, coulomb, 0.0, math.sqrt(2.0) * speed, speed / 10.0
    )
    assert_allclose(torque, (brk - coulomb) + coulomb * math.tanh(10.0), rtol=1e-12)


def test_table_3_1_of_the_knee_is_the_same_law_in_both_signs():
    assert_allclose(
        array_laws.two_velocity_torque(SPEEDS, -1.743, -3.193, 2.06, -0.2031, -0.02031),
        array_laws.two_velocity_torque(SPEEDS, 1.743, 3.193, 2.06, 0.2031, 0.02031),
        atol=1e-12,
    )


def test_stribeck_runs_from_breakaway_to_coulomb_friction():
    w = np.array([1e-12, 0.1, 50.0])
    torque = array_laws.coulomb_viscous_torque(w, array_laws.stribeck_level(w, 2.0, 3.0, 0.1, 2.0), 0.0)
    assert_allclose(torque, [3.0, 2.0 + math.exp(-1.0), 2.0], rtol=1e-9)


def test_old_model_of_twin_at_one_fortieth_equals_tanh_of_one():
    assert_allclose(
        array_laws.coulomb_viscous_tanh_torque(np.array([1 / 40]), 3.0, 2.0, 40.0),
        3.0 * math.tanh(1.0) + 0.05,
    )


def test_conditioned_friction_falls_with_warmth_and_grows_with_load():
    w, one = np.array([5.0]), np.ones(1)
    base = array_laws.load_and_temperature_torque(w, 0 * one, 25 * one, 3.0, 0.1, -0.02, 2.0, -0.05, 0.01)
    assert_allclose(base, 13.0)
    assert_allclose(
        array_laws.load_and_temperature_torque(w, -10 * one, 25 * one, 3.0, 0.1, -0.02, 2.0, -0.05, 0.01)
        - base,
        1.0,
    )
    warm = array_laws.load_and_temperature_torque(w, 0 * one, 35 * one, 3.0, 0.1, -0.02, 2.0, -0.05, 0.01)
    assert_allclose(warm - base, -0.2 - 2.5)


def test_asymmetric_friction_contains_the_symmetric_laws():
    viscous = array_laws.directional_viscous_torque(SPEEDS, 2.0, 2.0, 1.0)
    plain = array_laws.asymmetric_torque(SPEEDS, 0.0, 3.0, 1 / 40, viscous)
    assert_allclose(plain, array_laws.coulomb_viscous_tanh_torque(SPEEDS, 3.0, 2.0, 40.0), atol=1e-12)
    backward = array_laws.directional_viscous_torque(np.array([-2.0, 2.0]), 1.0, 3.0, 0.5)
    assert_allclose(backward, [-3.0 * math.sqrt(2.0), math.sqrt(2.0)])


@pytest.mark.parametrize("speed", [0.3, -0.02])
def test_bristle_steps_are_the_solution_of_the_differential_equation(speed):
    level, stiffness, start, period = 2.0, 400.0, 0.001, 0.004
    exact = solve_ivp(
        lambda t, z: [bristle_rate(speed, z[0], level, stiffness)],
        (0.0, period),
        [start],
        rtol=1e-11,
        atol=1e-14,
    ).y[0, -1]
    assert_allclose(bristle_step(speed, start, level, stiffness, period), exact, rtol=1e-8)
    halves = bristle_step(
        speed, bristle_step(speed, start, level, stiffness, period / 2), level, stiffness, period / 2
    )
    assert_allclose(halves, exact, rtol=1e-8)


def test_bristles_stay_bent_at_rest():
    assert bristle_step(0.0, 0.003, 2.0, 400.0, 1.0) == 0.003


def test_lugre_slides_as_stribeck_friction():
    """In steady sliding σ0 z = g(ω) sgn ω and ż = 0 (Canudas de Wit et al. 1995)."""
    time = np.arange(4000) * 0.001
    w = np.full(4000, 0.05)
    level = array_laws.stribeck_level(w, 1.0, 1.5, 0.1, 2.0)
    z = bristle_deflection(w, np.full(4000, 0.001), time < 0.0005, level, 1e4)
    rate = np.array([bristle_rate(*item, 1e4) for item in zip(w, z, level, strict=True)])
    torque = array_laws.lugre_torque(w, z, rate, 1e4, 100.0, 0.4)
    assert_allclose(torque[-1:], array_laws.coulomb_viscous_torque(w[-1:], level[-1:], 0.4), rtol=1e-9)


def test_dahl_loop_of_small_motion_is_the_closed_form():
    """From rest in one direction: F = T_c (1 - exp(-σ0 x / T_c))."""
    x = np.linspace(0.0, 0.01, 500)
    w = np.gradient(x, 0.01)
    z, forces, law = 0.0, [], 300.0
    for speed in w[1:]:
        z = bristle_step(speed, z, 2.0, law, 0.01)
        forces.append(law * z)
    assert_allclose(forces, 2.0 * (1.0 - np.exp(-law * x[1:] / 2.0)), rtol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_derivative_of_every_model_equals_finite_differences(name):
    """Five-point differences of the prediction, a step and an order apart from the fitter's own."""
    rows, model = samples(), MODELS[name]
    x = vector(name, 3, rows)
    matrix = model.jacobian(x, rows)
    for index in range(model.size):
        step = np.zeros(model.size)
        step[index] = h = 1e-3

        def at(k, step=step):
            return model.predict(x + k * step, rows)

        expected = (at(-2) - 8 * at(-1) + 8 * at(1) - at(2)) / (12 * h)
        assert_allclose(matrix[:, index], expected, atol=2e-5 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_linear_in_its_coefficients(name):
    rows, model = samples(), MODELS[name]
    beta, eta = model.split(vector(name, 5, rows))
    linear = model.basis(eta, rows) @ beta + model.constant(eta, rows)
    assert_allclose(linear, model.torque(rows, beta, eta), atol=1e-11)
    if not model.dynamic:
        assert not model.constant(eta, rows).any()


def test_an_initial_deflection_decays_as_the_differential_equation_predicts():
    time = np.arange(300) * 0.002
    w = 0.05 * np.cos(9 * time)
    level, fresh = np.full(300, 2.0), time < 0.001
    straight = bristle_deflection(w, np.full(300, 0.002), fresh, level, 400.0)
    left = initial_deflection_share(w, np.full(300, 0.002), fresh, level, 400.0)
    z = 0.004
    for i in range(1, 300):
        z = bristle_step(w[i], z, 2.0, 400.0, 0.002)
        assert_allclose(straight[i] + 0.004 * left[i], z, atol=1e-14)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_reports_as_many_parameters_as_it_has(name):
    model = MODELS[name]
    reported = model.parameters(vector(name, 7, samples()))
    assert len(reported) == model.size == len(set(model.names))


@pytest.mark.parametrize(
    ("child", "parent", "tolerance"),
    [
        ("asymmetric", "coulomb_viscous_tanh", 1e-12),
        ("asymmetric_stribeck", "asymmetric", 1e-12),
        ("asymmetric_stribeck", "stribeck", 1e-3),
        ("load_dependent", "coulomb_viscous_tanh", 1e-12),
        ("temperature_dependent", "coulomb_viscous_tanh", 1e-12),
        ("load_temperature_dependent", "temperature_dependent", 1e-12),
        ("load_temperature_dependent", "load_dependent", 1e-12),
        ("lugre", "dahl", 1e-12),
        ("lugre_asymmetric", "lugre", 1e-12),
    ],
)
def test_a_model_starts_from_the_law_of_a_simpler_one(child, parent, tolerance):
    rows = samples()
    x = vector(parent, 11, rows)
    (start,) = inherited_starts(child, {parent: x})
    expected = MODELS[parent].predict(x, rows)
    assert_allclose(MODELS[child].predict(start, rows), expected, atol=tolerance * np.abs(expected).max())


def test_coulomb_viscous_friction_is_odd():
    assert_allclose(
        array_laws.coulomb_viscous_torque(-SPEEDS, 3.0, 2.0),
        -array_laws.coulomb_viscous_torque(SPEEDS, 3.0, 2.0),
    )


@pytest.mark.parametrize("name", PARAMETER_FILES[PLANT_FILE])
def test_a_plant_with_an_identified_law_has_the_identified_torque(name):
    """Sample by sample, bristles bent by the way from each to the next."""
    rows, model = samples(), MODELS[name]
    x = np.abs(vector(name, 4, rows))  # no negative friction
    count = len(model.coefficients)
    x[count:] = np.log(np.clip(np.exp(vector(name, 4, rows)[count:]), 1e-3, 1e3))
    if name.startswith(("asymmetric", "lugre_")):
        x[count - 1] = 0.1  # an offset below what it adds to
    friction = law_of(PARAMETER_FILES[PLANT_FILE][name], model.parameters(x)).to_plant_friction()
    # A test whose first torque is not the bristles' starts with straight ones.
    directions = (friction.viscous_friction_forward, friction.viscous_friction_backward)
    rest = array_laws.directional_viscous_torque(rows.velocity[0], *directions, friction.viscous_exponent)
    clean = replace(rows, torque=np.full(len(rows), rest + friction.offset))
    z, torques = 0.0, []
    for velocity, period, fresh in zip(rows.velocity, rows.period, rows.fresh, strict=True):
        z = 0.0 if fresh else advance_deflection(friction, velocity * period, velocity, z)
        torques.append(friction_torque(friction, velocity, z))
    assert_allclose(torques, model.predict(x, clean), rtol=1e-9, atol=1e-12)
