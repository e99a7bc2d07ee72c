"""Tests that remains of killed runs are found and removed, and that written files survive a power failure."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from errors import raises

from twin_gait import files
from twin_gait.cli import main
from twin_gait.exceptions import RunDirectoryError
from twin_gait.runs import folders
from twin_gait.runs.folders import FolderKind, find_abandoned_folders, staged_directory

KIND = FolderKind("a test folder", "mark")
WRITER = """
import sys, time
from pathlib import Path
from twin_gait.runs.folders import FolderKind, staged_directory
with staged_directory(Path(sys.argv[1]), FolderKind("a test folder", "mark")) as folder:
    (folder / "half").write_bytes(bytes(3_000_000))
    print("writing", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the remains of a process that was killed while it wrote a folder."""
    monkeypatch.setattr(folders, "SETTLED", -1.0)
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / "runs" / "a")], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    with process:
        assert process.stdout.readline() == "writing\n"
        assert find_abandoned_folders(tmp_path / "runs") == []  # it is being written
        process.send_signal(signal.SIGKILL)
    (left,) = (tmp_path / "runs").iterdir()
    return left


def test_the_folder_of_a_killed_run_is_found_and_reported(
    killed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert find_abandoned_folders(killed.parent) == [killed]
    monkeypatch.chdir(tmp_path)
    arguments = ["simulate", "bench_leg", "--duration", "0.1", "--no-pictures", "--out", "runs/b"]
    assert main(arguments) == 0
    notice = capsys.readouterr().err.splitlines()[-1]
    assert notice.startswith("twin-gait: 1 ")
    command = notice.split("twin-gait sessions clean ")[1]

    assert main(["sessions", "clean", command]) == 1  # no user can confirm
    shown = capsys.readouterr().out
    assert str(killed) in shown and "--yes" in shown and killed.exists()
    assert main(["sessions", "clean", "--yes", command]) == 0
    assert [path.name for path in killed.parent.iterdir()] == ["b"]
    assert main(["sessions", "clean"]) == 0
    assert "no folders of killed runs in runs" in capsys.readouterr().out.splitlines()[-1]


def test_a_folder_that_is_being_written_is_not_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with staged_directory(tmp_path / "a", KIND) as staging:
        os.utime(staging, (0, 0))
        assert find_abandoned_folders(tmp_path) == []
        (staging / "mark").touch()
    assert (tmp_path / "a" / "mark").exists()
    fresh = tmp_path / f".b.0{folders.PARTIAL}"
    fresh.mkdir()
    assert find_abandoned_folders(tmp_path) == []  # its process may be about to lock it
    os.utime(fresh, (time.time() - 2 * folders.SETTLED,) * 2)
    assert find_abandoned_folders(tmp_path) == [fresh]


def test_clean_of_no_folder_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sessions", "clean", str(tmp_path / "nowhere")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Record synced and renamed files in order."""
    seen: list[tuple[str, str]] = []
    sync, replace, rename = os.fsync, os.replace, os.rename

    def note_sync(descriptor: int) -> None:
        seen.append(("sync", Path(os.readlink(f"/proc/self/fd/{descriptor}")).name))
        sync(descriptor)

    def note_name(act: object, old: object, new: object) -> None:
        seen.append(("name", Path(str(new)).name))
        act(old, new)  # type: ignore[operator]

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", lambda old, new: note_name(replace, old, new))
    monkeypatch.setattr(os, "rename", lambda old, new: note_name(rename, old, new))
    return seen


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc to name what is synced")
def test_a_file_is_on_the_disk_before_it_gets_its_name(tmp_path: Path, steps: list[tuple[str, str]]) -> None:
    files.write_atomically(tmp_path / "a.json", "{}")
    first, second, third = steps
    assert first[0] == "sync" and first[1].startswith(".a.json.")
    assert (second, third) == (("name", "a.json"), ("sync", tmp_path.name))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc to name what is synced")
def test_a_folder_is_on_the_disk_before_it_gets_its_name(
    tmp_path: Path, steps: list[tuple[str, str]]
) -> None:
    with staged_directory(tmp_path / "run", KIND) as staging:
        (staging / "mark").touch()
    assert steps == [("sync", staging.name), ("name", "run"), ("sync", tmp_path.name)]


def test_a_new_file_takes_the_first_free_name(tmp_path: Path) -> None:
    names = [tmp_path / f"table-{number}.yaml" for number in (1, 2, 3)]
    names[0].write_text("of an earlier session")
    assert [files.write_new(names, text) for text in ("a", "b")] == names[1:]
    assert [path.read_text() for path in names] == ["of an earlier session", "a", "b"]
    with raises(RunDirectoryError, "name"):
        files.write_new(names, "c")
    with raises(RunDirectoryError, "nowhere/a", "No such file or directory"):
        files.write_new([tmp_path / "nowhere" / "a"], "c")
