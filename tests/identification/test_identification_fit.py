"""The fitter: reference problems of NIST, scipy's curve_fit, recovery of parameters, honest intervals.

All friction data here are synthetic, made by formulas written out in the tests.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from friction_bench import HIP, KNEE, rotational
from numpy.testing import assert_allclose
from scipy.optimize import curve_fit, least_squares
from scipy.special import huber

from twin_gait.exceptions import ParameterError
from twin_gait.identification import fitting
from twin_gait.identification.fitting import Fit, FitOptions, Loss, bounds, fit_model, refine, refit
from twin_gait.identification.identify import IdentificationOptions, identify_tests
from twin_gait.identification.laws import MODELS
from twin_gait.identification.models import FrictionModel, FrictionTest, ShapeParameter, join_tests
from twin_gait.identification.statistics import goodness, uncertainty

ROTATIONAL = (
    "breakaway_torque_Nm",
    "coulomb_friction_Nm",
    "breakaway_velocity_rad_per_s",
    "viscous_friction_Nms_per_rad",
)
LEAST_SQUARES = FitOptions(loss=Loss.LINEAR)

# Data and certified values of the NIST Statistical Reference Datasets, nonlinear regression.
MISRA_X = [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0]
MISRA_Y = [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78]
NIST = {
    "Misra1a": (
        lambda x, b, e: b[0] * (1 - np.exp(-e[0] * x)),
        MISRA_X,
        MISRA_Y,
        (2.3894212918e02, 5.5015643181e-04),
        (2.7070075241e00, 7.2668688436e-06),
        1.2455138894e-01,
    ),
    "Misra1b": (
        lambda x, b, e: b[0] * (1 - (1 + e[0] * x / 2) ** -2),
        MISRA_X,
        MISRA_Y,
        (3.3799746163e02, 3.9039091287e-04),
        (3.1643950207e00, 4.2547321834e-06),
        7.5464681533e-02,
    ),
    "Misra1c": (
        lambda x, b, e: b[0] * (1 - (1 + 2 * e[0] * x) ** -0.5),
        MISRA_X,
        MISRA_Y,
        (6.3642725809e02, 2.0813627256e-04),
        (4.6638326572e00, 1.7728423155e-06),
        4.0966836971e-02,
    ),
    "DanWood": (
        lambda x, b, e: b[0] * x ** e[0],
        [1.309, 1.471, 1.490, 1.565, 1.611, 1.680],
        [2.138, 3.421, 3.597, 4.340, 4.882, 5.660],
        (7.6886226176e-01, 3.8604055871e00),
        (1.8281973860e-02, 5.1726610913e-02),
        4.3173084083e-03,
    ),
    "BoxBOD": (
        lambda x, b, e: b[0] * (1 - np.exp(-e[0] * x)),
        [1, 2, 3, 5, 7, 10],
        [109, 149, 149, 191, 213, 224],
        (2.1380940889e02, 5.4723748542e-01),
        (1.2354515176e01, 1.0455993237e-01),
        1.1680088766e03,
    ),
}


def friction_tests(
    law,
    seed: int,
    *,
    number: int = 9,
    length: int = 300,
    noise: float = 0.1,
    spread: float = 0.0,
    top: float = 2.5,
):
    """Synthetic tests at 100 Hz: swings of several speeds, white noise, an offset that a test keeps."""
    rng = np.random.default_rng(seed)
    time = np.arange(length) / 100.0
    found = []
    for index in range(number):
        speed = top * (index + 1) / number
        velocity = speed * np.sin(2 * np.pi * (0.4 + 0.03 * index) * time + rng.uniform(0, 6))
        torque = law(velocity) + noise * rng.normal(size=length) + spread * rng.normal()
        found.append(FrictionTest(f"test {index}", velocity, torque, np.ones(length, dtype=bool), time=time))
    return found


@pytest.mark.parametrize("name", NIST)
def test_nist_reference_problems_are_solved_to_six_digits(name):
    law, x, y, certified, deviations, sse = NIST[name]
    model = FrictionModel(
        name=name,
        formula="",
        coefficients=("b1",),
        shape=(ShapeParameter("b2", 1e-6, 1e2),),
        torque=lambda samples, b, e: law(samples.velocity, b, e),
    )
    number = len(x)
    samples = join_tests(
        [FrictionTest(name, np.array(x, float), np.array(y, float), np.ones(number, dtype=bool))]
    )
    fit = fit_model(model, samples, LEAST_SQUARES)
    assert_allclose(list(model.parameters(fit.x).values()), certified, rtol=1e-6)
    left = fit.residuals(samples)
    assert_allclose(left @ left, sse, rtol=1e-6)
    errors = uncertainty(fit, samples, 0).standard_errors
    assert_allclose(list(errors.values()), deviations, rtol=1e-4)


def test_statistics_agree_with_scipys_curve_fit():
    samples = join_tests(friction_tests(lambda w: rotational(w, KNEE), 4))
    fit = fit_model(MODELS["rotational"], samples, LEAST_SQUARES)
    found = fit.model.parameters(fit.x)
    best, covariance = curve_fit(
        lambda w, *law: rotational(w, law), samples.velocity, samples.torque, p0=KNEE
    )
    assert_allclose([found[name] for name in ROTATIONAL], best, rtol=1e-5)
    errors = uncertainty(fit, samples, 0).standard_errors
    assert_allclose([errors[name] for name in ROTATIONAL], np.sqrt(np.diag(covariance)), rtol=1e-3)


def test_hubers_loss_agrees_with_scipys_least_squares():
    rng = np.random.default_rng(8)
    samples = join_tests(friction_tests(lambda w: rotational(w, KNEE) + 3 * (rng.random(w.shape) < 0.05), 5))
    fit = fit_model(MODELS["rotational"], samples, FitOptions())
    result = least_squares(
        lambda law: rotational(samples.velocity, law) - samples.torque,
        KNEE,
        loss="huber",
        f_scale=_threshold_of_minimum(fit, samples),
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
    )
    found = fit.model.parameters(fit.x)
    assert_allclose([found[name] for name in ROTATIONAL], result.x, rtol=1e-4)


def _threshold_of_minimum(fit: Fit, samples) -> float:
    assert fit.threshold < math.inf
    return fit.threshold


@pytest.mark.parametrize("law", [KNEE, HIP])
def test_table_3_1_is_recovered_without_noise(law):
    samples = join_tests(friction_tests(lambda w: rotational(w, law), 1, noise=0.0))
    fit = fit_model(MODELS["rotational"], samples, FitOptions())
    found = fit.model.parameters(fit.x)
    assert_allclose([found[name] for name in ROTATIONAL], law, rtol=1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_recovered_from_its_own_noisy_data(name):
    """The error of the fit is that of the truth, which means that no start was missed."""
    model, rng = MODELS[name], np.random.default_rng(2)
    tests = [
        replace(
            test,
            velocity=test.velocity * (1.0 - np.exp(-5.0 * test.time)),  # from rest, bristles unbent
            load=6.0 * np.cos(test.time * (1 + number)),
            temperature=20.0 + 2.0 * number + test.time,
            angle=np.cumsum(test.velocity) / 100.0,
        )
        for number, test in enumerate(friction_tests(lambda w: 0 * w, 3, number=6, noise=0.0))
    ]
    samples = join_tests(tests)
    truth = TRUTHS[name]
    clean = model.predict(truth, samples)
    noise = np.where(samples.fresh, 0.0, 0.05 * rng.normal(size=len(samples)))
    noisy = replace(samples, torque=clean + noise)
    fit = fit_model(model, noisy, LEAST_SQUARES)
    best = np.sum(fit.residuals(noisy) ** 2)
    assert best <= np.sum((noisy.torque - model.predict(truth, noisy)) ** 2) * (1 + 1e-9)
    apart = model.predict(fit.x, noisy) - model.predict(truth, noisy)
    assert np.sqrt(np.mean(apart**2)) < 0.02


def _x(beta, eta=()):
    return np.concatenate([beta, np.log(eta)])


TRUTHS = {
    "coulomb_viscous": _x([3.0, 2.0]),
    "coulomb_viscous_tanh": _x([3.0, 2.0], [40.0]),
    "stribeck": _x([1.0, 3.0, 2.0], [0.2, 1.5]),
    "rotational": _x([1.5, 3.0, 2.0], [0.3]),
    "rotational_simscape": _x([1.5, 3.0, 2.0], [0.2]),
    "load_dependent": _x([3.0, 2.0, 0.15], [0.03]),
    "temperature_dependent": _x([3.0, 2.0, -0.03, -0.04], [0.03]),
    "load_temperature_dependent": _x([3.0, 2.0, 0.15, -0.03, -0.04], [0.03]),
    "asymmetric": _x([3.0, 2.0, 1.4, 0.3], [0.03]),
    "asymmetric_stribeck": _x([1.5, 3.0, 2.0, 1.4, 0.3], [0.02, 0.3, 2.0, 0.7]),
    "position_ripple": _x([3.0, 2.0, 0.1, 0.5, -0.4], [0.03, 14.0]),
    "dahl": _x([3.0, 2.0], [40.0]),
    "lugre": _x([3.0, 0.3, 2.0], [60.0, 1.5, 0.3]),
    "lugre_asymmetric": _x([3.0, 0.3, 2.0, 1.4, 0.3], [60.0, 1.5, 0.3, 2.0, 0.7]),
}


def test_outliers_pull_least_squares_but_not_hubers_loss():
    rng = np.random.default_rng(0)
    samples = join_tests(friction_tests(lambda w: rotational(w, KNEE), 6))
    wrong = rng.random(len(samples)) < 0.03
    spoilt = replace(samples, torque=samples.torque + np.where(wrong, 25.0, 0.0))
    errors = {}
    for loss in Loss:
        fit = fit_model(MODELS["rotational"], spoilt, FitOptions(loss=loss))
        truth = rotational(samples.velocity, KNEE)
        errors[loss] = float(np.sqrt(np.mean((fit.model.predict(fit.x, samples) - truth) ** 2)))
    assert errors[Loss.HUBER] < 0.03 < 0.15 < errors[Loss.LINEAR]


def test_a_physical_fit_has_no_dip_and_no_negative_friction():
    samples = join_tests(friction_tests(lambda w: rotational(w, KNEE), 7))
    free = fit_model(MODELS["rotational"], samples, FitOptions())
    bound = fit_model(MODELS["rotational"], samples, FitOptions(physical=True))
    found = bound.model.parameters(bound.x)
    dipped = free.model.parameters(free.x)
    assert dipped["breakaway_torque_Nm"] < dipped["coulomb_friction_Nm"]
    assert found["breakaway_torque_Nm"] >= found["coulomb_friction_Nm"] >= 0.0
    assert np.sum(bound.residuals(samples) ** 2) > np.sum(free.residuals(samples) ** 2)


def test_refining_never_raises_the_loss():
    samples = join_tests(friction_tests(lambda w: rotational(w, HIP), 9))
    model, rng = MODELS["lugre_asymmetric"], np.random.default_rng(1)
    limits = bounds(model, samples, physical=False)
    for _ in range(5):
        start = np.concatenate([rng.normal(size=5), np.log([300.0, 1.2, 0.2, 2.0, 1.0])])
        before = np.sum(huber(0.5, samples.torque - model.predict(start, samples)))
        end = refine(model, samples, start, limits, 0.5)
        assert np.sum(huber(0.5, samples.torque - model.predict(end, samples))) <= before


def test_goodness_of_fit_equals_its_formulas():
    measured, left = np.array([1.0, 2.0, 4.0, 5.0]), np.array([0.5, -0.5, 0.5, -0.5])
    found = goodness(measured, left, 2)
    assert (found.sse, found.rmse, found.residual_standard_error) == (1.0, 0.5, math.sqrt(0.5))
    assert found.r_squared == 1.0 - 1.0 / 10.0
    assert_allclose(found.adjusted_r_squared, 1.0 - 0.1 * 3 / 2)
    assert_allclose(found.bic - found.aic, 3 * (math.log(4) - 2))


def test_one_step_bootstrap_spreads_as_full_fits_do():
    tests = friction_tests(lambda w: rotational(w, KNEE), 12, number=20, length=150, spread=0.15)
    samples = join_tests(tests)
    fit = fit_model(MODELS["rotational"], samples, FitOptions())
    known = uncertainty(fit, samples, 0)
    rng, found = np.random.default_rng(5), []
    for _ in range(150):
        drawn = join_tests([tests[index] for index in rng.integers(0, 20, 20)])
        again = refit(fit, drawn)
        found.append([again.model.parameters(again.x)[name] for name in ROTATIONAL])
    full = np.std(found, axis=0)
    halves = np.array([np.subtract(*known.intervals[name][::-1]) / 2 for name in ROTATIONAL])
    # Student's t with 19 degrees of freedom, sqrt(20/19), and some 10 % for the leverage of fast tests.
    assert ((halves / full > 0.8 * 2.15) & (halves / full < 1.5 * 2.15)).all()


def test_intervals_cover_the_truth_when_tests_have_offsets_of_their_own():
    """60 synthetic campaigns: 95 % intervals of four parameters hold the truth in 90 to 98 % of the cases."""
    covered = []
    for seed in range(60):
        samples = join_tests(
            friction_tests(lambda w: rotational(w, KNEE), 100 + seed, number=24, length=100, spread=0.2)
        )
        fit = refit(_truth(samples), samples)
        intervals = uncertainty(fit, samples, seed).intervals
        covered += [
            intervals[name][0] <= value <= intervals[name][1]
            for name, value in zip(ROTATIONAL, KNEE, strict=True)
        ]
    assert 0.90 <= np.mean(covered) <= 0.985


def _truth(samples) -> Fit:
    a, b, c, d = KNEE
    x = np.array([a - b, b, d, math.log(c)])
    return Fit(MODELS["rotational"], x, (np.full(4, -np.inf), np.full(4, np.inf)), math.inf)


def test_intervals_that_ignore_the_tests_are_too_short():
    """Offsets that a test keeps make ordinary standard errors wrong by far."""
    samples = join_tests(friction_tests(lambda w: rotational(w, KNEE), 3, number=24, length=400, spread=0.3))
    fit = fit_model(MODELS["asymmetric"], samples, FitOptions())
    known = uncertainty(fit, samples, 0)
    low, high = known.intervals["offset_Nm"]
    assert (high - low) / 4 > 5 * known.standard_errors["offset_Nm"]


def test_undetermined_parameters_are_reported():
    velocity = np.linspace(1.0, 2.0, 200)
    torque = 3 + 2 * velocity + 0.1 * np.random.default_rng(0).normal(size=200)
    test = FrictionTest("fast", velocity, torque, np.ones(200, dtype=bool))
    result = identify_tests([test], IdentificationOptions(models=("rotational", "coulomb_viscous")))
    assert result.models[0].name == "coulomb_viscous"
    assert any("one direction only" in line for line in result.warnings)
    assert any("no slow samples" in line for line in result.warnings)
    warned = " ".join(result.models[1].warnings)
    assert "not determined" in warned or "uncertain" in warned or "bound" in warned


def test_missing_slow_and_fast_samples_are_reported_by_their_limits():
    slow = friction_tests(lambda w: 3 * np.tanh(40 * w) + 2 * w, 1, top=0.3)
    warnings = " ".join(
        identify_tests(slow, IdentificationOptions(models=("coulomb_viscous_tanh",))).warnings
    )
    assert "no fast samples" in warnings and "one direction" not in warnings


def test_wide_intervals_and_correlations_are_warned_about():
    tests = friction_tests(lambda w: 3 * np.tanh(40 * w) + 0.01 * w, 1, spread=0.3, top=1.5)
    result = identify_tests(tests, IdentificationOptions(models=("coulomb_viscous_tanh",)))
    assert any("viscous_friction" in line and "uncertain" in line for line in result.models[0].warnings)
    fast = [
        replace(
            test,
            velocity=2.0 + 0.1 * test.velocity,
            torque=3.0 + 2 * (2.0 + 0.1 * test.velocity) + 0.1 * np.sin(test.time),
        )
        for test in tests
    ]
    tied = identify_tests(fast, IdentificationOptions(models=("coulomb_viscous",)))
    assert any("correlated" in line for line in tied.models[0].warnings)


@pytest.mark.parametrize(
    ("truth", "law"),
    [("rotational", lambda w: rotational(w, HIP)), ("coulomb_viscous", lambda w: 3 * np.sign(w) + 2 * w)],
)
def test_the_model_that_made_the_data_comes_first(truth, law):
    tests = friction_tests(law, 21, number=6, spread=0.05)
    result = identify_tests(
        tests,
        IdentificationOptions(
            models=tuple(name for name in MODELS if "lugre" not in name and "stribeck" not in name)
        ),
    )
    assert result.models[0].name == truth
    assert result.models[0].validations[0].left_out == "file"
    assert result.models[0].validations[0].rmse >= 0.95 * result.models[0].goodness.rmse


def slow_lugre(number: int, rng: np.random.Generator) -> FrictionTest:
    """LuGre below 0.01 rad/s by explicit Euler at 1 kHz, seen at 100 Hz with noise and an offset."""
    time = np.arange(14_000) * 1e-3
    first, second = 2 * np.pi * (0.1 + 0.04 * number), 2 * np.pi * 0.6
    speed = 0.008 * np.sin(first * time) + 0.001 * np.sin(second * time)
    z, force = 0.0, np.empty(len(time))
    for i, w in enumerate(speed):
        g = 4.0 + 2.0 * math.exp(-((w / 0.003) ** 2))
        rate = w - 8000.0 * abs(w) / g * z
        z += 1e-3 * rate
        force[i] = 8000.0 * z + 30.0 * rate + 60.0 * w
    seen = len(time) // 10
    velocity = speed[::10] + 5e-5 * rng.normal(size=seen)
    torque = force[::10] + 0.1 * rng.normal(size=seen) + 0.3
    return FrictionTest(str(number), velocity, torque, np.ones(seen, dtype=bool), time=time[::10])


def test_the_best_model_is_at_least_as_good_as_the_literature_on_slow_hysteresis():
    rng = np.random.default_rng(3)
    tests = [slow_lugre(number, rng) for number in range(3)]
    published = ("coulomb_viscous", "stribeck", "dahl", "lugre")
    result = identify_tests(tests, IdentificationOptions(models=(*published, "lugre_asymmetric")))
    best, found = result.models[0], {item.name: item for item in result.models}
    assert best.name == "lugre_asymmetric"  # the offset is in the data
    for name in published:
        other = found[name]
        assert best.goodness.rmse <= other.goodness.rmse
        assert best.validations[0].rmse <= other.validations[0].rmse
    assert best.goodness.rmse < 0.2
    assert found["stribeck"].goodness.rmse > 1.5 * best.goodness.rmse


def test_a_torque_that_opposes_the_velocity_is_negated_and_reported():
    tests = [
        replace(test, torque=-test.torque) for test in friction_tests(lambda w: 3 * np.sign(w) + 2 * w, 2)
    ]
    result = identify_tests(tests, IdentificationOptions(models=("coulomb_viscous",)))
    assert_allclose(
        list(result.models[0].fit.model.parameters(result.models[0].fit.x).values()), [3, 2], rtol=0.02
    )
    assert any("opposite sign of the velocity" in line for line in result.warnings)


def test_models_without_their_columns_are_skipped_and_a_requested_one_is_refused():
    tests = friction_tests(lambda w: 3 * np.sign(w) + 2 * w, 2)
    result = identify_tests(tests, IdentificationOptions(models=("coulomb_viscous", "load_dependent")))
    assert result.skipped == {"load_dependent": ("load",)}
    with raises(ParameterError, "model", "load"):
        identify_tests(tests, IdentificationOptions(models=("load_dependent",)))
    with raises(ParameterError, "gauss", "coulomb_viscous"):
        identify_tests(tests, IdentificationOptions(models=("gauss",)))


def test_thinning_keeps_the_fit_of_many_samples(monkeypatch):
    tests = friction_tests(lambda w: rotational(w, KNEE), 13, number=5, length=20_000)
    samples = join_tests(tests)
    for name in ("rotational", "dahl"):
        errors = []
        for most in (8_000, 200_000):
            monkeypatch.setattr(fitting, "MAX_FIT_SAMPLES", most)
            fit = fit_model(MODELS[name], samples, FitOptions())
            errors.append(np.sqrt(np.mean(fit.residuals(samples) ** 2)))
        assert errors[0] < 1.05 * errors[1]  # the path of a state is thinned too, by two here


def test_the_same_seed_gives_the_same_result():
    tests = friction_tests(lambda w: rotational(w, KNEE), 2, number=4)
    options = IdentificationOptions(models=("rotational", "lugre"), fit=FitOptions(seed=5))
    first, second = (identify_tests(tests, options) for _ in range(2))
    for one, other in zip(first.models, second.models, strict=True):
        assert one.uncertainty.intervals == other.uncertainty.intervals
        assert (one.fit.x == other.fit.x).all()


def test_progress_counts_up_to_its_total():
    seen = []
    identify_tests(
        friction_tests(lambda w: 3 * np.sign(w) + 2 * w, 2, number=3),
        IdentificationOptions(models=("coulomb_viscous",)),
        lambda done, total: seen.append((done, total)),
    )
    assert seen[-1][0] == seen[-1][1] and seen == sorted(seen)
