"""Limits of each joint: their forms in a file, their ceiling, and their effect on monitor and motors."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from errors import raises
from twin_device import KNEE_ACTUATOR

from twin_gait import load_experiment, simulate
from twin_gait.checking.check import build_case
from twin_gait.configuration.device_file import load_device
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.configuration.validation import assign
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.device import check_limits
from twin_gait.parameters.drives import LimitParameters
from twin_gait.report.device_page import describe_device
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName, Side

HIP, KNEE, ANKLE = JointName
BASE = {"schema_version": 2, "extends": "twin"}


def limits_of(*settings: str) -> Any:
    """Return the limits of the preset of the treadmill with settings."""
    return load_experiment("treadmill_guided", settings).experiment.control.limits


def write(path: Path, **content: Any) -> Path:
    """Write a device that extends TWIN."""
    path.write_text(yaml.safe_dump({**BASE, **content}), encoding="utf-8")
    return path


def test_pair_for_all_joints_is_one_record_for_each_joint() -> None:
    assert limits_of() == {joint: LimitParameters(torque=60.0, current=15.0) for joint in JointName}


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (["control.limits.hip.torque_Nm=40"], (40.0, 60.0)),
        (["control.limits={hip: {torque_Nm: 40}}"], (40.0, 60.0)),
        (["control.limits.hip.torque_Nm=40", "control.limits.torque_Nm=50"], (50.0, 50.0)),
        (["control.limits={torque_Nm: 50, hip: {torque_Nm: 40}}"], (40.0, 50.0)),
    ],
)
def test_later_value_of_a_joint_or_of_all_joints_counts(
    settings: list[str], expected: tuple[float, float]
) -> None:
    found = limits_of(*settings)
    assert (found[HIP].torque, found[KNEE].torque) == expected
    assert {found[joint].current for joint in found} == {15.0}


def test_common_value_of_an_experiment_replaces_that_of_a_joint_of_the_device(tmp_path: Path) -> None:
    device = write(
        tmp_path / "own.yaml",
        control={"limits": {"hip": {"torque_Nm": 40}, "knee": {"highest_speed_deg_per_s": 90}}},
    )
    found = limits_of(f"device={device}")
    assert (found[HIP].torque, found[KNEE].torque) == (40.0, 60.0)
    assert found[KNEE].highest_speed == pytest.approx(math.pi / 2) and found[HIP].highest_speed is None
    found = limits_of(f"device={device}", "control.limits.torque_Nm=30")
    assert (found[HIP].torque, found[KNEE].torque) == (30.0, 30.0)
    assert found[KNEE].highest_speed == pytest.approx(math.pi / 2)
    described = describe_device(load_device(str(device)))
    assert [row["torque_limit_Nm"] for row in described["drives"]] == [40.0, 60.0]
    numbers = {row["key"]: row["stated_by"] for row in described["numbers"]}
    assert numbers["control.limits.hip.torque_Nm"] == "own"
    assert numbers["control.limits.knee.torque_Nm"] == "twin"


def test_incomplete_common_value_adds_no_joint(tmp_path: Path) -> None:
    """Limits of hip and knee only, with a torque for both: the ankle has no drive and gets no limits."""
    path = tmp_path / "own.yaml"
    limits = {"torque_Nm": 50, "hip": {"current_A": 15}, "knee": {"current_A": 10}}
    twin = yaml.safe_load(load_device("twin").path.read_text(encoding="utf-8"))
    path.write_text(
        yaml.safe_dump({**twin, "control": {**twin["control"], "limits": limits}}), encoding="utf-8"
    )
    found = limits_of(f"device={path}")
    assert found == {
        HIP: LimitParameters(torque=50.0, current=15.0), KNEE: LimitParameters(torque=50.0, current=10.0)
    }  # fmt: skip
    with raises(ParameterError, "control.limits.ankle", "drive"):
        check_limits(found, load_experiment("treadmill_ankle").experiment.plant)


def test_document_of_unequal_limits_is_read_as_the_same_experiment() -> None:
    experiment = load_experiment("treadmill_guided", ["control.limits.hip.torque_Nm=40"]).experiment
    document = experiment_document(experiment)
    assert set(document["control"]["limits"]) == {"hip", "knee", "ankle"}
    assert experiment_from_mapping(document, "document", Path()) == experiment


def test_common_value_reaches_joints_whose_sections_have_not_changed() -> None:
    """A batch converts only sections that differ from the experiment before."""
    before = load_experiment("treadmill_guided", ["control.limits.hip.current_A=12"])
    document = assign(before.document, ["control", "limits", "torque_Nm"], 45)
    after = experiment_from_mapping(document, "batch", Path(), before)
    assert {item.torque for item in after.control.limits.values()} == {45.0}
    assert after.control.limits[HIP].current == 12.0


DRIVE = {
    "torque_constant": 0.1, "resistance": 0.5, "gear_ratio": 9.0, "gear_efficiency": 0.9, "peak_torque": None
}  # fmt: skip


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ({}, 0.1 * 9.0 * 0.9 * 24.0 / 0.5),
        ({"peak_current": 20.0}, 0.1 * 9.0 * 0.9 * 20.0),
        ({"peak_current": 20.0, "peak_torque": 18.0}, 18.0),
    ],
)
def test_ceiling_of_the_torque_follows_from_the_drive(more: dict[str, float], expected: float) -> None:
    assert replace(KNEE_ACTUATOR, **{**DRIVE, **more}).torque_ceiling(24.0) == pytest.approx(
        expected, rel=1e-12
    )


def test_torque_limit_above_the_ceiling_is_refused_with_joint_value_and_ceiling() -> None:
    assert limits_of("control.limits.torque_Nm=110")[KNEE].torque == 110.0
    with raises(ParameterFileError, "control.limits.hip.torque_Nm", "110", "peak_torque_Nm", "111"):
        limits_of("control.limits.torque_Nm=111")
    with raises(ParameterFileError, "control.limits.knee.torque_Nm", "50", "60"):
        limits_of("plant.actuators.knee.peak_torque_Nm=50")


def test_device_refuses_a_torque_limit_above_the_ceiling(tmp_path: Path) -> None:
    path = write(tmp_path / "weak.yaml", plant={"actuators": {"hip": {"peak_torque_Nm": 18}}})
    with raises(ParameterFileError, "weak.yaml", "control.limits.hip.torque_Nm", "18", "60"):
        describe_device(load_device(str(path)))


@pytest.mark.parametrize(
    "setting", ["highest_speed_deg_per_s=300", "lowest_angle_deg=-30", "highest_angle_deg=120"]
)
def test_limits_of_motion_are_at_most_those_of_the_urdf(setting: str) -> None:
    experiment = load_experiment("bench_leg", [f"control.limits.hip.{setting}"]).experiment
    with raises(ParameterError, "control.limits.hip", "right_hip", "URDF"):
        experiment.build_world()


def test_limit_in_degrees_may_be_that_of_the_rounded_urdf() -> None:
    setting = "control.limits.knee.lowest_angle_deg=-5"  # -0.087266 rad in body.urdf, 5e-7 rad less
    world = load_experiment("knee_orthosis", [setting]).experiment.build_world()
    assert world.model.position_limits(Side.LEFT, JointName.KNEE)[0] > math.radians(-5)


def test_range_for_all_joints_is_that_of_joints_with_a_drive() -> None:
    settings = ["control.limits.highest_angle_deg=110"]  # beyond the range of the ankles, which have no drive
    experiment = load_experiment("hip_exoskeleton", settings).experiment
    control, world = experiment.control, experiment.build_world()
    assert control.joint_range(world.model, Side.LEFT, JointName.HIP)[1] == pytest.approx(math.radians(110))


def test_range_is_not_empty() -> None:
    with raises(ParameterError, "lowest_angle", "highest_angle"):
        LimitParameters(torque=1.0, current=1.0, lowest_angle=0.5, highest_angle=0.5)


def test_monitor_and_check_use_the_limits_of_a_joint() -> None:
    settings = [
        "control.limits.knee={torque_Nm: 30, current_A: 9, highest_speed_rad_per_s: 2}",
        "control.limits.knee.highest_angle_deg=70",
    ]
    experiment = load_experiment("bench_leg", settings).experiment
    _, episode, _ = assemble(build_setup(experiment))
    hip, knee = (joint.board for joint in episode.joints)
    assert (hip.limits.torque, hip.limits.current) == (60.0, 15.0)
    assert (knee.limits.torque, knee.limits.current) == (30.0, 9.0)
    assert knee.bounds.highest_torque == 30.0
    assert knee.bounds.highest_current == pytest.approx(9.0 * experiment.control.safety.current_share)
    assert knee.bounds.highest_speed == 2.0 and hip.bounds.highest_speed > 2.0
    assert knee.bounds.upper == pytest.approx(math.radians(70.0))
    model = experiment.build_world().model
    assert knee.bounds.lower == model.position_limits(Side.RIGHT, KNEE)[0]
    case = build_case(experiment.table, experiment)
    assert case.limits["knee"] == (knee.bounds.lower, knee.bounds.upper)
    assert case.velocity_limits["knee"] == 2.0


def test_each_motor_keeps_the_limit_of_its_own_joint() -> None:
    settings = ["duration_s=4", "control.limits.hip.torque_Nm=6", "control.safety.enabled=false"]
    log = simulate(load_experiment("bench_leg", settings).experiment).log
    hip, knee = (np.abs(log[f"right_{joint}_motor_torque_Nm"]).max() for joint in ("hip", "knee"))
    assert hip == pytest.approx(6.0) and knee > 6.5
