"""Tests of the walks from standing to standing: trials, and classification of their endings."""

from __future__ import annotations

import pytest
from cohorts.standing import (
    FALLS,
    OTHERWISE,
    PRESET,
    ROWS,
    STANDS,
    STRIDE,
    Row,
    Trial,
    ending_of,
    line_of,
    trials_of,
    walk_of,
)

from twin_gait import load_experiment, simulate

NAMED = Row("what", "1 and 2 s", (("a=1",), ("a=2",)), 3)


def result_of(row: Row, endings: list[str]) -> str:
    return line_of(row, endings)["stops that end standing"]


def test_moments_are_spread_evenly_over_a_stride() -> None:
    first, second, third, *others = trials_of(NAMED)
    assert [item.settings for item in (first, second, third, *others)] == [("a=1",)] * 3 + [("a=2",)] * 3
    assert first.stop == 9.0  # the preset's command to walk, and seven seconds
    assert third.stop - second.stop == pytest.approx(second.stop - first.stop)
    assert third.stop + (second.stop - first.stop) - first.stop == pytest.approx(STRIDE)


@pytest.mark.parametrize("row", ROWS, ids=[f"{row.subject} {row.values}" for row in ROWS])
def test_every_row_sets_existing_keys(row: Row) -> None:
    plain = load_experiment(PRESET).experiment
    for settings in row.settings:
        assert (load_experiment(PRESET, settings).experiment != plain) == bool(settings)


def test_a_row_states_how_many_stops_end_standing_and_the_other_endings() -> None:
    assert line_of(NAMED, [STANDS] * 6) == {
        "what": "what",
        "range": "1 and 2 s",
        "stops that end standing": "3 of 3 each",
    }
    assert result_of(NAMED, [STANDS] * 5 + [FALLS]) == f"5 of 6, 1 {FALLS}"
    found = [FALLS, STANDS, STANDS, OTHERWISE, STANDS, STANDS]
    assert result_of(NAMED, found) == f"2 of 3 each, 1 {FALLS}, 1 {OTHERWISE}"
    assert result_of(NAMED._replace(settings=((),)), [STANDS] * 3) == "3 of 3"


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ((), STANDS),
        (("scenario.belt.delay_s=0.6",), FALLS),
        (("table.phases.stand.knee.equilibrium_deg=60",), None),
    ],
)
def test_an_ending_is_derived_from_the_run(settings: tuple[str, ...], word: str | None) -> None:
    found = ending_of(simulate(walk_of(Trial(settings, 9.0))))
    assert found == word if word else found != STANDS
