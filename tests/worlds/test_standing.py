"""Search for the start posture of a world on the ground."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.worlds.standing import _bisect


def plain_bisection(rising: Callable[[float], float], low: float, high: float) -> float:
    """Return the root that bisection finds if it evaluates every middle."""
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        low, high = (middle, high) if rising(middle) < 0.0 else (low, middle)


@given(
    root=st.floats(-0.3, 0.3), toe=st.floats(0.05, 0.3), heel=st.floats(0.0, 0.1), below=st.floats(0.01, 0.3)
)
def test_skipped_middles_do_not_change_the_root(root: float, toe: float, heel: float, below: float) -> None:
    def gap(angle: float) -> float:
        """Compute the height of the lower one of toe and heel, of which the heel falls."""
        return min(toe * math.sin(angle - root), heel + 0.01 - 0.05 * math.sin(angle - root))

    assert _bisect(gap, root - below, root + 0.1) == plain_bisection(gap, root - below, root + 0.1)


def test_middles_outside_of_the_bracket_are_not_evaluated() -> None:
    evaluated = []

    def gap(angle: float) -> float:
        evaluated.append(angle)
        return math.sin(angle - 0.1)

    assert _bisect(gap, -0.3, 0.5) == pytest.approx(0.1, abs=1e-15)
    assert len(evaluated) < 35
