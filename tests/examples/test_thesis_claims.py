"""Claims of the thesis: how one is judged, what each must state, and that the kept results answer all."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from gallery import ScriptOptions
from thesis import claims
from thesis.claims import (
    AGREES,
    CALIBRATED,
    CONTRADICTED,
    COUNTED,
    GIVEN_BACK,
    OUT_OF_BAND,
    UNSTATED,
    Answers,
    band_text,
    claims_of,
    number_text,
    rows_of,
    verdict_of,
)

SCRIPTS = ("thesis_friction", "thesis_falls", "thesis_control", "thesis_limits")
RESULTS = Path(claims.__file__).parents[1] / "results"
CLAIM = {"claim": "slope", "thesis": 0.0493, "ours": "slope", "band": [0.049, "high"], "unit": "N·m/deg"}


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [
        (0.05, AGREES),
        (0.049, AGREES),
        (0.051, AGREES),
        (0.0489, OUT_OF_BAND),
        (0.0511, OUT_OF_BAND),
        (math.nan, OUT_OF_BAND),
        (math.inf, OUT_OF_BAND),
    ],
)
def test_a_predicted_number_holds_in_its_band_ends_included(ours: float, verdict: str) -> None:
    assert verdict_of(CLAIM, {"slope": ours, "high": 0.051}) == verdict


def test_a_calibrated_number_is_never_judged() -> None:
    claim = {"claim": "noise", "ours": "noise", "calibrated": "noise of a sample"}
    assert verdict_of(claim, {"noise": 1e9}) == CALIBRATED


@pytest.mark.parametrize(
    ("thesis", "ours", "verdict"),
    [(0.5, 0.05, CONTRADICTED), (0.05, 0.05, AGREES), (None, 0.05, UNSTATED), (0.5, 0.06, OUT_OF_BAND)],
)
def test_the_thesis_is_contradicted_only_by_a_number_within_its_band(thesis, ours, verdict) -> None:
    assert verdict_of({**CLAIM, "thesis": thesis}, {"slope": ours, "high": 0.051}) == verdict


def test_a_number_used_to_build_the_bench_is_not_a_prediction() -> None:
    claim = {**CLAIM, "given_back": True}
    assert verdict_of(claim, {"slope": 0.05, "high": 0.051}) == GIVEN_BACK
    assert verdict_of(claim, {"slope": 0.06, "high": 0.051}) == OUT_OF_BAND


def test_claims_on_the_friction_of_the_bench_are_inputs_not_predictions() -> None:
    """Table 3.1 and the curves of figure 3.4 are the parameters of the bench."""
    found = {figure: entries for script in SCRIPTS for figure, entries in claims_of(script).items()}
    for figure, entries in found.items():
        for claim in entries:
            assert claim.get("given_back", False) == (figure in ("table_3_1", "fig_3_4")), claim


def test_numbers_have_four_digits_a_true_minus_and_a_unit_and_bands_are_described() -> None:
    assert number_text(-0.44601) == "−0.446"
    assert number_text(0.31746, "N·m") == "0.3175 N·m"
    assert number_text(None, "s") == "–"
    assert band_text({"band": [None, 0]}, {}) == "at most 0"
    assert band_text({"band": ["low", None]}, {"low": 1.0}) == "at least 1"
    assert band_text({"calibrated": "by s"}, {}) == "–"


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_claim_states_source_and_either_band_and_reason_or_its_calibration(script: str) -> None:
    for figure, entries in claims_of(script).items():
        names = [claim["claim"] for claim in entries]
        assert len(set(names)) == len(names), figure
        for claim in entries:
            assert {"claim", "ours", "source"} < claim.keys(), claim
            assert ("band" in claim and "reason" in claim) != ("calibrated" in claim), claim
            assert claim.get("band") != [None, None], claim


def test_every_announced_figure_has_a_claim() -> None:
    promised = {"fig_2_12", "fig_2_20", "table_3_1", "fig_A_1", "fig_A_2", "filter_delay"}
    promised |= {f"fig_3_{number}" for number in range(1, 8)} | {f"fig_B_{number}" for number in range(1, 7)}
    assert promised <= {figure for script in SCRIPTS for figure in claims_of(script)}


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_stored_results_have_the_current_verdict_of_every_claim(script: str) -> None:
    kept = json.loads((RESULTS / script / "results.json").read_text(encoding="utf-8"))
    rows = list(rows_of(script, kept))
    assert kept["claims"] == rows
    assert len(rows) == sum(map(len, claims_of(script).values()))
    assert kept["in_band"] == kept["judged"] == sum(row["verdict"] != CALIBRATED for row in rows)
    for name, verdict in COUNTED.items():
        assert kept[name] == sum(row["verdict"] == verdict for row in rows)


def test_a_number_out_of_its_band_is_stored_printed_and_ends_with_status_1(tmp_path, capsys) -> None:
    answers = Answers("thesis_falls", ScriptOptions(tmp_path, quick=True, workers=1))
    answers.add("fig_A_1", {"counts": 70.0})
    with pytest.raises(SystemExit) as ended:
        answers.conclude()
    assert ended.value.code == 1
    assert "figure fig-A.1" in capsys.readouterr().out
    kept = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert (kept["judged"], kept["in_band"], kept["fig_A_1"]) == (1, 0, {"counts": 70.0})
    assert [row["verdict"] for row in kept["claims"]] == [OUT_OF_BAND]
