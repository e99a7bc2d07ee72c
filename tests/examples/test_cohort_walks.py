"""The scaling law that is fitted to people, and the cohorts that walk with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from twin_gait.studies.people import cohort_page, cohort_walks, scaling_fit
from twin_gait.studies.people.cohort_walks import (
    Walk,
    Walker,
    Work,
    draw_walkers,
    experiment_for,
    walk_cohort,
)
from twin_gait.studies.people.scaling_fit import Person, Worth, draw_people, fit_exponents, law_of
from twin_gait.studies.people.trials import MASS_ALONE

from twin_gait.configuration import load_experiment, load_gait_table
from twin_gait.experiment import Experiment
from twin_gait.gait.scaling import scale_table
from twin_gait.gait.table import SCALING_EXPONENTS, Scaling
from twin_gait.studies.tune.stages import START_TABLES

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def base() -> Experiment:
    return load_experiment("treadmill_normative").experiment


def test_people_are_the_same_in_a_set_of_any_size_and_keep_to_their_ranges() -> None:
    people = draw_people(30, 4)
    assert draw_people(7, 4) == people[:7]
    assert draw_walkers(7, 4) == draw_walkers(30, 4)[:7]
    for values, (low, high) in (
        ([item.support for item in people], scaling_fit.SUPPORTS),
        ([item.speed for item in people], scaling_fit.SPEEDS),
        ([item.speed for item in draw_walkers(30, 4)], cohort_walks.SPEEDS),
    ):
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < max(values) <= high


def test_whatever_the_exponents_the_base_walks_as_its_table_says(base: Experiment) -> None:
    law = law_of(base, {name: 1.7 for name in SCALING_EXPONENTS})
    assert [getattr(law, name) for name in SCALING_EXPONENTS] == [1.7] * len(SCALING_EXPONENTS)
    assert law.speed is not None and law.height is not None
    scaled = scale_table(
        load_gait_table("treadmill_normative"),
        carried_mass=law.carried_mass,
        speed=law.speed,
        height=law.height,
    )
    assert scaled.phases == load_gait_table("treadmill_normative").phases


def test_the_fit_finds_exponents_that_were_planted(base: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    planted = {"carried_mass_exponent": 0.6, "speed_exponent": -0.5, "height_exponent": 0.2}

    def bowl(base: Experiment, people: Sequence[Person], law: Scaling, workers: Any) -> Worth:
        return Worth(sum((getattr(law, name) - value) ** 2 for name, value in planted.items()), 0.0, 0)

    monkeypatch.setattr(scaling_fit, "worth_of", bowl)
    found = fit_exponents(base, (), generations=30)
    assert found == pytest.approx(planted, abs=0.1)


def test_a_law_is_worth_the_mean_over_its_people(base: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    costs = {0: 1.0, 1: 2.0, 2: 99.0}
    monkeypatch.setattr(scaling_fit, "cost_of", lambda trial: costs[trial.person.number])
    worth = scaling_fit.worth_of(base, draw_people(3, 0), base.table.scaling)
    assert worth == Worth(34.0, 2.0, 1)


def test_a_walk_with_a_law_depends_on_the_person(base: Experiment) -> None:
    first, second = draw_people(2, 0)
    law = law_of(base, dict.fromkeys(SCALING_EXPONENTS, 0.0))
    costs = [scaling_fit.cost_of(scaling_fit.Trial(base, person, law)) for person in (first, second)]
    assert [number for number, _ in costs] == [0, 1]
    assert all(0.0 < cost < scaling_fit.WORST for _, cost in costs)
    assert costs[0][1] != costs[1][1]


@pytest.mark.parametrize("name", START_TABLES)
def test_shipped_tables_state_the_law_that_the_documentation_shows(name: str) -> None:
    rows = pd.read_csv(DOCS / cohort_page.FIT_FILE).set_index(["table", "law"])
    stated, law = rows.loc[(name, cohort_page.STATED)], load_gait_table(name).scaling
    assert {item: stated[item] for item in SCALING_EXPONENTS} == {
        item: getattr(law, item) for item in SCALING_EXPONENTS
    }
    for cost in ("mean_fitted", "mean_others"):
        best = rows.loc[name][cost].min()
        # Its numbers are rounded on a flat bottom: more than two thirds of what the best law saves is left.
        assert rows.loc[(name, cohort_page.NONE)][cost] - stated[cost] > 2.0 / 3.0 * (
            rows.loc[(name, cohort_page.NONE)][cost] - best
        )
    assert stated["falls"] == 0


def test_a_walker_walks_in_his_own_condition_and_place() -> None:
    sizes = {"patient.mass_kg": 61.0, "patient.height_m": 1.66, "patient.sex": "female"}
    experiment = experiment_for(Walker(0, "stroke_left", sizes, 0.37), "treadmill_normative")
    person = experiment.patient
    assert person is not None
    assert (person.mass, person.height, person.sex) == (61.0, 1.66, "female")
    assert any(item.effort > 0.0 for item in person.conditions.values())
    assert experiment.table.name == "treadmill_normative"
    assert experiment.scenario.belt_speed == 0.37  # type: ignore[union-attr]
    assert experiment.scenario.support.share == cohort_walks.SUPPORT  # type: ignore[union-attr]
    assert experiment.duration == cohort_walks.DURATION
    assert experiment.integration is None


def test_outcomes_come_in_the_order_of_the_walkers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cohort_walks, "DURATION", 4.0)
    walkers = [item._replace(condition=MASS_ALONE) for item in draw_walkers(2, 0)]
    found = walk_cohort([Work(item, "treadmill_normative") for item in reversed(walkers)])
    assert [item.walker for item in found] == walkers
    assert all(item.lasted == pytest.approx(4.0) for item in found)


def _outcome(number: int, word: str) -> Walk:
    sizes = {"patient.mass_kg": 80.0, "patient.height_m": 1.8, "patient.sex": "male"}
    parts: dict[str, float | None] = {"hip_error_deg": 4.0 + number, "knee_error_deg": None}
    return Walk(Walker(number, MASS_ALONE, sizes, 0.4), word, "the pelvis fell", 12.0, parts)


def test_the_page_counts_who_walks_and_names_who_does_not() -> None:
    walks = [_outcome(number, "walked") for number in range(9)] + [_outcome(9, "fell")]
    fits = pd.read_csv(DOCS / cohort_page.FIT_FILE)
    text = cohort_page.cohort_text(fits, {("treadmill", 11): walks}, walks[:9], walks)
    assert "9 of 10 (90.0%)" in text
    share, z, n = 0.9, 1.959964, 10  # Wilson's interval by hand
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    reach = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    assert f"{centre - reach:.1%} to {centre + reach:.1%}" in text
    assert "| 8.0 | – | 1 fell |" in text
    assert "number 9: mass alone, 80 kg, 1.80 m, 0.40 m/s fell after 12.0 s (the pelvis fell)" in text
    assert "## Tuned one by one" in text
    everybody = cohort_page.cohort_text(fits, {("treadmill", 11): walks[:9]}, (), ())
    assert "Everybody walks." in everybody
    assert "## Tuned one by one" not in everybody
