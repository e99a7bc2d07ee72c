"""Tests of the wheel: its content, and the commands of the README outside of the checkout."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import zipfile
from pathlib import Path, PurePosixPath

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parent.parent


def pip(*arguments: object) -> None:
    words = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Build the wheel as ``pip install .`` does, with the installed build tool, or one from the index."""
    folder = tmp_path_factory.mktemp("wheel")
    offline = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
    pip("wheel", "--no-deps", *offline, "--wheel-dir", folder, ROOT)
    (path,) = folder.glob("twin_gait-*.whl")
    return path


def test_the_wheel_contains_only_the_package(wheel):
    names = [PurePosixPath(name) for name in zipfile.ZipFile(wheel).namelist()]
    tops = {name.parts[0] for name in names}
    assert len(tops) == 2 and "twin_gait" in tops
    inside = {name.parts[1] for name in names if name.parts[0] == "twin_gait"}
    assert not inside & {"examples", "benchmarks", "tests", "docs"}
    shipped = {str(name) for name in names}
    kept = [
        path.relative_to(ROOT)
        for path in (ROOT / "twin_gait").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    assert {path.as_posix() for path in kept} <= shipped
    assert {"twin_gait/urdf/twin.urdf", "twin_gait/urdf/twin.dbc"} <= shipped


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory) -> dict[str, str]:
    """Return an environment that finds the package of the wheel first, and not the checkout."""
    folder = tmp_path_factory.mktemp("site")
    pip("install", "--no-deps", "--target", folder, wheel)
    return {**os.environ, "PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}


def run(site: dict[str, str], folder: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=False, cwd=folder, env=site
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_package_of_the_wheel_is_the_one_that_runs(site, tmp_path):
    path = run(site, tmp_path, "-c", "import twin_gait; print(twin_gait.__file__)")
    assert Path(path.strip()).is_relative_to(site["PYTHONPATH"])


def test_a_gait_runs_outside_the_checkout(site, tmp_path):
    printed = run(site, tmp_path, "-m", "twin_gait", "simulate", "treadmill_guided", "--duration", "4")
    assert printed.startswith("walked: 4 s")
    (made,) = (tmp_path / "runs").iterdir()
    assert {"experiment.yaml", "log.parquet", "summary.json", "animation.html", "figures"} <= {
        path.name for path in made.iterdir()
    }


def test_the_program_of_the_wheel_is_installed_and_lists_the_presets(site, tmp_path):
    program = Path(site["PYTHONPATH"]) / "bin" / "twin-gait"
    assert "treadmill_start_stop" in run(site, tmp_path, str(program), "presets")


def test_the_fifteen_lines_run_outside_the_checkout(site, tmp_path):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = readme.partition("```python\n")[2].partition("```")[0]
    run(site, tmp_path, "-c", code)
    assert (tmp_path / "stride.png").stat().st_size > 0


def test_the_test_kit_of_the_wheel_tests_a_table(site, tmp_path):
    """Pytest finds the plugin of the package without the checkout's own conftest."""
    table = run(site, tmp_path, "-m", "twin_gait", "presets", "sup_2009")
    (tmp_path / "mine.yaml").write_text(table, encoding="utf-8")
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "--gait-table", "mine.yaml")
    assert " passed" in run(site, tmp_path, *words)
