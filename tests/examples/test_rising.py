"""Least push of the arms for rising and sitting down: the bisection, and what counts as done."""

from __future__ import annotations

import numpy as np
import pytest
from rising import RISING, SITTING, WITHIN, least, pushes, risen, run_of, sits, standing_height, stays


@pytest.mark.parametrize("bound", [0.013, 0.25, 0.501, 0.89])
def test_bisection_finds_a_known_bound_from_above(bound):
    asked = []

    def enough(value):
        asked.append(value)
        return value >= bound

    found = least(enough, 0.9, WITHIN)
    assert bound <= found <= bound + WITHIN
    assert len(asked) <= 1 + np.ceil(np.log2(0.9 / WITHIN))


def test_nothing_is_found_where_the_most_is_not_enough():
    assert least(lambda value: value > 1.0, 0.9, WITHIN) is None


@pytest.fixture(scope="module")
def up():
    return run_of(RISING)


@pytest.fixture(scope="module")
def down():
    return run_of(SITTING)


def test_standing_height_is_that_of_who_stands_nearly_straight(up, down):
    assert standing_height(up) == standing_height(down)
    standing = down.log["time_s"].between(3.0, 3.4)  # before the request
    heights = down.log.loc[standing, "pelvis_height_m"]
    assert heights.between(0.97 * standing_height(up), standing_height(up)).all()


def test_who_stands_does_not_sit_and_who_sits_does_not_stand(up, down):
    assert risen(up) and stays(up) and not sits(up)
    assert sits(down) and not risen(down) and not stays(down)


def test_arms_that_may_hardly_push_do_not_and_nobody_rises():
    share = 0.02
    weak = run_of(RISING, share=share)
    assert not risen(weak) and not stays(weak)
    assert pushes(weak).max() <= share * (1.0 + 1e-9)
