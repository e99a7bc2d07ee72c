"""Points of a sweep: grids against brute force, Latin hypercubes by their defining property."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.configuration.validation import validate
from twin_gait.exceptions import TwinGaitError
from twin_gait.studies.sweep.spec import MOST_EPISODES, Range, SweepFile, make_overrides

LEVELS = {"a": [1, 2, 3], "b.c": ["x", "y"], "d": [[1, 2], {"k": 3}]}


def design(method: str, **entries: object) -> pd.DataFrame:
    return pd.DataFrame(make_overrides(validate(SweepFile, {"method": method, **entries}, "a"), "a"))


def grid(parameters: dict[str, object], **entries: object) -> pd.DataFrame:
    return design("grid", parameters=parameters, **entries)


def latin_hypercube(
    parameters: dict[str, object], samples: int, seed: int, **entries: object
) -> pd.DataFrame:
    return design("latin_hypercube", parameters=parameters, samples=samples, seed=seed, **entries)


def test_a_grid_is_every_combination_in_order():
    wanted = [dict(zip(LEVELS, values, strict=True)) for values in itertools.product(*LEVELS.values())]
    assert grid(LEVELS).to_dict("records") == wanted


def test_a_range_of_a_grid_is_evenly_spaced_with_both_ends_exact():
    linear = grid({"a": {"from": 0.1, "to": 0.7, "count": 4}})["a"].tolist()
    assert (linear[0], linear[-1]) == (0.1, 0.7)
    np.testing.assert_allclose(np.diff(linear), 0.2, rtol=1e-14)
    log = grid({"a": {"from": 0.01, "to": 100.0, "count": 5, "scale": "log"}})["a"].tolist()
    assert (log[0], log[-1]) == (0.01, 100.0)
    np.testing.assert_allclose(log, [0.01, 0.1, 1.0, 10.0, 100.0], rtol=1e-14)


@given(samples=st.integers(1, 60), seed=st.integers(0, 2**32))
def test_a_latin_hypercube_has_one_point_in_every_slice_of_every_range(samples, seed):
    ranges = {"a": {"from": -3.0, "to": 5.0}, "b": {"from": 0.5, "to": 500.0, "scale": "log"}}
    a, b = latin_hypercube(ranges, samples, seed).to_numpy(dtype=float).T
    shares = [(a + 3.0) / 8.0, np.log10(b / 0.5) / 3.0]
    for share in shares:
        # A share at a slice's very edge may round to its neighbour.
        slices = np.floor(np.sort(share) * samples + np.array([1e-9]))
        assert slices.tolist() == list(range(samples))


def test_a_latin_hypercube_uses_the_values_of_a_list_equally_often_and_its_seed():
    values = {"a": ["x", "y", "z"], "b": {"from": 0.0, "to": 1.0}}
    first = latin_hypercube(values, 30, 1)
    assert sorted(first["a"]) == ["x"] * 10 + ["y"] * 10 + ["z"] * 10
    assert first.equals(latin_hypercube(values, 30, 1))
    assert not first.equals(latin_hypercube(values, 30, 2))


def test_rows_of_a_list_need_not_change_the_same_keys():
    rows = [{"a": 1}, {"b": None}, {}]
    assert make_overrides(validate(SweepFile, {"method": "list", "episodes": rows}, "a"), "a") == rows


WRONG = {
    "falling": (lambda: validate(Range, {"from": 2, "to": 1}, "a"), ("a", "from", "to", "2", "1")),
    "log of zero": (
        lambda: validate(Range, {"from": 0, "to": 1, "scale": "log"}, "a"),
        ("a", "from", "log", "0"),
    ),
    "no count": (lambda: grid({"a": {"from": 0.0, "to": 1.0}}), ("parameters.a", "count", "2")),
    "one": (lambda: validate(Range, {"from": 0, "to": 1, "count": 1}, "a"), ("count", "2", "1")),
    "too many": (
        lambda: grid({name: {"from": 0.0, "to": 1.0, "count": 3000} for name in "abc"}),
        ("10000000", "27000000000"),
    ),
    "too many samples": (
        lambda: latin_hypercube({"a": [1]}, MOST_EPISODES + 1, 0),
        ("a", "10000000", "10000001"),
    ),
}


@pytest.mark.parametrize(("make", "message"), WRONG.values(), ids=WRONG.keys())
def test_an_inconsistent_design_is_refused(make, message):
    with raises(TwinGaitError, *message):
        make()
