"""Elementary functions of 32-bit numbers, compiled, against mpmath; where their constants come from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import mpmath
import numpy as np
import pytest
from firmware_tools import require_tools
from mpmath import mpf
from printed_library import CLibrary

from twin_gait.core import elementary
from twin_gait.core.elementary_single import SINGLE
from twin_gait.firmware.printer import TranslationUnit, print_units

RNG = np.random.default_rng(20)
PRECISION, LEAST_POWER, MOST_POWER = 24, -126, 127  # of binary32
ENTRIES = [
    elementary.exponential,
    elementary.settled_share,
    elementary.hyperbolic_tangent,
    elementary.sine_cosine,
]


@pytest.fixture(scope="module", autouse=True)
def precision():
    with mpmath.workprec(160):
        yield


@pytest.fixture(scope="module")
def library() -> CLibrary:
    require_tools("gcc")
    return CLibrary(print_units([TranslationUnit("elementary", ENTRIES, {})]), double=False)


def single(x: Any) -> float:
    return float(np.float32(float(x)))


def rounded(x: Any, bits: int) -> float:
    """The nearest number of so many bits."""
    mantissa, power = mpmath.frexp(x)
    return float(mpmath.ldexp(mpmath.nint(mpmath.ldexp(mantissa, bits)), int(power) - bits))


def neighbours(values: Iterable[Any]) -> list[float]:
    found = [np.float32(float(value)) for value in values]
    return [float(np.nextafter(x, np.float32(side * np.inf))) for x in found for side in (-1, 1)]


def uniform(low: float, high: float) -> list[float]:
    return RNG.uniform(low, high, 4000).tolist()


SMALL = [float(sign * 10.0**power) for power in RNG.uniform(-30.0, 0.0, 1000) for sign in (1, -1)]


def worst(function: Callable[[float], float], exact: Callable[[Any], Any], points: Iterable[float]) -> float:
    """Largest error in units of the last place of binary32 of the exact result."""

    def error(x: float) -> float:
        value = exact(mpf(x))
        unit = math.ldexp(1.0, max(math.frexp(float(value))[1] - PRECISION, LEAST_POWER - PRECISION + 1))
        return float(abs(function(x) - value)) / unit

    return max(error(single(x)) for x in points)


def test_the_exponential_is_within_a_unit(library):
    edges = neighbours((n + mpf(0.5)) * mpmath.log(2) for n in range(LEAST_POWER, MOST_POWER))
    points = [*uniform(-3.0, 3.0), *uniform(-87.0, 88.2), *SMALL, *edges]
    assert worst(lambda x: library.call("exponential", x), mpmath.exp, points) <= 1.0


@pytest.mark.parametrize("span, most", [(1.5, 1.0), (40.0, 1.0), (-1.5, 2.0), (-80.0, 2.0)])
def test_the_settled_share_is_within_a_unit_and_within_two_where_it_is_negative(library, span, most):
    points = [*uniform(min(span, 0.0), max(span, 0.0)), *(x for x in SMALL if x * span > 0.0)]
    assert worst(lambda x: library.call("settled_share", x), lambda x: -mpmath.expm1(-x), points) <= most


def test_the_hyperbolic_tangent_is_within_three_units(library):
    points = [*uniform(-1.0, 1.0), *uniform(-12.0, 12.0), *SMALL]
    assert worst(lambda x: library.call("hyperbolic_tangent", x), mpmath.tanh, points) <= 3.0


@pytest.mark.parametrize("index, exact", [(0, mpmath.sin), (1, mpmath.cos)])
@pytest.mark.parametrize("span, most", [(100.0, 1.5), (3000.0, 2.5)])
def test_sine_and_cosine_are_within_a_unit_and_a_half_up_to_16_turns(library, index, exact, span, most):
    quarters = range(1, int(span / (math.pi / 2)))
    on_axes, between = (neighbours((n + half) * mpmath.pi / 2 for n in quarters) for half in (0, mpf(0.5)))
    points = [*uniform(-span, span), *on_axes, *between, *(x for x in SMALL if abs(x) > 1e-30)]
    assert worst(lambda x: library.call("sine_cosine", x)[index], exact, points) <= most


@pytest.mark.parametrize(
    "name, x, value",
    [
        ("exponential", math.inf, math.inf),
        ("exponential", 88.5, math.inf),
        ("exponential", -87.9, 0.0),
        ("exponential", -math.inf, 0.0),
        ("exponential", 0.0, 1.0),
        ("settled_share", math.inf, 1.0),
        ("settled_share", 0.0, 0.0),
        ("hyperbolic_tangent", math.inf, 1.0),
        ("hyperbolic_tangent", -10.0, -1.0),
        ("hyperbolic_tangent", single(1e-40), single(1e-40)),
    ],
)
def test_ends_and_zeros(library, name, x, value):
    assert library.call(name, x) == value


def test_nan_passes_and_the_sine_of_infinity_is_nan(library):
    for function in ENTRIES[:3]:
        assert math.isnan(library.call(function.__name__, math.nan))
    for angle in (math.nan, math.inf, -math.inf):
        assert all(map(math.isnan, library.call("sine_cosine", angle)))


def test_the_constants_match_their_derivation():
    ln2, quarter = mpmath.log(2), mpmath.pi / 2
    ln2_high, quarter_high = rounded(ln2, 15), rounded(quarter, 13)
    quarter_middle = rounded(quarter - quarter_high, 13)
    derived = {
        "_SHIFT": 1.5 * 2.0 ** (PRECISION - 1),
        "_PER_LN2": single(1 / ln2),
        "_LN2_HIGH": ln2_high,
        "_LN2_LOW": single(ln2 - ln2_high),
        "_PER_QUARTER": single(1 / quarter),
        "_QUARTER_HIGH": quarter_high,
        "_QUARTER_MIDDLE": quarter_middle,
        "_QUARTER_LOW": single(quarter - quarter_high - quarter_middle),
    }
    assert derived.items() <= SINGLE.items()


def test_the_ends_are_where_the_powers_are_0_and_infinite_and_the_tangent_1():
    def power(name: str) -> int:
        return round(single(SINGLE[name]) * SINGLE["_PER_LN2"])

    assert (power("_MIN_ARGUMENT"), power("_MAX_ARGUMENT")) == (LEAST_POWER - 1, MOST_POWER + 1)
    assert power("_FINITE") == power("_MAX_ARGUMENT") - 1
    assert 1 - mpmath.tanh(SINGLE["_SATURATED"]) < 2.0 ** -(PRECISION + 1)


def test_every_constant_takes_the_place_of_one_of_the_64_bit_functions():
    assert all(isinstance(getattr(elementary, name), float) for name in SINGLE)
