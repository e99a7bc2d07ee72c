"""The measured table on the page about standing."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin_gait import load_experiment
from twin_gait.exceptions import TwinGaitError
from twin_gait.studies.people import stand_page
from twin_gait.studies.people.stand_page import (
    FALLS,
    OTHERWISE,
    ROWS,
    STANDS,
    Row,
    Trial,
    ending,
    line_of,
    trials_of,
)

DOCS = Path(__file__).parents[2] / "docs"
NAMED = Row("what", "1 and 2 s", (("a=1",), ("a=2",)), 3)


def test_moments_are_spread_evenly_over_a_stride() -> None:
    first, second, third, *others = trials_of(NAMED)
    assert [item.settings for item in (first, second, third, *others)] == [("a=1",)] * 3 + [("a=2",)] * 3
    assert first.stop == 9.0  # the preset's command to walk, and seven seconds
    assert third.stop - second.stop == pytest.approx(second.stop - first.stop)
    assert third.stop + (second.stop - first.stop) - first.stop == pytest.approx(stand_page.STRIDE)


@pytest.mark.parametrize("row", ROWS, ids=[f"{row.what} {row.values}" for row in ROWS])
def test_every_line_sets_what_there_is(row: Row) -> None:
    plain = load_experiment(stand_page.PRESET, ()).experiment
    for settings in row.settings:
        experiment = load_experiment(stand_page.PRESET, settings).experiment
        assert (experiment != plain) == bool(settings)


def test_a_line_says_how_many_stand_and_what_became_of_the_others() -> None:
    assert line_of(NAMED, [STANDS] * 6) == "| what | 1 and 2 s | 3 of 3 each |"
    assert line_of(NAMED, [STANDS] * 5 + [FALLS]) == f"| what | 1 and 2 s | 5 of 6, 1 {FALLS} |"
    found = [FALLS, STANDS, STANDS, OTHERWISE, STANDS, STANDS]
    assert line_of(NAMED, found) == f"| what | 1 and 2 s | 2 of 3 each, 1 {FALLS}, 1 {OTHERWISE} |"
    assert line_of(NAMED._replace(settings=((),)), [STANDS] * 3) == "| what | 1 and 2 s | 3 of 3 |"


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ((), STANDS),
        (("scenario.belt.delay_s=0.6",), FALLS),
        (("table.phases.stand.knee.equilibrium_deg=60",), None),
    ],
)
def test_an_ending_is_told_from_the_run(settings: tuple[str, ...], word: str | None) -> None:
    found = ending(Trial(settings, 9.0))
    assert found == word if word else found != STANDS


def test_the_page_keeps_what_is_written_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / stand_page.PAGE
    page.write_text(f"before\n{stand_page.BEGIN}old\n{stand_page.END}after\n")
    monkeypatch.setattr(stand_page, "ROWS", (NAMED,))

    class Standing:
        def slots(self) -> int:
            return 1

        def run(self, function, items):
            return ((number, STANDS) for number, _ in items)

    stand_page.write_page(tmp_path, Standing())
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("after\n")
    assert "old" not in text and "3 of 3 each" in text
    page.write_text("no marks")
    with pytest.raises(TwinGaitError, match=r"stand\.md: expected one"):
        stand_page.write_page(tmp_path, Standing())
    assert page.read_text() == "no marks"


def test_the_page_in_the_documentation_has_every_line() -> None:
    text = (DOCS / stand_page.PAGE).read_text().split(stand_page.BEGIN)[1].split(stand_page.END)[0]
    lines = [line for line in text.splitlines() if line.startswith("| ")][1:]
    assert [tuple(line.split(" | ")[:2]) for line in lines] == [(f"| {row.what}", row.values) for row in ROWS]
