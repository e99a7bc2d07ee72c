"""Tests of the site: scripts have places and titles, tutorials run, the page of the summary is complete."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from pathlib import Path

import pytest

import twin_gait
from twin_gait import load_experiment, simulate, summarise_run
from twin_gait.vocabulary import JointName, Side

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "extensions"))
import api_pages  # noqa: E402 -- of the site, not of the package
import gallery_pages  # noqa: E402

SCRIPTS = sorted(path.stem for path in (ROOT / "examples").glob("*.py") if path.stem != "gallery")


def test_every_script_has_a_place_in_the_gallery():
    placed = [name for _, names in gallery_pages.SECTIONS.values() for name in names]
    assert sorted(placed) == SCRIPTS
    assert gallery_pages.IN_FULL | gallery_pages.NOT_RUN <= set(SCRIPTS)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_is_prepared_with_a_title_and_its_code_as_it_is(name):
    path = ROOT / "examples" / f"{name}.py"
    text = gallery_pages.prepared(path, run=False)
    title, line, *_ = (ast.get_docstring(ast.parse(text)) or "").splitlines()
    assert 3 < len(title) <= 72 and line == "=" * len(title)
    before, after = (ast.parse(source).body[1:] for source in (path.read_text(encoding="utf-8"), text))
    assert [ast.dump(node) for node in before] == [ast.dump(node) for node in after]


@pytest.mark.parametrize("module", ["twin_gait", *api_pages.PUBLIC])
def test_every_public_name_is_described(module):
    """Classes and functions by their docstrings, constants by the comments where they are assigned."""
    found = importlib.import_module(module)
    names = (
        set(twin_gait.__all__) - {"__version__"} if module == "twin_gait" else set(api_pages.PUBLIC[module])
    )
    described = {} if module == "twin_gait" else api_pages.meanings(module)
    # The colours are described by the docstring of their module.
    assert all(described.values()) or module == "twin_gait.palette", described
    for name in names - set(described):
        assert inspect.getdoc(getattr(found, name)), f"{module}.{name}"


def test_public_names_are_few():
    assert len(twin_gait.__all__) + sum(map(len, api_pages.PUBLIC.values())) <= 120


def test_the_first_tutorial_runs_as_a_notebook_and_shows_a_run_as_a_card(tmp_path):
    """Run in a Jupyter kernel; the other tutorials run when the site is built."""
    jupytext, nbclient = pytest.importorskip("jupytext"), pytest.importorskip("nbclient")
    notebook = jupytext.read(DOCS / "tutorials" / "walk.md", fmt="md:myst")
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    shown = [
        output["data"] for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output
    ]
    assert any("walked" in data.get("text/html", "") for data in shown)
    assert any("image/png" in data for data in shown)


def keys_of(summary: dict, before: str = "") -> set[str]:
    """Return dotted keys with SIDE, JOINT and PHASE in place of names."""
    found = set()
    for key, value in summary.items():
        name = "SIDE" if key in tuple(Side) else "JOINT" if key in tuple(JointName) else key
        name = "PHASE" if before.endswith("phase_duration_mean_s.") else name
        name = re.sub(r"(?<=^rmse_)(hip|knee|ankle)|^(hip|knee|ankle)(?=_motor)", "JOINT", name)
        found |= keys_of(value, f"{before}{name}.") if isinstance(value, dict) else {f"{before}{name}"}
    return found


@pytest.mark.parametrize(
    ("preset", "settings"),
    [
        ("treadmill", []),
        ("treadmill_guided", ["network={}"]),
        pytest.param("overground", [], marks=pytest.mark.slow),
        ("bench_leg", []),
        pytest.param("treadmill_guided", ["faults=['supply_loss_shorted@3s']"], marks=pytest.mark.slow),
    ],
    ids=["braces", "bus", "overground", "bench", "supply"],
)
def test_every_key_of_a_summary_is_in_its_page(preset, settings):
    page = (DOCS / "reference" / "summary.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.*]+)`", page))
    wild = tuple(name.removesuffix("*") for name in named if name.endswith("*"))
    # Measures of the ground stand in a table of fields, without the unit of the key.
    measures = {name for name in re.findall(r"^\| `(\w+)` \| `", page, flags=re.MULTILINE)}
    run = simulate(load_experiment(preset, [*settings, "duration_s=4"]).experiment)
    unsaid = set()
    for key in keys_of(summarise_run(run)):
        ends = {key, key.rpartition(".")[2], ".".join(key.split(".")[-2:]), ".".join(key.split(".")[-3:])}
        short = re.sub(r"_(deg|m|Ns|N|W|per_min)$", "", key.rpartition(".")[2]).removeprefix("JOINT_")
        of_walk = key.startswith(("sides.SIDE.walk.", "walk_reference.", "power."))
        if not (ends & named or key.startswith(wild) or (of_walk and short in measures)):
            unsaid.add(key)
    assert not unsaid
