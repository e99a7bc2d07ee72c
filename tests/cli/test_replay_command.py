"""``twin-gait replay`` as a user meets it: runs, files, folders, one line."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from errors import states
from table_builder import FIVE_PHASES

from twin_gait.cli import main

PHASES = ["early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension"]


def run(*arguments: object) -> int:
    try:
        return main([str(item) for item in arguments])
    except SystemExit as leave:  # argparse leaves on its own for usage errors
        return int(leave.code or 0)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "walk"
    assert run("simulate", "treadmill_guided", "--duration", 4, "--out", out, "--no-pictures") == 0
    return out


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "bench"
    assert run("simulate", "bench_leg", "--duration", 4, "--out", out, "--no-pictures") == 0
    return out


def test_a_run_replays_to_its_own_switches(walk, tmp_path, capsys):
    out = tmp_path / "again"
    assert run("replay", walk, "--out", out) == 0
    printed = capsys.readouterr().out
    assert printed.count("recorded phases: 100.0 % of the ticks equal") == 2
    switches, original = pd.read_csv(out / "transitions.csv"), pd.read_csv(walk / "transitions.csv")
    columns = ["tick", "time_s", "side", "from", "to", "cause", "hip_angle_rad", "knee_angle_rad"]
    assert list(switches.columns) == list(original.columns)
    pd.testing.assert_frame_equal(switches[columns], original[columns], check_exact=True)
    phases, log = pd.read_csv(out / "phases.csv"), pd.read_parquet(walk / "log.parquet")
    assert len(phases) == len(log)
    for side in ("left", "right"):
        assert phases[f"{side}_phase"].tolist() == log[f"{side}_phase"].tolist()
    assert (out / "figures" / "replay.png").read_bytes().startswith(b"\x89PNG")


def test_the_summary_counts_strides_and_switches(walk, tmp_path):
    out = tmp_path / "again"
    assert run("replay", walk, "--out", out, "--no-pictures") == 0
    written = {path.name for path in out.iterdir()}
    assert written == {"log.parquet", "phases.csv", "strides.csv", "summary.json", "transitions.csv"}
    summary = json.loads((out / "summary.json").read_text())
    switches = pd.read_csv(out / "transitions.csv")
    assert summary["cycles"] == [PHASES]
    for side, values in summary["sides"].items():
        counted = switches[switches["side"] == side].groupby(["from", "to", "cause"]).size()
        for item in values["switches"]:
            assert counted[item["from"], item["to"], item["cause"]] == item["count"]
        assert sum(item["count"] for item in values["switches"]) == counted.sum()
        assert values["strides"] == values["strides_with_the_whole_cycle"]
        assert values["equal_share"] == 1.0


@pytest.mark.parametrize("file_format", ["csv", "mot", "sto"])
def test_a_run_replays_to_its_own_switches_through_an_exported_file(walk, tmp_path, capsys, file_format):
    path = tmp_path / f"log.{file_format}"
    assert run("export", walk, "--format", file_format, "--out", path) == 0
    # The run scales its table to its belt; an ideal sensor measures the true angle, which motions hold.
    # A motion in degrees is off by a rounding, which no switch notices.
    options = ["--speed", 1.5]
    to = ["--out", tmp_path / "again", "--no-pictures"]
    if file_format != "csv":
        options += ["--convention", "opensim_gait2392"]
    assert run("replay", path, "--table", "treadmill_guided", *options, *to) == 0
    found, original = (pd.read_csv(folder / "transitions.csv") for folder in (tmp_path / "again", walk))
    columns = ["tick", "side", "from", "to", "cause"]
    # A motion does not say in which phase the legs were; after a stride they are in those of the run.
    found, original = (switches[switches["tick"] > 2000][columns] for switches in (found, original))
    assert len(original) > 8
    np.testing.assert_array_equal(found, original)


def test_one_leg_goes_through_the_table_of_the_bench_and_not_through_one_for_two(bench, capsys):
    assert run("replay", bench) == 0
    assert "right: 1 stride of" in capsys.readouterr().out
    assert run("replay", bench, "--table", "treadmill_guided") == 2
    error = capsys.readouterr().err
    assert states(error, "other.phase", "early_stance → middle_stance (other_swings)", "both legs")


def test_a_run_at_another_speed_keeps_its_own_table(walk, capsys):
    assert run("replay", walk, "--speed", 0.8) == 0
    printed = capsys.readouterr().out
    assert "through the table treadmill_guided" in printed
    assert printed.count("100.0 % of the ticks equal") == 0


def test_missing_trunk_pitch_is_upright_for_a_run_and_warned_of_for_a_file(walk, tmp_path, capsys):
    """An added guard on it changes nothing for a run; a file must have the column."""
    table = tmp_path / "upright.yaml"
    tilted = "{from: early_stance, to: late_stance, cause: fallen, all: ['trunk.pitch_deg > 20']}"
    table.write_text(f"schema_version: 2\nextends: treadmill_guided\ntransitions:\n  - {tilted}\n")
    assert run("replay", walk, "--table", table) == 0
    assert capsys.readouterr().out.count("recorded phases: 100.0 % of the ticks equal") == 2
    assert run("replay", walk / "log.parquet", "--table", table, "--total-mass", 90) == 2
    warning = capsys.readouterr().err
    assert states(warning, "trunk.pitch_deg", "--columns") and warning.count("\n") == 1


def test_healthy_walking_goes_through_the_table(capsys):
    assert run("replay", "koopman@1.5", "--table", FIVE_PHASES) == 0
    printed = capsys.readouterr().out
    assert printed.count("7 strides of 1.75 s, 7 with a whole cycle of the table") == 2
    assert "timeout" not in printed


def test_an_own_table_is_read_from_its_file(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    impedance = (
        "{stiffness_Nm_per_deg: 1, damping_ratio: 1, equilibrium_deg: 0, friction_compensation_gain: 0}"
    )
    phases = "\n".join(f"  {name}: {{hip: {impedance}}}" for name in ("behind", "before"))
    transitions = "\n".join(
        f"  - {{from: {source}, to: {target}, cause: {cause}, all: ['{guard}']}}"
        for source, target, cause, guard in (
            ("behind", "before", "forward", "hip.angle_deg > 10"),
            ("before", "behind", "back", "hip.angle_deg < 5"),
        )
    )
    path.write_text(f"schema_version: 2\njoints: [hip]\nphases:\n{phases}\ntransitions:\n{transitions}\n")
    assert run("replay", "koopman@4", "--table", path) == 0
    assert "× behind → before (forward)" in capsys.readouterr().out


def test_a_folder_is_replaced_with_force_only_and_only_if_it_is_a_replay(tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_text("time_s,left_hip_angle_deg,left_knee_angle_deg\n0,10,5\n0.1,-20,5\n")
    command = ["replay", log, "--table", "bench_leg", "--no-pictures", "--out"]
    out = tmp_path / "out"
    assert run(*command, out) == 0
    assert run(*command, out) == 2
    assert states(capsys.readouterr().err, out, "--out", "--force")
    (out / "note.txt").write_text("old")
    assert run(*command, out, "--force") == 0
    assert not (out / "note.txt").exists() and (out / "phases.csv").is_file()
    other_folder = tmp_path / "mine"
    other_folder.mkdir()
    (other_folder / "thesis.tex").write_text("irreplaceable")
    assert run(*command, other_folder, "--force") == 2
    assert (other_folder / "thesis.tex").read_text() == "irreplaceable"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "mine", "out"]


def test_a_run_directory_is_never_replaced_by_a_replay_of_it(walk, capsys):
    before = sorted(path.name for path in walk.iterdir())
    assert run("replay", walk, "--out", walk) == 2
    assert sorted(path.name for path in walk.iterdir()) == before


BAD = {
    "no log": ["nowhere.csv"],
    "not a run": ["."],
    "no table": ["koopman@1.5", "--table", "moonwalk"],
    "convention": ["koopman@1.5", "--convention", "isb"],
    "columns without a name": ["koopman@1.5", "--columns", "time"],
    "columns twice": ["koopman@1.5", "--columns", "time=a,time=b"],
    "no such quantity": ["koopman@1.5", "--columns", "elbow=b"],
    "columns of a walk without any": ["koopman@1.5", "--columns", "time=b"],
    "speed": ["koopman@1.5", "--speed", "0"],
    "mass": ["koopman@1.5", "--total-mass", "-70"],
    "units": ["koopman@1.5", "--units", "grad"],
    "out of range": ["koopman@50"],
}


@pytest.mark.parametrize("arguments", BAD.values(), ids=BAD)
def test_bad_input_is_one_line_with_status_2_and_no_folder(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("replay", *arguments, "--out", "out") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1 and printed.err.startswith("twin-gait: ")
    assert list(tmp_path.iterdir()) == []
