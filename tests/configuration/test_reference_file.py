"""Measured gait as the reference of an experiment, from strides of LocoHub."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from lab_files import locohub_frame
from synthetic_run import synthetic_run

from twin_gait import load_experiment, load_run, simulate
from twin_gait.cli import main
from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.experiments import experiment_from_mapping, resolved_document
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.experiment.reference_gait import ReferenceGait
from twin_gait.report.reference import reference_cycle, reference_label, reference_measures
from twin_gait.report.run_figures import draw_cycle
from twin_gait.runs.leg_summary import MeasuredLeg
from twin_gait.runs.record import save_run
from twin_gait.vocabulary import JointName, Side
from twin_gait.yaml12 import load_yaml

HIP, KNEE, ANKLE = JointName.HIP, JointName.KNEE, JointName.ANKLE
PERCENT = np.arange(101.0)


def hip_curve(shift: float = 0.0) -> np.ndarray:
    """Return the hip of ``locohub_frame`` at every percent, between its 150 samples."""
    phase = np.linspace(0.0, 100.0, 150)
    return np.interp(PERCENT, phase, 0.2 + shift + 0.3 * np.cos(2.0 * np.pi * phase / 100.0))


def write(folder, *frames: pd.DataFrame, name: str = "people_phase.parquet"):
    pd.concat(frames).to_parquet(folder / name)
    return folder / name


def experiment_with(path, **more: str) -> Experiment:
    return load_experiment(
        "treadmill_guided", [f"reference={dump_yaml({'file': str(path), **more})}"]
    ).experiment


def test_the_mean_and_deviation_of_one_person_are_those_of_the_strides(tmp_path):
    shifts = (-0.05, 0.01, 0.1)
    frames = [
        locohub_frame(1, shift=shift, task_info=f"leg:{leg}")
        for shift, leg in zip(shifts, "lrl", strict=True)
    ]
    found = experiment_with(write(tmp_path, *frames)).reference
    assert found.strides == 3 and found.subjects == 1 and found.cycle_time == pytest.approx(1.2)
    np.testing.assert_allclose(found.angles(HIP), hip_curve(np.mean(shifts)), atol=1e-6)
    np.testing.assert_allclose(found.deviation(HIP), np.std(shifts, ddof=1), atol=1e-6)
    assert found.angles(ANKLE) is None and found.deviation(ANKLE) is None


def test_people_count_once_however_many_strides_they_make(tmp_path):
    many, one = locohub_frame(5, shift=0.0), locohub_frame(1, shift=0.2, subject="UM21_AB02", cycle_time=None)
    path = write(tmp_path, many, one)
    found = experiment_with(path).reference
    assert found.strides == 6 and found.subjects == 2
    np.testing.assert_allclose(found.angles(HIP), hip_curve(0.1), atol=1e-6)
    np.testing.assert_allclose(found.deviation(HIP), 0.2 / math.sqrt(2.0), atol=1e-6)
    alone = experiment_with(path, subject="UM21_AB02").reference
    assert alone.strides == 1 and not alone.sd and alone.cycle_time is None
    np.testing.assert_allclose(alone.angles(HIP), hip_curve(0.2), atol=1e-6)


def test_several_files_of_own_trials_are_one_reference(tmp_path):
    write(tmp_path, locohub_frame(2, subject="P03"), name="one.parquet")
    write(tmp_path, locohub_frame(2, subject="P03", shift=0.1), name="two.parquet")
    file = tmp_path / "walk.yaml"
    file.write_text("preset: treadmill_guided\nreference: [one.parquet, two.parquet]\n")
    found = load_experiment(file).experiment.reference
    assert found.strides == 4 and found.subjects == 1 and found.source == "one.parquet, two.parquet"
    np.testing.assert_allclose(found.angles(HIP), hip_curve(0.05), atol=1e-6)


def test_the_run_folder_contains_the_curves(tmp_path):
    experiment = experiment_with(write(tmp_path, locohub_frame(2), locohub_frame(1, shift=0.1)))
    text = dump_yaml(resolved_document(experiment, None, {}))
    again = experiment_from_mapping(load_yaml(text), "experiment.yaml", tmp_path)
    assert (
        again.reference == experiment.reference
        and again.reference.sd
        and max(map(len, text.splitlines())) < 200
    )


def test_errors_and_measures_are_those_against_the_measured_gait(tmp_path):
    run = synthetic_run()
    measured = replace(run, experiment=replace(run.experiment, reference=experiment_with(
        write(tmp_path, locohub_frame(2))).reference))  # fmt: skip
    leg = MeasuredLeg(measured, measured.leg_record(Side.LEFT))
    strides = leg.record.strides()
    hip = run.log["left_hip_angle_rad"].to_numpy()
    samples = np.array([np.interp(np.linspace(a, b, 101), np.arange(len(hip)), hip) for a, b in strides])
    expected = np.degrees(np.sqrt(np.mean((samples - hip_curve())[:, :-1] ** 2)))
    summary = leg.summary()
    assert summary["rmse_hip_by_contact_deg"] == pytest.approx(expected, rel=1e-4)
    assert summary["errors"]["hip"]["total_deg"] == pytest.approx(expected, rel=1e-4)
    assert "ankle" not in summary["errors"]
    healthy = MeasuredLeg(run, run.leg_record(Side.LEFT)).summary()
    assert healthy["rmse_hip_by_contact_deg"] != pytest.approx(expected, rel=0.05)
    assert reference_label(measured.experiment) == "people_phase.parquet"
    found = reference_measures(measured.experiment)
    assert found["stride_time_s"] == pytest.approx(1.2) and found["cadence_per_min"] == pytest.approx(100.0)
    assert found["hip_lowest_deg"] == pytest.approx(np.degrees(-0.1), abs=0.01)
    assert "ankle_range_deg" not in found and "step_length_m" not in found
    # Winter's forces stay: these strides have none.
    assert found["load_peak"] == reference_measures(run.experiment)["load_peak"]


def test_a_measured_gait_is_a_reference_where_the_regression_has_none(tmp_path):
    path = write(tmp_path, locohub_frame(2))
    settings = ["scenario.belt_speed_km_per_h=6", f"reference={path}"]
    fast = load_experiment("treadmill_guided", settings).experiment
    np.testing.assert_allclose(reference_cycle(fast, HIP), hip_curve(), atol=1e-6)
    assert reference_cycle(replace(fast, reference=None), HIP) is None


def test_a_figure_shows_the_reference_with_its_deviation(tmp_path):
    experiment = experiment_with(write(tmp_path, locohub_frame(2), locohub_frame(1, shift=0.1)))
    run = synthetic_run()
    figure = draw_cycle(replace(run, experiment=replace(run.experiment, reference=experiment.reference)))
    entries = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert "people_phase.parquet" in entries and "reference ± SD" in entries
    plain = [text.get_text() for legend in draw_cycle(run).legends for text in legend.get_texts()]
    assert "healthy, Koopman (2014)" in plain and "reference ± SD" not in plain


def test_mistakes_are_refused_in_one_line(tmp_path, capsys):
    path = write(tmp_path, locohub_frame(1), locohub_frame(1, task="run"))
    for reference, facts in {
        "nowhere.parquet": ("reference", "nowhere.parquet", "LocoHub"),
        "3": ("reference", "3", "file"),
        "[]": ("reference.file", "none"),
        str(path): ("task", "level_walking", "run"),
        f"{{file: {path}, task: hop}}": ("task", "'hop'", "level_walking"),
        f"{{file: {path}, task: run, subject: P1}}": ("subject", "'P1'", "UM21_AB01"),
        f"{{file: {path}, subjects: P1}}": ("reference.subjects", "subject"),
        f"{{file: {tmp_path / 'walk.csv'}}}": ("walk.csv", "LocoHub"),
    }.items():
        (tmp_path / "walk.csv").write_text("time,hip\n0,1\n")
        assert main(["simulate", "treadmill_guided", "--set", f"reference={reference}"]) == 2
        message = capsys.readouterr().err
        assert states(message, *facts) and message.count("\n") == 1


def test_curves_of_a_wrong_length_are_refused(tmp_path):
    with raises(ParameterError, "mean.hip", "101", "3"):
        ReferenceGait(source="own", strides=1, subjects=1, mean={HIP: (0.0, 0.1, 0.0)})
    file = tmp_path / "walk.yaml"
    curve = {"source": "own", "strides": 1, "subjects": 1, "mean_rad": {"hip": [0.0] * 100}}
    file.write_text(dump_yaml({"preset": "treadmill_guided", "reference": curve}))
    with raises(ParameterFileError, "walk.yaml", "reference", "101", "100"):
        load_experiment(file)


def test_a_run_with_a_reference_is_saved_and_read(tmp_path):
    path = write(tmp_path, locohub_frame(2))
    settings = [f"reference={path}", "engine=pinocchio", "duration_s=0.02"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    saved = save_run(run, tmp_path / "run", pictures=False)
    path.unlink()
    stored = load_run(saved).experiment.reference
    assert stored == run.experiment.reference and stored.strides == 2
    plain = simulate(replace(run.experiment, reference=None))
    pd.testing.assert_frame_equal(run.log, plain.log)  # the reference does not change the walk
