"""The hyperbolic tangent against the one of the C library and its identities."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin_gait.core.hyperbolic import hyperbolic_tangent


def test_it_equals_the_one_of_the_c_library_to_the_stated_error():
    points = np.concatenate([np.linspace(-40.0, 40.0, 20_001), np.logspace(-20, 2, 2_001)])
    worst = max(abs(hyperbolic_tangent(float(x)) - math.tanh(x)) for x in points)
    assert worst < 3e-16


@pytest.mark.parametrize("x", [1e-300, 1e-9, 0.3, 2.0, 19.0, 1e3, 1e308, math.inf])
def test_it_is_odd_and_bounded(x):
    assert hyperbolic_tangent(-x) == -hyperbolic_tangent(x)
    assert 0.0 <= hyperbolic_tangent(x) <= 1.0


def test_nan_stays_nan():
    assert math.isnan(hyperbolic_tangent(math.nan))
