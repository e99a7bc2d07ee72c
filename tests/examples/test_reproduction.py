"""``twin-gait reproduce``: verdicts, page, folder, exit status."""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from twin_gait.cli import reproduce
from twin_gait.cli.terminal import DONE, FAILED
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.report.reproduction import ShownClaim, ShownFigure, number_text, page_text
from twin_gait.simulation import RunStatus
from twin_gait.studies.reproduction import docs_page, recipes, writing
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.running import run_recipes

CLAIM = Claim(
    name="slope",
    thesis=0.0493,
    ours=0.0495,
    unit="N m/°",
    kind=Kind.PREDICTED,
    low=0.049,
    high=0.051,
    reason="two percent of k",
    source="section 3.6",
)


def recipe_of(key: str, *claims: Claim, readings: tuple[str, ...] = ()) -> Recipe:
    def make(folder: Path, seed: int) -> Reproduction:
        return Reproduction(
            key=key, title="A title", figure=Figure(), claims=claims, text=f"seed {seed}", readings=readings
        )

    return Recipe(key=key, title="A title", make=make)


@pytest.fixture
def with_recipes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def put(*given: Recipe) -> None:
        monkeypatch.setattr(recipes, "RECIPES", given)

    return put


def call(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    reproduce.add_parser(parser.add_subparsers())
    # In this process, which alone knows the recipes of a test.
    parsed = parser.parse_args(["reproduce", "--workers", "1", *map(str, arguments)])
    return int(parsed.run(parsed))


@pytest.mark.parametrize(
    ("ours", "holds"),
    [
        (0.05, True),
        (0.049, True),
        (0.051, True),
        (0.0489, False),
        (0.0511, False),
        (math.nan, False),
        (math.inf, False),
    ],
)
def test_a_predicted_number_holds_in_its_band_ends_included(ours: float, holds: bool) -> None:
    assert replace(CLAIM, ours=ours).holds is holds


def test_a_calibrated_number_is_not_judged_however_far_off() -> None:
    claim = replace(CLAIM, kind=Kind.CALIBRATED, ours=1e9)
    assert claim.holds is None
    assert not claim.contradicts
    assert writing.verdict_of(claim) == writing.NOT_JUDGED


@pytest.mark.parametrize(
    ("thesis", "ours", "contradicts"),
    [(0.5, 0.05, True), (0.05, 0.05, False), (None, 0.05, False), (0.5, 0.06, False)],
)
def test_the_thesis_is_contradicted_only_by_a_number_that_holds(
    thesis: float | None, ours: float, contradicts: bool
) -> None:
    claim = replace(CLAIM, thesis=thesis, ours=ours)
    assert claim.contradicts is contradicts
    assert (writing.verdict_of(claim) == writing.CONTRADICTS) is contradicts


def test_every_figure_that_was_promised_has_a_recipe_and_no_key_comes_twice() -> None:
    promised = {"fig-2.12", "fig-2.20", "table-3.1", "fig-A.1", "fig-A.2", "filter-delay"}
    promised |= {f"fig-3.{number}" for number in range(1, 8)}
    promised |= {f"fig-B.{number}" for number in range(1, 7)}
    keys = [recipe.key for recipe in recipes.RECIPES]
    assert promised <= set(keys)
    assert len(keys) == len(set(keys))


def test_recipes_come_in_the_order_of_the_thesis_whatever_the_order_of_the_keys() -> None:
    found = recipes.find_recipes(["fig-B.6", "fig-A.1", "table-3.1", "fig-3.2", "fig-A.1"])
    assert [recipe.key for recipe in found] == ["fig-3.2", "table-3.1", "fig-A.1", "fig-B.6"]
    keys = [recipe.key for recipe in recipes.find_recipes([])]
    assert keys.index("fig-3.2") < keys.index("fig-3.4") < keys.index("fig-A.2") < keys.index("fig-B.1")


def test_an_unknown_key_names_the_keys_and_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(
        ParameterError, match=r"--only: no 'fig-9.9'; there are .*fig-3\.2.*fig-B\.6"
    ) as error:
        call("--only", "fig-9.9", "--out", tmp_path / "out")
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_list_prints_the_keys_and_makes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--list", "--only", "fig-3.1", "fig-B.6") == DONE
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["fig-3.1", "fig-B.6"]


def test_without_a_folder_or_with_a_negative_seed_it_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="--out: expected a folder"):
        call()
    with pytest.raises(ParameterError, match="--seed: expected a whole number"):
        call("--out", tmp_path / "out", "--seed", -1)
    with pytest.raises(ParameterError, match="--workers: expected 1 or more"):
        call("--out", tmp_path / "out", "--workers", 0)
    assert list(tmp_path.iterdir()) == []


def test_a_number_out_of_its_band_is_written_printed_and_ends_in_status_1(
    tmp_path: Path, with_recipes: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    with_recipes(recipe_of("fig-1.1", CLAIM), recipe_of("fig-1.2", replace(CLAIM, name="worse", ours=0.06)))
    assert call("--out", tmp_path / "out", "--seed", 7) == FAILED
    document = json.loads((tmp_path / "out" / writing.DOCUMENT_FILE).read_text(encoding="utf-8"))
    assert document["out_of_band"] == ["fig-1.2: worse"]
    assert (document["predicted"], document["in_band"], document["seed"]) == (2, 1, 7)
    assert [item["text"] for item in document["figures"]] == ["seed 7", "seed 7"]
    assert document["figures"][1]["claims"][0]["band"] == [0.049, 0.051]
    assert "out of band: fig-1.2, worse: thesis 0.0493 N m/°, ours 0.06" in capsys.readouterr().out


def test_numbers_in_their_bands_end_in_status_0_with_page_pictures_and_no_infinity(
    tmp_path: Path, with_recipes: Callable[..., None]
) -> None:
    with_recipes(recipe_of("fig-1.1", replace(CLAIM, low=-math.inf, thesis=None)))
    assert call("--out", tmp_path / "out") == DONE
    written = sorted(str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*"))
    assert written == ["figures/fig-1.1.png", "reproduction.html", "reproduction.json"]
    assert (tmp_path / "out/figures/fig-1.1.png").read_bytes().startswith(b"\x89PNG")
    claim = json.loads((tmp_path / "out/reproduction.json").read_text(encoding="utf-8"))["figures"][0][
        "claims"
    ][0]
    assert claim["band"] == [None, 0.051]
    assert claim["thesis"] is None


def test_an_existing_folder_is_refused_and_replaced_by_force_only_if_it_is_a_reproduction(
    tmp_path: Path, with_recipes: Callable[..., None]
) -> None:
    with_recipes(recipe_of("fig-1.1", CLAIM))
    out = tmp_path / "out"
    assert call("--out", out) == DONE
    with pytest.raises(RunDirectoryError, match="--force"):
        call("--out", out)
    with_recipes(recipe_of("fig-1.2", CLAIM))
    assert call("--out", out, "--force") == DONE
    assert [path.name for path in (out / "figures").iterdir()] == ["fig-1.2.png"]
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.txt").write_text("years of work", encoding="utf-8")
    with pytest.raises(RunDirectoryError, match="--force does not replace it"):
        call("--out", mine, "--force")
    assert (mine / "thesis.txt").read_text(encoding="utf-8") == "years of work"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine", "out"]


def test_a_recipe_that_fails_leaves_the_earlier_folder_as_it_was(
    tmp_path: Path, with_recipes: Callable[..., None]
) -> None:
    with_recipes(recipe_of("fig-1.1", CLAIM))
    assert call("--out", tmp_path / "out") == DONE
    before = (tmp_path / "out/reproduction.json").read_text(encoding="utf-8")

    def fail(folder: Path, seed: int) -> Reproduction:
        raise ParameterError("no such bench")

    with_recipes(Recipe(key="fig-1.1", title="", make=fail))
    with pytest.raises(ParameterError, match="no such bench"):
        call("--out", tmp_path / "out", "--force")
    assert (tmp_path / "out/reproduction.json").read_text(encoding="utf-8") == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_interrupted_reproduction_keeps_the_figures_so_far_and_says_so(
    tmp_path: Path, with_recipes: Callable[..., None]
) -> None:
    with_recipes(recipe_of("fig-1.1", CLAIM), recipe_of("fig-1.2", CLAIM))
    result = run_recipes([], 0, should_stop=lambda: True)
    assert result.status is RunStatus.INTERRUPTED
    assert [item.key for item in result.made] == ["fig-1.1"]
    writing.write_reproduction(result, tmp_path)
    assert "Interrupted" in (tmp_path / "reproduction.html").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "reproduction.json").read_text(encoding="utf-8"))["status"] == "interrupted"


def test_progress_counts_the_figures(with_recipes: Callable[..., None]) -> None:
    with_recipes(recipe_of("fig-1.1", CLAIM), recipe_of("fig-1.2", CLAIM))
    steps: list[tuple[int, int]] = []
    run_recipes([], 0, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 2), (2, 2)]


def shown(text: str, **changes: object) -> ShownClaim:
    values: dict[str, object] = {
        "name": f"name {text}",
        "thesis": -0.446,
        "ours": 0.31746,
        "unit": "N m",
        "kind": "predicted",
        "low": 0.0,
        "high": 0.5,
        "reason": f"reason {text}",
        "source": f"source {text}",
        "holds": True,
        "contradicts": True,
        "verdict": "in its band",
    }
    return ShownClaim(**(values | changes))  # type: ignore[arg-type]


def page_of(*figures: ShownFigure) -> str:
    return page_text(figures, version="1.0", seed=3, complete=True)


def test_the_page_holds_every_claim_reading_and_picture_and_loads_nothing() -> None:
    claims = tuple(shown(str(number)) for number in range(5))
    page = page_of(
        ShownFigure("fig-3.2", "knee", "what was done", claims, ("as printed", "corrected"), b"PNG")
    )
    for number in range(5):
        for word in ("name", "reason", "source"):
            assert f"{word} {number}<" in page
    assert page.count("−0.446 N m") == page.count("0.3175 N m") == 5
    for text in ("what was done", "as printed", "corrected", "data:image/png;base64,UE5H", "seed 3"):
        assert text in page
    assert "default-src 'none'" in page
    assert not re.search(r"https?://|<script|<link|@import|url\(", page)


def test_the_page_escapes_what_it_is_given() -> None:
    evil = "<script>alert('1')</script>\"&"
    page = page_of(
        ShownFigure(evil, evil, evil, (shown(evil, verdict=evil, unit=evil, kind=evil),), (evil,), b"")
    )
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 10
    assert "'1'" not in page


def test_the_page_tells_what_failed_what_was_calibrated_and_where_the_thesis_is_outside() -> None:
    claims = (
        shown("a", holds=True, contradicts=False, thesis=None),
        shown("b", holds=False, contradicts=False, ours=math.nan),
        shown("c", holds=None, contradicts=False),
        shown("d", low=-math.inf),
        shown("e", high=math.inf),
    )
    page = page_of(ShownFigure("fig-3.2", "knee", "", claims, (), b""))
    tiles = dict(re.findall(r"<li class='(\w+)'><b>(\d+)</b>", page))
    assert tiles == {"good": "3", "bad": "1", "doubt": "2", "plain": "1"}
    assert "of 4 predicted in their bands" in page
    assert "at most 0.5" in page
    assert "at least 0<" in page
    assert "<b>none N m</b>" in page


def test_an_incomplete_page_says_so() -> None:
    assert "Interrupted" in page_text([], version="1", seed=0, complete=False)
    assert "Interrupted" not in page_text([], version="1", seed=0, complete=True)


@pytest.mark.parametrize(
    ("value", "text"), [(-0.44601, "−0.446"), (12907.0, "1.291e+04"), (math.nan, "none")]
)
def test_numbers_have_four_digits_and_a_true_minus(value: float, text: str) -> None:
    assert number_text(value) == text


def test_neighbours_that_share_a_reason_have_it_once_below_the_last() -> None:
    same = tuple(shown(name, reason="as large as chance") for name in "ab")
    page = page_of(ShownFigure("table-3.1", "", "", (*same, shown("c")), (), b""))
    assert page.count("as large as chance") == 1
    assert page.index("name b<") < page.index("as large as chance") < page.index("name c<")


def test_the_documentation_has_every_number_of_a_reproduction(
    tmp_path: Path, with_recipes: Callable[..., None]
) -> None:
    calibrated = replace(CLAIM, name="noise", kind=Kind.CALIBRATED, ours=0.0123)
    contradicted = replace(CLAIM, name="a|b", thesis=None, high=math.inf)
    with_recipes(
        recipe_of("fig-3.2", CLAIM, calibrated, readings=("as printed",)), recipe_of("fig-9.1", contradicted)
    )
    assert call("--out", tmp_path / "out") == DONE
    (tmp_path / "docs").mkdir()
    docs_page.write_page(tmp_path / "out", tmp_path / "docs")
    text = (tmp_path / "docs" / docs_page.PAGE).read_text(encoding="utf-8")
    assert "| fig-3.2 | slope | 0.0493 N m/° | 0.0495 N m/° | 0.049 … 0.051 | in its band |" in text
    assert "| fig-3.2 | noise | 0.0493 N m/° | 0.0123 N m/° | – | calibrated |" in text
    assert "| fig-9.1 | a∣b | – | 0.0495 N m/° | at least 0.049 | in its band |" in text
    assert "2 of 2 predicted" in text
    assert "- **fig-3.2**: as printed" in text
    assert sorted(path.name for path in (tmp_path / "docs").iterdir()) == [
        "reproduction.md",
        "reproduction_fig-3.2.png",
    ]


def test_documentation_of_what_is_no_reproduction_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match="not a reproduction"):
        docs_page.write_page(tmp_path, tmp_path)
