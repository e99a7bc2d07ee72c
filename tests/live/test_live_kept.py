"""Tests of the recovery of a live walk whose processes are killed, and of its memory use."""

import errno
import os
import resource
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from errors import raises, states
from test_live_loop import Rig, say, wait_for

from twin_gait.cli.program import main
from twin_gait.cli.sessions import format_session
from twin_gait.cli.simulate import _finish
from twin_gait.configuration.experiments import load_experiment
from twin_gait.exceptions import RunDirectoryError
from twin_gait.live import journal as finishing
from twin_gait.live.journal import (
    BATCH_TICKS,
    Journal,
    LogChunk,
    complete,
    lock_journal,
    read_journal,
    split_walks,
)
from twin_gait.live.session import LiveSession
from twin_gait.live.session_records import list_sessions, read_session
from twin_gait.runs.folders import journal_path
from twin_gait.runs.record import read_stored_run
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.worlds.faults import parse_fault

pytestmark = pytest.mark.slow

MOST_LOST = 1000  # ticks: a second
KILLS = 3


@pytest.fixture(scope="module")
def loaded():
    return load_experiment("bench_leg", ["duration_s=60"])


@pytest.fixture(scope="module")
def problem(loaded):
    return build_setup(loaded.experiment)


def written(loaded, problem, folder, *, ticks=1400, over=True):
    """Write a journal of a walk with a fault and a change, in chunks."""
    run, messages = SteppedRun(problem), []
    setup = {"document": loaded.document, "folder": str(folder), "force": False}
    journals = Journal(run.layout.names, setup, messages.append)
    run.inject(parse_fault("encoder_jump:right_knee@0s"))
    switches = 0
    while run.tick < ticks:
        new = {"time_s": round(1e-3 * run.tick, 3), "set": {}, "by": "Ann"}
        rows = run.advance(min(100, ticks - run.tick))
        journals.store(
            LogChunk(
                rows=rows, switches=run.switches(switches), events=(new,), status=run.status,
                reason=run.reason, trip=run.trip, wall_s=run.tick * 1e-3, is_last=over and run.tick == ticks,
            )
        )  # fmt: skip
        switches = len(run.switches())
    if not over:  # as a kill would leave it
        return run, journals
    journals.close()
    assert messages == []
    return run, journals


# ---------------------------------------------------------------------- the journal


@pytest.mark.slow
def test_a_journal_restores_the_walk_bit_for_bit(loaded, problem, tmp_path):
    run, journals = written(loaded, problem, tmp_path / "run")
    _, columns, pieces = read_journal(journals.path)
    (take,) = split_walks(pieces, 60_000)
    np.testing.assert_array_equal(take.rows, run.rows())
    assert columns == run.layout.names and run.trip is not None
    assert (take.switches, take.trip) == (run.switches(), run.trip)
    assert [round(1e3 * item["time_s"]) for item in take.events] == list(range(0, 1400, 100))
    assert journals.path.stat().st_mode & 0o077 == 0


@pytest.mark.slow
def test_a_journal_cut_anywhere_opens_up_to_its_last_complete_piece(loaded, problem, tmp_path):
    run, journals = written(loaded, problem, tmp_path / "run")
    whole, cut = journals.path.read_bytes(), tmp_path / "cut"
    lengths = set()
    for size in np.random.default_rng(3).integers(0, len(whole), 200).tolist():
        cut.write_bytes(whole[:size])
        try:
            _, _, pieces = read_journal(cut)
        except RunDirectoryError as error:
            assert states(str(error), cut) and "\n" not in str(error)
            assert size < len(whole) / 3
            continue
        for walk in split_walks(pieces, 60_000):
            np.testing.assert_array_equal(walk.rows, run.rows()[: len(walk.rows)])
            lengths.add(len(walk.rows))
    assert {BATCH_TICKS, 2 * BATCH_TICKS} <= lengths <= {BATCH_TICKS, 2 * BATCH_TICKS, 1400}


def test_a_journal_is_completed_once_and_not_while_it_is_written(loaded, problem, tmp_path):
    folder = tmp_path / "run"
    run, journals = written(loaded, problem, folder, over=False)
    with raises(RunDirectoryError, journals.path):
        complete(journals.path)
    with raises(RunDirectoryError, folder, "twin-gait sessions complete"):
        read_stored_run(folder)
    journals.store(LogChunk(rows=run.rows()[:0], is_last=True))
    journals.close()
    done = complete(journals.path)
    assert list(done) == [folder] and not journals.path.exists()
    assert read_stored_run(folder).summary["duration_s"] == pytest.approx(1.4)
    with raises(RunDirectoryError, journals.path):
        complete(journals.path)


def test_a_folder_that_has_come_in_between_is_left_alone(loaded, problem, tmp_path):
    _, journals = written(loaded, problem, tmp_path / "run")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("mine")
    assert list(complete(journals.path)) == [tmp_path / "run-2"]
    assert [item.name for item in (tmp_path / "run").iterdir()] == ["mine.txt"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is full")
def test_a_full_disk_is_reported_and_the_walk_continues(problem, tmp_path, monkeypatch):
    messages, columns = [], log_layout(problem).names
    monkeypatch.setattr(pa, "OSFile", lambda path, mode, open=pa.OSFile: open("/dev/full", mode))
    journals = Journal(columns, {"folder": str(tmp_path / "x")}, messages.append)
    for over in (False, False, True):
        journals.store(LogChunk(rows=np.zeros((10, len(columns))), is_last=over))
    journals.close()
    assert len(messages) == 1 and states(messages[0], "No space left on device")
    with lock_journal(journals.path):  # it has been let go
        pass


ROOM = 400_000  # bytes that fit on the disk; a journal of the bench has half of that in a second


@pytest.fixture
def small_disk():
    """Limit the size of files of this process and its children to ``ROOM``."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, before)
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_reported_in_terminal_record_and_page_and_the_stored_part_is_recovered(
    loaded, tmp_path, monkeypatch, small_disk, capsys
):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    records, folder, messages = tmp_path / "sessions", tmp_path / "run", []
    session = LiveSession(
        loaded=loaded, folder=folder, records=records, pictures=False, on_store_failure=messages.append
    )  # fmt: skip
    with monkeypatch.context() as context, closing(session):
        session.start()
        small_disk()  # for this process; that of the walk has it still
        wait_for(lambda: session.walk.store_failure)
        last = session.walk.frame["tick"]
        wait_for(lambda: session.walk.frame["tick"] > last + 100)  # the walk goes on
        context.setattr(finishing, "write_run", full)
    way_out = f"twin-gait sessions complete {folder}"
    (text,) = messages
    assert way_out in text and "\n" not in text
    assert way_out in session.failure and "No space left" in session.failure
    assert text in [event.text for event in session.event_log.after(0)]  # what pages are sent
    assert text in [item["text"] for item in read_session(records, 1)["log"]]
    (entry,) = list_sessions(records)
    assert entry["folders"] == entry["unfinished"] == [str(folder)] and way_out in format_session(entry)
    assert _finish(session, False) == 1 and way_out in capsys.readouterr().err

    _, columns, pieces = read_journal(journal_path(folder))
    (walk,) = split_walks(pieces, 60_000)
    assert BATCH_TICKS <= len(walk.rows) < last
    assert main(["sessions", "complete", str(folder)]) == 0
    angle = read_stored_run(folder).run.log["right_hip_angle_rad"]
    np.testing.assert_array_equal(angle, walk.rows[:, columns.index("right_hip_angle_rad")])
    (entry,) = list_sessions(records)
    assert entry["folders"] == [str(folder)] and entry["unfinished"] == []


def test_the_command_reports_at_once_that_a_walk_is_no_longer_stored_and_ends_with_1(tmp_path, small_disk):
    command = [sys.executable, "-m", "twin_gait", "live", "bench_leg", "--set", "duration_s=5"]
    command += ["--no-browser", "--no-pictures", "--no-record", "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "the walk is no longer saved" in line]
    assert f"twin-gait sessions complete {tmp_path / 'run'}" in line


def test_every_walk_of_a_journal_has_a_folder_and_only_the_last_is_drawn(
    problem, loaded, tmp_path, monkeypatch
):
    drawn, write = [], finishing.write_run

    def noted(run, directory, *, pictures, **rest):
        drawn.append(pictures)
        return write(run, directory, pictures=False, **rest)

    monkeypatch.setattr(finishing, "write_run", noted)
    _, journals = written(loaded, problem, tmp_path / "run", ticks=200)
    monkeypatch.setattr(finishing, "read_journal", lambda path: again(read_journal(path)))
    folders = [tmp_path / "run", tmp_path / "run-2", tmp_path / "run-3"]
    assert list(complete(journals.path, pictures=True)) == folders
    assert drawn == [False, False, True]


def again(read):
    """Read the journal three times and return the result."""
    setup, columns, pieces = read
    return setup, columns, iter(3 * list(pieces))


# ---------------------------------------------------------------------- memory


def test_the_loop_holds_the_last_rows_only_and_of_restarted_walks_nothing(problem):
    script = [(0.5 * n, {"serial": n, "command": "restart"}) for n in range(1, 21)]
    rig = Rig(problem, script, longest=12_000)
    most = 0
    advance = rig.run.advance

    def watched(ticks):
        nonlocal most
        rows = advance(ticks)
        most = max(most, len(rig.run.rows()))
        return rows

    rig.run.advance = watched
    rig.loop.walk()
    assert len(rig.takes) == 21 and len(rig.takes[-1].rows) == 12_000
    assert most <= 30
    assert max(len(piece.rows) for pieces in rig.pieces for piece in pieces) <= 10


# ---------------------------------------------------------------------- kills


@pytest.mark.slow
def test_a_killed_walk_process_is_reported_and_loses_a_second_at_most(loaded, tmp_path):
    database = tmp_path / "sessions"
    session = LiveSession(
        loaded=loaded, folder=tmp_path / "run", user="Ann", records=database, pictures=False
    )
    with closing(session):
        session.start()
        changed = say(session, kind="set", control="late_stance.hip.stiffness", value=2.4)
        wait_for(lambda: session.walk.frame["tick"] > changed.tick + MOST_LOST)
        os.kill(session.walk.process.pid, signal.SIGKILL)
        wait_for(lambda: not session.walk.alive)
        last = session.walk.frame
        assert last["status"] == session.walk.status == "died"
        assert "died" in session.event_log.after(0)[-1].text and "signal 9" in session.walk.exit_reason
    stored = read_stored_run(tmp_path / "run")
    assert len(stored.run.log) >= last["tick"] - MOST_LOST
    assert stored.summary["status"] == "interrupted" and states(stored.summary["reason"], "died")
    assert [item.tick for item in stored.run.experiment.events] == [changed.tick]
    (entry,) = list_sessions(database)
    assert (entry["status"], entry["folders"]) == ("died", [str(tmp_path / "run")])
    assert any("died" in item["text"] for item in read_session(database, entry["id"])["log"])


def walk_process_of(pid):
    lists = Path(f"/proc/{pid}/task").glob("*/children")  # a list for each of its threads
    found = [int(item) for path in lists for item in path.read_text().split()]
    return next(item for item in found if "live.process" in Path(f"/proc/{item}/cmdline").read_text())


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs the list of a process's children")
def test_the_command_reports_that_its_walk_process_died_and_ends_with_1(tmp_path):
    words = ["live", "bench_leg", "--no-browser", "--port", "0", "--no-pictures", "--out", tmp_path / "run"]
    with subprocess.Popen(
        [sys.executable, "-m", "twin_gait", *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TWIN_GAIT_SESSIONS": str(tmp_path / "sessions")},
    ) as command:  # fmt: skip
        try:
            assert command.stdout.readline().startswith("open http")
            time.sleep(1.5)
            os.kill(walk_process_of(command.pid), signal.SIGKILL)
            output, errors = command.communicate(timeout=120)
        finally:
            command.kill()
    assert command.returncode == 1
    assert str(tmp_path / "run") in output and states(errors, "died")
    assert len(read_stored_run(tmp_path / "run").run.log) > 0


PARENT = """
    import sys, time
    from pathlib import Path
    from twin_gait.configuration.experiments import load_experiment
    from twin_gait.live.protocol import SetControl
    from twin_gait.live.session import LiveSession

    loaded = load_experiment("bench_leg", ["duration_s=60"])
    session = LiveSession(loaded=loaded, folder=Path(sys.argv[1]), pictures=False, records=Path(sys.argv[2]))
    session.start()
    print(session.walk.process.pid, flush=True)
    serial = 0
    while True:
        serial += 1
        session.submit(SetControl(id=str(serial), user="Ann", control="belt", value=1.0))
        tick = session.walk.frame.get("tick", "")
        print(time.monotonic(), len(session.event_log.after(0)), tick, flush=True)
        time.sleep(0.02)
"""


def let_go(journal):
    try:
        with lock_journal(journal):
            return True
    except RunDirectoryError:
        return False


def killed_together(folder, database, delay):
    """Kill both processes of a session; return its reports on walk and events, with times."""
    code = textwrap.dedent(PARENT)
    with subprocess.Popen(
        [sys.executable, "-c", code, str(folder), str(database)], stdout=subprocess.PIPE, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
        parent.send_signal(signal.SIGKILL)
        lines = [line.split() for line in parent.stdout if line.endswith("\n")]
    wait_for(lambda: let_go(journal_path(folder)))  # the system takes its time to bury the walk's process
    return [(float(line[0]), int(line[1]), int(line[2])) for line in lines if len(line) == 3]


def test_both_processes_killed_at_random_moments_lose_a_second_at_most(tmp_path, monkeypatch, capsys):
    database = tmp_path / "sessions"
    for number, delay in enumerate(np.random.default_rng(11).uniform(0.8, 2.5, KILLS)):
        folder = tmp_path / f"run-{number}"
        reports = killed_together(folder, database, float(delay))
        last, _, tick = reports[-1]
        # A process that started slowly may have reported nothing a second before it was killed.
        events = max((events for at, events, _ in reports if last - at > 1.0 or events == 0), default=0)
        assert main(["sessions", "complete", str(folder)]) == 0
        assert capsys.readouterr().out.strip() == str(folder)
        assert len(read_stored_run(folder).run.log) >= tick - MOST_LOST
        found = read_session(database, number + 1)
        assert (found["status"], found["folders"], found["ended"]) == ("killed", [str(folder)], None)
        assert len(found["log"]) >= events


RESTARTING = """
    import sys
    from pathlib import Path
    from test_live_loop import say, wait_for
    from twin_gait.configuration.experiments import load_experiment
    from twin_gait.live.session import LiveSession

    loaded = load_experiment("bench_leg", ["duration_s=60"])
    session = LiveSession(loaded=loaded, folder=Path(sys.argv[1]), pictures=False, records=Path(sys.argv[2]))
    session.start()
    for _ in range(2):
        wait_for(lambda: session.walk.frame["tick"] > 300)
        say(session, kind="do", action="restart")
        wait_for(lambda: session.walk.frame["tick"] < 300)
    wait_for(lambda: session.walk.frame["tick"] > 1500)
    print(session.walk.process.pid, flush=True)
    sys.stdin.read()
"""


def test_run_folders_of_all_walks_of_a_killed_session_are_listed(tmp_path, capsys):
    records, folder = tmp_path / "sessions", tmp_path / "run"
    code = [sys.executable, "-c", textwrap.dedent(RESTARTING), folder, records]
    tests = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": tests}
    with subprocess.Popen(list(map(str, code)), **pipes) as parent:
        os.kill(int(parent.stdout.readline()), signal.SIGKILL)
        parent.kill()
    wait_for(lambda: let_go(journal_path(folder)))
    file = records / "1.jsonl"
    file.write_text(file.read_text() + '{"log": {"ti')  # a line that the kill has cut short
    (entry,) = list_sessions(records)
    assert entry["folders"] == entry["unfinished"] == [str(folder)]
    assert main(["sessions", "complete", str(folder)]) == 0
    made = [str(folder), f"{folder}-2", f"{folder}-3"]
    assert capsys.readouterr().out.splitlines() == made
    (entry,) = list_sessions(records)
    assert (entry["status"], entry["folders"], entry["unfinished"]) == ("killed", made, [])
    assert format_session(entry).endswith("  " + ", ".join(made))
    assert all(len(read_stored_run(Path(path)).run.log) >= 300 for path in made)


def test_a_walk_that_was_killed_is_completed_by_name(loaded, problem, tmp_path, capsys):
    _, journals = written(loaded, problem, tmp_path / "run")
    assert main(["sessions", "complete", str(tmp_path / "run")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "run") and not journals.path.exists()


def test_a_session_that_begins_where_one_was_killed_completes_that_first(loaded, problem, tmp_path):
    written(loaded, problem, tmp_path / "run")
    with raises(RunDirectoryError, tmp_path / "run", "--out", "--force"):
        LiveSession(loaded=loaded, folder=tmp_path / "run", pictures=False).start()
    assert read_stored_run(tmp_path / "run").summary["duration_s"] == pytest.approx(1.4)
