"""Least push of the arms for rising and sitting down: the bisection, and what counts as done."""

from __future__ import annotations

import numpy as np
import pytest
from rising import RISING, SITTING, WITHIN, least, pushes, risen, run_of, sits, standing_height, stays


@pytest.mark.parametrize("bound", [0.013, 0.25, 0.501, 0.89])
def test_bisection_finds_a_known_bound_from_above(bound):
    tried = []

    def enough(value):
        tried.append(value)
        return value >= bound

    found = least(enough, 0.9, WITHIN)
    assert bound <= found <= bound + WITHIN
    assert len(tried) <= 1 + np.ceil(np.log2(0.9 / WITHIN))


def test_bisection_finds_nothing_if_the_maximum_is_insufficient():
    assert least(lambda value: value > 1.0, 0.9, WITHIN) is None


@pytest.fixture(scope="module")
def up():
    return run_of(RISING)


@pytest.fixture(scope="module")
def down():
    return run_of(SITTING)


def test_standing_height_belongs_to_a_nearly_straight_posture(up, down):
    assert standing_height(up) == standing_height(down)
    standing = down.log["time_s"].between(3.0, 3.4)  # before the request
    heights = down.log.loc[standing, "pelvis_height_m"]
    assert heights.between(0.97 * standing_height(up), standing_height(up)).all()


def test_standing_and_sitting_exclude_each_other(up, down):
    assert risen(up) and stays(up) and not sits(up)
    assert sits(down) and not risen(down) and not stays(down)


def test_weak_arms_do_not_push_and_the_wearer_does_not_rise():
    share = 0.02
    weak = run_of(RISING, share=share)
    assert not risen(weak) and not stays(weak)
    assert pushes(weak).max() <= share * (1.0 + 1e-9)
