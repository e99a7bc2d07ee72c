"""Tuning with real walks, short ones: values against the summary, workers, the folder and its report."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.checking.check import check, counts, load_case
from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.experiment.experiment import Engine
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.reference import normative_ground_force, reference_curve, reference_cycle_time
from twin_gait.measures.strides import symmetry_index
from twin_gait.report import tune as pictures
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation import simulator
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate
from twin_gait.studies.tune import result
from twin_gait.studies.tune import tune as stages
from twin_gait.studies.tune.objective import Rating, objective_terms, rate_walk, term_values
from twin_gait.studies.tune.space import editable_document
from twin_gait.studies.tune.tune import TuningSettings, tune
from twin_gait.studies.tune.walks import (
    build_cases,
    candidate_table,
    quick_errors,
    table_performance,
    walk_all,
)
from twin_gait.studies.workers import Workers
from twin_gait.vocabulary import JointName, Outcome, Side

JOINTS = ("hip", "knee")
TITLES = [part.title for part in objective_terms(JOINTS)]
FALLS = (Outcome.FELL, Outcome.DIVERGED, Outcome.HELD)


@pytest.fixture(scope="module")
def walk() -> Run:
    experiment = load_experiment("treadmill_guided").experiment
    return simulate(replace(experiment, duration=12.0, engine=Engine.COMPILED))


def test_parts_are_the_numbers_of_the_summary(walk: Run) -> None:
    """Bit for bit, although only what the parts are made of is measured.

    Those of the ground's forces are made again here from the measures of the walk and the reference.
    """
    values, summary = term_values(walk), summarise_run(walk)
    sides = list(summary["sides"].values())
    joints = [joint for side in sides for joint in side["joints"].values()]
    pairs = [[side["swing_share"] for side in sides]]
    pairs += [[side["joints"][joint]["range_of_motion_deg"] for side in sides] for joint in ("hip", "knee")]
    legs = list(walk.walk_measures().values())
    carried = walk.walkway.carried_weight  # type: ignore[union-attr]
    speed = walk.experiment.scenario.walking.speed  # type: ignore[union-attr]
    healthy, percent = reference_cycle_time(speed, 1.75), np.arange(101.0)
    push = normative_ground_force(percent, speed=speed).forward.max()
    knee = np.degrees(reference_curve(JointName.KNEE, percent, speed=speed, height=1.75))
    healthy_yield = knee[:31].max() - knee[0]
    of_walk = {
        "knee_at_contact_deg": max(leg["knee_at_contact_deg"] for leg in legs),
        "yield_lack_deg": healthy_yield - min(leg["knee_yield_deg"] for leg in legs),
        "stride_time_error_pct": 100.0
        * max(abs(side["stride_time_mean_s"] - healthy) for side in sides)
        / healthy,
        "double_support_error_pct": 100.0
        * max(abs(side["double_support_share"] - (0.462 - 0.152 / 0.54 * (speed - 0.39))) for side in sides),
        "belt_power_W": abs(summary["power"]["belt_W"]),
        "braking_peak_pct": 100.0 * max(-leg["braking_peak"] for leg in legs),
        "slip_mm": 1e3 * max(leg["slip_m"] for leg in legs),
        "landing_speed_m_per_s": max(leg["landing_speed_m_per_s"] for leg in legs),
        "load_peak_pct": 100.0 * max(leg["load_peak"] for leg in legs) - 100.0,
        "trough_pct": 100.0 - 100.0 * min(leg["min_midstance_load"] for leg in legs),
        "slow_loading_pct": 100.0 - 100.0 * min(leg["min_load"] for leg in legs),
        "fore_aft_pct": 100.0 * abs(sum(leg["fore_aft_force_N"] for leg in legs)) / carried,
        "propulsion_lack_pct": max(0.0, 100.0 - 100.0 * min(leg["propulsion_peak"] for leg in legs) / push),
    }
    assert {name: values.pop(name) for name in of_walk} == pytest.approx(of_walk, abs=1e-9)
    curves = {name: values.pop(name) for name in ("offset_deg", "ankle_error_deg")}
    assert curves["offset_deg"] == pytest.approx(
        max(abs(_mean_distance(walk, side, joint)) for side in Side for joint in ("hip", "knee")), rel=1e-3
    )
    assert curves["ankle_error_deg"] == pytest.approx(_error(walk, "ankle"), rel=1e-6)
    for joint in ("hip", "knee"):
        error = max(side[f"rmse_{joint}_by_contact_deg"] for side in sides)
        assert values.pop(f"{joint}_error_deg") == pytest.approx(error, rel=1e-12)
    assert values == {
        "stride_variation_pct": 100.0 * max(side["stride_time_variation"] for side in sides),
        "second_contacts_per_stride": max(
            (side["further_contacts"] - side["scuffs"]) / side["strides"] for side in sides
        ),
        "scuffs_per_stride": max(side["scuffs"] / side["strides"] for side in sides),
        "saturated_pct": 100.0 * summary["any_joint_saturated_share"],
        "torque_change_Nm": max(joint["switch_torque_change_Nm"] for joint in joints),
        "torque_jump_Nm": max(joint["switch_torque_jump_Nm"] for joint in joints),
        "clearance_lack_mm": 15.0 - 1e3 * min(side["toe_clearance_min_m"] for side in sides),
        "asymmetry_pct": 100.0 * max(abs(symmetry_index(*pair)) for pair in pairs),
    }
    assert all(value is not None and value >= 0.0 for value in values.values())


def test_the_pitch_of_a_trunk_counts_only_if_it_moves(walk: Run) -> None:
    """A sine of 4° has a root mean square of 2.83° over strides, whatever their number."""
    assert "trunk_pitch_rms_deg" not in {part.name for part in rate_walk(walk).terms}
    start, end = walk.leg_records()[0].strides()[0]
    periods = (walk.log.index.to_numpy() - start) / (end - start)
    pitch = np.radians(4.0) * np.sin(8.0 * np.pi * periods)
    pitching = rate_walk(replace(walk, log=walk.log.assign(trunk_pitch_rad=pitch)))
    assert "trunk_pitch_rms_deg" in {part.name for part in pitching.terms}
    assert pitching.values["trunk_pitch_rms_deg"] == pytest.approx(4.0 / math.sqrt(2.0), rel=0.01)
    assert pitching.cost > rate_walk(walk).cost


def test_a_walk_counts_as_a_fall_according_to_its_outcome(walk: Run) -> None:
    """Without the verdict, which would look at all strides again."""
    limp = simulate(
        replace(
            walk.experiment,
            duration=3.0,
            scenario=replace(
                walk.experiment.scenario, support=replace(walk.experiment.scenario.support, share=0.0)
            ),
        )
    )  # type: ignore[arg-type, union-attr]
    assert rate_walk(walk).fell is (walk.verdict.outcome in FALLS) is False
    assert rate_walk(limp).fell is (limp.verdict.outcome in FALLS)


def test_the_error_is_the_one_that_a_loop_over_strides_finds(walk: Run) -> None:
    """From the force plate's crossings, stride by stride, with numpy's own interpolation."""
    assert term_values(walk)["knee_error_deg"] == pytest.approx(_error(walk, "knee"), rel=1e-6)


def _distances(walk: Run, side: Side, joint: str) -> np.ndarray:
    """Angle less the reference in [deg] at every percent of each counted stride."""
    speed = walk.experiment.scenario.belt_speed  # type: ignore[union-attr]
    loaded = walk.log[f"{side}_foot_normal_force_N"].to_numpy() > CONTACT_FORCE
    rises = np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1
    strikes = [tick for tick in rises if tick > 150 and not loaded[tick - 150 : tick].any()]
    angle = np.degrees(walk.log[f"{side}_{joint}_angle_rad"].to_numpy())
    percent = np.arange(100.0)  # 100 % belongs to the next stride
    reference = np.degrees(reference_curve(JointName(joint), percent, speed=speed, height=1.75))
    instants = [start + percent / 100.0 * (end - start) for start, end in itertools.pairwise(strikes[2:])]
    return np.array([np.interp(instant, np.arange(len(angle)), angle) - reference for instant in instants])


def _error(walk: Run, joint: str) -> float:
    return max(float(np.sqrt(np.mean(_distances(walk, side, joint) ** 2))) for side in Side)


def _mean_distance(walk: Run, side: Side, joint: str) -> float:
    return float(np.mean(_distances(walk, side, joint)))


def test_the_quick_rules_find_an_error_of_a_table() -> None:
    experiment = load_experiment("treadmill_guided").experiment
    assert quick_errors(experiment) == set()
    table = editable_document(experiment.table)
    # The knee can never be so far bent, and nothing else ends the phase.
    table["transitions"] = [
        item
        for item in table["transitions"]
        if not (item["from"] == "swing_extension" and item["cause"] != "limb_extended")
    ]
    for item in table["transitions"]:
        if item["cause"] == "limb_extended":
            item["all"] = ["knee.angle_deg > 500"]
    assert quick_errors(replace(experiment, table=candidate_table(table)))


def test_walks_depend_neither_on_the_worker_nor_on_the_stored_columns() -> None:
    experiment = replace(load_experiment("treadmill_guided").experiment, duration=10.0)
    cases = build_cases(experiment, "robust")
    walks = [cases[name] for name in ("nominal", "bus 23 V", "belt −10 %")]
    alone = [rate_walk(simulate(walk)) for walk in walks]
    assert walk_all(walks, Workers()) == alone
    with Workers(2) as workers:
        assert walk_all(walks, workers) == alone
    assert len(alone[0].deviations) == 2 * 2 * 20


def test_deviations_add_up_to_the_errors_over_goals(walk: Run) -> None:
    """The strides of this walk are alike, so that the mean stride is as far off as they are."""
    rating, sides = rate_walk(walk), summarise_run(walk)["sides"].values()
    errors = [
        (side[f"rmse_{joint}_by_contact_deg"] / goal) ** 2
        for side in sides
        for joint, goal in (("hip", 3.5), ("knee", 4.5))
    ]
    assert np.square(rating.deviations).sum() == pytest.approx(sum(errors) / 2, rel=0.02)


# ---------------------------------------------------------------------- the whole

SETTINGS = TuningSettings(generations=1, search_duration=10.0, robust_duration=12.0, seed=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tuning too short to find anything, whose table is the best candidate all the same."""
    experiment = load_experiment("treadmill_guided").experiment
    directory = tmp_path_factory.mktemp("tuned") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "FINALISTS", 1)
        # Alone, which the loop of lanes is proven to equal.
        patch.setattr(simulator, "FEWEST_IN_ALL", math.inf)
        cases = build_cases(replace(experiment, seed=SETTINGS.seed), "robust")
        two = {name: cases[name] for name in ("nominal", "bus 23 V")}
        patch.setattr(stages, "build_cases", lambda item, kind: two)
        tuning = tune(experiment, SETTINGS)
        assert tuning is not None
        tuning.ranked = [item for item in tuning.ranked if item.points is not None] or tuning.ranked
        written = result.write_tuning(tuning, directory, wearer="the default wearer")
    assert written["experiment"] == "treadmill_guided"
    return directory


@pytest.fixture(scope="module")
def tuning_document(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "tune.json").read_text())
    return document


@pytest.mark.slow
def test_the_folder_is_whole(folder: Path) -> None:
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "table.yaml",
        "tune.json",
        "report.html",
        *(f"figures/{name}.png" for name in ("gait", "trade_offs", "convergence")),
    }


def test_the_table_that_is_written_is_the_one_that_walked(
    folder: Path, tuning_document: dict[str, Any]
) -> None:
    settings = [f"table={folder / 'table.yaml'}", "duration_s=12", f"seed={SETTINGS.seed}"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    again = term_values(run)
    assert {part["name"]: part["after"] for part in tuning_document["parts"]} == again


def test_the_table_passes_the_check(folder: Path, tuning_document: dict[str, Any]) -> None:
    found = counts(check(load_case(folder / "table.yaml", "treadmill_guided")))
    assert found["errors"] == 0
    assert {key: tuning_document["check"][key] for key in found} == found


def test_reported_numbers_equal_the_table(folder: Path, tuning_document: dict[str, Any]) -> None:
    table = load_gait_table(folder / "table.yaml")
    tuned = {item["name"]: item["tuned"] for item in tuning_document["parameters"]}
    for phase, values in table.phases.items():
        for joint, impedance in values.joints.items():
            found = tuned[f"{phase}.{joint}.equilibrium_deg"]
            assert np.degrees(impedance.equilibrium_angle) == pytest.approx(found, abs=1e-9)
    assert tuned["blending.duration_ms"] == table.blending.duration_ticks
    assert any(item["tuned"] != item["start"] for item in tuning_document["parameters"])


def test_the_costs_of_the_cases_add_up_to_the_cost_of_the_robust_set(tuning_document: dict[str, Any]) -> None:
    weight = tuning_document["nominal_weight"]
    for which in ("before", "after"):
        nominal, *others = (case[which]["cost"] for case in tuning_document["robust_set"])
        whole = weight * nominal + (1.0 - weight) * sum(others) / len(others)
        assert whole == pytest.approx(tuning_document["cost"][which])


class _Page(HTMLParser):
    """Addresses and cells of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attributes if name in ("src", "srcset", "href")]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_report_is_one_file_that_names_every_part(folder: Path) -> None:
    page = _Page()
    page.feed((folder / "report.html").read_text(encoding="utf-8"))
    assert len(page.addresses) == 3  # each once: the style sheet turns them dark
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    for title in TITLES:
        assert title in page.text
    assert "its weight of the excess × (value / goal − 0.9)² more." in " ".join(page.text.split())
    assert "Not a medical device" in page.text
    assert "nan" not in page.text.lower()


def test_the_summary_names_the_traded_parts(tuning_document: dict[str, Any]) -> None:
    parts = [{**part, "verdict": "traded"} for part in tuning_document["parts"][:1]]
    parts += [{**part, "verdict": "better"} for part in tuning_document["parts"][1:2]]
    worse, better = pictures.summary({**tuning_document, "found_better": True, "parts": parts})[-2:]
    assert worse.startswith("  worse   hip error:") and better.startswith("  better  knee error:")


def test_a_search_without_improvement_is_reported(tuning_document: dict[str, Any]) -> None:
    text = pictures.summary({**tuning_document, "found_better": False})[0]
    assert "table.yaml is a copy of" in text


@given(
    st.integers(1, 3).flatmap(
        lambda size: st.lists(st.lists(st.integers(0, 4), min_size=size, max_size=size), max_size=12)
    )
)
def test_a_compromise_is_best_if_no_other_dominates_it(points: list[list[int]]) -> None:
    def dominates(one: list[int], other: list[int]) -> bool:
        return one != other and all(a <= b for a, b in zip(one, other, strict=True))

    expected = [not any(dominates(one, other) for one in points) for other in points]
    found = pictures.non_dominated(
        np.array(points, dtype=float).reshape(len(points), len(points[0]) if points else 1)
    )
    assert found.tolist() == expected


def test_a_table_is_rated_by_its_nominal_walk_and_the_costs_of_the_other_cases() -> None:
    values: dict[str, float | None] = {"hip_error_deg": 3.0, "knee_error_deg": 5.0}
    nominal = Rating(5.0, values, False, 1.0, torque=20.0)
    fallen = nominal._replace(fell=True, cost=60.0)
    assert table_performance([nominal]) == [pytest.approx(17.0**0.5), 20.0, None]
    assert table_performance([nominal, nominal, fallen]) == [pytest.approx(17.0**0.5), 20.0, 32.5]
    assert table_performance([fallen, nominal]) == [None, None, 5.0]
    assert table_performance([nominal._replace(values={**values, "hip_error_deg": None})]) == [
        None,
        None,
        None,
    ]


def test_the_torque_of_a_walk_is_the_motor_torque(walk: Run) -> None:
    joints = [joint for side in summarise_run(walk)["sides"].values() for joint in side["joints"].values()]
    squares = [joint["torque_rms_Nm"] ** 2 for joint in joints]
    assert len(squares) == 4
    assert rate_walk(walk).torque == pytest.approx(np.mean(squares) ** 0.5, rel=1e-12)


def test_the_best_compromises_and_the_chosen_table_are_drawn(tuning_document: dict[str, Any]) -> None:
    """In both panels: candidates with an effort of 20 to 22 N·m, of which one is dominated."""
    tried = [[6.0, 20.0, 9.0], [5.0, 22.0, 8.0], [6.5, 21.0, 9.0], [4.0, 25.0, None], [None, None, 3.0]]
    figure = pictures.draw_trade_offs(
        {"candidates": tried, "before": [9.0, 24.0, 9.5], "after": tried[1]}, JOINTS
    )
    for axes, column in zip(figure.axes, (1, 2), strict=True):
        shown = {
            str(line.get_label()): sorted(zip(line.get_xdata(), line.get_ydata(), strict=True))
            for line in axes.lines
        }
        assert shown["best compromises (Pareto front of the three)"] == sorted(
            (item[column], item[0]) for item in tried[:2]
        )
        assert shown["chosen"] == [(tried[1][column], 5.0)]
    own = [item for item in tuning_document["trade_offs"]["candidates"] if None not in item]
    assert len(own) >= stages.RACED
    assert tuning_document["trade_offs"]["after"][0] == pytest.approx(
        np.sqrt(np.mean([part["after"] ** 2 for part in tuning_document["parts"][:2]]))
    )
