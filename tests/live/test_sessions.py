"""Tests of the record of live sessions: stored entries, and entries that survive a kill."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from errors import raises

from twin_gait.cli import sessions as command
from twin_gait.cli.program import OneLineParser
from twin_gait.configuration.experiments import load_experiment
from twin_gait.exceptions import TwinGaitError
from twin_gait.live import session_records as sessions
from twin_gait.live.session import LiveSession
from twin_gait.live.session_records import (
    KILLED,
    RUNNING,
    SessionError,
    SessionRecorder,
    default_records,
    delete_session,
    list_sessions,
    read_session,
)

KILLS = 20
FAKE = Path(__file__).parents[1] / "session_process.py"


def change(serial, *, response="applied", user="Ann", value=1.3):
    return SimpleNamespace(
        serial=serial,
        tick=10 * serial,
        response=response,
        user=user,
        subject="late_stance.hip.stiffness",
        before=1.17,
        value=value,
        text=f"late_stance.hip.stiffness: 1.17 → {value}",
    )


@pytest.fixture
def record(tmp_path):
    """Return a record with one finished and one running session."""
    path = tmp_path / "deep" / "sessions"
    first = SessionRecorder(
        path, user="Ann", experiment="treadmill_guided", document={"duration_s": 600}, folder=Path("run")
    )
    first.table({"name": "treadmill_guided", "k": 1}, 0)
    first.event(change(1))
    first.table({"name": "treadmill_guided", "k": 2}, 10)
    first.event(change(2, response="refused", value="a lot"))
    first.close("ended", 1234, {"fell": False}, ["/runs/one"])
    second = SessionRecorder(path, user="Ben", experiment="bench_leg", document={}, folder=Path("run"))
    yield path
    second.close("ended", 0, {}, [])


def test_all_run_folders_of_a_session_are_listed(tmp_path):
    recorder = SessionRecorder(
        tmp_path, user="Ann", experiment="treadmill_guided", document={}, folder=Path("run")
    )
    recorder.close("ended", 5, {}, ["/runs/one", "/runs/one-2", "/runs/one-3"])
    (entry,) = list_sessions(tmp_path)
    assert command.format_session(entry).endswith("  /runs/one, /runs/one-2, /runs/one-3")


@pytest.mark.parametrize("forged", ["Eve\n   9  2026-01-01 00:00 UTC  Ann", "\x1b[2J", "a\rb", "x" * 65])
def test_a_name_that_would_forge_lines_is_refused_and_one_of_a_record_is_shown_on_one_line(tmp_path, forged):
    loaded = load_experiment("bench_leg", ["duration_s=1"])
    with raises(TwinGaitError, "user", "0", "64") as error:
        LiveSession(loaded=loaded, folder=tmp_path / "run", user=forged)
    assert str(error.value).isprintable() and not list(tmp_path.iterdir())
    recorder = SessionRecorder(
        tmp_path, user=forged, experiment="treadmill_guided", document={}, folder=Path("r\n")
    )
    recorder.close("ended", 0, {}, ["r\n"])
    (entry,) = list_sessions(tmp_path)
    assert command.format_session(entry).isprintable() and command.format_session(entry).startswith("   1  ")


# ---------------------------------------------------------------------- keeping


def test_a_session_is_read_back_as_it_was_recorded(record):
    found = read_session(record, 1)
    assert (found["user"], found["experiment"], found["status"], found["tick"]) == (
        "Ann",
        "treadmill_guided",
        "ended",
        1234,
    )
    assert (found["document"], found["summary"], found["folders"]) == (
        {"duration_s": 600},
        {"fell": False},
        ["/runs/one"],
    )
    assert [(item["tick"], item["document"]["k"]) for item in found["tables"]] == [(0, 1), (10, 2)]
    assert [(item["serial"], item["tick"], item["response"]) for item in found["log"]] == [
        (1, 10, "applied"),
        (2, 20, "refused"),
    ]
    assert [(item["before"], item["value"]) for item in found["log"]] == [(1.17, 1.3), (1.17, "a lot")]
    assert found["began"] <= found["log"][0]["at"] <= found["ended"]


def test_sessions_are_listed_newest_first_and_per_user(record):
    assert [(item["id"], item["user"]) for item in list_sessions(record)] == [(2, "Ben"), (1, "Ann")]
    (ann,) = list_sessions(record, "Ann")
    assert [ann[name] for name in ("changes", "refusals", "versions")] == [1, 1, 2] and ann["ended"]


def test_a_session_without_an_end_is_running_or_killed_depending_on_its_process(tmp_path):
    with subprocess.Popen([sys.executable, str(FAKE), str(tmp_path)], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        assert [item["status"] for item in list_sessions(tmp_path)] == [RUNNING]
        process.kill()
    assert [item["status"] for item in list_sessions(tmp_path)] == [KILLED]


def test_a_session_is_deleted_with_all_that_belongs_to_it_but_not_while_it_is_going_on(record):
    with raises(SessionError, "2"):
        delete_session(record, 2)
    delete_session(record, 1)
    assert [item["id"] for item in list_sessions(record)] == [2]
    assert [path.name for path in record.iterdir()] == ["2.jsonl"]
    with raises(SessionError, "1", "twin-gait sessions list"):
        delete_session(record, 1)


def test_recording_never_waits_for_a_disk_that_hangs(tmp_path, monkeypatch):
    path, released, sync = tmp_path / "sessions", threading.Event(), os.fsync
    recorder = SessionRecorder(path, user="", experiment="treadmill_guided", document={}, folder=Path("run"))
    monkeypatch.setattr(os, "fsync", lambda descriptor: (released.wait(), sync(descriptor)))
    recorder.event(change(1))
    time.sleep(0.5)  # its thread waits for the disk now
    began = time.monotonic()
    for serial in range(2, 1001):
        recorder.event(change(serial))
    taken = time.monotonic() - began
    released.set()
    recorder.close("ended", 0, {}, [])
    assert taken < 0.5  # 0.5 ms each, beside seven others on this machine; the disk hung throughout
    assert len(read_session(path, 1)["log"]) == 1000


def test_two_sessions_at_once_keep_apart(tmp_path):
    path = tmp_path / "sessions"

    def one(user):
        recorder = SessionRecorder(
            path, user=user, experiment="treadmill_guided", document={}, folder=Path("run")
        )
        for serial in range(1, 51):
            recorder.event(change(serial, user=user))
            time.sleep(0.002)
        recorder.close("ended", 0, {}, [])

    threads = [threading.Thread(target=one, args=(user,)) for user in ("Ann", "Ben")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for entry in list_sessions(path):
        log = read_session(path, entry["id"])["log"]
        assert [item["serial"] for item in log] == list(range(1, 51))
        assert {item["user"] for item in log} == {entry["user"]}


# ---------------------------------------------------------------------- kills


def killed_after(database, delay):
    """Run the fake session, kill it, and return its number, the time of the kill and its changes."""
    with subprocess.Popen(
        [sys.executable, str(FAKE), str(database)], stdout=subprocess.PIPE, text=True
    ) as process:
        number = int(process.stdout.readline().split()[1])
        threading.Timer(delay, process.send_signal, (signal.SIGKILL,)).start()
        lines = process.stdout.readlines()
    printed = [line.split() for line in lines if line.endswith("\n")]
    changes = {int(serial): float(at) for _, serial, at in printed}
    return number, max(changes.values(), default=time.monotonic()), changes


@pytest.mark.slow
def test_killed_at_a_random_moment_twenty_times_the_record_opens_is_whole_and_lacks_a_second_at_most(
    tmp_path,
):
    path = tmp_path / "sessions"
    for delay in np.random.default_rng(7).uniform(0.0, 0.7, KILLS):
        number, last, changes = killed_after(path, float(delay))
        kept = [item["serial"] for item in read_session(path, number)["log"]]
        assert kept == list(range(1, len(kept) + 1))
        missing = [at for serial, at in changes.items() if serial not in kept]
        assert all(last - at <= 1.0 for at in missing)
    assert len(list_sessions(path)) == KILLS
    assert all(item["ended"] is None for item in list_sessions(path))


def test_entries_older_than_a_second_survive_a_kill_of_the_process(tmp_path):
    path = tmp_path / "sessions"
    number, last, changes = killed_after(path, 1.8)
    kept = {item["serial"] for item in read_session(path, number)["log"]}
    old = {serial for serial, at in changes.items() if last - at > 1.0}
    assert len(old) > 20 and old <= kept


# ---------------------------------------------------------------------- mistakes


def test_an_invalid_record_is_refused_in_one_line(tmp_path):
    (tmp_path / "text.sqlite").write_text("the record of an earlier version")
    for name, line in (("noise", "no session\n"), ("other", '{"a": 1}\n')):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.jsonl").write_text(line)
    for name in ("missing", "text.sqlite", "noise", "other"):
        with raises(SessionError, tmp_path / name) as caught:
            list_sessions(tmp_path / name)
        assert isinstance(caught.value, TwinGaitError) and "\n" not in str(caught.value)
        assert str(tmp_path / name) in str(caught.value)
    with raises(SessionError, "text.sqlite", "TWIN_GAIT_SESSIONS"):
        SessionRecorder(
            tmp_path / "text.sqlite" / "below", user="", experiment="", document={}, folder=Path("run")
        )
    assert not (tmp_path / "missing").exists()


def test_the_record_is_for_its_user_alone(tmp_path):
    recorder = SessionRecorder(
        tmp_path / "sessions", user="Ann", experiment="treadmill_guided", document={}, folder=Path("run")
    )
    recorder.event(change(1))
    recorder.close("ended", 0, {}, [])
    modes = [
        item.stat().st_mode & 0o777 for item in (tmp_path / "sessions", tmp_path / "sessions" / "1.jsonl")
    ]
    assert modes == [0o700, 0o600]


def test_the_record_is_at_the_path_of_the_variable(monkeypatch, tmp_path):
    monkeypatch.setenv(sessions.FOLDER_VARIABLE, str(tmp_path / "mine"))
    assert default_records() == tmp_path / "mine"
    monkeypatch.delenv(sessions.FOLDER_VARIABLE)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_records() == tmp_path / "twin_gait" / "sessions"


# ---------------------------------------------------------------------- the command


def call(*words):
    parser = OneLineParser(prog="twin-gait")
    command.add_parser(parser.add_subparsers(parser_class=OneLineParser))
    arguments = parser.parse_args(["sessions", *map(str, words)])
    return arguments.run(arguments)


def test_the_command_lists_shows_exports_and_deletes(record, capsys):
    assert call("--records", record, "list") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and "Ben" in lines[0] and "1 changes, 1 rejected, 2 table versions" in lines[1]
    assert call("--records", record, "show", 1) == 0
    shown = capsys.readouterr().out
    assert "tick      10  applied Ann  late_stance.hip.stiffness: 1.17 → 1.3" in shown
    assert "tick      20  rejected Ann  late_stance.hip.stiffness: " in shown
    assert call("--records", record, "export", 1) == 0
    assert json.loads(capsys.readouterr().out) == read_session(record, 1)
    assert call("--records", record, "delete", 1) == 0
    assert [item["id"] for item in list_sessions(record)] == [2]
