"""C3D files that ezc3d writes, through replay: the angles of Plug-in Gait by name, and events of the feet."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from lab_files import MODEL_ANGLES, healthy_frames, write_c3d

from twin_gait.cli import main
from twin_gait.conventions import PLUG_IN_GAIT, RAJAGOPAL
from twin_gait.exceptions import MissingOptionalDependency, ParameterFileError
from twin_gait.export.motion import write_storage
from twin_gait.measures.reference import reference_cycle_time
from twin_gait.replay.machine import replay_log
from twin_gait.replay.recording import LogFormat, read_recording
from twin_gait.replay.writing import summarise_replay
from twin_gait.vocabulary import JointName, Side

pytest.importorskip("ezc3d", reason="needs ezc3d: pip install 'twin-gait[mocap]'")
LEFT, RIGHT, HIP, KNEE = Side.LEFT, Side.RIGHT, JointName.HIP, JointName.KNEE
CYCLE_TIME = reference_cycle_time(3.0 / 3.6, 1.75)  # [s] of the walk in lab_files


def points(**more: np.ndarray) -> dict[str, np.ndarray]:
    """Return the angles of Plug-in Gait, and a marker, by the names of their points."""
    _, angles = healthy_frames()
    marker = np.linspace(0.0, 900.0, len(angles[LEFT, HIP]))
    return {"LASI": marker, **{MODEL_ANGLES[key]: values for key, values in angles.items()}, **more}


def test_a_trial_replays_as_the_motion_of_the_same_angles(tmp_path):
    time, angles = healthy_frames()
    columns = {RAJAGOPAL.columns[key]: values for key, values in angles.items()}
    write_storage(tmp_path / "walk.mot", {"time": time, **columns}, in_degrees=True)
    trial = replay_log(str(write_c3d(tmp_path / "walk.c3d", points())))
    motion = replay_log(str(tmp_path / "walk.mot"), log_format=LogFormat(convention=RAJAGOPAL))
    assert len(trial.recording.angles) == 6
    for key, values in motion.recording.angles.items():
        np.testing.assert_allclose(trial.recording.angles[key], values, rtol=0.0, atol=1e-9)
    assert trial.switches == motion.switches and len(trial.switches) > 30
    for side in Side:
        np.testing.assert_array_equal(trial.phases[side], motion.phases[side])


def test_names_and_signs_are_those_of_plug_in_gait():
    # Lower body angles as output from Plug-in Gait (docs.vicon.com, Nexus 2.12): flexion and dorsiflexion +.
    assert PLUG_IN_GAIT.columns[LEFT, HIP] == "LHipAngles"
    assert PLUG_IN_GAIT.columns[RIGHT, KNEE] == "RKneeAngles"
    assert PLUG_IN_GAIT.columns[RIGHT, JointName.ANKLE] == "RAnkleAngles"
    assert PLUG_IN_GAIT.unit == "deg" and not PLUG_IN_GAIT.signs


def test_radians_are_read_by_their_unit(tmp_path):
    turned = {name: np.radians(values) for name, values in points().items()}
    radians = read_recording(write_c3d(tmp_path / "rad.c3d", turned, unit="rad"))
    degrees = read_recording(write_c3d(tmp_path / "deg.c3d", points()))
    for key, values in degrees.angles.items():
        np.testing.assert_allclose(radians.angles[key], values, rtol=0.0, atol=1e-7)  # single precision
    with raises(ParameterFileError, "POINT:ANGLE_UNITS", "turns", "deg", "rad"):
        read_recording(write_c3d(tmp_path / "walk.c3d", points(), unit="turns"))


def test_events_give_strides_foot_off_and_onsets_of_the_phases(tmp_path):
    events = [("Left", "Foot Strike", number * CYCLE_TIME) for number in range(8)]
    events += [("Right", "Foot Strike", (number + 0.5) * CYCLE_TIME) for number in range(7)]
    events += [("Left", "Foot Off", (number + 0.63) * CYCLE_TIME) for number in range(7)]
    events += [("General", "Foot Strike", 0.7), ("Left", "Turn", 0.9)]
    result = replay_log(str(write_c3d(tmp_path / "walk.c3d", points(), events=events)))
    sides = summarise_replay(result)["sides"]
    left, right = (sides[side]["recorded_strides"] for side in ("left", "right"))
    assert left["stride_time_s"]["strides"] == 7 and right["stride_time_s"]["strides"] == 6
    assert left["stride_time_s"]["mean"] == pytest.approx(CYCLE_TIME, abs=1e-3)
    assert left["foot_off_percent"]["mean"] == pytest.approx(63.0, abs=0.2)
    assert right["foot_off_percent"] is None
    # docs/reference/replay.md: early stance begins some per cent before heel contact.
    onsets = left["phase_onset_percent"]
    assert 90.0 < onsets["early_stance"]["mean"] < 98.0
    swings = [item.tick for item in result.switches if item.side is LEFT and item.target == "swing_flexion"]
    instants = [100.0 * (tick * 1e-3 / CYCLE_TIME % 1.0) for tick in swings]
    assert onsets["swing_flexion"]["mean"] == pytest.approx(np.mean(instants[:7]), abs=0.2)


def test_time_counts_from_frame_1_like_the_events(tmp_path):
    # The C3D File Format User Guide, EVENT:TIMES: frame 1 is time 0; the file may begin later.
    cut = {name: values[200:] for name, values in points().items()}
    events = [("Left", "Foot Strike", 2.5), ("Left", "Foot Strike", 62.5)]
    recording = read_recording(write_c3d(tmp_path / "cut.c3d", cut, events=events, first_frame=200))
    whole = read_recording(write_c3d(tmp_path / "whole.c3d", points()))
    assert recording.start == 2.0
    np.testing.assert_allclose(recording.foot_strikes[LEFT], [2.5, 62.5])
    # The first interval between frames has another slope at its start.
    same = whole.angles[LEFT, KNEE][2010:]
    np.testing.assert_allclose(recording.angles[LEFT, KNEE][10:], same, rtol=0.0, atol=1e-9)


def test_a_person_of_several_is_chosen(tmp_path):
    flexed = {f"Bob:{name}": values + 5.0 for name, values in points().items()}
    both = {**{f"Ann:{name}": values for name, values in points().items()}, **flexed}
    events = [("Left", "Foot Strike", 0.1), ("Left", "Foot Strike", 0.2)]
    path = write_c3d(tmp_path / "two.c3d", both, events=events, owners=["Ann", "Bob"])
    ann, bob = (read_recording(path, LogFormat(subject=name)) for name in ("Ann", "Bob"))
    np.testing.assert_allclose(np.degrees(bob.angles[LEFT, HIP] - ann.angles[LEFT, HIP]), 5.0, atol=1e-4)
    assert ann.foot_strikes[LEFT] == pytest.approx([0.1]) and bob.foot_strikes[LEFT] == pytest.approx([0.2])
    for name in (None, "Cyd"):
        with raises(ParameterFileError, "subject", "Ann", "Bob", name or "none"):
            read_recording(path, LogFormat(subject=name))
    alone = write_c3d(tmp_path / "one.c3d", {f"Ann:{name}": values for name, values in points().items()})
    np.testing.assert_array_equal(read_recording(alone).angles[LEFT, HIP], ann.angles[LEFT, HIP])


def test_gaps_of_a_trial_are_gaps(tmp_path):
    angles = points()
    angles["LKneeAngles"] = angles["LKneeAngles"].copy()
    angles["LKneeAngles"][300:306] = np.nan
    (gap,) = read_recording(write_c3d(tmp_path / "gap.c3d", angles)).gaps
    assert gap.column == "left knee" and gap.length == pytest.approx(0.07)
    angles["LKneeAngles"][300:320] = np.nan
    with raises(ParameterFileError, "left knee", "0.21"):
        read_recording(write_c3d(tmp_path / "long.c3d", angles))


def test_points_of_another_model_are_named(tmp_path):
    renamed = {"LASI": points()["LASI"], "HIP_L": points()["LHipAngles"], "KNEE_L": points()["LKneeAngles"]}
    path = write_c3d(tmp_path / "visual3d.c3d", renamed)
    named = {"left_hip_angle": "HIP_L", "left_knee_angle": "KNEE_L"}
    assert set(read_recording(path, LogFormat(columns=named)).angles) == {(LEFT, HIP), (LEFT, KNEE)}


@pytest.mark.parametrize("name", ["markers.c3d", "markers.trc"])
def test_markers_are_refused_with_the_programs_that_compute_angles(tmp_path, capsys, name):
    path = tmp_path / name
    if name.endswith("c3d"):
        write_c3d(path, {"LASI": np.arange(100.0), "RASI": np.arange(100.0)})
    else:
        path.write_text("PathFileType\t4\t(X/Y/Z)\tmarkers.trc\n")
    assert main(["replay", str(path)]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert states(message, name, "markers", "inverse kinematics", "OpenSim", "Pose2Sim", "OpenCap", ".mot")
    assert states(message, "LHipAngles", "RKneeAngles")


def test_a_file_that_is_no_trial_is_refused(tmp_path):
    whole = write_c3d(tmp_path / "whole.c3d", points()).read_bytes()
    for name, content in {"empty": b"", "text": b"time,hip\n" * 90, "cut": whole[:700]}.items():
        (tmp_path / f"{name}.c3d").write_bytes(content)
        with raises(ParameterFileError, f"{name}.c3d", "C3D"):
            read_recording(tmp_path / f"{name}.c3d")


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    path = write_c3d(tmp_path / "walk.c3d", points())
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with raises(MissingOptionalDependency, "ezc3d", "twin-gait[mocap]", "walk.c3d"):
        read_recording(path)


def test_strides_of_a_trial_are_written_and_replayed(tmp_path, capsys):
    events = [("Left", "Foot Strike", number * CYCLE_TIME) for number in range(8)]
    path, out = write_c3d(tmp_path / "walk.c3d", points(), events=events), tmp_path / "own.parquet"
    assert main(["replay", str(path), "--strides", str(out), "--subject", "P03"]) == 0
    assert states(capsys.readouterr().err, "own.parquet", "recorded", "hip")
    table = pd.read_parquet(out)
    left = table[table["task_info"] == "leg:l"]
    assert set(table["subject"]) == {"P03"} and len(left) == 7 * 150
    recording, instants = read_recording(path), np.linspace(0.0, CYCLE_TIME, 150)
    stride = left[left["step"] == 3]["knee_flexion_angle_ipsi_rad"]
    expected = np.interp(2 * CYCLE_TIME + instants, recording.time, recording.angles[LEFT, KNEE])
    np.testing.assert_allclose(stride, expected, atol=2e-3)  # strikes are rounded to ticks of 1 ms
    assert main(["replay", str(path), "--strides", str(out)]) == 2
    assert states(capsys.readouterr().err, "own.parquet", "--force")
