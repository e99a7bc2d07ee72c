"""Firmware of devices that are not TWIN: single joints, three joints, one leg, own names of the joints."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from firmware_tools import TARGET_TOOLS, require_tools
from own_devices import leg, write_experiment, write_urdf

from twin_gait import load_experiment
from twin_gait.cli.program import main
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.project import print_project
from twin_gait.firmware.verification import verify

JOINTS = [("hip",), ("knee",), ("hip", "knee"), ("hip", "knee", "ankle")]
NAMED = ["-".join(joints) for joints in JOINTS]


def experiment_of(folder: Path, joints: tuple[str, ...]) -> Experiment:
    return load_experiment(write_experiment(folder, joints)).experiment


@pytest.mark.parametrize("joints", JOINTS, ids=NAMED)
def test_printed_units_are_those_of_the_driven_joints(tmp_path: Path, joints: tuple[str, ...]) -> None:
    project = print_project(experiment_of(tmp_path, joints))
    boards = [f"right_{joint}" for joint in joints]
    assert project.joints == boards
    header = project.program.files["joint_board.h"]
    for board in ("left_hip", "right_hip", "right_knee", "right_ankle"):
        assert (f"joint_board_{board}_init" in header) == (board in boards)
    codec = project.program.files["can_codec.h"]
    for board in ("left_hip", "right_hip", "right_knee", "right_ankle"):
        assert (f"message_{board}_setpoint" in codec) == (board in boards)
    drives = project.setup.experiment.plant.actuators
    assert [board.motor.gear_ratio for board in project.exoskeleton.record.boards] == [
        item.gear_ratio for item in drives.values()
    ]


@pytest.mark.parametrize("joints", [("hip",), ("knee",)], ids=["hip", "knee"])
def test_firmware_of_a_single_joint_compiles_and_is_proven(
    tmp_path: Path, joints: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    require_tools("gcc", *TARGET_TOOLS)
    path, out = write_experiment(tmp_path, joints), tmp_path / "c"
    assert main(["firmware", str(path), "--verify", "--out", str(out)]) == 0
    assert capsys.readouterr().out.count("passed: ") == 4
    text = (out / "README.md").read_text(encoding="utf-8")
    assert f"at the {joints[-1]}, `foot_load`" in text and "left_hip" not in text


@pytest.mark.slow
@pytest.mark.parametrize("joints", JOINTS, ids=NAMED)
def test_firmware_of_every_set_of_joints_is_proven(tmp_path: Path, joints: tuple[str, ...]) -> None:
    require_tools("gcc", *TARGET_TOOLS)
    found = verify(replace(experiment_of(tmp_path, joints), duration=3.0))
    assert found["passed"] and [item["passed"] for item in found["checks"]] == [True] * 4


def without_comments(text: str) -> str:
    """Return C without comments, which have the hash of the sources and the names of the URDF."""
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def test_names_of_the_urdf_do_not_change_the_firmware(tmp_path: Path) -> None:
    """Two legs with three joints, whose names in the URDF are the user's."""
    urdf = write_urdf(tmp_path / "links.urdf", "twin_ankle.urdf")
    legs: dict[str, Any] = {side: leg(side, ankle=True) for side in ("left", "right")}
    device = tmp_path / "named.yaml"
    content = {"schema_version": 2, "extends": "twin_ankle", "leg": {"urdf": urdf.name, **legs}}
    device.write_text(yaml.safe_dump(content), encoding="utf-8")
    ours, theirs = (
        print_project(load_experiment("treadmill_ankle", settings).experiment)
        for settings in ([f"device={device}"], [])
    )
    assert ours.joints == theirs.joints and len(ours.joints) == 6
    assert ours.program.files.keys() == theirs.program.files.keys()
    for name, text in ours.program.files.items():
        assert without_comments(text) == without_comments(theirs.program.files[name])
