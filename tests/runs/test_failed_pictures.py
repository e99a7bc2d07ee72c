"""No picture, and no setting of matplotlib, costs the numbers of a run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from errors import warns

from twin_gait import load_experiment, load_run, plot_run, save_run, simulate
from twin_gait.cli import main
from twin_gait.report import canvas, figures
from twin_gait.report.failures import PictureWarning
from twin_gait.simulation.run import Run

# Each of them made every picture fail, or look different.
SETTINGS = {"text.usetex": True, "font.size": 31.0, "savefig.dpi": 10.0, "savefig.bbox": "tight"}


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(load_experiment("bench_leg", ["duration_s=0.5"]).experiment)


@pytest.fixture(scope="module")
def pictures(run: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("pictures")
    assert figures.write_figures(run, folder, figures.default_figures(run)) == {}
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("source", ["MATPLOTLIBRC", "working folder", "MPLBACKEND"])
def test_settings_of_the_user_change_no_picture(
    source: str, pictures: dict[str, bytes], tmp_path: Path
) -> None:
    environment = {**os.environ}
    rc = "\n".join(f"{name}: {value}" for name, value in SETTINGS.items())
    match source:
        case "MATPLOTLIBRC":
            (tmp_path / "rc").write_text(rc, encoding="utf-8")
            environment["MATPLOTLIBRC"] = str(tmp_path / "rc")
        case "working folder":
            (tmp_path / "matplotlibrc").write_text(rc, encoding="utf-8")
        case "MPLBACKEND":
            environment["MPLBACKEND"] = "Qt4Agg"
    command = [
        sys.executable,
        "-m",
        "twin_gait",
        "simulate",
        "bench_leg",
        "--duration",
        "0.5",
        "--out",
        "walk",
    ]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""
    assert contents(tmp_path / "walk" / "figures") == pictures
    assert "pictures_failed" not in json.loads((tmp_path / "walk" / "summary.json").read_text())


def test_a_figure_is_drawn_and_written_with_the_defaults(run: Run, tmp_path: Path) -> None:
    expected = canvas.picture_bytes(plot_run(run, "torques", width_mm=85.0), "svg")
    with mpl.rc_context(SETTINGS):
        assert canvas.picture_bytes(plot_run(run, "torques", width_mm=85.0), "svg") == expected
        drawn = canvas.write_pictures({"torques": lambda: figures.FIGURES["torques"](run)}, tmp_path)
        assert mpl.rcParams["font.size"] == SETTINGS["font.size"]  # the user's own stay
    default = canvas.write_pictures({"torques": lambda: figures.FIGURES["torques"](run)}, tmp_path)
    assert drawn == default and not drawn.failed


def test_a_picture_that_fails_is_warned_of_and_recorded(
    run: Run, pictures: dict[str, bytes], tmp_path: Path, monkeypatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no latex\nthere")

    monkeypatch.setitem(figures.FIGURES, "torques", fail)
    monkeypatch.setattr("twin_gait.viewer.scene.load_visuals", fail)
    with pytest.warns(PictureWarning) as issued:
        folder = save_run(run, tmp_path / "walk")
    assert len(issued) == 1 and "\n" not in str(issued[0].message) and "torques" in str(issued[0].message)
    summary = json.loads((folder / "summary.json").read_text())
    reason = "RuntimeError: no latex there"
    assert summary["pictures_failed"] == {"torques": reason, "animation.html": reason}
    assert set(contents(folder / "figures")) == set(pictures) - {"torques.png"}
    assert load_run(folder).log.equals(run.log)


def test_without_matplotlib_only_the_pictures_are_missing(run: Run, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "twin_gait.report.figures", None)
    with warns(PictureWarning, "figures", "ModuleNotFoundError"):
        folder = save_run(run, tmp_path / "walk")
    assert (folder / "animation.html").is_file() and load_run(folder).log.equals(run.log)


def test_simulate_prints_one_line_and_exits_with_0(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(figures.FIGURES, "torques", lambda *_, **__: 1 / 0)
    out = tmp_path / "walk"
    with warns(PictureWarning, "torques", "ZeroDivisionError"):
        assert main(["simulate", "bench_leg", "--duration", "0.2", "--out", str(out)]) == 0
    assert (out / "summary.json").is_file()


def test_other_reports_omit_a_failed_picture(tmp_path: Path) -> None:
    drawings = {"one": lambda: 1 / 0, "two": canvas.Figure, "none": lambda: None}
    failed = canvas.write_figures_page(
        tmp_path / "report.html", drawings, "title", "", [("head",), ("cell",)], {}
    )  # type: ignore[arg-type]
    assert failed == {"one": "ZeroDivisionError: division by zero"}
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["two.png"]
    page = (tmp_path / "report.html").read_text()
    assert page.count("<img") == 1 and "cell" in page
