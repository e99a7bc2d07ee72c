"""The check and the test kit take a table whose third joint is driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from errors import states

from twin_gait import load_experiment
from twin_gait.checking.check import build_case, check, load_case
from twin_gait.checking.finding import Severity
from twin_gait.checking.hanging_leg import hanging_legs
from twin_gait.checking.published_ranges import STIFFNESS_RANGES, unusual_gain, unusual_stiffness
from twin_gait.checking.stability import unstable
from twin_gait.gait.table import GaitTable
from twin_gait.testing.cases import transition_tests
from twin_gait.vocabulary import JointName

WALK = "treadmill_ankle"


def with_ankle(table: GaitTable, phase: str, **changes: float | None) -> GaitTable:
    parameters = table.phases[phase]
    ankle = replace(parameters.joints["ankle"], **changes)
    changed = replace(parameters, joints={**parameters.joints, "ankle": ankle})
    return replace(table, phases={**table.phases, phase: changed})


def changed_case(phase: str, **changes: float | None):
    experiment = load_experiment(WALK).experiment
    return build_case(with_ankle(experiment.table, phase, **changes), experiment)


@pytest.mark.slow
def test_a_walk_with_a_driven_ankle_is_checked_as_a_whole() -> None:
    case = load_case(None, WALK)
    assert not [item for item in check(case) if item.severity is Severity.ERROR]
    (leg,) = hanging_legs(case)
    assert leg.joints == tuple(JointName)
    assert leg.mass(np.zeros(3)).shape == (3, 3) and leg.torque_limits().shape == (3,)
    low, high = np.degrees(case.limits["ankle"])
    assert (low, high) == pytest.approx((-30.0, 30.0))
    assert np.degrees(case.velocity_limits["ankle"]) == pytest.approx(np.degrees(8.14), abs=1.0)


def test_without_an_experiment_a_table_is_checked_against_the_preset_of_its_joints_or_by_itself() -> None:
    for name in (WALK, "treadmill_guided"):
        experiment = load_case(name).experiment
        assert experiment is not None and experiment.name == name
    assert load_case("sup_2009").experiment is None


def test_an_ankle_stiffness_outside_the_published_range_is_reported_with_the_source() -> None:
    most = STIFFNESS_RANGES[JointName.ANKLE].high
    assert not unusual_stiffness(changed_case("late_stance", stiffness=np.degrees(0.9 * most)))[1:]
    found = unusual_stiffness(changed_case("late_stance", stiffness=np.degrees(1.5 * most)))
    (finding,) = (item for item in found if item.phase == "late_stance")
    assert states(finding.reason, "0.14", "5.00", "Sup et al. 2009")


def test_no_usable_gain_is_published_for_an_ankle() -> None:
    assert not unusual_gain(changed_case("late_stance", friction_compensation_gain=0.9))


def test_an_ankle_with_too_much_damping_is_unstable() -> None:
    found = unstable(changed_case("swing_flexion", damping=4000.0, damping_ratio=None))
    assert [item.phase for item in found] == ["swing_flexion"]
    assert "ankle 1" in found[0].suggestion and "(4000)" in found[0].suggestion


@pytest.mark.slow
def test_an_equilibrium_beyond_the_stop_of_the_ankle_is_found() -> None:
    case = changed_case("late_stance", equilibrium_angle=np.radians(35.0))
    reasons = [item.reason for item in check(case) if item.rule == "equilibrium_beyond_limits"]
    assert any(states(reason, "ankle", "35.0°", "-30.0", "30.0°") for reason in reasons)


def test_the_kit_tests_every_transition_of_a_table_with_guards_on_the_ankle() -> None:
    table = load_experiment(
        WALK, ['table.transitions[5]={from: late_stance, to: swing_flexion, cause: push_off, '
               'all: ["ankle.angle_deg < -12", "hip.angle_deg < 0"]}']
    ).experiment.table  # fmt: skip
    names = [item.name for item in transition_tests(table)]
    own = [item for item in transition_tests(table) if "(push_off)" in item.name]
    assert any("ankle.angle_deg < -12" in name for name in names)
    assert len(own) > 4
    for item in own:
        item.run()
