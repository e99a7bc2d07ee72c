"""The table of strides: against an independent script on stored runs, and its statistics."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml
from numpy.testing import assert_allclose
from plain_strides import Facts, recompute
from synthetic_run import synthetic_run

from twin_gait import Run, load_experiment, load_run, save_run, simulate, summarise_run
from twin_gait.labels import label_of
from twin_gait.report.reference import reference_cycle
from twin_gait.runs.stride_table import IDENTITY, STATISTICS, column_meanings, stride_statistics
from twin_gait.vocabulary import JointName, Side

# Two changes of a live session, as its run folder stores them: a stiffness, and the belt with a fade.
CHANGES = (
    "events=[{time_s: 10.1, set: {table.phases.late_stance.hip.stiffness_Nm_per_deg: 1.2}, by: Ann},"
    " {time_s: 19.7, fade_ms: 500, set: {scenario.belt_speed_km_per_h: 1.6}, by: Ann}]"
)
RUNS = {
    "walk": ("treadmill_guided", "duration_s=10"),
    "stroke": ("treadmill_guided", "patient=stroke_left", "duration_s=10"),
    "brace": ("treadmill_guided", "interface=brace", "duration_s=8"),
    "overground": ("overground", "duration_s=12"),
    "fault": ("treadmill_guided", "faults=['supply_loss_shorted@8s']", "duration_s=9"),
    "session": ("treadmill_guided", CHANGES, "duration_s=30"),
    "bench": ("bench_leg", "duration_s=8"),
}


@pytest.fixture(scope="module", params=RUNS)
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    preset, *settings = RUNS[request.param]
    run = simulate(load_experiment(preset, settings).experiment)
    return save_run(run, tmp_path_factory.mktemp("strides") / request.param, pictures=False)


def facts_of(folder: Path, run: Run) -> Facts:
    experiment, walkway = run.experiment, run.walkway
    first, last = experiment.scenario.steady
    document = yaml.safe_load((folder / "experiment.yaml").read_text(encoding="utf-8"))
    ground = {}
    if walkway is not None:
        ground["carried_weight"], ground["friction"], ground["transition"] = (
            walkway.carried_weight, walkway.friction_coefficient, walkway.transition_velocity,
        )  # fmt: skip
    curves = {str(joint): reference_cycle(experiment, joint) for joint in JointName}
    return Facts(
        joints=[str(joint) for joint in experiment.joints],
        mass=experiment.patient.mass if experiment.patient else math.nan,
        armature={str(joint): item.armature for joint, item in experiment.plant.actuators.items()},
        references={joint: curve for joint, curve in curves.items() if curve is not None},
        phases=[str(name) for name in run.table.phase_names],
        steady=(first, min(last, run.trip.time if run.trip else math.inf)),
        changes=[item["time_s"] for item in document.get("events") or () if "set" in item],
        **ground,
    )


def test_file_is_recomputed_from_the_log_by_an_independent_script(folder: Path) -> None:
    written = pd.read_csv(folder / "strides.csv")
    columns = pq.read_table(folder / "log.parquet").to_pandas()
    log = {name: columns[name].to_numpy() for name in columns}
    expected = pd.DataFrame(recompute(log, facts_of(folder, load_run(folder))))
    assert len(expected) >= 4 and set(written.columns) == set(expected.columns)
    for name in expected:
        if name == "side":
            assert written[name].tolist() == expected[name].tolist()
        else:
            numbers = written[name].to_numpy(float), expected[name].to_numpy(float)
            # The square root of a difference of squares has half of their digits.
            tolerance = 1e-6 if name.endswith(("timing_deg", "shape_deg")) else 1e-9
            assert_allclose(*numbers, rtol=tolerance, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("folder", ["session"], indirect=True)
def test_a_session_is_split_at_each_change(folder: Path) -> None:
    table = pd.read_csv(folder / "strides.csv")
    for _, leg in table.groupby("side"):
        starts = leg.groupby("condition")["start_s"].agg(["min", "max"])
        assert starts.index.tolist() == [1, 2, 3]
        assert starts["max"][1] < 10.1 <= starts["min"][2] and starts["max"][2] < 19.7 <= starts["min"][3]
        assert not leg.groupby("condition").head(2)["settled"].any()
        mixed = leg[(leg["start_s"] < 19.7) & (leg["start_s"] + leg["stride_time_s"] > 19.701)]
        assert len(mixed) == 1 and not mixed["settled"].any()
    speeds = table[table["settled"]].groupby("condition")["speed_m_per_s"].mean()
    assert_allclose(speeds, np.array([1.5, 1.5, 1.6]) / 3.6, rtol=1e-9)


@pytest.mark.parametrize("folder", ["walk"], indirect=True)
def test_the_summary_is_an_aggregate_of_the_table(folder: Path) -> None:
    run = load_run(folder)
    table, summary = run.strides, summarise_run(run)
    for side in Side:
        rows, leg = table[(table["side"] == side) & table["settled"]], summary["sides"][side]
        assert leg["strides_counted"] == len(rows) and leg["strides"] == (table["side"] == side).sum()
        means = {"stride_time_mean_s": "stride_time_s", "double_support_share": "double_support_share"}
        for name, column in means.items():
            assert leg[name] == pytest.approx(rows[column].mean(), rel=1e-12)
        for name in ("step_length_m", "load_peak", "braking_impulse_Ns", "slip_m", "landing_speed_m_per_s"):
            assert leg["walk"][name] == pytest.approx(rows[name].mean(), rel=1e-12)
        knee = leg["joints"]["knee"]
        for name in ("range_of_motion_deg", "power_peak_W", "positive_work_J_per_kg", "jerk_dimensionless"):
            assert knee[name] == pytest.approx(rows[f"knee_{name}"].mean(), rel=1e-12)
        total = rows["hip_error_total_deg"]
        assert leg["rmse_hip_by_contact_deg"] == pytest.approx(math.sqrt((total**2).mean()), rel=1e-12)
        found = summary["stride_statistics"]["1"][side]["knee_error_total_deg"]
        values = rows["knee_error_total_deg"].to_numpy()
        expected = (values.mean(), values.std(ddof=1), len(values), np.median(values))
        assert [found[name] for name in STATISTICS] == pytest.approx(expected)


def test_every_column_has_a_meaning_a_unit_and_a_name(folder: Path) -> None:
    known = {name for group in column_meanings().values() for name in group}
    for column in pd.read_csv(folder / "strides.csv", nrows=0):
        ending = column.removeprefix(column.partition("_")[0] + "_")
        assert column in known or ending in known or column.endswith("_onset_percent"), column
        if column not in IDENTITY:
            assert label_of(column).unit != "1" or column.endswith(
                ("share", "peak", "trough", "dimensionless")
            ), column


def test_statistics_count_values_that_are_defined() -> None:
    table = synthetic_run().strides
    table.loc[table["stride"] == 3, "trough"] = math.nan
    found = stride_statistics(table)
    assert found.loc[(1, "left", "stride_time_s")].tolist() == pytest.approx([1.2, 0.0, 3.0, 1.2], abs=1e-12)
    assert found.loc[(1, "left", "trough"), "n"] <= 2


def test_a_run_without_strides_has_an_empty_table_with_all_columns() -> None:
    run = simulate(load_experiment("treadmill_guided", ["duration_s=0.1"]).experiment)
    assert len(run.strides) == 0 and {"knee_error_total_deg", "slip_m"} <= set(run.strides.columns)
    assert summarise_run(run)["stride_statistics"] == {}
