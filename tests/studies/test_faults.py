"""Faults: their notation, their place in experiments, seeded campaigns and the command."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from hypothesis import given
from hypothesis import strategies as st
from injected_faults.audit import audit, audited_row

from twin_gait import load_experiment, simulate
from twin_gait.cli import simulate as simulate_command
from twin_gait.cli import studies as command
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.validation import parse_assignment
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.studies.fault_campaign import (
    DRAWN_KINDS,
    draw_faults,
    fault_row,
    outcome_table,
    simulate_faults,
    violations,
)
from twin_gait.vocabulary import JointName, Outcome, Side
from twin_gait.worlds.faults import Fault, FaultKind, parse_fault


@st.composite
def any_fault(draw):
    kind = draw(st.sampled_from(list(FaultKind)))
    side, joint = draw(st.sampled_from(list(Side))), draw(st.sampled_from(list(JointName)))
    return Fault(
        kind=kind,
        time=draw(st.floats(0.0, 1e3)),
        location=kind.location(side, joint),
        magnitude=draw(st.none() | st.floats(-3.0, 3.0)) if kind.units else None,
    )


@given(fault=any_fault())
def test_a_fault_survives_its_notation(fault):
    assert parse_fault(str(fault)) == fault


def test_the_notation_takes_degrees():
    fault = parse_fault("encoder_drift:right_hip@3s=20deg/s")
    assert (fault.side, fault.joint, fault.time) == ("right", "hip", 3.0)
    assert fault.magnitude_or_default == pytest.approx(np.radians(20.0))
    assert parse_fault("encoder_freeze:left_knee@4.2s").location == "left_knee"


NOTATION = "KIND:SIDE_JOINT@TIMEs"
WRONG = {
    "encoder_melt:left_knee@4.2s": ("kind", "encoder_freeze"),
    "encoder_freeze:left_elbow@4.2s": ("left_hip", "right_hip", "left_elbow"),
    "encoder_freeze:left_ankle@4.2s": ("left_hip or right_hip or left_knee or right_knee", "left_ankle"),
    "encoder_freeze:left_foot@4.2s": ("left_hip", "right_hip", "left_foot"),
    "encoder_freeze@4.2s": ("left_hip", "right_hip"),
    "foot_load_stuck:left_knee@1s": ("left_foot or right_foot", "left_knee"),
    "supply_dip:left_knee@1s": ("supply_dip@4.2s", "left_knee"),
    "supply_loss_open:left_knee@1s": ("supply_loss_open@4.2s", "left_knee"),
    "supply_loss_open@1s=0.9s": ("unit", "no magnitude", "s"),
    "supply_loss_shorted@1s=101s": ("100 s", "101.0"),
    "encoder_freeze:left_knee@soons": (NOTATION, "soons"),
    "encoder_freeze:left_knee@-1s": ("0", "-1.0"),
    "encoder_freeze:left_knee@nans": (NOTATION, "nans"),
    "encoder_freeze:left_knee@4.2": (NOTATION,),
    "encoder_freeze:left_knee@1s=3deg": ("unit", "deg"),
    "encoder_drift:left_knee@1s=3deg": ("unit", "rad/s or deg/s", "deg"),
    "supply_dip@1s=1e999V": ("V", "1e999V"),
    "encoder_freeze:left_knee@99s": ("2 s", "encoder_freeze:left_knee@99.0s"),
    "": (NOTATION,),
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_fault_is_refused_in_one_line(text):
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill_guided", ["duration_s=2", f"faults=['{text}']"])
    assert "\n" not in str(caught.value) and states(
        str(caught.value), "treadmill_guided", "--set", *WRONG[text]
    )


def test_a_fault_must_strike_something_that_is_there():
    for text, problem in {
        "encoder_freeze:left_knee@1s": ("right_hip", "right_knee", "left_knee"),
        "foot_load_stuck:right_foot@1s": ("fault", "foot_load_stuck:right_foot@1.0s"),
    }.items():
        with raises(TwinGaitError, *problem):
            load_experiment("bench_leg", [f"faults=['{text}']"])


def test_faults_and_monitor_are_in_the_document_of_an_experiment():
    settings = ["faults=['motor_dead:right_hip@1s', 'supply_dip@2s=9V']", "control.safety.torque_time_s=0.3"]
    experiment = load_experiment("bench_leg", settings).experiment
    document = experiment_document(experiment)
    assert document["faults"] == ["motor_dead:right_hip@1.0s", "supply_dip@2.0s=9.0V"]
    assert document["control"]["safety"]["torque_time_s"] == 0.3
    assert experiment.control.safety.torque_time == 0.3
    assert (
        load_experiment("bench_leg", [f"faults={document['faults']}"]).experiment.faults == experiment.faults
    )


@pytest.fixture(scope="module")
def treadmill():
    return load_experiment("treadmill_guided", ["duration_s=4"]).experiment


def test_the_same_seed_draws_the_same_faults_and_longer_lists_extend_shorter_ones(treadmill):
    first = draw_faults(treadmill, 30, 7)
    assert draw_faults(treadmill, 50, 7)[:30] == first
    assert draw_faults(treadmill, 30, 8) != first
    assert {item.kind for item in first} == set(DRAWN_KINDS)
    assert {item.side for item in first} == {Side.LEFT, Side.RIGHT, None}
    assert all(1.0 <= item.time <= 2.0 for item in first)


def test_an_inconsistent_campaign_is_refused(treadmill):
    with raises(ParameterError, "count", "1", "0"):
        draw_faults(treadmill, 0, 0)
    with raises(ParameterError, "duration", "3 s", "2.0"):
        draw_faults(replace(treadmill, duration=2.0), 3, 0)
    with raises(ParameterError, "workers", "1", "0"):
        simulate_faults(treadmill, draw_faults(treadmill, 1, 0), workers=0)


@pytest.fixture(scope="module")
def campaign(treadmill):
    return simulate_faults(treadmill, draw_faults(treadmill, 20, 1))


def test_twenty_faults_stay_inside_the_limits_and_end_in_the_hold(campaign):
    table = campaign
    assert len(table) == 20 and len(violations(table)) == 0
    assert table["within_limits"].all() and (table["null_values"] == 0).all()
    assert (table["cause"] != "").sum() >= 10 and table["hold_kept"].all()


def test_holds_begin_in_the_stated_time_according_to_the_log(treadmill):
    rows = simulate_faults(treadmill, draw_faults(treadmill, 10, 1), row=audited_row)
    tripped = rows[rows["cause"] != ""]
    assert len(tripped) >= 5
    assert tripped["hold_kept"].all() and tripped["in_time"].all()
    assert np.isfinite(tripped["reaction_s"]).all()


def test_severe_faults_are_always_detected(campaign):
    table = campaign.set_index("kind")
    assert (table.loc["encoder_missing", "detection_s"] == 0.0).all()
    assert (table.loc["encoder_missing", "cause"] == "encoder_missing").all()
    assert table.loc["motor_dead", "cause"].isin(["drive", "joint_range", "joint_speed"]).all()


def test_the_table_counts_every_run_once(campaign):
    rows = outcome_table(campaign)
    # A column for an outcome that no run had is there for those that a fault can have.
    counts = rows[[str(item) for item in Outcome if item is not Outcome.TOO_SHORT]].sum(axis=1)
    assert (rows["runs"] == counts).all()
    assert rows["runs"].iloc[:-1].sum() == rows["runs"].iloc[-1] == 20
    assert rows["fault"].iloc[-1] == "all"


def test_a_campaign_can_be_stopped(treadmill):
    seen = []
    stopped = simulate_faults(
        treadmill,
        draw_faults(treadmill, 5, 1),
        progress=lambda done, total: seen.append((done, total)),
        should_stop=lambda: len(seen) >= 2,
    )
    assert len(stopped) == 2
    assert seen == [(1, 5), (2, 5)]


@pytest.fixture(scope="module")
def tripped():
    return simulate(
        load_experiment("bench_leg", ["duration_s=2", "faults=['encoder_jump:right_hip@1s']"]).experiment
    )


def _changed(run, column, tick, value):
    log = run.log.copy()
    log.loc[tick, column] = value
    return replace(run, log=log)


def test_a_row_detects_every_kind_of_breach(tripped):
    """A log that is tampered with is found out."""
    healthy = fault_row(tripped)
    assert healthy["within_limits"] and healthy["hold_kept"] and healthy["null_values"] == 0

    def found(column, tick, value):
        return fault_row(_changed(tripped, column, tick, value))

    assert not found("right_hip_motor_torque_Nm", 50, 61.0)["within_limits"]
    assert not found("right_hip_measured_current_A", 50, -15.1)["within_limits"]
    assert found("right_knee_motor_command_torque_Nm", 50, np.nan)["null_values"] == 1
    assert found("right_knee_measured_angle_rad", 50, np.nan)["null_values"] == 0
    assert not found("safety_state", 1500, 0.0)["hold_kept"]


def test_the_audit_detects_every_kind_of_breach(tripped):
    healthy = audit(tripped)
    assert healthy.hold_kept and healthy.in_time
    assert not audit(_changed(tripped, "safety_state", 1500, 0.0)).hold_kept
    assert not audit(_changed(tripped, "right_knee_stiffness_Nm_per_rad", 1500, 5.0)).hold_kept
    late = _changed(tripped, "right_knee_damping_Nms_per_rad", slice(1000, 1001), 5.0)
    assert audit(late).hold_kept and not audit(late).in_time  # the hold begins two ticks after the trip


def test_a_trip_without_a_breach_in_the_log_is_not_in_time(tripped):
    log = tripped.log.copy()
    log["right_hip_measured_angle_rad"] = log["right_hip_angle_rad"]
    found = audit(replace(tripped, log=log))
    assert np.isnan(found.reaction_s) and not found.in_time


def test_a_row_states_the_outcome_of_a_fault(tripped):
    row = fault_row(tripped)
    assert (row["outcome"], row["cause"], row["trip_location"]) == ("held", "encoder_jump", "right hip")
    assert row["detection_s"] == 0.0 and row["time_s"] == 1.0


def test_a_trip_before_the_fault_is_not_its_detection(tripped):
    (fault,) = tripped.experiment.faults
    late = replace(tripped.experiment, faults=(replace(fault, time=1.5),))
    row = fault_row(replace(tripped, experiment=late))
    assert (row["cause"], row["trip_time_s"]) == ("encoder_jump", 1.0) and math.isnan(row["detection_s"])
    table = pd.DataFrame([fault_row(tripped), row])
    outcomes = outcome_table(table).iloc[0]
    assert (outcomes["held"], outcomes["detected by"], outcomes["longest"]) == (2, "encoder_jump 1", "0 ms")


@pytest.mark.slow
def test_runs_without_a_walk_command_are_counted():
    rising = load_experiment("sit_to_stand", ["duration_s=3"]).experiment
    row = outcome_table(simulate_faults(rising, [parse_fault("supply_dip@1s=2V")])).iloc[0]
    assert (row["runs"], row["completed"], row["walked"]) == (1, 1, 0)


def run_command(module, *arguments: str) -> int:
    parser = argparse.ArgumentParser()
    module.add_parser(parser.add_subparsers())
    parsed = parser.parse_args(arguments)
    return parsed.run(parsed)


def test_the_command_prints_the_table(capsys):
    given = "faults bench_leg --count 9 --seed 3 --duration 4 --workers 1".split()
    assert run_command(command, *given) == 0
    printed = capsys.readouterr().out
    assert "bench_leg, 4 s each, 9 faults, seed 3" in printed
    assert "faults with an exceeded limit, an empty value or an unfinished hold: none" in printed
    assert "foot_load_stuck" not in printed  # there is no foot on the bench


def test_simulate_accepts_faults_and_prints_the_trip(tmp_path, capsys):
    given = ("simulate", "bench_leg", "--duration", "1", "--no-pictures", "--out", str(tmp_path / "run"))
    assert run_command(simulate_command, *given, "--fault", "encoder_missing:right_knee@0.4s") == 0
    assert states(capsys.readouterr().out, "0.400 s", "encoder missing", "right knee")
    text = (tmp_path / "run" / "experiment.yaml").read_text()
    assert "encoder_missing:right_knee@0.4s" in text
    assert parse_assignment("faults=[a]")[1] == ["a"]
    with raises(TwinGaitError, "faults[0]", "kind", "nonsense"):
        run_command(
            simulate_command, *given[:-1], str(tmp_path / "other"), "--fault", "nonsense:right_knee@1s"
        )
    assert not (tmp_path / "other").exists()
