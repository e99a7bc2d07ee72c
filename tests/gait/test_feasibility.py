"""The solver of guards: against linear programs, and strict bounds in the proofs of the tests."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from kit_equivalence import feasible
from scipy.optimize import linprog

from twin_gait.gait.feasibility import ZERO, Bound, solve

bounds = st.builds(
    Bound,
    upper=st.sampled_from([ZERO, "a", "b", "c", "d"]),
    lower=st.sampled_from([ZERO, "a", "b", "c", "d"]),
    limit=st.integers(-6, 9).map(float),
).filter(lambda item: item.upper != item.lower)


@settings(max_examples=200)
@given(system=st.lists(bounds, min_size=1, max_size=9))
def test_bounds_have_a_solution_exactly_if_a_linear_program_has_one(system: list[Bound]) -> None:
    names = ["a", "b", "c", "d"]
    rows = [[(item.upper == name) - float(item.lower == name) for name in names] for item in system]
    limits = [item.limit for item in system]
    program = linprog(np.zeros(4), A_ub=np.array(rows), b_ub=limits, bounds=(None, None), method="highs")
    found = solve(system)
    assert (found is not None) is (program.status == 0)
    if found is not None:
        values = {ZERO: 0.0, **found}
        assert all(values[item.upper] - values[item.lower] <= item.limit + 1e-12 for item in system)


@settings(max_examples=100)
@given(system=st.lists(bounds, min_size=1, max_size=9))
def test_feasible_agrees_with_solve_and_with_strict_bounds_a_whole_apart(system: list[Bound]) -> None:
    """On whole limits a strict bound excludes as much as one that is tighter by less than 1 / 9."""
    assert feasible(system) is (solve(system) is not None)
    strict = [replace(item, strict=True) for item in system]
    tighter = [replace(item, limit=item.limit - 0.1) for item in system]
    assert feasible(strict) is (solve(tighter) is not None)


def test_strict_bounds_exclude_their_limit() -> None:
    below, above = Bound("a", ZERO, 5.0, strict=True), Bound(ZERO, "a", -5.0)
    assert solve([below, above]) is None
    assert not feasible([below, above])
    assert feasible([replace(below, limit=math.nextafter(5.0, 6.0)), above])
    assert solve([replace(below, strict=False), above]) == {"a": 5.0}


def test_solution_keeps_a_margin_from_a_limit() -> None:
    found = solve([Bound(ZERO, "a", -3.0, margin=2.0)], share=1.0)
    assert found == {"a": 5.0}
