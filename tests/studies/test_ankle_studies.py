"""Tuning, comparing and breaking a walk whose table drives the ankle, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.checking.published_ranges import STIFFNESS_RANGES
from twin_gait.control.controllers.assistance import AssistanceParameters
from twin_gait.measures.reference import gait_profile_score
from twin_gait.report import tune as pictures
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.run import Run
from twin_gait.studies.accuracy import step_error
from twin_gait.studies.batch import flat_summary, summary_table
from twin_gait.studies.compare.comparison import CONTROLLERS
from twin_gait.studies.compare.measures import run_measures
from twin_gait.studies.compare.writing import shown_measures
from twin_gait.studies.fault_campaign import draw_faults
from twin_gait.studies.tune.objective import WORST, objective_terms, rate_walk, residuals, walk_cost
from twin_gait.studies.tune.space import editable_document, tunable_parameters
from twin_gait.studies.tune.walks import build_cases
from twin_gait.vocabulary import JointName, Side

WALK = "treadmill_ankle"
JOINTS = tuple(JointName)
TWO = (JointName.HIP, JointName.KNEE)


@pytest.fixture(scope="module")
def walk() -> Run:
    return simulate(load_experiment(WALK, ["duration_s=12"]).experiment)


# ---------------------------------------------------------------------------------- tuning


def test_the_error_of_a_driven_ankle_counts_like_hip_and_knee_errors() -> None:
    two, three = ({part.name: part for part in objective_terms(joints)} for joints in (TWO, JOINTS))
    assert set(two) == set(three)
    assert three["ankle_error_deg"].weight == three["knee_error_deg"].weight > two["ankle_error_deg"].weight
    assert three["ankle_error_deg"].excess == three["hip_error_deg"].excess > two["ankle_error_deg"].excess
    at_goal = {part.name: part.goal for part in objective_terms(JOINTS)}
    assert walk_cost({**at_goal, "ankle_error_deg": None}, 1.0, False, JOINTS) == WORST
    assert walk_cost({**at_goal, "ankle_error_deg": None}, 1.0, False, TWO) < WORST
    only = [part.name for part in objective_terms((JointName.KNEE, JointName.ANKLE))]
    assert only[:3] == ["knee_error_deg", "ankle_error_deg", "offset_deg"] and "hip_error_deg" not in only


def test_a_walk_is_rated_by_its_three_joints(walk: Run) -> None:
    rating, sides = rate_walk(walk), summarise_run(walk)["sides"].values()
    assert rating.joints == JOINTS
    for joint in JOINTS:
        largest = max(side[f"rmse_{joint}_by_contact_deg"] for side in sides)
        assert rating.values[f"{joint}_error_deg"] == pytest.approx(largest, rel=1e-9)
    assert len(rating.deviations) == 2 * 3 * 20
    found = residuals(rating)
    assert found is not None and len(found) == len(rating.deviations) + 2 * len(rating.terms) - 3
    torques = [walk.log[f"{side}_{joint}_motor_torque_Nm"] ** 2 for side in Side for joint in JOINTS]
    assert rating.torque == pytest.approx(np.mean(torques) ** 0.5, rel=1e-12)


def test_numbers_of_the_ankle_are_searched_within_its_published_range() -> None:
    table = load_experiment(WALK).experiment.table
    found = [item for item in tunable_parameters(table) if ".ankle." in item.name]
    assert len(found) == 4 * len(table.phases)
    stiff = [item for item in found if item.unit == "N·m/deg"]
    assert all(item.upper == STIFFNESS_RANGES[JointName.ANKLE].high for item in stiff)
    assert editable_document(table)["phases"]["late_stance"]["ankle"]["equilibrium_deg"] == -18.0


def test_cases_of_a_tuning_reach_the_ankle_s_drive() -> None:
    experiment = load_experiment(WALK).experiment
    cases = build_cases(experiment, "robust")
    rough, worn = cases["friction ratio 0.35"], cases["gear efficiency 0.75"]
    law = experiment.plant.friction[JointName.ANKLE]
    assert rough.plant.true_friction()[JointName.ANKLE] == law.scaled(0.35)
    assert worn.plant.actuators[JointName.ANKLE].gear_efficiency == 0.75


def test_pictures_of_a_tuning_have_the_ankle(walk: Run) -> None:
    nothing = {"candidates": [], "before": [9.0, 24.0, 9.5], "after": [8.0, 24.0, 9.5]}
    effort = {"evolved_generations": 0}
    outcome = {"trade_offs": nothing, "joints": JOINTS, "convergence": [9.5, 9.0], "effort": effort}
    drawings = pictures.tuning_drawings(outcome, walk.experiment, {"before": walk, "after": walk})
    figures = {name: draw() for name, draw in drawings.items()}
    panels = figures["gait"].axes
    assert [axes.get_title() for axes in panels[::2]] == [f"left {joint} angle [°]" for joint in JOINTS]
    assert all(len(axes.lines) == 3 for axes in panels)
    labels = [axes.get_ylabel() for axes in figures["trade_offs"].axes]
    assert labels[0] == "error: RMS of hip, knee and ankle [°]"


# ---------------------------------------------------------------------------------- the others


def test_a_comparison_has_measures_of_the_ankle(walk: Run) -> None:
    found = run_measures(walk)
    for name in ("range_of_motion_deg", "interaction_rms_Nm", "assistance_level", "gvs_koopman_deg"):
        both = [found[f"{side}_ankle_{name}"] for side in Side]
        assert found[f"ankle_{name}"] == pytest.approx(np.mean(both)) and both[0] > 0.0
    every = [found[f"{side}_{joint}_gvs_koopman_deg"] for side in Side for joint in JOINTS]
    assert found["gps_koopman_deg"] == pytest.approx(gait_profile_score(every))
    assert "ankle_range_symmetry" in found


def test_a_comparison_shows_the_joints_that_are_driven() -> None:
    two, three = (
        {name for rows in shown_measures(joints).values() for name in rows} for joints in (TWO, JOINTS)
    )
    assert three - two == {"ankle_range_of_motion_deg", "ankle_interaction_rms_Nm"} and two < three


def test_controllers_support_the_ankle() -> None:
    experiment = load_experiment(WALK).experiment
    assert {name for name, item in CONTROLLERS.items() if not item.can_drive(experiment)} == {
        "position", "policy",
    }  # fmt: skip
    plain = load_experiment("treadmill_guided").experiment
    assert {name for name, item in CONTROLLERS.items() if not item.can_drive(plain)} == {"policy"}
    shared = CONTROLLERS["twincare"].apply_to(experiment).control.assistance
    assert set(shared.share) == set(JOINTS) and len(set(shared.share.values())) == 1
    assert shared.share[JointName.ANKLE] < AssistanceParameters().share[JointName.HIP]


def test_a_batch_has_columns_of_the_ankle_where_it_is_driven(walk: Run) -> None:
    table = summary_table([flat_summary(walk)])
    assert table["left_ankle_torque_peak_Nm"][0] > 5.0
    columns = [name for name in table if name.startswith("left_ankle_")]
    assert [name.replace("ankle", "knee") for name in columns] == [
        name for name in table if name.startswith("left_knee_") and name != "left_knee_yield_deg"
    ]


def test_faults_are_drawn_for_the_ankle_too_and_the_step_is_judged_by_it() -> None:
    experiment = load_experiment(WALK, ["duration_s=10"]).experiment
    joints = [fault.joint for fault in draw_faults(experiment, 60, seed=1) if fault.joint is not None]
    assert set(joints) == set(JOINTS)
    still = simulate(replace(experiment, duration=0.3))
    assert 0.0 <= step_error(still)["largest_angle_error_rad"] < 1e-3
