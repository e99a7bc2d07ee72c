"""Comparison of the strides of folders: intervals, bands, files, figure, command."""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from errors import raises
from numpy.testing import assert_allclose
from scipy import stats

from twin_gait.cli import main
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.measures.strides import PERCENT
from twin_gait.studies.compare import conditions as compared
from twin_gait.studies.compare.condition_page import draw_conditions, format_rows
from twin_gait.studies.compare.conditions import (
    curve_difference,
    differences,
    read_conditions,
    welch_half_width,
)

DURATION, STRIDES = 1.25, 12  # [s] of a stride, and number of strides


def write_folder(
    folder: Path, *, lift: float = 0.0, spread: float = 1.0, seed: int = 0, changed: int = 99
) -> Path:
    """Write a folder of measured data: a table of strides and a log at 100 Hz.

    ``lift``: degrees by which the knee bends more in every stride; ``spread``: SD in degrees between strides;
    ``changed``: first stride of the second condition.
    """
    draws = np.random.default_rng(seed).normal(0.0, spread, STRIDES)
    number = np.arange(1, STRIDES + 1)
    time = np.arange(int(DURATION * STRIDES * 100) + 1) / 100
    stride = np.minimum((time / DURATION).astype(int), STRIDES - 1)
    angle = np.radians(lift + draws[stride] + 30.0 * np.sin(np.pi * (time / DURATION - stride)) ** 2)
    table = pd.DataFrame({
        "side": "left", "stride": number, "condition": 1 + (number >= changed),
        "settled": (number > 2) & ((number < changed) | (number > changed + 1)),
        "start_s": DURATION * (number - 1), "stride_time_s": DURATION, "knee_peak_deg": lift + draws + 30.0,
        "early_stance_onset_percent": 10.0 + draws, "empty_deg": np.nan,
    })  # fmt: skip
    folder.mkdir()
    table.to_csv(folder / "strides.csv", index=False)
    pd.DataFrame({"time_s": time, "left_knee_angle_rad": angle}).to_parquet(folder / "log.parquet")
    return folder


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    return [write_folder(tmp_path / "plain"), write_folder(tmp_path / "lifted", lift=5.0, spread=2.0, seed=1)]


def test_interval_is_welchs() -> None:
    generator = np.random.default_rng(3)
    first, second = generator.normal(0.0, 1.0, 7), generator.normal(1.0, 4.0, 19)
    low, high = stats.ttest_ind(second, first, equal_var=False).confidence_interval(0.95)
    assert welch_half_width(first, second) == pytest.approx(0.5 * (high - low), rel=1e-9)
    assert (
        np.isnan(welch_half_width(first[:1], second)) and welch_half_width(first * 0.0, second * 0.0) == 0.0
    )


def test_differences_are_those_of_the_settled_strides(pair: list[Path]) -> None:
    rows = differences(*read_conditions(pair)).set_index("measure")
    plain, lifted = (pd.read_csv(folder / "strides.csv")["knee_peak_deg"][2:] for folder in pair)
    found = rows.loc["knee_peak_deg"]
    assert [found["first_n"], found["second_n"]] == [10, 10]
    assert found["difference"] == pytest.approx(lifted.mean() - plain.mean())
    assert found["second_sd"] == pytest.approx(lifted.std())
    interval = stats.ttest_ind(lifted, plain, equal_var=False).confidence_interval(0.95)
    assert_allclose([found["low"], found["high"]], interval, rtol=1e-9)
    assert "empty_deg" not in rows.index
    assert [rows.loc["stride_time_s", name] for name in ("difference", "low", "high")] == [0.0, 0.0, 0.0]


def test_curves_are_read_from_the_log_at_any_rate(pair: list[Path]) -> None:
    plain, lifted = read_conditions(pair)
    (key,) = plain.curves
    assert key == ("left", "knee") and plain.curves[key].shape == (10, 101)
    peaks = pd.read_csv(pair[0] / "strides.csv")["knee_peak_deg"][2:]
    assert_allclose(plain.curves[key].max(axis=1), peaks, atol=0.05)
    found = curve_difference(plain.curves[key], lifted.curves[key])
    assert found is not None and found.spans == [(0, 100)]
    means = [condition.curves[key].mean(axis=0) for condition in (plain, lifted)]
    assert_allclose(found.mean, means[1] - means[0])


@pytest.mark.parametrize("shape", ["shift", "noise"])
def test_band_contains_the_whole_difference_with_its_confidence(shape: str, monkeypatch) -> None:
    """The band contains zero everywhere for 95 % of 200 pairs of equal populations."""
    monkeypatch.setattr(compared, "has_spm1d", lambda: False)
    monkeypatch.setattr(compared, "RESAMPLES", 400)
    generator, contained = np.random.default_rng(5), 0
    for _ in range(200):
        sample = generator.normal(size=(2, 25, 1 if shape == "shift" else 8))
        modes = np.sin(np.outer(np.arange(1, sample.shape[2] + 1), PERCENT / 32.0))
        first, second = sample @ modes
        found = curve_difference(first, second)
        assert found is not None
        contained += not found.spans
    assert (
        0.89 <= contained / 200 <= 0.99
    )  # 95 % with a standard deviation of 1.5 %, a little less by resampling


def test_too_few_strides_have_no_band() -> None:
    curves = np.random.default_rng(0).normal(size=(6, 101))
    assert curve_difference(curves[:2], curves) is None and curve_difference(curves[:3], curves) is not None


def test_spm1d_gives_the_threshold_if_it_is_installed(monkeypatch) -> None:
    calls = []

    def ttest2(second, first, equal_var):
        calls.append((len(second), len(first), equal_var))
        inference = lambda alpha, two_tailed: types.SimpleNamespace(zstar=4.0 if two_tailed else 0.0)  # noqa: E731
        return types.SimpleNamespace(inference=inference)

    module = types.ModuleType("spm1d")
    module.stats = types.SimpleNamespace(ttest2=ttest2)
    monkeypatch.setitem(sys.modules, "spm1d", module)
    monkeypatch.setattr(compared, "has_spm1d", lambda: True)
    curves = np.random.default_rng(0).normal(size=(10, 101))
    found = curve_difference(curves[:4], curves[4:])
    error = np.sqrt(curves[:4].var(axis=0, ddof=1) / 4 + curves[4:].var(axis=0, ddof=1) / 6)
    assert calls == [(6, 4, False)] and found is not None
    assert_allclose(found.half_width, 4.0 * error)


def test_spm1d_itself_has_a_threshold_near_that_of_resampling(monkeypatch) -> None:
    pytest.importorskip("spm1d", reason="the extra spm is not installed")
    curves = np.cumsum(np.random.default_rng(0).normal(size=(40, 101)), axis=1)
    widths = []
    for installed in (True, False):
        monkeypatch.setattr(compared, "has_spm1d", lambda installed=installed: installed)
        found = curve_difference(curves[:20], curves[20:])
        assert found is not None
        widths.append(found.half_width[50])
    assert widths[0] == pytest.approx(widths[1], rel=0.25)


def test_a_session_is_compared_with_itself_by_condition(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "session", changed=7)
    first, second = read_conditions([folder])
    assert (first.name, second.name) == ("session, condition 1", "session, condition 2")
    assert first.table["stride"].tolist() == [3, 4, 5, 6]
    assert second.table["stride"].tolist() == [9, 10, 11, 12]


def test_figure_names_only_what_it_draws(pair: list[Path], tmp_path: Path) -> None:
    def legend(folders: list[Path]) -> list[str]:
        (box,) = draw_conditions(read_conditions(folders)).legends
        return [text.get_text() for text in box.get_texts()]

    assert legend(pair) == ["plain", "mean ± SD over strides", "lifted", "Δθ from plain, 95 % band"]
    table = pd.read_csv(pair[1] / "strides.csv")
    table[:3].to_csv(pair[1] / "strides.csv", index=False)  # one settled stride
    assert legend(pair) == ["plain", "mean ± SD over strides", "lifted"]


def test_numbers_of_the_page_have_the_digits_of_their_spread(pair: list[Path]) -> None:
    rows = differences(*read_conditions(pair))
    rows.loc[rows["measure"] == "knee_peak_deg", list(rows.columns[2:])] = (
        30.123456, 0.52, 10, 28.0, 12.3, 10, -2.123456, -3.456, -0.79,
    )  # fmt: skip
    cells = {row[0][0]: row[1:] for row in format_rows(rows)}
    assert [text for text, _ in cells["knee angle, largest [°]"]] == [
        "30.12 ± 0.52", "28 ± 12", "−2.1 [−3.5, −0.8]",
    ]  # fmt: skip
    assert [apart for _, apart in cells["knee angle, largest [°]"]] == [False, False, True]
    assert not any(apart for _, apart in cells["stride time [s]"])


def test_command_writes_page_figures_and_numbers(pair: list[Path], tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["compare", *map(str, pair), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {
        "compare.html", "compare.json", "compare.png", "compare-85mm.pdf", "compare-174mm.pdf", "curves.csv",
        "differences.csv",
    }  # fmt: skip
    assert "early stance onset [%]" in capsys.readouterr().out
    page = (out / "compare.html").read_text(encoding="utf-8")
    assert "knee angle, largest [°]" in page and "strides and not people" in " ".join(page.split())
    width = 85.0 / 25.4 * 72.0  # [pt]
    box = (out / "compare-85mm.pdf").read_bytes().split(b"/MediaBox [")[1].split(b"]")[0].split()
    assert float(box[2]) == pytest.approx(width, abs=0.01)
    document = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    assert document["conditions"] == {"plain": {"left": 10}, "lifted": {"left": 10}}
    assert document["spans"][0]["spans_percent"] == [[0, 100]]
    curves = pd.read_csv(out / "curves.csv")
    assert len(curves) == 2 * 101 and curves["difference_deg"].notna().sum() == 101
    assert main(["compare", *map(str, pair), "--out", str(out)]) == 2
    assert "--force" in capsys.readouterr().err


def test_mistakes_name_folder_and_way_out(pair: list[Path], tmp_path: Path) -> None:
    with raises(RunDirectoryError, "nowhere", "strides.csv"):
        read_conditions([pair[0], tmp_path / "nowhere"])
    with raises(ParameterError, "2 to 6", "plain"):
        read_conditions(pair[:1])
    table = pd.read_csv(pair[1] / "strides.csv")
    table.assign(settled=False).to_csv(pair[1] / "strides.csv", index=False)
    with raises(RunDirectoryError, "lifted", "settled stride"):
        read_conditions(pair)
    table.drop(columns="start_s").to_csv(pair[1] / "strides.csv", index=False)
    with raises(RunDirectoryError, "strides.csv", "start_s"):
        read_conditions(pair)
    table.assign(knee_peak_deg="high").to_csv(pair[1] / "strides.csv", index=False)
    with raises(RunDirectoryError, "strides.csv", "knee_peak_deg", "high"):
        read_conditions(pair)


def test_options_of_an_experiment_do_not_apply_to_folders(pair: list[Path], capsys) -> None:
    assert main(["compare", *map(str, pair), "--speed", "2"]) == 2
    assert "leave them out" in capsys.readouterr().err
