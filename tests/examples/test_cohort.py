"""The cohorts that walk with the scaled table, and the people who ship."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cohorts.people import HEAVIEST_WEARER, SIZES, BodySizes, cohort
from cohorts.shipped import JOINTS, experiment_of, pair, wearer_peak, wearer_power
from cohorts.tuned import experiment_of as tuned_experiment
from cohorts.walkers import DURATION, SPEEDS, SUPPORT, cohort_row, failures, sizes_of, walkers
from errors import raises

from twin_gait import Patient, Side, TwinGaitError, load_experiment, simulate, summarise_run
from twin_gait.configuration.experiments import list_patients
from twin_gait.exceptions import ParameterError
from twin_gait.studies.batch import override_experiment
from twin_gait.vocabulary import Sex

ROOT = Path(__file__).parents[2]
BELT, SHARE = "scenario.belt_speed_m_per_s", "scenario.support.share"


def results_of(name: str) -> dict:
    return json.loads((ROOT / "examples" / "results" / name / "results.json").read_text())


def test_people_are_the_same_in_a_set_of_any_size_and_keep_to_their_range() -> None:
    people, (low, high) = walkers(30, 4), SPEEDS
    assert walkers(7, 4) == people[:7]
    speeds = [item[BELT] for item in people]
    assert low <= min(speeds) < low + 0.2 * (high - low)
    assert high - 0.2 * (high - low) < max(speeds) <= high


def test_a_walker_has_their_own_condition_and_settings() -> None:
    walker = next(item for item in walkers(40, 11) if item.get("patient") == "stroke_left")
    experiment = tuned_experiment(walker)
    person = experiment.patient
    assert (person.mass, person.height) == (walker["patient.mass_kg"], walker["patient.height_m"])
    assert any(item.effort > 0.0 for item in person.conditions.values())
    assert experiment.scenario.belt_speed == walker[BELT]
    assert (experiment.scenario.support.share, experiment.duration) == (SUPPORT, DURATION)
    assert experiment.integration is None


def test_a_row_counts_walking_people_and_a_sentence_names_the_others() -> None:
    errors = {f"{side}_rmse_{joint}_by_contact_deg": 4.0 for side in Side for joint in ("hip", "knee")}
    walks = pd.DataFrame(
        [{"episode": n, "outcome": "walked", "duration_s": 60.0, **errors} for n in range(10)]
    )
    walks.loc[9, ["outcome", "duration_s"]] = ["fell", 12.0]
    walks.loc[:8, "left_rmse_hip_by_contact_deg"] = [float(4 + number) for number in range(9)]
    row = cohort_row("treadmill_guided", 11, walks)
    assert row["walk"] == "9 of 10 (90.0%)"
    share, z, n = 0.9, 1.959964, 10  # Wilson's interval by hand
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    reach = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    assert row["95 % interval"] == f"{centre - reach:.1%} to {centre + reach:.1%}"
    assert (row["hip [°]"], row["knee [°]"], row["others"]) == ("8.0", "4.0", "1 fell")
    people = [{"patient.mass_kg": 80.0, "patient.height_m": 1.8}] * 10
    (sentence,) = failures("treadmill_guided", 11, walks, people)
    assert sentence == "treadmill_guided, seed 11, number 9: mass alone, 80 kg, 1.80 m fell after 12.0 s"


def test_powers_of_a_wearer_add_up_to_their_work() -> None:
    """Against the work that the engine integrates; powers are sampled once a tick."""
    run = simulate(experiment_of("healthy", 0.6, 0.3))
    work = run.log["external_work_J"].iloc[-1]
    assert abs(work) > 0.1
    assert sum(wearer_power(run, joint) for joint in JOINTS) * run.duration == pytest.approx(work, rel=0.02)
    assert wearer_peak(run, JOINTS[0]) == max(
        run.log[f"{side}_hip_external_torque_Nm"].abs().max() for side in Side
    )
    assert pair([0.5, None], ".1f", 100.0) == "50.0, –"


def test_the_page_covers_the_shipped_people() -> None:
    text = (ROOT / "docs" / "background" / "people.md").read_text(encoding="utf-8")
    for name, description in list_patients().items():
        assert f"| `{name}` | {description} |" in text
    assert {row["who"] for row in results_of("shipped_people")["people"]} > set(list_patients())


def test_a_row_of_the_robustness_map_equals_its_single_walk() -> None:
    table = pd.read_csv(ROOT / "examples" / "results" / "robustness_map" / "robustness_map.csv")
    worst = table.sort_values(
        ["mass_kg", "height_m", "support_share", "speed_m_per_s"], ascending=[0, 1, 1, 0]
    )
    row = worst.iloc[0]
    base = load_experiment("treadmill_guided", ["duration_s=20"]).experiment
    changes = {
        "patient.mass_kg": row["mass_kg"],
        "patient.height_m": row["height_m"],
        BELT: row["speed_m_per_s"],
        SHARE: row["support_share"],
    }
    run = simulate(override_experiment(base, changes))
    assert run.verdict.outcome == row["outcome"]
    assert min(side["strides"] for side in summarise_run(run)["sides"].values()) == row["strides"]
    assert len(table) == 320


# ---------------------------------------------------------------- cohorts


@pytest.fixture(scope="module")
def population() -> tuple[Patient, ...]:
    return cohort(1500, 7)


def test_people_of_a_seed_are_the_same_in_a_cohort_of_any_size(population):
    assert cohort(5, 7) == population[:5]
    assert cohort(5, 8) != population[:5]


@pytest.mark.parametrize("sex", list(Sex))
def test_cohort_fills_the_5th_to_the_95th_percentile_of_either_sex(population, sex):
    """Percentiles of a lognormal variable with the published mean and deviation, from scipy."""
    from scipy import stats

    sizes, own = SIZES[sex], [item for item in population if item.sex is sex]
    assert abs(len(own) - 750) < 5.0 * math.sqrt(1500 * 0.25)
    for values, mean, deviation in (
        (np.array([item.height for item in own]), sizes.stature_mean, sizes.stature_deviation),
        (np.array([item.mass for item in own]), sizes.mass_mean, sizes.mass_deviation),
    ):
        spread = math.sqrt(math.log(1.0 + (deviation / mean) ** 2))
        law = stats.lognorm(spread, scale=mean * math.exp(-(spread**2) / 2.0))
        assert law.mean() == pytest.approx(mean, rel=1e-12)
        assert law.std() == pytest.approx(deviation, rel=1e-12)
        quantiles = law.cdf(values)
        assert quantiles.min() >= 0.05 - 1e-9
        assert quantiles.max() <= 0.95 + 1e-9
        assert np.histogram(quantiles, bins=9, range=(0.05, 0.95))[0].min() > len(own) / 18  # no gap
    assert max(item.mass for item in own) <= HEAVIEST_WEARER


def test_tall_people_are_heavier_as_published():
    """Brute force: normal draws with the published correlation, cut at the same percentiles."""
    generator = np.random.default_rng(0)
    for sex in Sex:
        own = [item for item in cohort(3000, 11) if item.sex is sex]
        found = np.corrcoef([item.height for item in own], [item.mass for item in own])[0, 1]
        rho = SIZES[sex].correlation
        pairs = generator.multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]], size=200_000)
        kept = pairs[(np.abs(pairs) < 1.645).all(axis=1)]
        expected = np.corrcoef(kept.T)[0, 1]
        assert abs(found - expected) < 4.0 / math.sqrt(len(own))


def test_heavy_population_is_limited_by_the_load_capacity_of_the_device():
    heavy = BodySizes(
        stature_mean=1.8, stature_deviation=0.07, mass_mean=105.0, mass_deviation=12.0, correlation=0.5
    )
    masses = [item.mass for item in cohort(200, 1, sizes=dict.fromkeys(Sex, heavy))]
    assert 107.0 < max(masses) <= HEAVIEST_WEARER


def test_cohort_has_the_properties_of_its_pattern():
    stroke = load_experiment("treadmill_guided", ["patient=stroke_left"]).experiment.patient
    drawn = cohort(3, 2, like=stroke)
    assert all(item.conditions == stroke.conditions for item in drawn)
    assert len({item.mass for item in drawn}) == 3


def test_sizes_of_a_cohort_are_changes_of_an_experiment():
    base = load_experiment("treadmill_guided", ["patient=healthy"]).experiment
    drawn = cohort(4, 3, like=base.patient)
    assert [override_experiment(base, item).patient for item in map(sizes_of, drawn)] == list(drawn)


def test_every_drawn_person_fits_the_device(population):
    for item in (min(population, key=lambda p: p.height), max(population, key=lambda p: p.height)):
        load_experiment(
            "treadmill_guided", [f"{k}={v}" for k, v in sizes_of(item).items()]
        ).experiment.build_world()


def test_an_empty_cohort_is_refused():
    with raises(ParameterError, "count", "1"):
        cohort(0, 1)


def test_population_without_admissible_people_is_refused():
    giants = BodySizes(
        stature_mean=1.8, stature_deviation=0.07, mass_mean=200.0, mass_deviation=12.0, correlation=0.5
    )
    with raises(ParameterError, "mass_mean", "110 kg"):
        cohort(1, 0, sizes=dict.fromkeys(Sex, giants))
    with raises(TwinGaitError, "sizes", "male"):
        cohort(1, 0, sizes={Sex.MALE: SIZES[Sex.MALE]})
