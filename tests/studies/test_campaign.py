"""The simulated testing campaign: protocol, files, seeds, and what an independent reader makes of them."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import friction_bench
import numpy as np
import pandas as pd
import pytest
from errors import raises
from numpy.testing import assert_allclose
from twin_device import KNEE_ACTUATOR

from twin_gait.cli import friction as command
from twin_gait.exceptions import ParameterError, RunDirectoryError, TwinGaitError
from twin_gait.identification.processing import BenchSetup, process_log
from twin_gait.identification.reading import Quantity, read_log
from twin_gait.simulation.bench_joint.episode import LOG_COLUMNS
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.campaign import (
    Campaign,
    PlannedTest,
    Protocol,
    drop_amplitude,
    log_text,
    planned_tests,
    run_campaign,
)
from twin_gait.vocabulary import JointName
from twin_gait.worlds.bench_joint import LinkParameters

KNEE, HIP = JointName.KNEE, JointName.HIP


@pytest.fixture(scope="module")
def knee_drop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a whole campaign of falls."""
    folder = tmp_path_factory.mktemp("campaign") / "knee"
    assert run_campaign(Campaign(joint=KNEE, seed=4), folder)["status"] is RunStatus.COMPLETED
    return folder


def shown(plan: PlannedTest) -> np.ndarray:
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
    return run.log[list(LOG_COLUMNS)].to_numpy()


def test_campaign_leaves_45_logs_in_the_columns_of_the_thesis(knee_drop: Path) -> None:
    logs = sorted(path.name for path in knee_drop.glob("*.log"))
    assert len(logs) == 45
    assert logs[0] == "knee_1.5kg_1.log"
    theirs = friction_bench.bench_log(
        (np.zeros(3), np.zeros(3), np.zeros(3)), 1.0, friction_bench.KNEE, np.random.default_rng(0)
    )
    assert tuple(theirs) == LOG_COLUMNS
    text = (knee_drop / logs[0]).read_text()
    assert text.startswith("# synthetic data: simulated")
    assert "# mass_kg: 1.5\n" in text and f"\n{','.join(LOG_COLUMNS)}\n" in text


def test_logs_run_at_1_khz_from_level_and_their_stop_is_at_125_degrees(knee_drop: Path) -> None:
    log = pd.read_csv(knee_drop / "knee_3kg_9.log", comment="#")
    assert_allclose(np.diff(log["time_s"]), 1e-3, atol=1e-9)
    assert_allclose(log["position_rad"].iloc[0], math.pi / 2, atol=1e-5)
    assert 125 < math.degrees(log["position_rad"].max()) < 126.5  # the stop gives a little
    assert not log.isna().any().any()


def test_settings_equal_the_protocol(knee_drop: Path) -> None:
    settings = json.loads((knee_drop / "campaign.json").read_text())
    assert settings["synthetic"] is True and settings["seed"] == 4
    tests = settings["tests"]
    assert {test["K"] for test in tests} == {1.0, 1.1, 1.15}
    assert {test["f_Hz"] for test in tests} == {3.0}
    assert {test["mass_kg"] for test in tests} == {1.0, 1.5, 2.0, 2.5, 3.0}
    amplitudes = [test["A_counts"] for test in tests]
    assert (min(amplitudes), max(amplitudes)) == (140.0, 195.0)
    assert settings["bench"]["friction"]["law"]["coulomb_friction"] == -3.193  # as table 3.1 prints it


def test_lighter_weights_get_larger_amplitudes_in_steps_of_five() -> None:
    for step in range(3):
        by_mass = [drop_amplitude(mass, step) for mass in (3.0, 2.5, 2.0, 1.5, 1.0)]
        assert by_mass == sorted(by_mass)
    assert [drop_amplitude(1.0, step) for step in range(3)] == [185.0, 190.0, 195.0]


def test_falls_follow_the_thesis(knee_drop: Path) -> None:
    tests = pd.DataFrame(json.loads((knee_drop / "campaign.json").read_text())["tests"])
    heavy = tests[tests.mass_kg == 3.0].groupby("K").duration_s.mean()  # to 0.3 s beyond the stop
    assert heavy[1.0] > heavy[1.1] > heavy[1.15]
    slowest = tests[(tests.mass_kg == 1.0) & (tests.K == 1.0)].duration_s
    assert slowest.min() > 2.5 * tests[(tests.mass_kg == 1.0) & (tests.K == 1.15)].duration_s.max() > 0.0
    logs = (pd.read_csv(path, comment="#") for path in knee_drop.glob("*.log"))
    assert 0.5 < max(log.velocity_rad_per_s.max() for log in logs) < 0.7  # its fit stands on 0 to 0.6 rad/s


def test_smaller_amplitude_needs_more_time_to_break_away_on_average() -> None:
    waited = []
    for amplitude in (120.0, 195.0):
        plan = planned_tests(Campaign(joint=KNEE, seed=1))[-1]
        moved = []
        for start in range(0, 1000, 100):
            test = replace(plan.test, control=replace(plan.test.control, amplitude=amplitude), duration=3.0)
            run = simulate_bench(test, variation=replace(plan.variation, duty_start=start))
            fast = run.column("motor_velocity_rad_per_s") > 0.11
            moved.append(int(np.argmax(fast)) if fast.any() else len(fast))
        waited.append(np.mean(moved))
    assert waited[0] > 1.1 * waited[1]


def test_same_seed_gives_the_same_campaign_bit_for_bit() -> None:
    first, again, other = (planned_tests(Campaign(joint=HIP, seed=seed))[20] for seed in (7, 7, 8))
    assert (shown(first) == shown(again)).all()
    assert first.variation != other.variation and first.noise_seed != other.noise_seed


def test_tests_of_a_campaign_differ_randomly() -> None:
    plans = planned_tests(Campaign(joint=KNEE))
    assert len({plan.noise_seed for plan in plans}) == 45
    ratios = [plan.variation.friction_ratio for plan in plans]
    assert 0.01 < np.std(ratios) < 0.03


@pytest.mark.parametrize("joint", [KNEE, HIP])
def test_two_way_campaign_reaches_2_5_rad_per_s_in_both_directions_without_a_stop(joint: JointName) -> None:
    plan = planned_tests(Campaign(joint=joint, protocol=Protocol.TWO_WAY))[8]
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
    velocity, angle = run.column("motor_velocity_rad_per_s"), run.column("link_angle_rad")
    assert_allclose([velocity.min(), velocity.max()], [-2.5, 2.5], rtol=0.02)
    assert math.radians(-4) < angle.min() and angle.max() < math.radians(125)
    assert np.abs(run.column("stop_torque_Nm")).max() == 0.0


def logs_of(plans: Sequence[PlannedTest], folder: Path) -> list[Path]:
    paths = []
    for plan in plans:
        run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
        path = folder / plan.name
        path.write_text(log_text(run, {"mass_kg": f"{plan.mass:g}"}))
        paths.append(path)
    return paths


def test_reader_of_the_identification_recovers_the_simulated_friction(tmp_path: Path) -> None:
    plans = planned_tests(Campaign(joint=KNEE, protocol=Protocol.TWO_WAY, seed=2))[::11]
    bench = BenchSetup(actuator=KNEE_ACTUATOR)
    for path, plan in zip(logs_of(plans, tmp_path), plans, strict=True):
        log = read_log(path)
        assert log.mass == plan.mass and Quantity.MEASURED_CURRENT in log.columns
        test = process_log(log, bench)
        truth = plan.variation.friction_ratio * friction_bench.rotational(test.velocity, friction_bench.KNEE)
        error = (test.torque - truth)[test.used]
        assert test.used.sum() > 300
        # The ripple of 0.3 N·m has an RMS of 0.21; the offset of the current adds K_t τ times itself.
        offset = abs(plan.variation.current_offset) * 7.05
        assert np.sqrt(np.mean(error**2)) < 0.26 + offset
        assert abs(error.mean()) < 0.05 + offset


def test_bench_and_identification_assume_the_same_bench() -> None:
    bench, link = BenchSetup(actuator=KNEE_ACTUATOR), LinkParameters(mass=2.5)
    assert (bench.lever, bench.link_inertia, bench.link_moment) == (link.lever, link.inertia, link.moment)
    assert_allclose(bench.inertia(2.5), KNEE_ACTUATOR.armature + link.total_inertia)


def test_existing_folder_is_refused_and_unchanged(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with raises(RunDirectoryError, tmp_path, "--out", "--force"):
        run_campaign(Campaign(joint=KNEE), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_stopped_campaign_keeps_its_logs_and_is_marked_interrupted(tmp_path: Path) -> None:
    stops = iter([False, False, True])
    seen: list[tuple[int, int]] = []
    result = run_campaign(
        Campaign(joint=KNEE),
        tmp_path / "some",
        should_stop=lambda: next(stops),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result["status"] is RunStatus.INTERRUPTED and seen == [(1, 45), (2, 45)]
    assert len(list((tmp_path / "some").glob("*.log"))) == 2
    assert json.loads((tmp_path / "some" / "campaign.json").read_text())["status"] == "interrupted"


@pytest.mark.parametrize(
    "make",
    [
        lambda: Campaign(joint=JointName.ANKLE),
        lambda: Campaign(joint=KNEE, seed=-1),
        lambda: Campaign(joint=KNEE, cycles=0),
    ],
)
def test_mistakes_in_a_campaign_are_found_before_it_begins(make: object) -> None:
    with pytest.raises(ParameterError):
        make()  # type: ignore[operator]


def called(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers(dest="command"))
    parsed = parser.parse_args(["bench", *arguments])
    status: int = parsed.run(parsed)
    return status


def test_campaign_from_the_command_line_writes_logs_of_each_protocol(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("twin_gait.studies.campaign.WEIGHTS", (3.0, 1.0))
    monkeypatch.setattr("twin_gait.studies.campaign.TESTS_PER_WEIGHT", 3)
    for protocol in ("drop", "two-way"):
        out = tmp_path / protocol
        arguments = ("campaign", "--joint", "knee", "--out", str(out))
        assert called(*arguments, "--protocol", protocol, "--seed", "3") == 0
        assert len(list(out.glob("*.log"))) == 6
        assert capsys.readouterr().out.count("synthetic logs") == 1
        settings = json.loads((out / "campaign.json").read_text())
        assert_allclose(settings["bench"]["friction"]["law"]["viscous_friction"], 2.06)
        with raises(TwinGaitError, out, "--out"):
            called(*arguments)
