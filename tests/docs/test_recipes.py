"""Tests that every recipe of the documentation is a diff that applies to this tree and works as described."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECIPES = ROOT / "docs" / "recipes"
NAMES = sorted(path.stem for path in RECIPES.glob("*.diff"))


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """Return a function that copies the files changed by a recipe to a separate folder."""
    folder = tmp_path_factory.mktemp("recipes")

    def changed(name: str) -> Path:
        checkout = folder / name
        if not checkout.is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            for part in ("twin_gait", "urdf"):
                shutil.copytree(ROOT / part, checkout / part, ignore=ignored)
            applied = subprocess.run(
                ["git", "apply", "--recount", str(RECIPES / f"{name}.diff")],
                cwd=checkout,
                capture_output=True,
                text=True,
                env={**os.environ, "GIT_CEILING_DIRECTORIES": str(folder)},
            )
            assert applied.returncode == 0, f"{applied.stderr}write the diff anew"
        return checkout

    return changed


@pytest.mark.parametrize("name", NAMES)
def test_the_diff_of_a_recipe_applies(name, tree):
    changed = re.findall(r"^\+\+\+ b/(.*)$", (RECIPES / f"{name}.diff").read_text(), flags=re.MULTILINE)
    checkout = tree(name)
    for path in changed:
        before = ROOT / path
        after = (checkout / path).read_text(encoding="utf-8")
        assert not before.is_file() or before.read_text(encoding="utf-8") != after
        if path.endswith(".py"):
            compile(after, path, "exec")


@pytest.mark.parametrize("name", NAMES)
def test_a_recipe_has_a_page_and_changes_the_stated_number_of_files(name):
    page = (RECIPES / f"{name}.md").read_text(encoding="utf-8")
    assert f"```{{literalinclude}} {name}.diff" in page and f"```{{literalinclude}} try_{name}.py" in page
    diff = (RECIPES / f"{name}.diff").read_text(encoding="utf-8")
    (stated,) = re.findall(r"^Files: (\d+)", page, flags=re.MULTILINE)
    assert int(stated) == diff.count("\ndiff --git") + diff.startswith("diff --git")


@pytest.mark.slow
@pytest.mark.compile
@pytest.mark.parametrize("name", NAMES)
def test_a_recipe_works_as_its_page_describes(name, tree, tmp_path):
    checkout = tree(name)
    environment = {**os.environ, "PYTHONPATH": str(checkout), "TWIN_GAIT_CACHE": str(tmp_path / "cache")}
    script = str(RECIPES / f"try_{name}.py")
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


NEARBY = (
    "gait",
    "worlds",
    "configuration",
    "checking/test_counterexamples.py",
    "simulation/test_signals_in_engines.py",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["signal", "leg_signal", "world"])
def test_only_the_tests_named_by_a_page_fail_with_its_recipe(name, tree):
    """All other tests follow the declarations."""
    checkout = tree(name)
    for part in ("tests", "examples", "docs"):
        shutil.copytree(ROOT / part, checkout / part, ignore=shutil.ignore_patterns("__pycache__", "_build"))
    for part in ("pyproject.toml", "README.md", "CHANGELOG.md"):
        shutil.copy(ROOT / part, checkout / part)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-m", "not slow", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, *(f"tests/{part}" for part in NEARBY)],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
    )
    assert " passed" in done.stdout, done.stdout + done.stderr
    failed = set(re.findall(r"^(?:FAILED|ERROR) ([\w/.]+)", done.stdout, flags=re.MULTILINE))
    named = set(re.findall(r"`(tests/[\w/.]+\.py)`", (RECIPES / f"{name}.md").read_text(encoding="utf-8")))
    assert failed == named, done.stdout


def test_the_index_states_the_number_of_files_of_every_recipe():
    rows = re.findall(
        r"^\| \[.*\]\((\w+)\.md\) \| (\d+) \|$", (RECIPES / "index.md").read_text(), flags=re.MULTILINE
    )
    stated = {name: int(count) for name, count in rows}
    counted = {name: (RECIPES / f"{name}.diff").read_text().count("diff --git a/") for name in NAMES}
    assert stated == counted
