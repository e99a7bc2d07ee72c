"""Pictures drawn by a process beside: the same files, also if it is lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path

import pytest
from synthetic_run import synthetic_run

from twin_gait.exceptions import ParameterError
from twin_gait.report.figures import FIRST_FIGURES, write_figures
from twin_gait.runs import drawing
from twin_gait.runs.drawing import begin_drawing, drawing_beside
from twin_gait.simulation.run import Run


@pytest.fixture(scope="module")
def walk() -> Run:
    return synthetic_run()


@pytest.fixture(scope="module")
def pictures(walk: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("here")
    assert write_figures(walk, folder, FIRST_FIGURES) == {}
    return contents(list(folder.iterdir()))


def contents(paths: list[Path]) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(paths)}


@pytest.fixture
def drawn_here(monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Runs that this process draws."""
    runs: list[Run] = []

    def noted(run: Run, folder: Path, names: Sequence[str]) -> dict[str, str]:
        runs.append(run)
        return write_figures(run, folder, names)

    monkeypatch.setattr("twin_gait.report.figures.write_figures", noted)
    return runs


@pytest.mark.parametrize(("processors", "expected"), [(1, False), (2, True), (16, True)])
def test_a_process_draws_what_this_one_would(
    processors: int, expected: bool, walk: Run, pictures: dict[str, bytes], tmp_path: Path, monkeypatch,
    drawn_here,
) -> None:  # fmt: skip
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    with drawing_beside() as beside:
        begin_drawing(walk, tmp_path, beside)()
    assert contents(list(tmp_path.iterdir())) == pictures and len(pictures) == len(FIRST_FIGURES)
    assert (beside is not None) == expected and len(drawn_here) == (not expected)


@pytest.mark.slow
def test_a_process_that_is_lost_is_done_without(
    walk: Run, pictures: dict[str, bytes], tmp_path: Path, monkeypatch, drawn_here
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with drawing_beside() as beside:
        finish = begin_drawing(walk, tmp_path, beside)
        for number in beside._processes:
            os.kill(number, signal.SIGKILL)
        finish()
    assert contents(list(tmp_path.iterdir())) == pictures
    assert len(drawn_here) == 1


@pytest.mark.slow
def test_what_a_process_cannot_draw_is_named(walk: Run, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    torque = "left_knee_impedance_torque_Nm"
    with drawing_beside() as beside:
        finish = begin_drawing(replace(walk, log=walk.log.drop(columns=torque)), tmp_path, beside)
        failed = finish()
    assert list(failed) == ["torques"] and torque in failed["torques"]
    assert len(list(tmp_path.iterdir())) == len(FIRST_FIGURES) - 1


def test_the_process_is_killed_if_the_command_fails(monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    others = set(active_children())
    with pytest.raises(ParameterError), drawing_beside():
        (process,) = set(active_children()) - others
        raise ParameterError("a slip in an argument")
    assert process.exitcode == -signal.SIGKILL


def test_no_process_is_started_where_none_is_wanted(monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with drawing_beside(wanted=False) as beside:
        assert beside is None


@pytest.mark.slow
def test_a_long_log_stays_in_this_process(walk: Run, tmp_path: Path, monkeypatch, drawn_here) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(drawing, "LARGEST_LOG", 1000)
    with drawing_beside() as beside:
        begin_drawing(walk, tmp_path, beside)()
    assert len(drawn_here) == 1
