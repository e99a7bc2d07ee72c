"""Tests that closed or full standard streams lose no run and are not reported as internal errors."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from twin_gait import load_run
from twin_gait.cli import terminal

FULL = Path("/dev/full")
RUN = "simulate bench_leg --duration 0.2 --out walk"


def shell(words: str, streams: str, folder: Path) -> subprocess.CompletedProcess[str]:
    line = f"{shlex.quote(sys.executable)} -m twin_gait {words} {streams}"
    return subprocess.run(["sh", "-c", line], cwd=folder, capture_output=True, text=True, check=False)


ONE_OR_TWO = [pytest.param(item, marks=pytest.mark.slow) for item in ("2>&-", ">&-", "<&-", ">&- 2>&-")]


@pytest.mark.parametrize("streams", ["<&- >&- 2>&-", *ONE_OR_TWO])
def test_a_run_is_kept_with_any_closed_streams(streams: str, tmp_path: Path) -> None:
    done = shell(RUN, streams, tmp_path)
    assert done.returncode == 0 and done.stderr == ""
    run = load_run(tmp_path / "walk")
    assert len(run.log) == 200 and len(list((tmp_path / "walk" / "figures").iterdir())) > 1
    for path in (tmp_path / "walk").iterdir():  # nothing was printed into a file of the run
        assert path.is_dir() or b"runs/" not in path.read_bytes()[:200]


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.parametrize("more", ["--no-pictures", "--json"])
def test_a_run_is_kept_where_its_summary_cannot_be_printed(more: str, tmp_path: Path) -> None:
    done = shell(f"{RUN} {more}", f"> {FULL}", tmp_path)
    assert done.returncode == terminal.FAILED
    assert done.stderr == (
        "twin-gait: standard output: cannot be written (No space left on device); "
        "written files are complete\n"
    )
    assert len(load_run(tmp_path / "walk").log) == 200


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_no_command_reports_a_full_disk_as_an_internal_error(tmp_path: Path) -> None:
    for words in ("presets", "diagram treadmill_guided"):
        done = shell(words, f"> {FULL}", tmp_path)
        assert done.returncode == terminal.FAILED and len(done.stderr.splitlines()) == 1, words


def test_a_mistake_without_standard_error_keeps_its_status(tmp_path: Path) -> None:
    assert shell("simulate moonwalk", "<&- >&- 2>&-", tmp_path).returncode == terminal.BAD_INPUT
