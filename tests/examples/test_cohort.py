"""The cohorts that walk with the scaled table, and the people who ship."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pandas as pd
import pytest
from cohorts.shipped import JOINTS, experiment_of, pair, wearer_peak, wearer_power
from cohorts.tuned import experiment_of as tuned_experiment
from cohorts.walkers import DURATION, SPEEDS, SUPPORT, cohort_row, failures, walkers

from twin_gait import Side, load_experiment, simulate, summarise
from twin_gait.configuration import people
from twin_gait.studies import overridden

ROOT = Path(__file__).parents[2]
BELT, SHARE = "scenario.belt_speed_m_per_s", "scenario.support.share"


def results_of(name: str) -> dict:
    return json.loads((ROOT / "examples" / "results" / name / "results.json").read_text())


def test_people_are_the_same_in_a_set_of_any_size_and_keep_to_their_range() -> None:
    who, (low, high) = walkers(30, 4), SPEEDS
    assert walkers(7, 4) == who[:7]
    speeds = [item[BELT] for item in who]
    assert low <= min(speeds) < low + 0.2 * (high - low)
    assert high - 0.2 * (high - low) < max(speeds) <= high


def test_a_walker_walks_in_their_own_condition_and_place() -> None:
    who = next(item for item in walkers(40, 11) if item.get("patient") == "stroke_left")
    experiment = tuned_experiment(who)
    person = experiment.patient
    assert (person.mass, person.height) == (who["patient.mass_kg"], who["patient.height_m"])
    assert any(item.effort > 0.0 for item in person.conditions.values())
    assert experiment.scenario.belt_speed == who[BELT]
    assert (experiment.scenario.support.share, experiment.duration) == (SUPPORT, DURATION)
    assert experiment.integration is None


def test_a_row_counts_who_walks_and_a_sentence_names_who_does_not() -> None:
    errors = {f"{side}_rmse_{joint}_by_contact_deg": 4.0 for side in Side for joint in ("hip", "knee")}
    walks = pd.DataFrame(
        [{"episode": n, "outcome": "walked", "duration_s": 60.0, **errors} for n in range(10)]
    )
    walks.loc[9, ["outcome", "duration_s"]] = ["fell", 12.0]
    walks.loc[:8, "left_rmse_hip_by_contact_deg"] = [float(4 + number) for number in range(9)]
    row = cohort_row("treadmill", 11, walks)
    assert row["walk"] == "9 of 10 (90.0%)"
    share, z, n = 0.9, 1.959964, 10  # Wilson's interval by hand
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    reach = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    assert row["95 % interval"] == f"{centre - reach:.1%} to {centre + reach:.1%}"
    assert (row["hip [°]"], row["knee [°]"], row["others"]) == ("8.0", "4.0", "1 fell")
    who = [{"patient.mass_kg": 80.0, "patient.height_m": 1.8}] * 10
    (sentence,) = failures("treadmill", 11, walks, who)
    assert sentence == "treadmill, seed 11, number 9: mass alone, 80 kg, 1.80 m fell after 12.0 s"


def test_powers_of_a_wearer_add_up_to_their_work() -> None:
    """Against the work that the engine integrates; powers are sampled once a tick."""
    run = simulate(experiment_of("healthy", 0.6, 0.3))
    work = run.log["patient_work_J"].iloc[-1]
    assert abs(work) > 0.1
    assert sum(wearer_power(run, joint) for joint in JOINTS) * run.duration == pytest.approx(work, rel=0.02)
    assert wearer_peak(run, JOINTS[0]) == max(
        run.log[f"{side}_hip_patient_torque_Nm"].abs().max() for side in Side
    )
    assert pair([0.5, None], ".1f", 100.0) == "50.0, –"


def test_the_page_is_about_the_people_who_ship() -> None:
    text = (ROOT / "docs" / "background" / "people.md").read_text(encoding="utf-8")
    for name, description in people().items():
        assert f"| `{name}` | {description} |" in text
    assert {row["who"] for row in results_of("shipped_people")["people"]} > set(people())


def test_a_row_of_the_robustness_map_is_what_its_walk_alone_does() -> None:
    table = pd.read_csv(ROOT / "examples" / "results" / "robustness_map" / "robustness_map.csv")
    worst = table.sort_values(
        ["mass_kg", "height_m", "support_share", "speed_m_per_s"], ascending=[0, 1, 1, 0]
    )
    row = worst.iloc[0]
    base = load_experiment("treadmill", ["duration_s=20"]).experiment
    place = {
        "patient.mass_kg": row["mass_kg"],
        "patient.height_m": row["height_m"],
        BELT: row["speed_m_per_s"],
        SHARE: row["support_share"],
    }
    run = simulate(overridden(base, place))
    assert run.verdict.outcome == row["outcome"]
    assert min(side["strides"] for side in summarise(run)["sides"].values()) == row["strides"]
    assert len(table) == 320
