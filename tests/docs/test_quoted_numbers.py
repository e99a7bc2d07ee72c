"""Pages quote the results that are kept beside the scripts."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest
from errors import raises

from twin_gait.simulation import log
from twin_gait.worlds.registry import find_world, world_kinds

ROOT = Path(__file__).parents[2]
INSERT = ROOT / "docs" / "insert.py"


@pytest.fixture
def insert(tmp_path):
    spec = importlib.util.spec_from_file_location("insert", INSERT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.DOCS = tmp_path / "docs"
    return module


def test_numbers_and_tables_of_all_pages_match_the_results():
    check = subprocess.run([sys.executable, INSERT, "--check"], capture_output=True, text=True)
    assert check.returncode == 0, f"{check.stdout}{check.stderr}run python docs/insert.py"


def test_every_column_of_the_log_and_every_key_of_a_world_has_its_line():
    columns = {name for group in log.GROUPS.values() for name in group.columns}
    page = (ROOT / "docs" / "reference" / "log.md").read_text()
    assert [name for name in columns - {"phase"} if f"`{name}`" not in page] == []
    page = (ROOT / "docs" / "reference" / "parameters.md").read_text()
    shipped = [kind for kind in world_kinds() if find_world(kind).__module__.startswith("twin_gait.")]
    assert [kind for kind in shipped if f"<!-- keys scenario:{kind} -->" not in page] == []


def keep(folder, **results):
    folder.mkdir(parents=True)
    (folder / "results.json").write_text(json.dumps(results))


def test_a_page_gets_number_and_table(insert, tmp_path):
    rows = [{"k": 1.5, "ends": "rest"}, {"k": 2, "ends": None}]
    keep(tmp_path / "examples" / "results" / "fit", quick=False, gain={"hip": [0.0, 0.4567]}, rows=rows)
    page = "G = <!-- value fit gain.hip.1 .2f -->9<!-- / -->.\n<!-- table fit rows --><!-- / -->\n"
    expected = (
        "G = <!-- value fit gain.hip.1 .2f -->0.46<!-- / -->.\n"
        "<!-- table fit rows -->\n| k | ends |\n| --- | --- |\n| 1.5 | rest |\n| 2 |  |\n<!-- / -->\n"
    )
    assert insert.insert_results(page) == expected
    assert insert.insert_results(expected) == expected


def test_the_readme_is_one_of_the_pages(insert, tmp_path, monkeypatch):
    keep(tmp_path / "examples" / "results" / "fit", quick=False, gain=0.5)
    stale = "G = <!-- value fit gain -->9<!-- / -->\n"
    (tmp_path / "docs").mkdir()
    paths = [tmp_path / "README.md", tmp_path / "docs" / "fit.md"]
    for path in paths:
        path.write_text(stale)
    assert insert.pages() == paths
    monkeypatch.setattr(sys, "argv", ["insert.py"])
    assert insert.main() == 0
    assert [path.read_text() for path in paths] == ["G = <!-- value fit gain -->0.5<!-- / -->\n"] * 2


def test_results_that_are_missing_are_named(insert):
    with raises(ValueError, "fit"):
        insert.insert_results("<!-- value fit ratio -->1<!-- / -->")


def test_results_of_the_quick_form_are_not_quoted(insert, tmp_path):
    keep(tmp_path / "benchmarks" / "results" / "engines", quick=True, ratio=2.0)
    with raises(ValueError, "engines", "--quick"):
        insert.insert_results("<!-- value engines ratio -->1<!-- / -->")


def test_no_line_begins_with_a_quoted_number():
    """To Markdown a comment at the beginning of a line is the end of the paragraph."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    begun = [(page, line) for page in pages for line in page.read_text(encoding="utf-8").splitlines()]
    assert sum("<!-- value " in line for _, line in begun) > 100
    assert [occurrence for occurrence in begun if occurrence[1].lstrip().startswith("<!-- value ")] == []
