"""Tests of the fitter against lmfit on the same samples, and on hard reference problems of NIST.

Data and certified values of the NIST Statistical Reference Datasets, nonlinear regression; the starts are the
product's own, drawn over wide bounds that hold NIST's far start.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from friction_bench import KNEE, rotational
from numpy.testing import assert_allclose

from twin_gait.identification.fitting import FitOptions, Loss, fit_model
from twin_gait.identification.laws import MODELS
from twin_gait.identification.models import FrictionModel, FrictionTest, ShapeParameter, join_tests
from twin_gait.identification.statistics import goodness, uncertainty

LEAST_SQUARES = FitOptions(loss=Loss.LINEAR)

ECKERLE_Y = """
0.0001575 0.0001699 0.0002350 0.0003102 0.0004917 0.0008710 0.0017418 0.0046400 0.0065895 0.0097302 0.0149002
0.0237310 0.0401683 0.0712559 0.1264458 0.2073413 0.2902366 0.3445623 0.3698049 0.3668534 0.3106727 0.2078154
0.1164354 0.0616764 0.0337200 0.0194023 0.0117831 0.0074357 0.0022732 0.0008800 0.0004579 0.0002345 0.0001586
0.0001143 0.0000710
"""
ECKERLE_X = [*range(400, 435, 5), 435, *np.arange(436.5, 465, 1.5), 465, *range(470, 505, 5)]
RAT43_Y = [
    16.08,
    33.83,
    65.80,
    97.20,
    191.55,
    326.20,
    386.87,
    520.53,
    590.03,
    651.92,
    724.93,
    699.56,
    689.96,
    637.56,
    717.41,
]
MGH09_X = [4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625]
MGH09_Y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
MGH10_Y = [
    34780,
    28610,
    23650,
    19630,
    16370,
    13720,
    11540,
    9744,
    8261,
    7030,
    6005,
    5147,
    4427,
    3820,
    3307,
    2872,
]
# Name: law of (x, linear, shape), bounds of the shape, x, y, certified values, deviations, sum of squares.
# NIST's own order of parameters; those that enter linearly come first in each of these.
HARD = {
    "Eckerle4": (
        lambda x, b, e: b[0] / e[0] * np.exp(-0.5 * ((x - e[1]) / e[0]) ** 2),
        ((0.5, 100.0), (300.0, 600.0)),
        ECKERLE_X,
        [float(word) for word in ECKERLE_Y.split()],
        (1.5543827178, 4.0888321754, 451.54121844),
        (1.5408051163e-02, 4.6803020753e-02, 4.6800518816e-02),
        1.4635887487e-03,
    ),
    "Rat43": (
        lambda x, b, e: b[0] / (1 + e[0] * np.exp(-e[1] * x)) ** (1 / e[2]),
        ((1.0, 1e4), (0.01, 10.0), (0.1, 10.0)),
        list(range(1, 16)),
        RAT43_Y,
        (699.64151270, math.exp(5.2771253025), 0.75962938329, 1.2792483859),
        None,
        8.7864049080e03,
    ),
    "MGH09": (
        lambda x, b, e: b[0] * (x * x + e[0] * x) / (x * x + e[1] * x + e[2]),
        ((1e-3, 1e3), (1e-3, 1e3), (1e-3, 1e3)),
        MGH09_X,
        MGH09_Y,
        (0.19280693458, 0.19128232873, 0.12305650693, 0.13606233068),
        (1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02),
        3.0750560385e-04,
    ),
    "MGH10": (
        lambda x, b, e: b[0] * np.exp(e[0] / (x + e[1]) - 12.0),  # b1 in units of exp(12), which conditions
        ((2e2, 4e5), (1e2, 2.5e4)),
        [50 + 5 * index for index in range(16)],
        MGH10_Y,
        (5.6096364710e-03 * math.exp(12.0), 6.1813463463e03, 3.4522363462e02),
        (1.5687892471e-04 * math.exp(12.0), 2.3309021107e01, 7.8486103508e-01),
        8.7945855171e01,
    ),
}


def quietly(law, x, b, e):
    """Return a law that may overflow at extreme shapes, which the fitter must skip."""
    with np.errstate(all="ignore"):
        return law(x, b, e)


def as_model(law, limits, count: int = 1) -> FrictionModel:
    return FrictionModel(
        name="reference",
        formula="",
        coefficients=tuple(f"b{index}" for index in range(count)),
        shape=tuple(ShapeParameter(f"e{index}", *pair) for index, pair in enumerate(limits)),
        torque=lambda samples, b, e: quietly(law, samples.velocity, b, e),
    )


@pytest.mark.parametrize("name", HARD)
def test_hard_reference_problems_of_nist_are_solved_to_six_digits(name):
    law, limits, x, y, certified, deviations, sse = HARD[name]
    model = as_model(law, limits)
    used = np.ones(len(x), dtype=bool)
    samples = join_tests([FrictionTest(name, np.array(x, float), np.array(y, float), used)])
    fit = fit_model(model, samples, LEAST_SQUARES)
    left = fit.residuals(samples)
    assert_allclose(left @ left, sse, rtol=1e-6)
    assert_allclose(list(model.parameters(fit.x).values()), certified, rtol=1e-6)
    if deviations is not None:
        errors = uncertainty(fit, samples, 0).standard_errors
        assert_allclose(list(errors.values()), deviations, rtol=1e-4)


def swings(seed: int, law):
    rng = np.random.default_rng(seed)
    time = np.arange(500) / 100.0
    tests = []
    for number in range(4):
        velocity = (0.3 + 0.6 * number) * np.sin(2 * np.pi * (0.4 + 0.05 * number) * time)
        torque = law(velocity) + 0.1 * rng.normal(size=500)
        tests.append(FrictionTest(str(number), velocity, torque, np.ones(500, dtype=bool), time=time))
    return join_tests(tests)


def rotational_law(w, a, b, d, c):
    return rotational(w, (a, b, c, d))


def stribeck_law(w, breakaway, coulomb, viscous, speed, exponent):
    level = coulomb + (breakaway - coulomb) * np.exp(-(np.abs(w / speed) ** exponent))
    return level * np.sign(w) + viscous * w


@pytest.mark.parametrize(
    ("name", "law", "truth"),
    [
        ("rotational", rotational_law, {"a": 1.743, "b": 3.193, "d": 2.06, "c": 0.2031}),
        (
            "stribeck",
            stribeck_law,
            {"breakaway": 4.5, "coulomb": 3.0, "viscous": 2.0, "speed": 0.3, "exponent": 1.5},
        ),
    ],
)
def test_lmfit_finds_the_same_parameters_covariance_and_criteria(name, law, truth):
    lmfit = pytest.importorskip("lmfit")
    samples = swings(3, lambda w: law(w, **truth))
    fit = fit_model(MODELS[name], samples, LEAST_SQUARES)
    other = lmfit.Model(law, independent_vars=["w"]).fit(
        samples.torque, w=samples.velocity, **truth, fit_kws={"xtol": 1e-12, "ftol": 1e-12}
    )
    ours, errors = fit.model.parameters(fit.x), uncertainty(fit, samples, 0).standard_errors
    for key, theirs in zip(ours, other.params.values(), strict=True):
        assert_allclose(ours[key], theirs.value, rtol=1e-4)
        assert_allclose(errors[key], theirs.stderr, rtol=1e-2)
    found = goodness(samples.torque, fit.residuals(samples), fit.model.size)
    assert_allclose(found.sse, other.chisqr, rtol=1e-8)
    assert_allclose(found.residual_standard_error**2, other.redchi, rtol=1e-8)
    assert_allclose(found.r_squared, other.rsquared, rtol=1e-8)
    # lmfit does not count the variance of the noise as a parameter: two and log n less.
    assert_allclose(found.aic - 2.0, other.aic, rtol=1e-8)
    assert_allclose(found.bic - math.log(len(samples)), other.bic, rtol=1e-8)


def test_bootstrap_intervals_of_independent_tests_equal_lmfit():
    """60 tests of white noise: drawing whole tests agrees with ordinary theory within sampling error."""
    lmfit = pytest.importorskip("lmfit")
    rng, time = np.random.default_rng(5), np.arange(100) / 100.0
    tests = []
    for number in range(60):
        velocity = 2.0 * np.sin(2 * np.pi * time + number)
        torque = rotational(velocity, KNEE) + 0.2 * rng.normal(size=100)
        tests.append(FrictionTest(str(number), velocity, torque, np.ones(100, dtype=bool), time=time))
    samples = join_tests(tests)
    fit = fit_model(MODELS["rotational"], samples, LEAST_SQUARES)
    intervals = uncertainty(fit, samples, 0).intervals
    a, b, c, d = KNEE
    other = lmfit.Model(rotational_law, independent_vars=["w"]).fit(
        samples.torque, w=samples.velocity, a=a, b=b, c=c, d=d
    )
    for key, theirs in zip(intervals, other.params.values(), strict=True):
        low, high = intervals[key]
        assert 0.75 < (high - low) / (2 * 1.96 * theirs.stderr) < 1.35
