"""Tests of the helper that finds facts in messages as whole words, numbers and paths."""

from __future__ import annotations

import warnings

import pytest
from errors import missing, raises, states, warns

TEXT = "sub/left.yaml: left_hip: expected hip or knee, -1.5 to 10 deg, got 'hips'"


@pytest.mark.parametrize(
    "fact", ["hip", "knee", "left_hip", "hips", "-1.5", "10", 10, "10 deg", "left.yaml", "sub/left.yaml"]
)
def test_a_fact_is_found_wherever_it_is_whole(fact: object) -> None:
    assert states(TEXT, fact)


@pytest.mark.parametrize("fact", ["ankle", "left_hip_deg", "kne", "1", "1.5", "5", "0", "100", "eft.yaml"])
def test_a_part_of_a_word_or_a_number_is_not_a_fact(fact: str) -> None:
    assert missing(TEXT, "knee", fact) == [fact]


def test_errors_and_warnings_without_a_fact_fail_the_test() -> None:
    with pytest.raises(AssertionError, match="ankle"), raises(ValueError, "hip", "ankle"):
        raise ValueError(TEXT)
    with pytest.raises(AssertionError, match="ankle"), warns(UserWarning, "ankle"):
        warnings.warn(TEXT, UserWarning, stacklevel=1)
    with raises(ValueError, "hip") as caught:
        raise ValueError(TEXT)
    assert str(caught.value) == TEXT
