"""The run directory: complete, atomic, readable again."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.runs.folders import staged_directory
from twin_gait.runs.record import RUN_DIRECTORY, read_stored_run, write_run
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.log import LOG_SCHEMA_VERSION, log_layout, unit_of
from twin_gait.simulation.simulation_setup import build_setup


@pytest.fixture(scope="module")
def run():
    return simulate(load_experiment("bench_leg", ["duration_s=1.2"]).experiment)


@pytest.fixture(scope="module")
def directory(run, tmp_path_factory):
    target = tmp_path_factory.mktemp("runs") / "walk"
    with staged_directory(target, RUN_DIRECTORY) as staging:
        write_run(run, staging, pictures=False)
    return target


def test_run_directory_contains_every_file(directory):
    assert sorted(path.name for path in directory.iterdir()) == [
        "experiment.yaml",
        "log.parquet",
        "strides.csv",
        "summary.json",
        "transitions.csv",
    ]


def test_log_is_read_back_bit_for_bit(run, directory):
    log = read_stored_run(directory).run.log
    pd.testing.assert_frame_equal(log, run.log, check_exact=True)


def test_columns_of_numbers_are_written_without_a_dictionary(directory):
    """With one a log takes three times as long to write and a quarter more space."""
    group = pq.ParquetFile(directory / "log.parquet").metadata.row_group(0)
    columns = [group.column(index) for index in range(group.num_columns)]
    encoded = {column.physical_type for column in columns if column.has_dictionary_page}
    assert "DOUBLE" not in encoded and any(column.physical_type == "DOUBLE" for column in columns)


def test_a_run_is_read_back_completely(run, directory):
    again = read_stored_run(directory).run
    assert (again.table, again.switches, again.trip) == (run.table, run.switches, run.trip)
    assert (again.status, again.reason, again.wall_s) == (run.status, run.reason, run.wall_s)
    assert (again.body_weight, again.duration) == (run.body_weight, run.duration)
    assert summarise_run(again) == summarise_run(run)


def test_an_experiment_with_numbers_of_numpy_is_written_and_read(run, tmp_path):
    plant = replace(run.experiment.plant, friction_ratio={"knee": np.float64(0.5)}, gravity=np.float32(9.5))
    changed = simulate(replace(run.experiment, plant=plant, seed=np.int64(3), duration=np.float64(0.1)))
    write_run(changed, tmp_path, pictures=False)
    assert read_stored_run(tmp_path).run.experiment.plant == plant


@pytest.mark.parametrize("name", ["", "a/b", "a\nb", None])
def test_a_name_unfit_for_a_run_directory_is_refused(run, name):
    with raises(ParameterError, "name", repr(name)):
        replace(run.experiment, name=name)


def test_switches_that_the_table_does_not_have_are_refused(directory, tmp_path):
    broken = tmp_path / "run"
    shutil.copytree(directory, broken)
    switches = broken / "transitions.csv"
    switches.write_text(switches.read_text().replace(",late_stance,", ",last_stance,"))
    with raises(RunDirectoryError, "transitions.csv", "last_stance"):
        read_stored_run(broken)


def test_log_carries_units_schema_version_and_status(directory):
    metadata = pq.read_schema(directory / "log.parquet").metadata
    assert metadata[b"twin_gait.schema_version"] == str(LOG_SCHEMA_VERSION).encode()
    assert metadata[b"twin_gait.status"] == b"completed"
    units = json.loads(metadata[b"twin_gait.units"])
    assert units["right_hip_motor_torque_Nm"] == "N·m"
    assert units["right_knee_stiffness_Nm_per_rad"] == "N·m/rad"
    assert units["right_knee_velocity_rad_per_s"] == "rad/s"


def test_every_column_has_a_unit():
    names = log_layout(build_setup(load_experiment("treadmill_guided").experiment)).names
    without = {name.split("_", 2)[2] for name in names if unit_of(name) == "1"}
    assert without == {"friction_compensation_gain", "cop_ratio"}


def test_transitions_hold_cause_and_angles(run, directory):
    table = pd.read_csv(directory / "transitions.csv", dtype=str)  # pandas 2 reads numbers to an ulp only
    assert len(table) == len(run.switches) >= 2
    first = table.iloc[0]
    assert first["cause"] == run.switches[0].cause
    assert float(first["time_s"]) == pytest.approx(run.switches[0].tick * 1e-3)
    assert float(first["hip_angle_rad"]) == run.log["right_hip_angle_rad"].iloc[run.switches[0].tick]


def test_experiment_has_hashes_and_versions(directory):
    document = yaml.safe_load((directory / "experiment.yaml").read_text())
    assert len(document["provenance"]["urdf_sha256"]) == 64
    assert len(document["provenance"]["table_sha256"]) == 64
    assert {"twin_gait", "pinocchio", "numpy", "python"} <= set(document["provenance"]["versions"])


def test_summary_is_strict_json(directory):
    def refuse(text):
        raise AssertionError(f"{text} is not JSON")

    json.loads((directory / "summary.json").read_text(), parse_constant=refuse)


def test_an_error_while_writing_leaves_no_files(tmp_path):
    with pytest.raises(ZeroDivisionError), staged_directory(tmp_path / "walk", RUN_DIRECTORY) as staging:
        (staging / "half").write_text("half")
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_an_existing_directory_is_refused_and_kept(directory):
    with (
        raises(RunDirectoryError, directory, "--out", "--force"),
        staged_directory(directory, RUN_DIRECTORY),
    ):
        pass
    assert (directory / "log.parquet").is_file()


def test_force_replaces_a_run_but_nothing_else(tmp_path, directory):
    other = tmp_path / "letters"
    other.mkdir()
    (other / "dear.txt").write_text("dear")
    with (
        raises(RunDirectoryError, other, "--out"),
        staged_directory(other, RUN_DIRECTORY, force=True),
    ):
        pass
    assert (other / "dear.txt").read_text() == "dear"
    run_again = tmp_path / "walk"
    for text in ("one", "two"):
        with staged_directory(run_again, RUN_DIRECTORY, force=True) as staging:
            (staging / "experiment.yaml").write_text(text)
    assert (run_again / "experiment.yaml").read_text() == "two"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["letters", "walk"]


def test_a_folder_that_is_not_a_run_is_refused(tmp_path):
    with raises(RunDirectoryError, "experiment.yaml"):
        read_stored_run(tmp_path)


def test_a_run_with_other_columns_is_refused_with_the_command_that_repeats_it(tmp_path, directory):
    old = shutil.copytree(directory, tmp_path / "old")
    summary = json.loads((old / "summary.json").read_text())
    (old / "summary.json").write_text(json.dumps({**summary, "log_schema_version": 1}))
    with raises(RunDirectoryError, "twin-gait simulate", "old/experiment.yaml"):
        read_stored_run(old)


def test_a_broken_log_is_one_line(tmp_path, directory):
    for name in ("experiment.yaml", "summary.json"):
        (tmp_path / name).write_bytes((directory / name).read_bytes())
    (tmp_path / "log.parquet").write_bytes(b"PAR1 broken")
    with pytest.raises(RunDirectoryError) as caught:
        read_stored_run(tmp_path)
    assert "\n" not in str(caught.value)


def test_atomic_write_keeps_the_old_file_when_it_fails(tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "file.txt"
    write_atomically(path, "old")
    with pytest.raises(RunDirectoryError):
        write_atomically(tmp_path / "no" / "such" / "folder.txt", "x")
    monkeypatch.setattr(os, "replace", refuse)
    with raises(RunDirectoryError, "file.txt", "No space left"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["file.txt"]


def test_csv_export_has_every_column_and_all_digits(tmp_path, run):
    from twin_gait.export.motion import export_csv

    export_csv(run.log, tmp_path / "log.csv")
    table = pd.read_csv(tmp_path / "log.csv", dtype=str)
    assert list(table.columns) == list(run.log.columns)
    np.testing.assert_array_equal(
        table["right_knee_angle_rad"].map(float).to_numpy(), run.log["right_knee_angle_rad"].to_numpy()
    )
