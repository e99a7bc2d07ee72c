"""Table of strides of a recorded walk, and its comparison with another one."""

from __future__ import annotations

import json

import numpy as np
import pytest
from errors import states

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.measures.reference import reference_cycle_time
from twin_gait.runs.stride_table import read_strides

KOOPMAN = "koopman@1.5"


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    run = simulate(load_experiment("treadmill_guided", ["duration_s=12"]).experiment)
    folder = tmp_path_factory.mktemp("run") / "walk"
    run.save(folder)
    return folder


def replayed(log, folder, *options):
    """Return the table of strides of a replay."""
    assert main(["replay", str(log), "--out", str(folder), "--no-pictures", *options]) == 0
    return read_strides(folder)


def test_healthy_walking_has_its_stride_time_and_no_error(tmp_path):
    table = replayed(KOOPMAN, tmp_path / "healthy", "--reference", KOOPMAN)
    assert table["stride_time_s"].to_numpy() == pytest.approx(reference_cycle_time(1.5 / 3.6, 1.75), abs=1e-3)
    assert len(table) > 10 and table["settled"].all() and set(table["side"]) == {"left", "right"}
    # Heel strikes are found from the angles, within 0.3 % of the stride.
    assert table[["hip_error_total_deg", "knee_error_total_deg"]].to_numpy().max() < 0.6
    assert 40.0 < table["knee_range_of_motion_deg"].min() < 55.0  # 47° by Koopman at this speed


def test_strides_of_a_run_are_those_of_its_own_table(run_folder, tmp_path):
    found = replayed(run_folder, tmp_path / "again", "--reference", KOOPMAN)
    known = read_strides(run_folder)
    columns = [name for name in found if name.endswith(("_onset_percent", "_deg")) or "stride_time" in name]
    assert len(columns) > 20
    for side in ("left", "right"):
        ours = found[found["side"] == side].set_index(found["start_s"].round(3)[found["side"] == side])
        theirs = known[known["side"] == side].set_index(known["start_s"].round(3)[known["side"] == side])
        both = ours.index.intersection(theirs.index)
        assert len(both) >= 4
        for name in columns:
            difference = (ours.loc[both, name] - theirs.loc[both, name]).abs().max()
            assert difference < 1e-6, (side, name, difference)


def test_two_recorded_walks_are_compared(run_folder, tmp_path, capsys):
    replayed(KOOPMAN, tmp_path / "healthy", "--reference", KOOPMAN)
    replayed(run_folder, tmp_path / "again", "--reference", KOOPMAN)
    out = tmp_path / "difference"
    folders = [str(tmp_path / name) for name in ("healthy", "again")]
    assert main(["compare", *folders, "--out", str(out)]) == 0
    assert "knee error" in capsys.readouterr().out
    assert (out / "compare-85mm.pdf").read_bytes().startswith(b"%PDF")
    assert (out / "curves.csv").read_text().count("\n") > 100


def test_a_walk_whose_heel_strikes_are_unknown_has_no_table_but_a_warning(tmp_path, capsys):
    log = tmp_path / "knee.csv"
    time = np.arange(0.0, 6.0, 0.01)
    rows = [f"{t:.2f},{30 + 25 * np.sin(6.28 * t / 1.5):.4f}" for t in time]
    log.write_text("\n".join(["time_s,left_knee_angle_deg", *rows]))
    table = tmp_path / "table.yaml"
    spring = (
        "{stiffness_Nm_per_deg: 1, damping_Nms_per_deg: 0.1, friction_compensation_gain: 0, equilibrium_deg"
    )
    table.write_text(
        "schema_version: 2\nname: knee\ndescription: knee only\njoints: [knee]\nphases:\n"
        f"  stance: {{knee: {spring}: 0}}}}\n  swing: {{knee: {spring}: 40}}}}\n"
        "transitions:\n  - {from: stance, to: swing, all: ['knee.angle_deg > 40'], cause: bent}\n"
        "  - {from: swing, to: stance, all: ['knee.angle_deg < 20'], cause: straight}\n"
    )
    command = ["replay", str(log), "--table", str(table), "--out", str(tmp_path / "out"), "--no-pictures"]
    assert main([*command, "--json"]) == 0
    (warning,) = [text for text in json.loads(capsys.readouterr().out)["warnings"] if "strides" in text]
    assert states(warning, "hip", "knee") and not (tmp_path / "out" / "strides.csv").exists()


@pytest.mark.parametrize(
    ("options", "facts"),
    [
        (["--reference", KOOPMAN], ("--reference", "--out")),
        (["--reference", "koopman@9", "--out", "x"], ("speed",)),
        (["--reference", "missing.parquet", "--out", "x"], ("missing.parquet", "reference")),
    ],
)
def test_a_wrong_reference_is_rejected_in_one_line(options, facts, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", KOOPMAN, *options]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and states(message, *facts)
    assert not (tmp_path / "x").exists()
