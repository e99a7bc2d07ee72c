"""The study of coverage: campaigns simulated and identified, on one process or more; its example."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from twin_gait.exceptions import ParameterError
from twin_gait.identification import Processing
from twin_gait.studies.campaign import TwoWayProtocol
from twin_gait.studies.coverage import (
    CoverageStudy,
    Estimate,
    estimate_campaign,
    measure_coverage,
    true_parameters,
    usual_warnings,
)
from twin_gait.vocabulary import JointName

EXAMPLE = Path(__file__).parents[2] / "examples" / "coverage.py"
SHORT = CoverageStudy(joint=JointName.KNEE, campaigns=2, two_way=TwoWayProtocol(cycles=1, period=1.0))


def test_zero_phase_is_near_the_truth_and_another_seed_is_another_campaign():
    truth = np.array(list(true_parameters(JointName.KNEE).values()))
    (first,), (second,) = (estimate_campaign(SHORT, seed).values() for seed in (0, 1))
    for estimate in (first, second):
        # Four standard deviations of short campaigns; the intervals are four of them wide.
        assert (np.abs(estimate.values - truth) < 2.0 * np.ptp(estimate.intervals, axis=1) / 2.0).all()
    assert (first.values != second.values).all()


def test_workers_find_what_one_process_finds():
    (found,) = measure_coverage(SHORT, workers=2).values()
    expected = [estimate_campaign(SHORT, seed)[Processing.ZERO_PHASE].values for seed in (0, 1)]
    values = sorted(tuple(item.values) for item in found)  # they come in the order in which they are done
    assert values == sorted(map(tuple, expected))


def test_a_study_that_is_stopped_keeps_what_is_done():
    steps: list[tuple[int, int]] = []
    (found,) = measure_coverage(
        SHORT, progress=lambda done, total: steps.append((done, total)), should_stop=lambda: True
    ).values()
    assert len(found) == 1
    assert steps == [(1, 2)]


def test_a_study_of_one_campaign_is_refused():
    with pytest.raises(ParameterError, match="campaigns"):
        CoverageStudy(joint=JointName.KNEE, campaigns=1)


def test_warnings_are_counted_without_their_numbers():
    values, intervals = np.zeros(4), np.zeros((4, 2))
    estimates = [
        Estimate(values, intervals, ("one direction only: 3.1 % of the samples", "no fast samples: 0.0 %")),
        Estimate(values, intervals, ("one direction only: 2.0 % of the samples",)),
    ]
    assert usual_warnings(estimates) == {"one direction only": 1.0, "no fast samples": 0.5}


def test_the_example_prints_both_processings_and_the_warning(capsys, monkeypatch):
    specification = importlib.util.spec_from_file_location("coverage_example", EXAMPLE)
    assert specification is not None and specification.loader is not None
    example = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(example)
    monkeypatch.setattr(example, "measure_coverage", _measured_once)
    example.main("knee", campaigns=2)
    text = capsys.readouterr().out
    assert "knee, 2 campaigns (two-way), zero_phase" in text
    assert "knee, 2 campaigns (two-way), thesis" in text
    assert text.count("breakaway_velocity_rad_per_s") == 2
    assert "warns in 100 %: the thesis's processing makes the velocity" in text


def _measured_once(study: CoverageStudy, workers: int) -> dict[Processing, list[Estimate]]:
    """One short campaign, counted twice: what is printed does not depend on how many there are."""
    short = CoverageStudy(joint=study.joint, processings=study.processings, two_way=SHORT.two_way)
    return {key: [estimate] * 2 for key, estimate in estimate_campaign(short, 0).items()}
