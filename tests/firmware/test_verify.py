"""Tests of the verification of the printed C: results for the shipped tables, and detection of errors."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from errors import states
from firmware_tools import TARGET_TOOLS, require_tools

from twin_gait import load_experiment
from twin_gait.cli.program import main
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware import verification as verifying
from twin_gait.firmware.cross import INSTALL
from twin_gait.firmware.exoskeleton_unit import record_vectors
from twin_gait.firmware.project import Project, print_project
from twin_gait.firmware.verification import VerificationBuild, cases_of, run_with_unit, verify
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate
from twin_gait.worlds.faults import FaultKind

DOUBLE, FLOAT, TARGET, LOOP = range(4)  # checks
TABLES = {
    "treadmill_guided": ("treadmill_guided",),
    "treadmill_pre_swing": ("treadmill_guided", "table=treadmill_pre_swing"),
    "treadmill_40": ("treadmill_40",),
    "treadmill_ankle": ("treadmill_ankle",),
    "treadmill_start_stop": ("treadmill_start_stop",),
    "bench_leg": ("bench_leg",),
    "inertia": ("treadmill_guided", "control.inertia_compensation=0.5"),
}


def experiment_of(name: str, duration: float) -> Experiment:
    preset, *changes = TABLES[name]
    return replace(load_experiment(preset, changes).experiment, duration=duration)


@pytest.fixture(scope="module")
def project() -> Project:
    return print_project(experiment_of("treadmill_guided", 4.0))


@pytest.fixture(scope="module")
def bench(project, tmp_path_factory) -> VerificationBuild:
    """Builds, and vectors with each fault."""
    require_tools("gcc")
    vectors = [record_vectors(case) for case in cases_of(project.setup.experiment)]
    return VerificationBuild(project, vectors, project.write_sources(tmp_path_factory.mktemp("bench")))


def assert_proven(checks: list[tuple[bool | None, dict[str, Any]]]) -> None:
    assert [passed for passed, _ in checks] == [True] * 4, checks
    figures = [found for _, found in checks]
    assert figures[DOUBLE]["differing"] == figures[TARGET]["differing"] == 0
    assert figures[FLOAT]["largest_shift_ticks"] <= 1
    assert max(figures[FLOAT]["current_rmse_A"].values()) <= 1e-4
    boards = len(figures[FLOAT]["current_rmse_A"])  # 5000 were requested with the four boards of the device
    most = max(5_000, 5_000 * boards // 4)
    assert 0 < figures[TARGET]["instructions_mean"] < figures[TARGET]["instructions_worst"] <= most
    assert figures[LOOP]["outcome"] == figures[LOOP]["outcome_before"]


# ------------------------------------------------------------------------- the shipped tables


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_20_s_of_every_shipped_table_are_proven(name):
    require_tools("gcc", *TARGET_TOOLS)
    checks = verify(experiment_of(name, 20.0))["checks"]
    assert_proven([(check["passed"], check["found"]) for check in checks])


@pytest.mark.slow  # all checks at once; the tests below have each of them by itself
def test_some_seconds_of_the_treadmill_are_proven(bench):
    require_tools("gcc", *TARGET_TOOLS)
    assert_proven([check(bench) for check in verifying.CHECKS.values()])


# ------------------------------------------------------------------------- vectors


@pytest.mark.slow
def test_python_and_c_in_double_numbers_follow_the_simulation_in_every_fault(bench):
    assert len(bench.vectors) == len(FaultKind)  # a walk without, and every kind but a controller's own
    tripped = missing = 0
    double = bench.outputs(bench.host(double=True), double=True)
    for expected, given, vectors in zip(bench.expected, double, bench.vectors, strict=True):
        printed = print_project(replace(vectors.run.experiment, faults=()))
        with printed.python_unit() as unit:
            assert verifying.count_differences(unit.exchange(vectors.inputs), vectors.outputs) == 0
        assert verifying.count_differences(expected, given) == 0
        tripped += vectors.run.trip is not None
        missing += bool(np.isnan(vectors.inputs["boards"]["angle"]).any())
    assert tripped >= 5 and missing == 1


def test_vectors_equal_the_log(bench):
    vectors, experiment = bench.vectors[0], bench.project.setup.experiment
    log = simulate(experiment).log
    angles = vectors.inputs["boards"]["angle"]
    for index, joint in enumerate(bench.project.joints):
        np.testing.assert_array_equal(angles[:, index], log[f"{joint}_measured_angle_rad"])
        current = vectors.outputs["commands"]["target_current"][:, index]
        np.testing.assert_array_equal(current, log[f"{joint}_target_current_A"])
        np.testing.assert_array_equal(
            vectors.inputs["boards"]["current"][1:, index], log[f"{joint}_measured_current_A"][:-1]
        )
    np.testing.assert_array_equal(vectors.inputs["direct"]["bus_voltage"], log["bus_voltage_V"])


def test_a_controller_that_runs_away_is_refused(capsys):
    words = ["firmware", "treadmill_guided", "--verify", "--duration", "4"]
    assert main([*words, "--set", 'faults=["controller_runaway:left_knee@1s"]']) == 2
    message = capsys.readouterr().err
    assert "controller_runaway:left_knee@1.0s" in message and message.count("\n") == 1


# ------------------------------------------------------------------------- processor in the loop


@pytest.mark.parametrize("fault", [None, FaultKind.MOTOR_STUCK, FaultKind.ENCODER_MISSING])
def test_in_double_numbers_the_loop_is_the_simulation_bit_for_bit(bench, fault):
    """With the same controller in the loop the log is the same: only the exchange of signals differs."""
    (before,) = (
        item.run
        for item in bench.vectors
        if [one.kind for one in item.run.experiment.faults] == [fault] * bool(fault)
    )
    with bench.host(double=True) as unit:
        after = run_with_unit(unit, bench.project, before.experiment, double=True)
    assert after.switches == before.switches and after.trip == before.trip
    assert_same_log(after, before)


def assert_same_log(first: Run, second: Run) -> None:
    for name in second.log.columns:
        np.testing.assert_array_equal(first.log[name], second.log[name], err_msg=name)


# ------------------------------------------------------------------------- what is wrong is found


MUTANTS = {
    "current": (
        "return saturate(current, current_limit)",
        "return saturate(current * REAL(1.001), current_limit)",
    ),
    "trip": ("board->command.drive_off || torque", "torque"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_c_is_found(bench, tmp_path, name):
    good, bad = MUTANTS[name]
    project, text = bench.project, bench.project.program.files["exoskeleton.c"]
    assert text.count(good) == 1
    files = {**project.program.files, "exoskeleton.c": text.replace(good, bad)}
    wrong = replace(project, program=project.program._replace(files=files))
    passed, figures = verifying.host_in_double(
        VerificationBuild(wrong, bench.vectors, wrong.write_sources(tmp_path))
    )
    assert passed is False and figures["differing"] > 100


def test_of_two_builds_that_differ_one_bit_is_found(bench):
    rows = bench.single[0]
    other = rows.copy()
    other["commands"]["torque"][7, 1] = np.nextafter(rows["commands"]["torque"][7, 1], np.float32(np.inf))
    other["setpoints"]["gravity"][9, 0] = -0.0 if rows["setpoints"]["gravity"][9, 0] == 0.0 else 0.0
    assert verifying.count_differences(rows, other) == 2
    other["commands"]["torque"] = np.nan
    assert verifying.count_differences(other, other.copy()) == 0


def test_late_or_different_switches_are_reported(bench):
    rows = bench.single[0]
    first = int(np.flatnonzero(np.diff(rows["decision"]["phases"][:, 0]))[0])
    late, other = rows.copy(), rows.copy()
    late["decision"]["phases"][first + 1 : first + 4, 0] = rows["decision"]["phases"][first, 0]
    other["decision"]["phases"][first + 1 :, 0] = rows["decision"]["phases"][first, 0]
    events = [verifying.events_of(item) for item in (rows, late, other)]
    assert verifying.largest_shift(events[0], events[0]) == 0
    assert verifying.largest_shift(events[0], events[1]) == 3
    assert verifying.largest_shift(events[0], events[2]) == np.inf


# ------------------------------------------------------------------------- missing tools, the command


def test_without_tools_the_target_is_not_verified(project, monkeypatch):
    monkeypatch.setenv("PATH", "")
    found = verify(project.setup.experiment)
    assert [check["passed"] for check in found["checks"]] == [None] * 4
    assert found["passed"]
    assert all("apt-get install" in check["found"]["missing"] for check in found["checks"])


@pytest.mark.slow
def test_without_an_emulator_the_host_is_still_checked(project, monkeypatch, tmp_path):
    import shutil

    require_tools("gcc")
    for name in ("gcc", "as", "ld"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    monkeypatch.setenv("PATH", str(tmp_path))
    found = verify(project.setup.experiment)
    assert [check["passed"] for check in found["checks"]] == [True, True, None, None]
    assert INSTALL in found["checks"][TARGET]["found"]["missing"]


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (["duration_s=0.3"], ("too short to judge", "left", "0.3 s")),
        (["duration_s=3", "control.safety.speed_share=0.05"], ("held", "held from")),
    ],
)
def test_a_run_without_a_walk_proves_nothing(settings, reason, capsys):
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["firmware", "treadmill_guided", "--verify", "--unchecked", *words]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("FAILED: ") and states(line, *reason)


def verification(*passed: bool | None) -> dict[str, Any]:
    found = {"differing": 3, "bytes": {"flash": 12, "error": 0.125}}
    checks = [{"name": f"check {k}", "passed": item, "found": found} for k, item in enumerate(passed)]
    return {"source_sha256": "hash", "passed": False not in passed, "checks": checks}


@pytest.mark.parametrize(("passed", "status"), [((True, None), 0), ((True, False), 1)])
def test_the_command_ends_with_1_only_if_something_is_wrong(monkeypatch, capsys, passed, status):
    monkeypatch.setattr("twin_gait.firmware.verification.verify", lambda *_: verification(*passed))
    assert main(["firmware", "treadmill_guided", "--verify"]) == status
    lines = capsys.readouterr().out.splitlines()
    words = {True: "passed", False: "FAILED", None: "skipped"}
    found = "differing 3, bytes (flash 12, error 0.125)"
    assert lines == [f"{words[item]}: check {number}: {found}" for number, item in enumerate(passed)]


def test_the_folder_contains_the_results(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("twin_gait.firmware.verification.verify", lambda *_: verification(True))
    assert main(["firmware", "treadmill_guided", "--verify", "--json", "--out", str(tmp_path / "c")]) == 0
    kept: dict[str, Any] = json.loads((tmp_path / "c" / "verification.json").read_text())
    assert kept["passed"] is True and kept["checks"][0]["name"] == "check 0"
    answer = json.loads(capsys.readouterr().out)
    assert {name: answer[name] for name in kept} == kept
