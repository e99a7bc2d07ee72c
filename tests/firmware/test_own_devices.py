"""Firmware of devices that are not TWIN: single joints, three joints, one leg, own names of the joints."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from firmware_tools import TARGET_TOOLS, require_tools
from own_devices import NAMES, leg, write_experiment, write_urdf

from twin_gait import load_experiment
from twin_gait.cli.program import main
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.project import UNITS, print_project
from twin_gait.firmware.verification import VerificationBuild, host_in_double, verify

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


@pytest.mark.parametrize(
    "joints",
    [
        pytest.param(joints, id=name, marks=[pytest.mark.slow] * (len(joints) == 3))
        for joints, name in zip(JOINTS, NAMED, strict=True)
    ],
)
def test_c_of_every_unit_equals_the_simulation_on_generated_inputs(
    tmp_path: Path, joints: tuple[str, ...]
) -> None:
    require_tools("gcc")
    project = print_project(experiment_of(tmp_path, joints))
    (tmp_path / "c").mkdir()
    build = VerificationBuild(project, [], project.write_sources(tmp_path / "c"))
    passed, found = host_in_double(build)
    assert passed and found["numbers"] > 100_000
    assert found["differing_by_unit"] == dict.fromkeys(
        [*(f"joint_board_right_{joint}" for joint in joints), *UNITS[1:]], 0
    )


@pytest.mark.slow
def test_folder_of_a_single_joint_has_no_word_of_other_joints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_experiment(tmp_path, ["knee"]), tmp_path / "c"
    assert main(["firmware", str(path), "--out", str(out)]) == 0
    text = (out / "README.md").read_text(encoding="utf-8")
    assert "at the knee, `foot_load`" in text and "hip" not in text and "left_" not in text.split("## CAN")[0]
    assert "right_hip" not in (out / "vectors.csv").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("joints", JOINTS, ids=NAMED)
def test_firmware_of_every_set_of_joints_is_proven(tmp_path: Path, joints: tuple[str, ...]) -> None:
    require_tools("gcc", *TARGET_TOOLS)
    found = verify(replace(experiment_of(tmp_path, joints), duration=3.0))
    assert found["passed"] and [item["passed"] for item in found["checks"]] == [True] * 4


def neutral(text: str) -> str:
    """Return C without comments, which have the hash of the sources, and with TWIN's names of the joints."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    for known, name in NAMES.items():
        text = text.replace(re.sub(r"\W", "_", name), known)
    return re.sub(r"\s+", " ", text)


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
        assert neutral(text) == neutral(theirs.program.files[name])
