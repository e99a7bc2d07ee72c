"""The design of the sensitivity study: indices against a closed form, and changes that change the walk."""

from __future__ import annotations

from pathlib import Path

import limits_of_validity as page
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from twin_gait import load_experiment
from twin_gait.studies.batch import override_experiment


def test_indices_are_those_of_the_ishigami_function() -> None:
    """Closed form with a = 7 and b = 0.1: Ishigami and Homma (1990), in Saltelli et al. (2008), chapter 4."""
    points = np.pi * (2.0 * page.saltelli_points(3, 4096) - 1.0)
    x, y, z = np.moveaxis(points, 2, 0)
    found = page.indices_of(np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x))
    assert_allclose(found["first"], [0.3139, 0.4424, 0.0], atol=0.02)
    assert_allclose(found["total"], [0.5576, 0.4424, 0.2437], atol=0.02)
    assert (found["total_half"] < 0.05).all()


def test_the_middle_values_are_those_of_the_default_walk_and_each_end_changes_it() -> None:
    base = load_experiment("treadmill_guided").experiment
    nominal = page.changes_of({item: item.nominal for item in page.ASSUMPTIONS})
    document = override_experiment(base, nominal)
    assert document.plant == base.plant and document.scenario == base.scenario
    assert document.assumed_patient == base.patient and document.sensors == base.sensors
    for item in page.ASSUMPTIONS:
        assert item.low <= item.nominal <= item.high
        ends = [override_experiment(base, page.changes_of({item: item.at(end)})) for end in (0.0, 1.0)]
        assert ends[0] != ends[1] and base != ends[1], item.label
        assert item.at(0.0) == item.low and item.at(1.0) == pytest.approx(item.high)


def test_soles_of_another_length_move_heel_and_toe() -> None:
    with page.other_soles() as soles:
        for label, settings in soles.items():
            leg = load_experiment("treadmill_guided", settings).experiment.leg
            text = Path(leg.urdf).read_text(encoding="utf-8")
            ratio = page.SOLES[label]
            assert text.count(f'xyz="{0.17 * ratio:.4f} 0 -0.08"') == 2
            assert text.count(f'xyz="{-0.05 * ratio:.4f} 0 -0.08"') == 2


def test_the_largest_span_over_both_ends_and_the_default_counts() -> None:
    """A walk that ends early has no result, so the other end counts."""
    columns = list(page.OUTPUTS)
    low = pd.DataFrame([[1.0] * 6, [2.0] * 6], index=["a", "b"], columns=columns)
    high = pd.DataFrame([[4.0] * 6, [np.nan] * 6], index=["a", "b"], columns=columns)
    moved = page.spans(low, high, pd.Series([3.0] * 6, index=columns))
    assert moved.loc["a"].tolist() == [3.0] * 6 and moved.loc["b"].tolist() == [1.0] * 6
