"""Motions for OpenSim: the header that it reads, the names and signs of its models, every digit."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
from errors import raises, states

from twin_gait.cli import main
from twin_gait.conventions import CORC_X2, OPENSIM_GAIT2392, OSL, OWN_CONVENTION, RAJAGOPAL
from twin_gait.exceptions import ParameterError
from twin_gait.export.motion import export_motion
from twin_gait.replay.recording import LogFormat, read_recording
from twin_gait.runs.log_files import read_log_table
from twin_gait.vocabulary import Side


def small_log(rng) -> pd.DataFrame:
    names = [f"{side}_{joint}_angle_rad" for side in ("left", "right") for joint in ("hip", "knee", "ankle")]
    angles = rng.uniform(-1.0, 1.0, size=(40, 6))
    return pd.DataFrame({"time_s": np.arange(40) * 1e-3, **dict(zip(names, angles.T, strict=True))})


def read_motion(path) -> tuple[dict[str, str], pd.DataFrame]:
    """Return header and table, read without code of this package."""
    header, _, body = path.read_text().partition("endheader\n")
    pairs = dict(line.split("=") for line in header.splitlines() if "=" in line)
    names, rows = body.split("\n", 1)
    return pairs, pd.DataFrame(np.loadtxt(io.StringIO(rows)), columns=names.split("\t"))


def test_radians_are_read_back_bit_for_bit(tmp_path, rng):
    log = small_log(rng)
    path = tmp_path / "walk.sto"
    export_motion(log, path, OPENSIM_GAIT2392, unit="rad")
    header, motion = read_motion(path)
    assert header == {"version": "1", "nRows": "40", "nColumns": "7", "inDegrees": "no"}
    assert motion.columns[0] == "time" and set(motion.columns[1:]) == set(OPENSIM_GAIT2392.columns.values())
    assert (motion["time"] == log["time_s"]).all()
    for side in ("left", "right"):
        assert (motion[f"hip_flexion_{side[0]}"] == log[f"{side}_hip_angle_rad"]).all()
        assert (motion[f"knee_angle_{side[0]}"] == -log[f"{side}_knee_angle_rad"]).all()
        assert (motion[f"ankle_angle_{side[0]}"] == log[f"{side}_ankle_angle_rad"]).all()


def test_degrees_are_read_back_to_a_rounding(tmp_path, rng):
    log = small_log(rng)
    path = tmp_path / "walk.mot"
    export_motion(log, path, RAJAGOPAL)
    header, motion = read_motion(path)
    assert header["inDegrees"] == "yes"
    knee = np.radians(motion["knee_angle_r"].to_numpy())
    np.testing.assert_allclose(knee, log["right_knee_angle_rad"], rtol=4 * np.finfo(float).eps, atol=0.0)


def test_the_reader_of_replay_reads_the_same_numbers(tmp_path, rng):
    path = tmp_path / "walk.sto"
    export_motion(small_log(rng), path, OPENSIM_GAIT2392, unit="rad")
    _, motion = read_motion(path)
    storage = read_log_table(path)
    assert storage.unit == "rad" and storage.names == tuple(motion.columns)
    for name in motion.columns:
        assert (storage.numbers(name) == motion[name].to_numpy()).all()


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_name_with_a_unit_states_the_one_that_is_written(tmp_path, rng, unit):
    log = small_log(rng).abs()  # knees that bend backwards are refused
    export_motion(log, tmp_path / "walk.sto", OWN_CONVENTION, unit=unit)
    assert f"left_hip_angle_{unit}" in read_motion(tmp_path / "walk.sto")[1]
    angle = read_recording(tmp_path / "walk.sto", LogFormat(convention=OWN_CONVENTION)).angles[
        Side.LEFT, "hip"
    ]
    np.testing.assert_allclose(angle, log["left_hip_angle_rad"], rtol=1e-14)


def test_a_log_of_one_leg_without_an_ankle_has_two_angles(tmp_path, rng):
    log = small_log(rng)[["time_s", "right_hip_angle_rad", "right_knee_angle_rad"]]
    gait2392, x2 = ["hip_flexion_r", "knee_angle_r"], ["JointPositions_3", "JointPositions_4"]
    for convention, angles in ((OPENSIM_GAIT2392, gait2392), (CORC_X2, x2)):
        export_motion(log, str(tmp_path / "leg.mot"), convention)
        assert list(read_motion(tmp_path / "leg.mot")[1].columns) == ["time", *angles]


def test_unwritable_targets_are_refused(tmp_path, rng):
    with raises(ParameterError, "osl"):
        export_motion(small_log(rng), tmp_path / "leg.mot", OSL)
    with raises(ParameterError, "deg", "rad", "grad"):
        export_motion(small_log(rng), tmp_path / "leg.mot", RAJAGOPAL, unit="grad")
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "bench"
    assert main(["simulate", "bench_leg", "--duration", "0.5", "--out", str(out), "--no-pictures"]) == 0
    return out


@pytest.mark.parametrize(
    ("options", "sign", "in_degrees"),
    [
        (["--format", "mot"], -1.0, "yes"),
        (["--format", "sto"], -1.0, "no"),
        (["--format", "sto", "--convention", "rajagopal"], 1.0, "no"),
    ],
)
def test_export_writes_a_motion_of_the_chosen_model(bench, tmp_path, capsys, options, sign, in_degrees):
    path = tmp_path / f"walk.{options[1]}"
    assert main(["export", str(bench), *options, "--out", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    header, motion = read_motion(path)
    assert header["inDegrees"] == in_degrees
    knee = motion["knee_angle_r"].to_numpy()
    expected = sign * pd.read_parquet(bench / "log.parquet")["right_knee_angle_rad"].to_numpy()
    np.testing.assert_allclose(np.radians(knee) if in_degrees == "yes" else knee, expected, rtol=1e-15)


def test_export_goes_into_the_run_by_default_and_replaces_with_force_only(bench, capsys):
    assert main(["export", str(bench), "--format", "mot"]) == 0
    assert main(["export", str(bench), "--format", "mot"]) == 2
    assert states(capsys.readouterr().err, "log.mot", "--out")
    assert main(["export", str(bench), "--format", "mot", "--out", "walk.csv"]) == 2
    assert states(capsys.readouterr().err, "--out walk.csv", ".csv", "mot")
    assert main(["export", str(bench), "--format", "mot", "--force"]) == 0


def test_a_csv_keeps_its_own_convention(bench, tmp_path, capsys):
    path = tmp_path / "log.csv"
    assert (
        main(["export", str(bench), "--format", "csv", "--convention", "rajagopal", "--out", str(path)]) == 2
    )
    assert states(capsys.readouterr().err, "--convention", "csv")
    assert not path.exists()
