"""Exponential, hyperbolic tangent, sine and cosine against mpmath, and in machine code against Python."""

from __future__ import annotations

import itertools
import math
import platform
import re
from collections.abc import Callable, Iterable
from typing import Any

import mpmath
import numba
import numpy as np
import pytest
from mpmath import mpf
from numpy.testing import assert_array_equal

from twin_gait.core import elementary
from twin_gait.core.elementary import (
    exponential,
    hyperbolic_tangent,
    power_of_two,
    settled_share,
    sine_cosine,
    whole_number,
)
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiling import BIT_FUNCTIONS, compiler_settings, jit

mpmath.mp.prec = 250
SHIFT = 1.5 * 2.0**52
LN2, QUARTER = mpmath.log(2), mpmath.pi / 2
RNG = np.random.default_rng(18)
PLAIN = numba.njit(error_model="numpy")  # for the loop around them, which Python calls


def uniform(low: float, high: float, count: int = 4000) -> list[float]:
    return RNG.uniform(low, high, count).tolist()


def neighbours(values: Iterable[Any]) -> list[float]:
    """Return the nearest number to each value, and its neighbours."""
    found = [float(value) for value in values]
    return [
        *found,
        *(math.nextafter(x, -math.inf) for x in found),
        *(math.nextafter(x, math.inf) for x in found),
    ]


SMALL = [sign * 10.0**power for power in range(-300, 0) for sign in (1.0, -1.0)]
# Where the power of two changes, and so r is longest.
EDGES = neighbours((n + mpf(0.5)) * LN2 for n in range(-1020, 1023, 7))
EXPONENTS = [*uniform(-3.0, 3.0), *uniform(-708.0, 709.0), *SMALL, *(x for x in EDGES if -708.0 < x < 709.4)]
SHARES = [*uniform(-1.5, 1.5, 8000), *uniform(0.0, 40.0), *SMALL, *(x for x in EDGES if -30.0 < x < 60.0)]
# Where r is tiny, where it is longest, where the sine is a half, and where r is small but not that small.
ON_AXES = [float(n * QUARTER) for n in range(1, 31_830, 3)]
BETWEEN = neighbours((n + mpf(0.5)) * QUARTER for n in range(0, 31_000, 41))
HALVES = [float((n + sign / mpf(3)) * QUARTER) for n in range(1, 31_000, 17) for sign in (1, -1)]
BESIDE = [x * (1.0 + 2.0**-bits) for x, bits in zip(ON_AXES, itertools.cycle(range(10, 40)), strict=False)]
ANGLES = [*uniform(-4.0, 4.0), *uniform(-5e4, 5e4), *SMALL, *ON_AXES, *BETWEEN, *HALVES, *BESIDE]
SPECIAL = [0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, 1e308, -1e308, 709.5, -709.5, 22.0, 1e9]


def worst(function: Callable[[float], float], exact: Callable[[Any], Any], points: Iterable[float]) -> float:
    """Largest error in units of the last place of the exact result."""

    def error(x: float) -> float:
        value = exact(mpf(x))
        return float(abs(function(x) - value) / math.ulp(float(value)))

    return max(error(x) for x in points)


# ---------------------------------------------------------------------------------------------- accuracy


def test_the_exponential_is_within_a_unit_in_the_last_place():
    assert worst(exponential, mpmath.exp, EXPONENTS) <= 1.0


def test_the_settled_share_is_within_a_unit_and_within_two_where_it_is_negative():
    def exact(x: Any) -> Any:
        return -mpmath.expm1(-x)

    assert worst(settled_share, exact, (x for x in SHARES if x >= 0.0)) <= 1.0
    assert worst(settled_share, exact, (x for x in SHARES if x < 0.0)) <= 2.0


def test_the_hyperbolic_tangent_is_within_three_units():
    assert worst(hyperbolic_tangent, mpmath.tanh, [*uniform(-25.0, 25.0), *SHARES]) <= 3.0


@pytest.mark.parametrize("index, exact", [(0, mpmath.sin), (1, mpmath.cos)])
def test_sine_and_cosine_are_within_a_unit_and_a_half(index, exact):
    assert worst(lambda x: sine_cosine(x)[index], exact, ANGLES) <= 1.5


@pytest.mark.parametrize("span", [1e5, 1e6, 1e7, 1e8, 1e9])
def test_beyond_their_range_sine_and_cosine_have_an_angle_error_of_two_roundings(span):
    for x in uniform(-span, span, 500):
        sine, cosine = sine_cosine(x)
        assert abs(sine - mpmath.sin(x)) <= abs(x) * 2.0**-52 + 2.0**-52
        assert abs(cosine - mpmath.cos(x)) <= abs(x) * 2.0**-52 + 2.0**-52


# ------------------------------------------------------------------------------------- where they come from


def bits_of(value: float) -> int:
    """Bits from the first to the last that is set."""
    return value.as_integer_ratio()[0].bit_length()


def test_the_parts_of_the_two_periods_are_exact_as_far_as_they_have_to_be():
    parts = [elementary._LN2_HIGH, elementary._LN2_LOW]
    assert bits_of(parts[0]) <= 33 and abs(mpmath.fsum(parts) - LN2) < 2.0**-85
    parts = [elementary._QUARTER_HIGH, elementary._QUARTER_MIDDLE, elementary._QUARTER_LOW]
    assert max(map(bits_of, parts[:2])) <= 38 and abs(mpmath.fsum(parts) - QUARTER) < 2.0**-128


def test_the_coefficients_of_the_exponential_match_their_derivation():
    """An interpolation at the outer eight of eleven Chebyshev nodes."""
    half = LN2 / 2 * mpf("1.0005")
    nodes = [half * mpmath.cos(mpmath.pi * (2 * i + 1) / 22) for i in (0, 1, 2, 3, 7, 8, 9, 10)]
    third = mpf(elementary._E3)
    values = [((mpmath.exp(r) - 1 - r) / r**2 - mpf(0.5) - third * r) / r**2 for r in nodes]
    powers = mpmath.matrix([[r**k for k in range(8)] for r in nodes])
    found = [float(c) for c in mpmath.lu_solve(powers, mpmath.matrix(values))]
    assert [float(1 / mpf(6)), *found] == [getattr(elementary, f"_E{k}") for k in range(3, 12)]


def test_the_polynomial_of_the_exponential_stays_below_its_stated_error():
    coefficients = [1, 1, 0.5, *(getattr(elementary, f"_E{k}") for k in range(3, 12))]
    for i in range(-200, 201):
        r = LN2 / 2 * i / 200
        value = mpmath.fsum(c * r**k for k, c in enumerate(coefficients))
        assert abs(value / mpmath.exp(r) - 1) < 1e-17


def test_the_even_function_of_the_hyperbolic_tangent_stays_below_its_stated_error():
    for i in range(1, 201):
        r = LN2 / 2 * i / 200
        value = 2 + mpmath.fsum(getattr(elementary, f"_R{k}") * r**k for k in range(2, 11, 2))
        assert abs(value - r * (mpmath.exp(r) + 1) / (mpmath.exp(r) - 1)) < 2.1e-18


# ------------------------------------------------------------------------------------------- special values


@pytest.mark.parametrize(
    "function, x, value",
    [
        (exponential, 0.0, 1.0),
        (exponential, math.inf, math.inf),
        (exponential, -math.inf, 0.0),
        (exponential, 1e308, math.inf),
        (exponential, 709.5, math.inf),
        (exponential, -708.9, 0.0),
        (settled_share, 0.0, 0.0),
        (settled_share, math.inf, 1.0),
        (settled_share, 709.5, 1.0),
        (settled_share, 5e-324, 5e-324),
        (settled_share, -1e308, settled_share(-709.4)),
        (hyperbolic_tangent, 0.0, 0.0),
        (hyperbolic_tangent, math.inf, 1.0),
        (hyperbolic_tangent, -math.inf, -1.0),
        (hyperbolic_tangent, 5e-324, 5e-324),
        (power_of_two, SHIFT - 1023.0, 0.0),
        (power_of_two, SHIFT - 1022.0, 2.0**-1022),
        (power_of_two, SHIFT, 1.0),
        (power_of_two, SHIFT + 1023.0, 2.0**1023),
        (power_of_two, SHIFT + 1024.0, math.inf),
        (whole_number, SHIFT - 7.0, -7),
        (whole_number, math.nan, 0),
    ],
)
def test_ends_and_zeros(function, x, value):
    assert function(x) == value


def test_nan_passes_and_the_sine_of_infinity_is_nan():
    for function in (exponential, settled_share, hyperbolic_tangent, power_of_two):
        assert math.isnan(function(math.nan))
    for angle in (math.nan, math.inf, -math.inf):
        assert all(map(math.isnan, sine_cosine(angle)))


@pytest.mark.parametrize("x", [1e-300, 1e-9, 0.3, 0.5, 2.0, 19.0, 22.1, 1e3, 1e308])
def test_the_hyperbolic_tangent_is_odd_and_bounded(x):
    assert hyperbolic_tangent(-x) == -hyperbolic_tangent(x)
    assert 0.0 < hyperbolic_tangent(x) <= 1.0


def test_the_sine_is_odd_and_the_cosine_even():
    for x in ANGLES[::7]:
        sine, cosine = sine_cosine(x)
        assert sine_cosine(-x) == (-sine, cosine)


# ------------------------------------------------------------------------------------------------- the bits


def over(points: np.ndarray, compile_loop: Callable[[Any], Any]) -> tuple[np.ndarray, Any]:
    """All functions over points in compiled code, shape ``(5, n)``, and the compiled loop."""
    functions = (exponential, settled_share, hyperbolic_tangent, sine_cosine)
    e, s, t, c = (specialize(function, BIT_FUNCTIONS, jit) for function in functions)

    def loop(x: np.ndarray, results: np.ndarray) -> None:
        for i in range(x.size):
            results[0, i] = e(x[i])
            results[1, i] = s(x[i])
            results[2, i] = t(x[i])
            sine, cosine = c(x[i])
            results[3, i] = sine
            results[4, i] = cosine

    compiled, results = compile_loop(loop), np.zeros((5, len(points)))
    compiled(points, results)
    return results, compiled


def in_python(points: np.ndarray) -> np.ndarray:
    one = [
        [exponential(x), settled_share(x), hyperbolic_tangent(x), *sine_cosine(x)] for x in points.tolist()
    ]
    return np.array(one).T


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return np.array([*EXPONENTS, *SHARES, *ANGLES, *EDGES, *uniform(-1e9, 1e9), *SPECIAL])


def assert_same_bits(found: np.ndarray, points: np.ndarray) -> None:
    expected = in_python(points)
    huge = np.isfinite(points) & (np.abs(points) > 1e9)  # whose sine and cosine mean nothing
    found[3:, huge] = expected[3:, huge] = 0.0
    nan = np.isnan(expected)
    assert_array_equal(np.isnan(found), nan)
    assert_array_equal(found.view(np.int64)[~nan], expected.view(np.int64)[~nan])


@pytest.mark.compile
def test_scalar_machine_code_gives_the_bits_of_python(points):
    with compiler_settings():
        found, _ = over(points, PLAIN)
    assert_same_bits(found, points)


@pytest.mark.compile
def test_vector_machine_code_gives_the_bits_of_python(points, monkeypatch):
    config = numba.config
    monkeypatch.setattr(config, "OPT", type(config.OPT)(3))
    monkeypatch.setattr(config, "LOOP_VECTORIZE", 1)
    found, compiled = over(points, PLAIN)
    assert_same_bits(found, points)
    if platform.machine() in ("x86_64", "AMD64"):
        (text,) = compiled.inspect_asm().values()
        assert "mulpd" in text  # of several numbers


@pytest.mark.compile
def test_machine_code_calls_nothing_of_the_c_library():
    with compiler_settings():
        _, compiled = over(np.ones(1), PLAIN)
    (text,) = compiled.inspect_llvm().values()
    declared = re.findall(r"^declare .*@([\w.]+)\(", text, re.MULTILINE)
    assert "llvm.fabs.f64" in declared
    mathematics = {name for name in vars(math) if not name.startswith("_")} - {"fabs"} | {"sincos"}
    assert not {name.removeprefix("llvm.").removesuffix(".f64") for name in declared} & mathematics
