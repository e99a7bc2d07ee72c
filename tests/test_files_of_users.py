"""Readers reject anything but a regular file at once, in one line; limits hold for all kinds of files."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from errors import raises, states

from twin_gait import files, load_experiment, simulate
from twin_gait.cli import main
from twin_gait.configuration import validation
from twin_gait.exceptions import ParameterFileError
from twin_gait.network.dbc import load_messages
from twin_gait.runs.record import write_run

SHORT = ["duration_s=0.05", "engine=pinocchio"]  # avoids compilation


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    write_run(simulate(load_experiment("bench_leg", SHORT).experiment), folder, pictures=False)
    return folder


@pytest.fixture(autouse=True)
def _no_hang() -> Iterator[None]:
    """Fail a test that waits for a pipe, because a rejection takes almost no time."""

    def end(*_: object) -> None:
        pytest.fail("a reader waits for a pipe")

    previous = signal.signal(signal.SIGALRM, end)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


@pytest.mark.parametrize("name", ["log.parquet", "summary.json", "transitions.csv"])
def test_a_pipe_in_a_run_folder_is_refused(
    stored: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(stored, run)
    (run / name).unlink()
    os.mkfifo(run / name)
    page, motion = str(tmp_path / "page.html"), str(tmp_path / "walk.csv")
    for command in (
        ["plot", str(run)],
        ["view", str(run), "--out", page],
        ["export", str(run), "--out", motion],
    ):
        assert main(command) == 2
        error = capsys.readouterr().err
        assert states(error, run / name, "FIFO", "regular file")
        assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["sweep", "--out", "swept"], "sweep.yaml"),
        (["simulate"], "walk.yaml"),
        (["check"], "table.yaml"),
        (["replay"], "walk.csv"),
        (["replay"], "log.parquet"),
        (["identify", "--out", "fit"], "friction.csv"),
        (["view"], "robot.urdf"),
    ],
)
def test_a_pipe_in_the_place_of_a_file_is_refused(
    tmp_path: Path, command: list[str], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / name)
    assert main([*command, str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert name in error and error.count("\n") == 1


@pytest.mark.parametrize("setting", ["leg.urdf={}", "network={{dbc: {}}}"])
def test_a_pipe_that_an_experiment_names_is_refused(
    tmp_path: Path, setting: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert main(["simulate", "treadmill_guided", "--set", setting.format(pipe)]) == 2
    error = capsys.readouterr().err
    assert str(pipe) in error and error.count("\n") == 1


def test_folders_and_devices_are_refused_as_files(tmp_path: Path) -> None:
    for path, kind in ((tmp_path, "folder"), (Path("/dev/zero"), "device")):
        with raises(ParameterFileError, path, kind):
            files.read_bytes(path)


def test_a_file_that_grows_beyond_the_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert files.read_bytes(path, 5) == b"12345"
    with raises(ParameterFileError, path, 4):
        files.read_bytes(path, 4)
    monkeypatch.setattr(files, "require_regular", lambda path, most: None)  # size before the growth
    with raises(ParameterFileError, path, 4):
        files.read_bytes(path, 4)


def test_a_dbc_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large.dbc"
    with path.open("wb") as file:
        file.truncate(files.MOST_DOCUMENT + 1)
    with raises(ParameterFileError, path, files.MOST_DOCUMENT):
        load_messages(path)


def test_a_json_file_that_is_nested_deeply_is_refused(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(stored, run)
    (run / "summary.json").write_text("[" * 100_000, encoding="utf-8")
    assert main(["plot", str(run)]) == 2
    assert states(capsys.readouterr().err, "summary.json")


def test_line_ends_of_every_system_are_read_alike(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_bytes("a\r\nb\rc\n°".encode())
    assert files.read_text(path) == path.read_text(encoding="utf-8") == "a\nb\nc\n°"


def test_unknown_keys_are_compared_with_others_once_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixty thousand keys took minutes, because each key was compared with all others."""
    calls, of = 0, validation.quantity_of

    def counted(key: str) -> str:
        nonlocal calls
        calls += 1
        return of(key)

    monkeypatch.setattr(validation, "quantity_of", counted)
    changes = {f"unknown_{number}": number for number in range(1000)}
    assert (
        validation.merge({f"known_{number}": 0 for number in range(1000)}, changes).keys() >= changes.keys()
    )
    assert calls <= 3 * 2000


def test_a_quantity_in_another_unit_still_takes_the_place_of_the_old_one() -> None:
    assert validation.merge({"a_deg": 1, "b": 2}, {"a_rad": 3}) == {"a_rad": 3, "b": 2}
