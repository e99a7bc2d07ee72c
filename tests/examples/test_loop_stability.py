"""The study that sets prediction, linear run and true run side by side, and the page made of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from twin_gait.studies.loop_stability import page as loop_stability_page
from twin_gait.studies.loop_stability.loop_stability import (
    POSTURE,
    UNDECIDED,
    VELOCITIES,
    Case,
    Ending,
    LoopResult,
    grid,
    linear_experiment,
    predicted_radius,
    true_ending,
    true_experiment,
    witness_all,
)
from twin_gait.studies.loop_stability.page import draw, page, result_table

DOCS = Path(__file__).parents[2] / "docs"
CALM = Case(math.degrees(2.5), 30.0, 0.4)


def result(radii: tuple[float, float], grows: tuple[bool, bool], case: Case = CALM) -> LoopResult:
    return LoopResult(case, radii, grows, Ending.REST, 0.0)


@pytest.mark.parametrize(
    ("radius", "grows", "misses"),
    [(1.1, True, 0), (1.1, False, 1), (0.9, False, 0), (0.9, True, 1), (1.004, False, 0), (0.996, True, 0)],
)
def test_a_miss_is_a_clear_prediction_that_the_linear_run_contradicts(radius, grows, misses):
    assert result((radius, 0.9), (grows, False)).misses() == misses


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


def test_the_page_tells_what_was_found(monkeypatch):
    monkeypatch.setattr(loop_stability_page, "_FINE", 6)  # a coarse ground is enough here
    progress = []
    results = witness_all([CALM], lambda done, total: progress.append((done, total)))
    assert progress == [(1, 1)]
    assert "**0 misses**" in page(results)
    wrong = [*results, result((1.2, 0.9), (False, False))]
    assert "**1 misses**" in page(wrong)
    assert "| 30 | 0.4 |" in page(results)
    assert len(draw(results).axes) == 5  # four panels and the colour bar


def test_the_published_table_is_that_of_the_grid_and_of_this_matrix():
    table = pd.read_csv(DOCS / "loop_stability.csv")
    cases = grid()
    assert len(table) == len(cases)
    for velocity in VELOCITIES:
        radii = table[f"spectral_radius_at_{velocity:g}_rad_per_s"]
        np.testing.assert_allclose(radii, [predicted_radius(case, velocity) for case in cases], atol=2e-5)
        clear = (radii - 1.0).abs() >= UNDECIDED
        grows = table[f"linear_run_at_{velocity:g}_rad_per_s"] == "grows"
        assert ((radii > 1.0) == grows)[clear].all()
    assert list(result_table([result((0.9, 0.9), (False, False))]).columns) == list(table.columns)


def test_the_posture_is_far_from_the_stops():
    limits = np.array([(-20.0, 110.0), (-4.0, 122.0)])
    assert (np.abs(np.degrees(POSTURE)[:, None] - limits) >= 40.0).all()
