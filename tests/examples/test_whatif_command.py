"""The command: folder, page and paragraphs; refusals; interruption."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from twin_gait.cli import whatif
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.report.whatif import ENDING_COLOURS, place_of
from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif import reports
from twin_gait.studies.whatif.friction_map import study_friction_map
from twin_gait.studies.whatif.friction_words import friction_text
from twin_gait.studies.whatif.inertia import study_inertia
from twin_gait.studies.whatif.inertia_words import inertia_text
from twin_gait.studies.whatif.page import PAGE_FILE, PARAGRAPH_FILE, Report, write_report
from twin_gait.studies.whatif.temperature import study_temperature
from twin_gait.studies.whatif.temperature_words import largest_safe_gain, temperature_text
from twin_gait.studies.whatif.work import Interrupted, Job, Means, tables_of


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    whatif.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["whatif", *words])
    return int(arguments.run(arguments))


@pytest.fixture(scope="module")
def quick_report() -> Report:
    return reports.report_on("inertia", Means(), quick=True)


@pytest.fixture
def quickly(quick_report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command with a study that is done already."""
    monkeypatch.setitem(reports.REPORTS, "inertia", lambda means, quick: quick_report)


@pytest.mark.usefixtures("quickly")
def test_command_writes_a_folder_and_prints_the_paragraphs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], quick_report: Report
) -> None:
    out = tmp_path / "new" / "inertia"
    assert run("inertia", "--quick", "--out", str(out)) == 0
    files = {path.name for path in out.iterdir()}
    tables = {"inertia.csv", "inertia_limits.csv", "inertia_noise.csv"}
    assert files == {PAGE_FILE, PARAGRAPH_FILE, "inertia.png", *tables}
    printed = " ".join(capsys.readouterr().out.split())
    written = (out / PARAGRAPH_FILE).read_text()
    for text in quick_report.text:
        assert text in printed and text in written
    for name in tables:
        assert len(pd.read_csv(out / name)) == len(quick_report.tables[name.removesuffix(".csv")])
    page = (out / PAGE_FILE).read_text()
    assert "data:image/png;base64," in page and "://" not in page.split("base64,")[0]
    assert (out / "inertia.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("quickly")
def test_folder_is_replaced_by_force_alone(tmp_path: Path) -> None:
    out = tmp_path / "study"
    run("inertia", "--out", str(out))
    (out / "mine").write_text("kept")
    with pytest.raises(RunDirectoryError, match="--force"):
        run("inertia", "--out", str(out))
    assert (out / "mine").exists()
    run("inertia", "--out", str(out), "--force")
    assert not (out / "mine").exists() and (out / PAGE_FILE).is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["study"]


@pytest.mark.usefixtures("quickly")
def test_foreign_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "mother.txt").write_text("dear")
    with pytest.raises(RunDirectoryError, match="is not a study"):
        run("inertia", "--out", str(tmp_path / "letters"), "--force")
    assert [path.name for path in (tmp_path / "letters").iterdir()] == ["mother.txt"]


def test_no_workers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="--workers"):
        run("inertia", "--workers", "0", "--out", str(tmp_path / "never"))
    assert not list(tmp_path.iterdir())


def test_interrupted_study_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(means: Means, quick: bool) -> Report:
        raise Interrupted("interrupted; nothing was written")

    monkeypatch.setitem(reports.REPORTS, "inertia", interrupted)
    assert run("inertia", "--out", str(tmp_path / "never")) == 130
    assert not list(tmp_path.iterdir()) and "interrupted" in capsys.readouterr().err


def square(value: int) -> dict[str, int]:
    return {"value": value, "square": value * value}


def test_rows_come_in_order_and_progress_ends_at_all() -> None:
    seen: list[tuple[int, int]] = []
    jobs = [Job(square, value) for value in range(25)]
    first, second = tables_of((jobs[:7], jobs[7:]), Means(progress=lambda done, of: seen.append((done, of))))
    assert list(first["value"]) == list(range(7)) and list(second["square"]) == [v * v for v in range(7, 25)]
    assert seen == [(done, 25) for done in range(1, 26)]


def test_study_stops_between_rows_when_asked() -> None:
    with pytest.raises(Interrupted):
        tables_of(([Job(square, value) for value in range(25)],), Means(should_stop=lambda: True))


def test_two_workers_give_what_one_gives() -> None:
    from twin_gait.studies.whatif.friction_joint import Setting
    from twin_gait.studies.whatif.friction_map import push_row

    jobs = [Job(push_row, Setting(gain=0.1 * step)) for step in range(12)]
    one, two = (tables_of((jobs,), Means(workers=workers))[0] for workers in (1, 2))
    pd.testing.assert_frame_equal(one, two)


# ---------------------------------------------------------------------- paragraphs


def test_paragraphs_on_friction_follow_the_table() -> None:
    found = study_friction_map(Means(), quick=True)
    above = (found.map["compensation"] == "measured") & (found.map["gain"] > found.map["friction_ratio"])
    text = friction_text(found)
    assert f"With G above s {above.sum()} of {above.sum()} did not" in text[0]
    changed = found.map.copy()
    changed.loc[above.idxmax(), "ending"] = str(Ending.REST)
    other = friction_text(replace(found, map=changed))
    assert f"With G above s {above.sum() - 1} of {above.sum()} did not" in other[0]
    assert "Those with G above s that rest are behind filters of 54.5 ms." in other[0]
    assert text[1:] == other[1:]


def test_paragraphs_on_temperature_follow_the_table() -> None:
    found = study_temperature(Means(), quick=True)
    best = found.best.copy()
    cold = best["temperature_degC"].idxmin()
    assert f"G = {best.loc[cold, 'largest_resting_gain']:.2f} at 10 °C" in temperature_text(found)[0]
    best.loc[cold, "largest_resting_gain"] = 1.75
    assert "G = 1.75 at 10 °C" in temperature_text(replace(found, best=best))[0]


def test_paragraphs_on_inertia_follow_the_table() -> None:
    found = study_inertia(Means(), quick=True)
    assert "disagree in 0 of" in inertia_text(found)[0]
    wrong = found.stability.assign(linear_run_grows=~found.stability["linear_run_grows"])
    assert "disagree in 0 of" not in inertia_text(replace(found, stability=wrong))[0]


def test_safe_gain_is_the_one_below_the_first_that_moves() -> None:
    table = pd.DataFrame(
        {"gain": [0.1, 0.2, 0.3, 0.1, 0.2, 0.3], "ending": ["rest", "rest", "runaway", *["rest"] * 3]}
    )
    assert largest_safe_gain(table) == 0.2
    assert largest_safe_gain(table[3:]) == 0.3


def test_every_ending_has_a_colour() -> None:
    assert set(ENDING_COLOURS) == set(Ending)


def test_lines_lie_where_the_cells_are() -> None:
    import numpy as np

    places = place_of([0.1, 0.2, 0.4], np.array([0.05, 0.1, 0.3, 0.4, 0.5]))
    assert places == pytest.approx([-0.5, 0.0, 1.5, 2.0, 2.5])


def test_report_cannot_be_written_over_a_folder(tmp_path: Path, quick_report: Report) -> None:
    with pytest.raises(RunDirectoryError):
        write_report(quick_report, tmp_path)
