"""Every script of the gallery and of the benchmarks stands on public names, and runs in its quick form."""

from __future__ import annotations

import ast
import os
import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pytest

import twin_gait

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(path for folder in ("examples", "benchmarks") for path in (ROOT / folder).glob("*.py"))
sys.path.insert(0, str(ROOT / "docs" / "extensions"))
import api_pages  # noqa: E402 -- of the site, not of the package

RUN = [path for path in SCRIPTS if path.stem != "gallery"]


def imported_names(path: Path) -> list[tuple[str, str]]:
    """Modules of this package that a script imports from, with the names."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "twin_gait":
            found += [(node.module, item.name) for item in node.names]
        if isinstance(node, ast.Import):
            found += [(item.name, "") for item in node.names if item.name.split(".")[0] == "twin_gait"]
    return found


@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_scripts_import_public_names_only(path):
    """Scripts of the gallery; the modules that some of them bring along may look deeper."""
    if path.parent.name != "examples":
        pytest.skip("benchmarks compare the inner parts")
    for module, name in imported_names(path):
        public = twin_gait.__all__ if module == "twin_gait" else api_pages.PUBLIC.get(module, ())
        assert not name or name in public, f"{module}.{name}"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_begins_with_a_description_and_has_cells(path):
    text = path.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text))
    assert path.stem == "gallery" or "\n# %%" in text


@pytest.mark.slow
@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_a_script_runs_in_its_quick_form(path, tmp_path, monkeypatch):
    """In this process, so that they share what takes longest: imports, and functions once compiled."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), "--quick", "--workers", "1", "--out", str(tmp_path)])
    with warnings.catch_warnings(), matplotlib.rc_context():
        warnings.simplefilter("default")  # as for a user
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as ended:
            assert not ended.code
    plt.close("all")
    assert any(tmp_path.iterdir()), "it left nothing"


@pytest.mark.slow
def test_a_script_runs_from_any_folder(tmp_path):
    """In a process of its own, which finds what lies beside the script."""
    script = ROOT / "examples" / "thesis_limits.py"
    command = [sys.executable, script, "--quick", "--workers", "1", "--out", tmp_path]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "MPLBACKEND": "Agg"}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert any(tmp_path.iterdir()), "it left nothing"
