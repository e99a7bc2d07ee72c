"""Tests of unexpected errors (one line, status 70, a report) and of restricted terminals and users."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from errors import states

from twin_gait.cli import main, tables

pytestmark = pytest.mark.slow

DEFECT = re.compile(r"twin-gait: .*\bKeyError: 'lost'.* the report is in (\S+\b).*\n")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(arguments: object) -> int:
        raise KeyError("lost")

    monkeypatch.setattr(tables, "show_presets", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_an_unforeseen_error_is_one_line_with_a_report(
    broken: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["presets", "treadmill_guided"]) == 70
    line = DEFECT.fullmatch(capsys.readouterr().err)
    assert line is not None
    report = Path(line[1])
    text = report.read_text()
    assert "arguments: ['presets', 'treadmill_guided']" in text
    assert "Traceback" in text and "in fail" in text
    assert report.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("arguments", [["--debug", "presets"], ["presets", "--debug"]])
def test_debug_shows_all(broken: None, capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert main(arguments) == 70
    shown = capsys.readouterr().err
    assert "Traceback" in shown and "in fail" in shown
    assert sum(line.startswith("twin-gait: ") for line in shown.splitlines()) == 1


def test_a_report_that_cannot_be_written_is_reported(
    broken: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    assert main(["presets"]) == 70
    assert states(capsys.readouterr().err, "KeyError", "No such file or directory")


def test_debug_shows_where_a_users_mistake_was_found(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets", "moonwalk", "--debug"]) == 2
    shown = capsys.readouterr().err
    assert "Traceback" in shown and shown.splitlines()[-1].startswith("twin-gait: ")


def in_a_process(
    *arguments: str, folder: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "twin_gait", *arguments]
    return subprocess.run(command, capture_output=True, check=False, cwd=folder, env=environment)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return the environment without variables of the user and their folders."""
    import os

    kept = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH")
    return {name: os.environ[name] for name in kept if name in os.environ}


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_any_terminal_can_be_printed_on(bare: dict[str, str], tmp_path: Path, encoding: str) -> None:
    out = str(tmp_path / "run")
    arguments = ["simulate", "treadmill_guided", "--duration", "12", "--no-pictures", "--out", out]
    done = in_a_process(*arguments, **bare, HOME=str(Path.home()), PYTHONIOENCODING=encoding)
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode(encoding)
    assert re.search(r"−\d" if encoding == "utf-8" else r"\?\d", text), text
    assert done.stderr == b""


def test_bad_input_is_one_line_on_an_ascii_terminal(bare: dict[str, str]) -> None:
    done = in_a_process("presets", "gehört", **bare, HOME=str(Path.home()), PYTHONIOENCODING="ascii")
    assert done.returncode == 2
    assert done.stderr.startswith(b"twin-gait: ") and done.stderr.count(b"\n") == 1


# A user whom the system does not know and who has no HOME, as in many containers.
USER_WITHOUT_HOME = """
import pwd, sys
def unknown(uid):
    raise KeyError(uid)
pwd.getpwuid = unknown
from twin_gait.cli import main
sys.exit(main(sys.argv[1:]))
"""


def as_user_without_home(
    bare: dict[str, str], folder: Path, *arguments: str
) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", USER_WITHOUT_HOME, *arguments]
    environment = {**bare, "MPLCONFIGDIR": str(folder)}
    return subprocess.run(command, capture_output=True, check=False, cwd=folder, env=environment)


def test_a_user_without_a_home_can_simulate(bare: dict[str, str], tmp_path: Path) -> None:
    done = as_user_without_home(
        bare, tmp_path, "simulate", "bench_leg", "--duration", "0.1", "--no-pictures", "--out", "run"
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "summary.json").is_file()
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [["simulate", "~/mine.yaml"], ["sessions", "list"]])
def test_a_missing_home_is_reported(bare: dict[str, str], tmp_path: Path, arguments: list[str]) -> None:
    done = as_user_without_home(bare, tmp_path, *arguments)
    assert done.returncode == 2
    assert done.stderr.startswith(b"twin-gait: ~: this user has no home") and done.stderr.count(b"\n") == 1
