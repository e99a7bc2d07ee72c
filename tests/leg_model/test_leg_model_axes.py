"""URDFs whose joints turn the other way: the walk is that of the joints as this package counts them."""

from __future__ import annotations

import subprocess
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from errors import states, warns
from numpy.testing import assert_array_equal
from pandas.testing import assert_frame_equal

from twin_gait import load_experiment, simulate
from twin_gait.leg_model.joints import LegJoints, ReversedJointWarning
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import packaged_urdf
from twin_gait.parameters.wearer import Patient
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side

JOINTS = tuple(JointName)


def turned(folder: Path, names: tuple[str, ...], source: str = "twin.urdf", kind: str = "revolute") -> Path:
    """A copy of a URDF in which some joints are drawn with the opposite axis, and so the opposite limits."""
    root = ElementTree.fromstring(packaged_urdf(source).read_text(encoding="utf-8"))
    for joint in root.iter("joint"):
        if joint.get("name") in names:
            joint.set("type", kind)
            axis, limit = joint.find("axis"), joint.find("limit")
            assert axis is not None and limit is not None
            axis.set("xyz", " ".join(f"{-float(word):g}" for word in axis.get("xyz", "").split()))
            low, high = limit.get("lower", ""), limit.get("upper", "")
            limit.set("lower", f"-{high}".replace("--", ""))
            limit.set("upper", f"-{low}".replace("--", ""))
    path = folder / "turned.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


def legs(**changed: str) -> dict[Side, LegJoints]:
    """Both legs of twin.urdf; ``knee="-"`` puts a sign in front of the names of both knees."""
    return {
        side: LegJoints(
            **{str(joint): f"{changed.get(str(joint), '')}{side}_{joint}" for joint in JOINTS},
            contact_frames=(f"{side}_heel", f"{side}_toe"),
        )
        for side in Side
    }


def ankle_moves(model: LegModel, joint: JointName) -> np.ndarray:
    """How the foot moves when a joint of the left leg turns a little, in [m]."""
    q = np.zeros(model.nv)
    q[model.index(Side.LEFT, joint)] = 0.1
    frame = "left_toe" if joint is JointName.ANKLE else "left_ankle"
    return model.frame_position(q, frame) - model.frame_position(np.zeros(model.nv), frame)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@pytest.mark.parametrize("joint", JOINTS)
def test_a_reversed_axis_is_detected_negated_and_reported(
    joint: JointName, kind: str, tmp_path: Path
) -> None:
    path = turned(tmp_path, tuple(f"{side}_{joint}" for side in Side), kind=kind)
    with pytest.warns(ReversedJointWarning) as caught:
        model = LegModel(path, legs(), patient=Patient())
    assert [str(item.message).partition(":")[2].split(":")[0].strip() for item in caught] == [
        f"{side} {joint}" for side in Side
    ]
    message = str(caught[0].message)
    assert f"write {joint}: -left_{joint}" in message and "\n" not in message
    straight = LegModel("twin.urdf", legs(), patient=Patient())
    q = np.linspace(-0.3, 0.7, model.nv)
    assert_array_equal(model.gravity_torque(q), straight.gravity_torque(q))
    assert_array_equal(ankle_moves(model, joint), ankle_moves(straight, joint))
    if kind == "revolute":
        assert model.position_limits(Side.LEFT, joint) == straight.position_limits(Side.LEFT, joint)


def test_flexion_and_dorsiflexion_move_the_leg_as_they_should() -> None:
    model = LegModel("twin.urdf", legs())
    assert ankle_moves(model, JointName.HIP)[0] > 0.0
    assert ankle_moves(model, JointName.KNEE)[0] < 0.0
    assert ankle_moves(model, JointName.ANKLE)[2] > 0.0


def test_a_minus_negates_without_a_warning(tmp_path: Path) -> None:
    path = turned(tmp_path, ("left_knee", "right_knee"))
    model = LegModel(path, legs(knee="-"))
    assert model.legs == legs()
    assert ankle_moves(model, JointName.KNEE)[0] < 0.0


def test_a_plus_keeps_the_way_of_the_urdf(tmp_path: Path) -> None:
    path = turned(tmp_path, ("left_knee", "right_knee"))
    model = LegModel(path, legs(knee="+"))
    assert ankle_moves(model, JointName.KNEE)[0] > 0.0


def test_a_minus_on_a_correct_joint_is_applied_and_reported() -> None:
    with warns(ReversedJointWarning, "left_knee", "-left_knee", "knee"):
        model = LegModel("twin.urdf", legs(knee="-"))
    assert ankle_moves(model, JointName.KNEE)[0] > 0.0


def test_an_axis_that_is_not_sideways_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "roll.urdf"
    whole = packaged_urdf("twin.urdf").read_text(encoding="utf-8")
    before, _, knee = whole.partition('<joint name="left_knee"')
    path.write_text(f'{before}<joint name="left_knee"{knee.replace("0 1 0", "1 0 0", 1)}', encoding="utf-8")
    with warns(ReversedJointWarning, "left knee", "left_knee"):
        LegModel(path, legs())
    LegModel(path, legs(knee="+"))  # warnings are errors


def walk(preset: str, *settings: str) -> Run:
    return simulate(load_experiment(preset, ["duration_s=1.5", *settings]).experiment)


@pytest.mark.parametrize("engine", ["compiled", "pinocchio"])
def test_the_walk_on_a_reversed_knee_equals_the_original(engine: str, tmp_path: Path) -> None:
    """Bit for bit: found by itself and stated; kernels, stops, contacts and wearer follow the sign."""
    path = turned(tmp_path, ("left_knee", "right_knee", "right_hip"))
    settings = [f"engine={engine}", *(["duration_s=0.2"] if engine == "pinocchio" else [])]
    original = walk("treadmill_guided", *settings).log
    with pytest.warns(ReversedJointWarning):
        found = walk("treadmill_guided", *settings, f"leg.urdf={path}").log
    assert_frame_equal(found, original)
    stated = ["leg.left.knee=-left_knee", "leg.right.knee=-right_knee", "leg.right.hip=-right_hip"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_frame_equal(walk("treadmill_guided", *settings, f"leg.urdf={path}", *stated).log, original)


def test_a_leg_without_an_ankle_is_read_the_same_way(tmp_path: Path) -> None:
    path = turned(tmp_path, ("right_hip",), source="twin_leg.urdf")
    with warns(ReversedJointWarning, "right hip", "right_hip"):
        found = walk("bench_leg", f"leg.urdf={path}").log
    assert_frame_equal(found, walk("bench_leg").log)


def test_the_command_line_reports_it_on_one_line(tmp_path: Path) -> None:
    path = turned(tmp_path, ("right_knee",), source="twin_leg.urdf")
    command = [
        sys.executable,
        "-m",
        "twin_gait",
        "simulate",
        "bench_leg",
        "--duration",
        "0.02",
        "--no-pictures",
    ]
    command += ["--out", str(tmp_path / "run"), "--set", f"leg.urdf={path}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0
    lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert len(lines) == 1
    assert lines[0].startswith("twin-gait: warning: ")
    assert states(lines[0], "right knee", "knee: -right_knee")
