"""Pictures drawn by a process beside: the same files, also if the process is lost."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_run import synthetic_run

from twin_gait.report.figures import FIGURES, write_figures
from twin_gait.runs import drawing
from twin_gait.runs.drawing import Draughtsman, draughtsman
from twin_gait.simulation.run import Run

PATIENCE = 60.0  # [s]


@pytest.fixture(scope="module")
def walk() -> Run:
    return synthetic_run()


@pytest.fixture(scope="module")
def pictures(walk: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return contents(write_figures(walk, tmp_path_factory.mktemp("here")))


def contents(paths: list[Path]) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in paths}


@pytest.fixture
def drawn_here(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders into which this process draws."""
    folders: list[Path] = []

    def noted(run: Run, folder: Path, share: slice) -> list[Path]:
        folders.append(folder)
        return write_figures(run, folder, share)

    monkeypatch.setattr("twin_gait.report.figures.write_figures", noted)
    return folders


def test_the_process_draws_what_this_one_would(
    walk: Run, pictures: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn_here: list
) -> None:
    monkeypatch.setattr(drawing, "_processors", lambda: 2)
    with draughtsman() as worker:
        children = multiprocessing.active_children()
        worker.begin(walk, tmp_path)
        worker.finish()
        worker.finish()  # nothing is left to do
    assert contents(sorted(tmp_path.iterdir())) == dict(sorted(pictures.items()))
    assert len(pictures) == len(FIGURES) and drawn_here == []
    assert len(children) == 2 and not any(child.is_alive() for child in children)


def test_a_process_that_is_lost_is_done_without(
    walk: Run, pictures: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn_here: list
) -> None:
    monkeypatch.setattr(drawing, "_processors", lambda: 2)
    with draughtsman() as worker:
        child, _ = multiprocessing.active_children()
        child.kill()
        child.join(PATIENCE)
        worker.begin(walk, tmp_path)
        worker.finish()
    assert contents(sorted(tmp_path.iterdir())) == dict(sorted(pictures.items()))
    assert drawn_here == [tmp_path]


def test_what_the_process_cannot_draw_fails_where_it_was_asked_for(
    walk: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawing, "_processors", lambda: 2)
    with draughtsman() as worker:
        worker.begin(replace(walk, log=walk.log.drop(columns="battery_power_W")), tmp_path)
        with pytest.raises(KeyError, match="battery_power_W"):
            worker.finish()


@pytest.mark.parametrize(("processors", "beside"), [(1, True), (2, False)])
def test_no_process_is_started_for_nothing(
    processors: int, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawing, "_processors", lambda: processors)
    with draughtsman(beside=beside) as worker:
        assert multiprocessing.active_children() == []
        worker.finish()  # nothing was begun


def test_a_long_log_stays_in_this_process(
    walk: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn_here: list
) -> None:
    monkeypatch.setattr(drawing, "LARGEST_LOG", 1000)
    ours, theirs = multiprocessing.Pipe()
    worker = Draughtsman([ours])
    worker.begin(walk, tmp_path)
    assert not theirs.poll()
    worker.finish()
    assert drawn_here == [tmp_path]
