"""Prediction, linear run and true run of the sampled loop, and the results that the page quotes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from loop_stability import (
    POSTURE,
    UNDECIDED,
    VELOCITIES,
    Case,
    Result,
    cross_check,
    grid,
    linear_experiment,
    predicted_radius,
    row_of,
    true_ending,
    true_experiment,
)
from whatif.endings import Ending

RESULTS = Path(__file__).parents[2] / "examples" / "results" / "loop_stability"
CALM = Case(math.degrees(2.5), 30.0, 0.4)


def result(radii: tuple[float, float], unstable: tuple[bool, bool], case: Case = CALM) -> Result:
    return Result(case, radii, unstable, Ending.REST, 0.0)


@pytest.mark.parametrize(
    ("radius", "unstable", "misses"),
    [(1.1, True, 0), (1.1, False, 1), (0.9, False, 0), (0.9, True, 1), (1.004, False, 0), (0.996, True, 0)],
)
def test_a_wrong_prediction_is_a_clear_one_that_the_linear_run_contradicts(radius, unstable, misses):
    assert result((radius, 0.9), (unstable, False)).misses() == misses


def test_the_linear_leg_is_the_true_one_with_friction_replaced_by_its_slope():
    true, linear = true_experiment(CALM), linear_experiment(CALM, 0.0)
    for joint, law in linear.plant.true_friction().items():
        assert law.coulomb_friction == law.breakaway_torque == 0.0
        # At rest equation (3.1) has the slope √(2e) (a - b) / c + 10 b / c + d.
        original = true.plant.true_friction()[joint].normalised()
        a, b, c, d = (
            original.breakaway_torque,
            original.coulomb_friction,
            original.breakaway_velocity,
            original.viscous_friction,
        )
        slope = math.sqrt(2.0 * math.e) * (a - b) / c + 10.0 * b / c + d
        assert law.viscous_friction == pytest.approx(slope, rel=1e-6)
    assert linear.table == true.table


@pytest.mark.parametrize(
    ("case", "ending"),
    [
        (CALM, Ending.REST),
        (Case(math.degrees(2.5), 10.0, 0.8), Ending.LIMIT_CYCLE),
        (Case(math.degrees(0.3), 0.0, 1.0), Ending.RUNAWAY),
    ],
)
def test_a_true_leg_rests_cycles_or_runs_away(case, ending):
    found, amplitude = true_ending(case)
    assert found is ending
    assert (amplitude > math.radians(0.5)) is (ending is not Ending.REST)


def test_a_cross_check_has_all_three():
    found = cross_check(CALM)
    assert max(found.radii) < 1.0 and not any(found.unstable) and found.ending is Ending.REST


def test_the_stored_table_matches_the_grid_and_the_transition_matrix():
    table = pd.read_csv(RESULTS / "loop_stability.csv")
    cases = grid()
    assert len(table) == len(cases)
    for velocity in VELOCITIES:
        radii = table[f"spectral_radius_at_{velocity:g}_rad_per_s"]
        np.testing.assert_allclose(radii, [predicted_radius(case, velocity) for case in cases], atol=2e-5)
        clear = (radii - 1.0).abs() >= UNDECIDED
        unstable = table[f"linear_run_at_{velocity:g}_rad_per_s"] == "unstable"
        assert ((radii > 1.0) == unstable)[clear].all()
    assert list(row_of(result((0.9, 0.9), (False, False)))) == list(table.columns)


def test_the_posture_is_far_from_the_stops():
    limits = np.array([(-20.0, 110.0), (-4.0, 122.0)])
    assert (np.abs(np.degrees(POSTURE)[:, None] - limits) >= 40.0).all()
