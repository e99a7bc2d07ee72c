"""Figures for print, from the command line and from Python, and what else a user does with a run."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from synthetic_run import LAG, LENGTH, STRIDE, synthetic_run

import twin_gait
from twin_gait import load_experiment, load_run, plot_run, save_run, simulate, summarise_run
from twin_gait.cli import main
from twin_gait.control.safety import Trip, TripCause
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.report.canvas import save
from twin_gait.report.figures import FIGURES
from twin_gait.simulation.run import RunStatus
from twin_gait.vocabulary import JointName, Side

MILLIMETRE = 72.0 / 25.4  # [pt]
LEAST_LETTERS = 5.5  # [pt]: "small" of 7 pt is 5.8


@pytest.fixture(scope="module")
def walk():
    trip = Trip(6500, TripCause.ENCODER_FROZEN, Side.LEFT, JointName.KNEE)
    return replace(synthetic_run(), trip=trip, status=RunStatus.FELL, reason="fell at 7.200 s")


@pytest.fixture(scope="module")
def bench():
    return simulate(load_experiment("bench_leg", ["duration_s=0.6"]).experiment)


@pytest.fixture(scope="module")
def folder(bench, tmp_path_factory):
    return bench.save(tmp_path_factory.mktemp("runs") / "bench")


def texts(figure):
    legend = [text for legend in figure.legends for text in legend.get_texts()]
    return [
        text
        for text in (*figure.findobj(match=type(legend[0])),)
        if text.get_visible() and text.get_text().strip()
    ]


@pytest.mark.parametrize("width", [85, 174])
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_for_print_is_legible_and_complete(walk, name, width):
    figure = plot_run(walk, name, width_mm=width)
    assert figure.get_figwidth() * 25.4 == pytest.approx(width)
    assert figure.get_suptitle() == ""
    for letter, axes in zip("abcdefg", figure.axes, strict=False):
        assert axes.get_title(loc="left").startswith(rf"$\mathbf{{{letter}}}$")
        assert axes.get_title() == ""
    figure.draw_without_rendering()
    whole = figure.bbox
    # Tick labels outside of the range of an axis are not drawn.
    drawn = [text for text in texts(figure) if text.get_window_extent().width > 0.0]
    for text in drawn:
        box = text.get_window_extent()
        tick = text.get_text().lstrip("\N{MINUS SIGN}-").replace(".", "").isdigit()
        assert tick or (whole.x0 - 1 <= box.x0 and box.x1 <= whole.x1 + 1), text.get_text()
        assert tick or (whole.y0 - 1 <= box.y0 and box.y1 <= whole.y1 + 1), text.get_text()
        assert text.get_fontsize() >= LEAST_LETTERS, text.get_text()
    entries = [
        text.get_window_extent()
        for legend in figure.legends
        for text in legend.get_texts()
        if text.get_text().strip()
    ]
    for index, box in enumerate(entries):
        assert not any(box.overlaps(other) for other in entries[:index])


def test_pdf_has_truetype_fonts_and_print_size(walk, tmp_path):
    path = tmp_path / "cycle.pdf"
    save(walk.plot("gait_cycle", width_mm=85), path)
    content = path.read_bytes()
    assert b"/FontFile2" in content and b"/Type3" not in content
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", content)
    assert float(box[1]) == pytest.approx(85 * MILLIMETRE, abs=0.01)


def test_a_figure_gives_the_same_file_each_time(walk, tmp_path):
    for form in ("pdf", "svg"):
        first, second = (
            save(plot_run(walk, "torques", width_mm=174), tmp_path / f"{number}.{form}").read_bytes()
            for number in (1, 2)
        )
        assert first == second and first.count(b"2026-") == 0
    width = re.search(rb'<svg[^>]* width="([\d.]+)pt"', first)
    assert float(width[1]) == pytest.approx(174 * MILLIMETRE, abs=0.01)


def test_figures_that_cannot_be_drawn_are_refused(walk, bench):
    with raises(ParameterError, "gait", "gait_cycle", "ground_forces", "joint_angles"):
        walk.plot("gait")
    with raises(ParameterError, "feet", "joint_angles"):
        bench.plot("feet")
    with raises(ParameterError, "gait_cycle"):
        bench.plot()
    with raises(ParameterError, "width", "60", "270 mm", "20"):
        plot_run(walk, width_mm=20)
    with raises(ParameterError, "figure", "torques", "none"):
        plot_run(replace(walk, log=walk.log.iloc[:1]), "torques")


# ---------------------------------------------------------------------- the command


def test_plot_writes_the_requested_figures(folder, tmp_path, capsys):
    out = tmp_path / "thesis" / "figures"
    words = ["--figure", "joint_angles", "--format", "svg", "--out", str(out)]
    assert main(["plot", str(folder), *words]) == 0
    assert capsys.readouterr().out == f"{out / 'joint_angles-85mm.svg'}\n"
    assert (out / "joint_angles-85mm.svg").read_text().lstrip().startswith("<?xml")
    assert main(["plot", str(folder), "--figure", "torques", "--format", "pdf", "--width", "174"]) == 0
    assert (folder / "figures" / "torques-174mm.pdf").read_bytes().startswith(b"%PDF")


def test_plot_draws_all_figures_of_the_run(folder):
    assert main(["plot", str(folder), "--format", "svg"]) == 0
    drawn = {path.name for path in (folder / "figures").glob("*.svg")}
    assert drawn == {
        f"{name}-85mm.svg" for name in FIGURES if name not in ("gait_cycle", "ground_forces", "feet")
    }


@pytest.mark.slow  # draws all figures three times
def test_plot_completes_the_screen_figures_of_a_run_folder(tmp_path, capsys):
    run = simulate(load_experiment("treadmill_guided", ["duration_s=6"]).experiment)
    folder, without = run.save(tmp_path / "walk"), save_run(run, tmp_path / "bare", pictures=False)
    first = {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}
    for one in (folder, without):
        assert main(["plot", str(one), "--format", "png"]) == 0
        printed = capsys.readouterr().out.split()
        assert [Path(line).name for line in printed] == [f"{name}.png" for name in FIGURES]
    complete = {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}
    assert set(complete) == {f"{name}.png" for name in FIGURES}
    assert len(first) == 3 and {name: complete[name] for name in first} == first
    assert {path.name: path.read_bytes() for path in (without / "figures").iterdir()} == complete


@pytest.mark.parametrize(
    ("options", "facts"),
    [
        (["--figure", "gait"], ("figure", "gait_cycle", "gait")),
        (["--figure", "gait_cycle"], ("gait_cycle",)),
        (["--figure", "torques", "--width", "3"], ("width", "60", "270 mm", "3")),
        (["--figure", "torques", "--format", "doc"], ("--format", "doc")),
    ],
)
def test_a_mistake_is_one_line(folder, capsys, options, facts):
    try:
        status = main(["plot", str(folder), *options])
    except SystemExit as stop:
        status = stop.code
    error = capsys.readouterr().err
    assert status == 2 and states(error, *facts) and error.count("\n") == 1


def test_plot_replaces_with_force_only(folder, capsys):
    command = ["plot", str(folder), "--figure", "torques", "--format", "png", "--width", "85"]
    assert main(command) == 0
    path = folder / "figures" / "torques-85mm.png"
    drawn = path.read_bytes()
    assert main(command) == 0  # the same content: nothing is replaced
    path.write_bytes(b"mine")
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err and path.read_bytes() == b"mine"
    assert main([*command, "--force"]) == 0 and path.read_bytes() == drawn


def test_plot_writes_nothing_where_one_of_its_files_exists(folder, tmp_path, capsys):
    (tmp_path / "torques-85mm.svg").touch()
    names = [word for name in ("joint_angles", "torques") for word in ("--figure", name)]
    assert main(["plot", str(folder), *names, "--format", "svg", "--out", str(tmp_path)]) == 2
    assert states(capsys.readouterr().err, "torques-85mm.svg")
    assert [path.name for path in tmp_path.iterdir()] == ["torques-85mm.svg"]


# ---------------------------------------------------------------------- the public names


def test_a_run_is_saved_and_loaded_again(bench, folder, tmp_path):
    again = load_run(folder)
    pd.testing.assert_frame_equal(again.log, bench.log, check_exact=True)
    assert summarise_run(again) == summarise_run(bench)
    with raises(RunDirectoryError, folder, "--out", "--force"):
        save_run(bench, folder)
    without = save_run(bench, tmp_path / "new" / "run", pictures=False)
    assert not (without / "figures").exists() and (without / "summary.json").is_file()
    with raises(RunDirectoryError, tmp_path, "experiment.yaml"):
        load_run(tmp_path)


def test_a_run_is_one_line_in_a_notebook(walk):
    line = repr(walk)
    assert "\n" not in line and len(line) < 250
    assert line.startswith("<Run synthetic: fell, 7.2 s (7200 ticks")
    assert line.endswith(", trip: encoder frozen, left knee at 6.50 s, fall at 7.20 s>")


def test_the_public_names_have_docstrings():
    for name in ("save_run", "load_run", "plot_run", "summarise_run"):
        assert name in twin_gait.__all__ and getattr(twin_gait, name).__doc__


def test_band_of_the_gait_cycle_is_mean_and_sd() -> None:
    run = synthetic_run()
    stride = (np.arange(LENGTH) - LAG) // STRIDE
    shift = np.where(stride < 2, 0.0, np.radians(2.0) * stride)  # of the settled strides from the third on
    run.log["left_knee_angle_rad"] += shift
    figure = plot_run(run)
    (panel,) = [axes for axes in figure.axes if axes.get_title().startswith("left knee")]
    (band,) = [item for item in panel.collections if item.get_label() == "mean ± SD over strides"]
    at_half = band.get_paths()[0].vertices[np.isclose(band.get_paths()[0].vertices[:, 0], 50.0), 1]
    count = len(run.leg_record(Side.LEFT).strides())
    deviation = 2.0 * np.std(np.arange(count), ddof=1)
    assert count >= 2 and np.ptp(at_half) == pytest.approx(2.0 * deviation, rel=1e-9)


def test_legend_of_the_gait_cycle_names_only_phases_that_are_drawn() -> None:
    run = simulate(load_experiment("treadmill_start_stop").experiment)
    assert "stand" in set(run.log["left_phase"])
    (legend,) = plot_run(run).legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert "early stance" in texts and "stand" not in texts and "first swing" not in texts
