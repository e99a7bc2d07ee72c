"""Tests of the settings of a patient, and of the report of a session: numbers, comparison, printed page."""

import json
import re
import shutil
import subprocess
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from errors import raises, states

from twin_gait import load_experiment, simulate
from twin_gait.cli.program import main
from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.live.controls import ControlPanel
from twin_gait.live.session_records import SessionError, SessionRecorder, read_session
from twin_gait.live.session_report import session_report
from twin_gait.live.session_strides import conditions_of, strides_by_condition
from twin_gait.live.settings_file import settings_document
from twin_gait.measures.reference import reference_curve

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PERSON = ["patient=stroke_left", "patient.name=P03"]
FIRST = "{time_s: 10, set: {scenario.belt_speed_km_per_h: 1.8}, by: Ann}"
SECOND = "{time_s: 20, set: {table.phases.late_stance.hip.stiffness_Nm_per_deg: 2.1}, by: Ann}"


def record_session(records, run, document, folder, changes, **more):
    """Record a session of one walk; ``changes``: tick, control, value before and after."""
    recorder = SessionRecorder(
        records, user="Ann", experiment="treadmill_guided", document=document, folder=folder
    )
    for serial, (tick, control, before, value) in enumerate(changes, start=1):
        event = {"serial": serial, "tick": tick, "response": "applied", "user": "Ann", "subject": control}
        recorder.event(SimpleNamespace(**event, before=before, value=value, text="", **more))
    run.save(folder)
    recorder.close("ended", len(run.log), {}, [folder])


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Return the record of two sessions of one patient, and their runs."""
    folder = tmp_path_factory.mktemp("sessions")
    runs, changes = [], [(10_000, "belt_speed", 1.5, 1.8), (20_000, "late_stance.hip.stiffness", 1.49, 2.1)]
    for number, events in enumerate(([FIRST, SECOND], [FIRST]), start=1):
        settings = [*PERSON, f"duration_s={10 * len(events) + 10}"]
        document = load_experiment("treadmill_guided", settings).document
        loaded = load_experiment("treadmill_guided", [*settings, f"events=[{','.join(events)}]"])
        run = simulate(loaded.experiment)
        runs.append(run)
        record_session(folder / "record", run, document, folder / f"run{number}", changes[: len(events)])
    return folder, runs


# ---------------------------------------------------------------------- strides by condition


def heel_strikes(run, side):
    """Find heel strikes in the force: 20 N after 0.25 s below 10 N (no foot bounces here)."""
    force, found, off = run.log[f"{side}_foot_normal_force_N"].to_numpy(), [], 0
    for tick, value in enumerate(force.tolist()):
        if value > 20.0 and off >= 250:
            found.append(tick)
        off = off + 1 if value < 10.0 else 0 if value > 20.0 else off
    return np.array(found)


@pytest.mark.parametrize("side", ["left", "right"])
def test_strides_are_those_of_the_log_and_belong_to_the_condition_in_which_they_begin(sessions, side):
    _, (run, _) = sessions
    table = strides_by_condition(run)
    rows = table[table["side"] == side].reset_index(drop=True)
    strikes = heel_strikes(run, side)
    np.testing.assert_allclose(rows["start_s"], strikes[:-1] * 1e-3, atol=1e-9)
    np.testing.assert_allclose(rows["stride_time_s"], np.diff(strikes) * 1e-3, atol=1e-9)
    conditions = np.searchsorted([10_000, 20_000], strikes[:-1], side="right")
    assert rows["condition"].tolist() == conditions.tolist()
    ends = np.array([10_000, 20_000, 30_000])[conditions]
    numbers = [int((conditions[:index] == one).sum()) for index, one in enumerate(conditions)]
    settled = (np.array(numbers) >= 2) & (strikes[1:] <= ends)
    assert rows["settled"].tolist() == settled.tolist() and 0 < settled.sum() < len(settled)


def test_errors_refer_to_the_belt_speed_of_the_condition_and_work_is_that_of_the_columns(sessions):
    _, (run, _) = sessions
    table = strides_by_condition(run)
    for number, speed in ((0, 1.5), (1, 1.8)):
        chosen = table["settled"] & (table["condition"] == number) & (table["side"] == "left")
        row = table[chosen].iloc[-1]
        start = round(1e3 * row["start_s"])
        ticks = np.arange(start, start + round(1e3 * row["stride_time_s"]))
        percent = np.linspace(0.0, 99.0, 100)
        angles = np.interp(
            start + percent / 100.0 * len(ticks), np.arange(len(run.log)), run.log["left_hip_angle_rad"]
        )
        healthy = reference_curve("hip", percent, speed=speed / 3.6, height=1.75)
        error = np.degrees(np.sqrt(np.mean((angles - healthy) ** 2)))
        assert row["hip_error_total_deg"] == pytest.approx(error, rel=1e-9)
        log, wearer, device = run.log.iloc[ticks], 0.0, 0.0
        for joint in ("hip", "knee"):
            velocity = log[f"left_{joint}_velocity_rad_per_s"]
            effort = (log[f"left_{joint}_voluntary_torque_Nm"] * velocity).clip(lower=0.0)
            inertia = run.experiment.plant.actuators[joint].armature
            acceleration = np.gradient(run.log[f"left_{joint}_velocity_rad_per_s"].to_numpy(), 1e-3)[ticks]
            torque = log[f"left_{joint}_motor_torque_Nm"] + log[f"left_{joint}_friction_torque_Nm"]
            wearer += effort.sum()
            device += ((torque - inertia * acceleration) * velocity).clip(lower=0.0).sum()
        assert row["wearer_work_share"] == pytest.approx(wearer / (wearer + device), rel=1e-9)


def test_a_change_at_the_start_of_a_walk_belongs_to_the_first_condition():
    events = "events=[{time_s: 0, set: {scenario.belt_speed_km_per_h: 1.8}, fade_ms: 0}]"
    run = SimpleNamespace(
        experiment=load_experiment("treadmill_guided", [events]).experiment, columns=range(20_000), trip=None
    )
    (only,) = conditions_of(run)
    assert (only.start, only.end) == (0, 20_000)
    assert only.experiment.scenario.belt_speed == pytest.approx(0.5)


# ---------------------------------------------------------------------- the page


def cells(page):
    """Return the rows of the tables of a page as lists of texts."""
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.S)
    return [[re.sub("<[^>]*>", " ", cell).strip() for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.S)]
            for row in rows]  # fmt: skip


def test_the_report_shows_person_changes_and_strides_of_each_condition(sessions):
    folder, (run, _) = sessions
    page = session_report(folder / "record", 1)
    rows = cells(page)
    assert states(page, "P03, 70 kg, 1.75 m, male", "Ann", "twin", "30 s in 1 walk: walked")
    assert ["2", "10.0 s", "belt speed", "1.50 km/h", "1.80 km/h", "Ann"] in rows
    assert ["3", "20.0 s", "late stance hip: stiffness k", "1.49 N·m/°", "2.10 N·m/°", "Ann"] in rows
    table = strides_by_condition(run)
    counted = table[table["settled"] & (table["side"] == "left")].groupby("condition")["stride_time_s"]
    found = next(row for row in rows if row[0] == "stride time [s], left")[1:]
    for text, mean, deviation in zip(found, counted.mean(), counted.std(ddof=1), strict=True):
        shown, spread = map(float, text.split(" ± "))
        assert shown == pytest.approx(mean, abs=0.005) and spread == pytest.approx(deviation, abs=0.005)
    assert page.count("data:image/png;base64,") == 2
    assert "no earlier session" in page and "None." in page


def test_the_report_compares_with_the_last_session_of_the_patient(sessions):
    folder, runs = sessions
    page = session_report(folder / "record", 2)
    tables = [strides_by_condition(run) for run in runs]
    tables = [table[table["settled"] & (table["side"] == "right")] for table in tables]
    last, now = (one[one["condition"] == one["condition"].max()]["swing_share"].mean() for one in tables)
    row = next(row for row in cells(page) if row[0] == "swing [%], right")
    assert float(row[-2].split(" ± ")[0]) == pytest.approx(100.0 * last, abs=0.06)
    assert float(row[-1].replace("−", "-")) == pytest.approx(100.0 * (now - last), abs=0.06)
    assert "other settings" in page and states(page, "belt speed", "late stance hip stiffness")


def test_the_report_loads_nothing_and_says_where_the_values_stay(sessions):
    page = session_report(sessions[0] / "record", 1)
    assert "default-src 'none'" in page and not re.search(r"https?://", page)
    assert "not measured on a person" in page and "pseudonym" in page


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_the_report_is_one_printed_page_also_with_many_changes(sessions, tmp_path):
    times = range(6, 66, 4)
    changes = [
        f"{{time_s: {time}, set: {{scenario.belt_speed_km_per_h: {1.5 + 0.01 * time}}}}}" for time in times
    ]
    settings = [*PERSON, "patient.mass_kg=120", "patient.age_years=30", "duration_s=70"]
    run = simulate(
        load_experiment("treadmill_guided", [*settings, f"events=[{','.join(changes)}]"]).experiment
    )
    document = load_experiment("treadmill_guided", settings).document
    rows = [(1000 * time, "belt_speed", 1.5, 1.5 + 0.01 * time) for time in times]
    shutil.copytree(sessions[0] / "record", tmp_path / "record")
    record_session(tmp_path / "record", run, document, tmp_path / "run", rows)
    for number in (2, 3):
        page = session_report(tmp_path / "record", number)
        (tmp_path / "page.html").write_text(page)
        command = [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            f"--print-to-pdf={tmp_path}/page.pdf",
        ]
        subprocess.run([*command, str(tmp_path / "page.html")], check=True, capture_output=True, timeout=120)
        assert len(re.findall(rb"/Type\s*/Page[^s]", (tmp_path / "page.pdf").read_bytes())) == 1
    assert "5 further changes" in page and states(page, "47", "68", "30") and states(page, "120", "110")


def test_a_walk_without_ground_and_without_a_name_has_a_report(tmp_path):
    loaded = load_experiment("bench_leg", ["duration_s=12", "patient=null"])
    record_session(tmp_path / "record", simulate(loaded.experiment), loaded.document, tmp_path / "run", [])
    page = session_report(tmp_path / "record", 1)
    assert "No parameter was changed." in page and "without a name" in page
    assert any(row[0] == "stride time [s], right" for row in cells(page))


def test_a_walk_without_a_stride_has_a_report(tmp_path):
    loaded = load_experiment("treadmill_guided", [*PERSON, "duration_s=1"])
    record_session(tmp_path / "record", simulate(loaded.experiment), loaded.document, tmp_path / "run", [])
    page = session_report(tmp_path / "record", 1)
    assert states(page, "P03", "1 s in 1 walk: too short to judge") and "data:image" not in page


def test_a_stop_and_a_push_are_listed(tmp_path):
    events = (
        "[{time_s: 2, push: {joint: left_knee, torque_Nm: 12, duration_ms: 100}}, {time_s: 5, stop: true}]"
    )
    loaded = load_experiment("treadmill_guided", [*PERSON, "duration_s=6"])
    run = simulate(
        load_experiment("treadmill_guided", [*PERSON, "duration_s=6", f"events={events}"]).experiment
    )
    record_session(tmp_path / "record", run, loaded.document, tmp_path / "run", [])
    page = session_report(tmp_path / "record", 1)
    assert states(page, "2.0 s: push of 12 N·m on left knee", "5.0 s: emergency stop")


def test_a_session_with_a_restart_has_conditions_of_both_walks(sessions, tmp_path):
    folder, document = sessions[0], load_experiment("treadmill_guided", PERSON).document
    recorder = SessionRecorder(
        tmp_path / "record", user="", experiment="treadmill_guided", document=document, folder=folder / "run1"
    )
    steps = [(10_000, "belt_speed", 1.5, 1.8), (0, "restart", None, None), (12_000, "belt_speed", 1.8, 1.6)]
    for serial, (tick, subject, before, value) in enumerate(steps, start=1):
        about = {"serial": serial, "tick": tick, "response": "applied", "user": "", "text": ""}
        recorder.event(SimpleNamespace(**about, subject=subject, before=before, value=value))
    carried = "{time_s: 0, set: {scenario.belt_speed_km_per_h: 1.8}, fade_ms: 0}"
    slower = "{time_s: 12, set: {scenario.belt_speed_km_per_h: 1.6}}"
    second = simulate(
        load_experiment(
            "treadmill_guided", [*PERSON, "duration_s=24", f"events=[{carried},{slower}]"]
        ).experiment
    )
    second.save(tmp_path / "run2")
    recorder.close("ended", 24_000, {}, [folder / "run1", tmp_path / "run2"])
    rows = cells(session_report(tmp_path / "record", 1))
    assert ["5", "walk 2, 12.0 s", "belt speed", "1.80 km/h", "1.60 km/h", ""] in rows
    heads = next(row for row in rows if row[1:] and row[1].startswith("condition 1"))
    assert [re.sub(r"\s+", " ", head) for head in heads[1:]] == [
        "condition 1 walk 1, 0.0–10.0 s",
        "condition 2 walk 1, 10.0–20.0 s",
        "condition 3 walk 1, 20.0–30.0 s",
        "condition 4 walk 2, 0.0–12.0 s",
        "condition 5 walk 2, 12.0–24.0 s",
    ]
    count = next(row for row in rows if row[0].startswith("strides"))
    assert all(int(number) >= 2 for cell in count[1:] for number in cell.split(" and "))


# ---------------------------------------------------------------------- the command


def test_the_command_writes_the_newest_report_for_its_user_alone(sessions, tmp_path, capsys, monkeypatch):
    record = sessions[0] / "record"
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "report.html"
    assert main(["sessions", "--records", str(record), "report", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n" and out.stat().st_mode & 0o077 == 0
    assert "session 2" in out.read_text()
    command = ["sessions", "--records", str(record), "report"]
    assert main([*command, "1", "--out", str(out)]) == 2
    assert states(capsys.readouterr().err, out, "--force")
    assert main([*command, "1", "--out", str(out), "--force"]) == 0 and "session 1" in out.read_text()
    assert main([*command, "9", "--out", str(tmp_path / "other.html")]) == 2
    assert states(capsys.readouterr().err, "9", "twin-gait sessions list")
    assert main(["sessions", "--records", str(record), "list", "--name", "P03"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert main(["sessions", "--records", str(record), "list", "--name", "P04"]) == 0
    assert capsys.readouterr().out == "no sessions\n"


def test_a_session_without_its_run_directories_has_no_report(sessions, tmp_path):
    shutil.copytree(sessions[0] / "record", tmp_path / "record")
    path = tmp_path / "record" / "1.jsonl"
    path.write_text(path.read_text().replace(str(sessions[0] / "run1"), str(tmp_path / "gone")))
    with raises(SessionError, "1", tmp_path / "gone"):
        session_report(tmp_path / "record", 1)
    assert "no earlier session" in session_report(tmp_path / "record", 2)


# ---------------------------------------------------------------------- the settings of a patient


def test_the_settings_of_a_patient_start_the_next_session_as_they_are(tmp_path):
    loaded = load_experiment(
        "treadmill_guided", ["patient=stroke_left", "patient.mass_kg=62", "duration_s=3600"]
    )
    panel = ControlPanel(loaded.experiment)
    changes = {"belt_speed": 1.8, "late_stance.hip.stiffness": 2.1, "late_stance.hip.damping": 9.0}
    settings = panel.set_all(panel.preset, {**changes, "mode": "torque_control"})
    now = datetime(2026, 11, 12, 9, 30)
    path = tmp_path / "P03.yaml"
    path.write_text(dump_yaml(settings_document(loaded.document, panel.preset, settings, "P03", now)))
    opened = load_experiment(path).experiment
    assert (opened.name, opened.patient.name, opened.table.name) == ("P03", "P03", "P03_2026-11-12")
    assert opened.scenario == settings.experiment.scenario and opened.control == settings.experiment.control
    assert opened.table.phases == settings.table.phases
    assert opened.patient.mass == 62.0 and opened.patient.conditions == loaded.experiment.patient.conditions
    assert opened.duration == 20.0 and "2026-11-12" in path.read_text().splitlines()[2]
    with raises(ParameterFileError, path, "scenario", "experiment"):
        load_experiment("treadmill_guided", [f"patient={path}"])


@pytest.mark.parametrize("name", ["", "../P03", ".P03", "P\n03", "x" * 81])
def test_a_name_that_is_no_file_name_is_rejected(name):
    loaded = load_experiment("treadmill_guided")
    panel = ControlPanel(loaded.experiment)
    with raises(ParameterError, "patient", "1", "80"):
        settings_document(loaded.document, panel.preset, panel.preset, name, datetime(2026, 11, 12))


def test_the_record_has_the_name_under_which_the_settings_were_saved(tmp_path):
    document = load_experiment("treadmill_guided", PERSON).document
    recorder = SessionRecorder(
        tmp_path, user="", experiment="treadmill_guided", document=document, folder=Path("run")
    )
    assert read_session(tmp_path, 1)["patient"] == "P03"
    recorder.patient("P04")
    recorder.close("ended", 0, {}, [])
    assert read_session(tmp_path, 1)["patient"] == "P04"
    assert json.loads((tmp_path / "1.jsonl").read_text().splitlines()[1]) == {"patient": "P04"}
