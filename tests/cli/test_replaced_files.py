"""``--force`` replaces regular files and folders of the program's own kinds, and nothing else."""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from errors import raises

from twin_gait import load_experiment, save_run, simulate
from twin_gait.cli import main
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.runs.folders import check_target
from twin_gait.runs.record import RUN_DIRECTORY


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a short run."""
    run = simulate(load_experiment("bench_leg", ["duration_s=0.1"]).experiment)
    return save_run(run, tmp_path_factory.mktemp("runs") / "walk", pictures=False)


def make_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as own:
        own.bind(os.path.relpath(path))


def link_to_file(path: Path) -> None:
    path.with_name("real").write_text("kept", encoding="utf-8")
    path.symlink_to(path.with_name("real"))


def link_to_run(path: Path) -> None:
    path.with_name("real").mkdir()
    (path.with_name("real") / RUN_DIRECTORY.mark).write_text("kept", encoding="utf-8")
    path.symlink_to(path.with_name("real"))


SPECIAL: dict[str, tuple[Callable[[Path], object], str]] = {
    "fifo": (os.mkfifo, "a FIFO"),
    "socket": (make_socket, "a socket"),
    "link to a file": (link_to_file, "a symbolic link"),
    "link to a run": (link_to_run, "a symbolic link"),
    "link to nothing": (lambda path: path.symlink_to("nothing"), "a symbolic link"),
}
COMMANDS = {
    "view": "view {run} --force --out {out}.html",
    "view --png": "view {run} --force --png {out}.png",
    "export": "export {run} --force --out {out}.csv",
    "export opensim": "export {run} --force --format opensim --out {out}",
    "plot": "plot {run} --force --figure joint_angles --format png --width 85 --out {folder}",
    "simulate": "simulate bench_leg --duration 0.1 --no-pictures --force --out {out}",
    "replay": "replay {run} --force --no-pictures --out {out}",
    "compare": "compare --force --out {out}",
    "tune": "tune --force --out {out}",
    "sweep": "sweep examples/sweep.yaml --out {out}",
    "firmware": "firmware --force --out {out}",
}


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_special_file_is_not_replaced(
    command: str, special: str, kept: Path, tmp_path: Path, capsys
) -> None:
    make, kind = SPECIAL[special]
    words = COMMANDS[command].format(run=kept, out=tmp_path / "out", folder=tmp_path).split()
    target = tmp_path / "joint_angles-85mm.png" if command == "plot" else Path(words[-1])
    make(target)
    before = target.lstat()
    assert main(words) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert str(target) in line and kind in line and "never replaced" in line
    after = target.lstat()
    assert (after.st_ino, after.st_mode, after.st_mtime_ns) == (
        before.st_ino,
        before.st_mode,
        before.st_mtime_ns,
    )
    assert sorted(path.name for path in tmp_path.iterdir() if path.name != "real") == [target.name]


def test_a_device_is_refused() -> None:
    device = Path("/dev/null")
    with raises(RunDirectoryError, "/dev/null"):
        check_target(device, RUN_DIRECTORY, force=True)
    with raises(RunDirectoryError, "/dev/null"):
        write_atomically(device, "text")
    assert stat.S_ISCHR(device.lstat().st_mode)


def test_a_regular_file_is_replaced(kept: Path, tmp_path: Path, capsys) -> None:
    target = tmp_path / "log.csv"
    target.write_text("old", encoding="utf-8")
    assert main(["export", str(kept), "--out", str(target)]) == 2
    assert target.read_text(encoding="utf-8") == "old"
    assert main(["export", str(kept), "--out", str(target), "--force"]) == 0
    assert target.read_text(encoding="utf-8").startswith("time_s,")
