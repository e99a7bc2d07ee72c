"""Strides of LocoHub through replay, and those of a run there and back."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from lab_files import locohub_frame

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.export.locohub import export_locohub
from twin_gait.measures.locohub import read_strides
from twin_gait.measures.reference import reference_cycle_time
from twin_gait.replay.foot_events import FROM_ANGLES, FROM_LOAD, foot_strikes
from twin_gait.replay.machine import replay_log
from twin_gait.replay.recording import LogFormat, normative_walk, read_recording
from twin_gait.replay.writing import stride_phases
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side

LEFT, RIGHT, HIP, KNEE = Side.LEFT, Side.RIGHT, JointName.HIP, JointName.KNEE
HIP_COLUMN = "hip_flexion_angle_ipsi_rad"


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(load_experiment("treadmill_guided", ["duration_s=12"]).experiment)


@pytest.fixture(scope="module")
def strides(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("locohub") / "walk.parquet"
    export_locohub(run, path)
    return path


def write(folder, frame: pd.DataFrame, name: str = "walk_phase.parquet"):
    frame.to_parquet(folder / name)
    return folder / name


# ---------------------------------------------------------------------- there and back


def test_a_run_comes_back_with_the_same_phases_and_strides(run, strides):
    result = replay_log(str(strides), table="treadmill_guided", speed=run.experiment.scenario.walking.speed)
    begins = {side: run.leg_record(side).contacts.heel_strikes for side in Side}
    start, sample = begins[LEFT][0], np.diff(begins[LEFT]).max() / 149.0
    settled = begins[LEFT][1] - start  # in the first stride the legs do not have the phases of the run
    assert result.recording.n_ticks == begins[LEFT][-1] - start + 1
    for side in Side:
        found = [item for item in result.switches if item.side is side and item.tick > settled]
        last = result.recording.n_ticks - sample
        known = [item for item in run.switches if item.side is side and settled < item.tick - start < last]
        assert [item[1:5] for item in found][: len(known)] == [item[1:5] for item in known] and len(
            known
        ) > 15
        apart = [one.tick + start - other.tick for one, other in zip(found, known, strict=False)]
        assert np.abs(apart).max() <= sample
        ends = [end + start for begin, end, _ in stride_phases(result.phases[side]) if begin > settled]
        entries = run.leg_record(side).first_phase_entries
        assert len(ends) >= 3
        assert all(np.abs(entries - end).min() <= sample for end in ends)


def test_the_file_has_the_columns_units_and_facts_of_locohub(run, strides):
    table, patient = pd.read_parquet(strides), run.experiment.patient
    record = run.leg_record(RIGHT)
    start, end = record.strides(skip=0)[1]
    stride = table[(table["task_info"].str.startswith("leg:r")) & (table["step"] == 2)]
    assert len(stride) == 150 and set(table["task"]) == {"level_walking"}
    np.testing.assert_allclose(stride["phase_ipsi"], np.linspace(0.0, 100.0, 150))
    np.testing.assert_allclose(stride["phase_ipsi_dot"], 100.0 / ((end - start) * 1e-3))
    facts = dict(pair.split(":") for pair in stride["task_info"].iloc[0].split(","))
    assert facts == {"leg": "r", "speed_m_s": "0.417", "treadmill": "true", "incline_deg": "0"}
    person = dict(pair.split(":") for pair in stride["subject_metadata"].iloc[0].split(","))
    assert person == {"height_m": f"{patient.height:g}", "weight_kg": f"{patient.mass:g}"}
    ticks, instants = np.arange(len(run.log)), np.linspace(start, end, 150)
    weight = patient.mass * run.experiment.plant.gravity
    external = run.log["left_knee_external_torque_Nm"]
    for column, signal in {
        "knee_flexion_angle_ipsi_rad": run.log["right_knee_angle_rad"],
        "hip_flexion_angle_contra_rad": run.log["left_hip_angle_rad"],
        "ankle_dorsiflexion_angle_ipsi_rad": run.log["right_ankle_angle_rad"],
        "hip_flexion_velocity_ipsi_rad_s": run.log["right_hip_velocity_rad_per_s"],
        "grf_vertical_ipsi_BW": run.log["right_foot_normal_force_N"] / weight,
        "grf_anterior_contra_BW": run.log["left_foot_friction_force_N"] / weight,
    }.items():
        np.testing.assert_allclose(stride[column], np.interp(instants, ticks, signal), rtol=0.0, atol=1e-12)
    # The moment of a joint is the device's and the wearer's.
    wearers = (
        stride["knee_flexion_moment_contra_Nm_kg"] - stride["knee_flexion_assistance_moment_contra_Nm_kg"]
    )
    expected = np.interp(instants, ticks, external) / patient.mass
    np.testing.assert_allclose(wearers, expected, rtol=0.0, atol=1e-12)
    assert not table.isna().any().any()


@pytest.mark.slow  # compiles a loop
def test_a_slope_turns_the_forces_and_names_the_task(tmp_path):
    steep = simulate(load_experiment("treadmill_guided", ["duration_s=6", "scenario.slope_deg=3"]).experiment)
    export_locohub(steep, tmp_path / "up.parquet")
    table, record = pd.read_parquet(tmp_path / "up.parquet"), steep.leg_record(LEFT)
    assert (
        set(table["task"]) == {"incline_walking"} and table["task_info"].str.contains("incline_deg:3").all()
    )
    start = record.strides(skip=0)[0][0]
    normal, along = (steep.log[f"left_foot_{name}_force_N"][start] for name in ("normal", "friction"))
    sine, cosine = np.sin(np.radians(3.0)), np.cos(np.radians(3.0))
    weight = steep.experiment.patient.mass * steep.experiment.plant.gravity
    assert table["grf_vertical_ipsi_BW"][0] == pytest.approx((normal * cosine + along * sine) / weight)
    assert table["grf_anterior_ipsi_BW"][0] == pytest.approx((along * cosine - normal * sine) / weight)


def test_a_walk_without_ground_or_without_a_stride_is_refused(tmp_path):
    with raises(ParameterError, "treadmill_guided", "stride"):
        export_locohub(
            simulate(load_experiment("treadmill_guided", ["duration_s=0.5"]).experiment),
            tmp_path / "x.parquet",
        )
    bench = simulate(load_experiment("bench_leg", ["duration_s=0.01", "engine=pinocchio"]).experiment)
    with raises(ParameterError, "bench_leg", "ground", "heel strikes"):
        export_locohub(bench, tmp_path / "x.parquet")
    assert not (tmp_path / "x.parquet").exists()


# ---------------------------------------------------------------------- reading


def test_strides_are_joined_with_their_duration_and_load(tmp_path):
    force = {f"grf_vertical_{limb}_BW": 0.8 for limb in ("ipsi", "contra")}
    recording = read_recording(write(tmp_path, locohub_frame(3, **force)))
    assert recording.n_ticks == 3601 and not recording.warnings
    turn = 2.0 * np.pi * recording.time / 1.2
    np.testing.assert_allclose(recording.angles[LEFT, HIP], 0.2 + 0.3 * np.cos(turn), atol=1e-4)
    np.testing.assert_allclose(recording.angles[RIGHT, HIP], 0.2 - 0.3 * np.cos(turn), atol=1e-4)
    np.testing.assert_allclose(recording.foot_strikes[LEFT], [0.0, 1.2, 2.4, 3.6])
    assert recording.body_weight == pytest.approx(70 * 9.81, rel=1e-3)
    np.testing.assert_allclose(recording.loads[RIGHT], 0.8 * recording.body_weight)


def test_a_right_limb_is_the_right_leg_and_an_unnamed_one_the_left(tmp_path):
    right = locohub_frame(task_info="speed_m_s:1.2,leg:right")
    assert set(read_recording(write(tmp_path, right)).foot_strikes) == {RIGHT}
    both = pd.concat([right, locohub_frame(shift=0.1)])
    assert read_recording(write(tmp_path, both)).angles[LEFT, HIP].max() == pytest.approx(0.6, abs=1e-3)
    unnamed = read_recording(write(tmp_path, locohub_frame(task_info="speed_m_s:1.2")))
    assert set(unnamed.foot_strikes) == {LEFT} and "left" in unnamed.warnings[0]


def test_person_and_task_are_chosen(tmp_path, capsys):
    people = [locohub_frame(subject=f"UM21_AB0{number}", shift=0.01 * number) for number in (1, 2)]
    fast = locohub_frame(subject="UM21_AB02", task_id="fast", shift=0.05)
    path = write(tmp_path, pd.concat([*people, fast, locohub_frame(task="run")]))
    chosen = read_recording(path, LogFormat(subject="UM21_AB02", task="fast"))
    assert chosen.angles[LEFT, HIP].max() == pytest.approx(0.55, abs=1e-3)
    for options, facts in {
        ("--task", "level_walking"): ("subject", "--subject", "UM21_AB01", "UM21_AB02"),
        ("--subject", "UM21_AB01"): ("task", "level_walking", "run"),
        ("--subject", "UM21_AB03"): ("subject", "UM21_AB01", "'UM21_AB03'"),
        ("--task", "hop"): ("task", "level_walking", "run", "fast", "'hop'"),
    }.items():
        capsys.readouterr()
        assert main(["replay", str(path), *options]) == 2
        message = capsys.readouterr().err
        assert states(message, "walk_phase.parquet", *facts) and message.count("\n") == 1


def test_a_duration_that_is_not_stated_is_given(tmp_path):
    path = write(tmp_path, locohub_frame(cycle_time=None))
    with raises(ParameterFileError, "phase_ipsi_dot", "--cycle-time-s"):
        read_recording(path)
    assert read_recording(path, LogFormat(cycle_time=1.5)).n_ticks == 6001


def test_mistakes_are_refused_in_one_line(tmp_path):
    whole = locohub_frame()
    for frame, facts in (
        (whole.drop(index=200), ("phase_ipsi", "150", "149", "UM21_AB01", "step 002")),
        (whole.drop(columns="phase_ipsi").assign(time_s=0.0), ("phase_ipsi", "_phase.parquet")),
        (whole.drop(columns="step"), ("step",)),
        (whole.assign(**{HIP_COLUMN: 30.0}), (HIP_COLUMN, "30", "degrees")),
        (whole.rename(columns={HIP_COLUMN: HIP_COLUMN.replace("rad", "deg")}), ("degrees", HIP_COLUMN)),
        (whole.assign(**{HIP_COLUMN: np.nan}).drop(columns="knee_flexion_angle_ipsi_rad"), (HIP_COLUMN,)),
        (whole.assign(**{HIP_COLUMN: whole[HIP_COLUMN].where(whole.index % 150 > 3)}), (HIP_COLUMN, "4")),
    ):
        with raises(ParameterFileError, "walk_phase.parquet", *facts) as refused:
            read_recording(write(tmp_path, frame))
        assert "\n" not in str(refused.value)
    with raises(ParameterFileError, "walk_phase.parquet", "LocoHub"):
        read_recording(write(tmp_path, whole), LogFormat(units="deg"))


def test_a_stride_with_a_gap_is_left_out_and_a_jump_is_named(tmp_path):
    frame = locohub_frame(4)
    frame.loc[160, HIP_COLUMN] = np.nan
    strides = read_strides(write(tmp_path, frame))
    assert len(strides.subjects) == 3 and states(strides.notices[0], "1 of 4 strides")
    frame.loc[300:, HIP_COLUMN] += 0.4
    recording = read_recording(write(tmp_path, frame))
    assert any(states(text, "1 of 2 strides", "10 deg") for text in recording.warnings)


# ---------------------------------------------------------------------- heel strikes


@pytest.mark.parametrize("speed", [0.5, 1.5, 5.0])
def test_heel_strikes_of_healthy_walking_follow_from_its_angles(speed):
    walk, cycle = normative_walk(f"koopman@{speed:g}"), reference_cycle_time(speed / 3.6, 1.75)
    for side, lead in ((LEFT, 0.0), (RIGHT, 0.5)):
        strikes, origin = foot_strikes(walk, side)
        share = (strikes * 1e-3 / cycle + lead + 0.5) % 1.0 - 0.5
        assert origin == FROM_ANGLES and len(strikes) >= 7 and np.abs(share).max() < 0.005


def test_heel_strikes_of_a_run_follow_from_its_load(run, strides):
    recording = read_recording(strides)
    ticks, origin = foot_strikes(recording, RIGHT)
    known = run.leg_record(RIGHT).contacts.heel_strikes - run.leg_record(LEFT).contacts.heel_strikes[0]
    assert origin == FROM_LOAD
    assert all(np.abs(known - tick).min() <= 25 for tick in ticks) and len(ticks) >= 3


def test_a_walk_without_strides_is_not_written(tmp_path, capsys):
    still = pd.DataFrame(
        {"time_s": np.arange(0.0, 2.0, 0.01), "left_hip_angle_deg": 3.0, "left_knee_angle_deg": 5.0}
    )
    still.to_csv(tmp_path / "still.csv", index=False)
    out = tmp_path / "own.parquet"
    given = ["replay", str(tmp_path / "still.csv"), "--table", "bench_leg", "--strides", str(out)]
    assert main(given) == 2 and not out.exists()
    assert states(capsys.readouterr().err, "still.csv", "heel strikes")
