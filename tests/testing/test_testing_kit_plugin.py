"""The test kit as a pytest plugin, in a pytest of its own."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from errors import states
from firmware_tools import require_tools
from table_builder import FIVE_PHASES

from twin_gait.configuration.gait_table_file import named_file

# Once the package is installed its entry point loads the plugin; -p would load it twice.
_INSTALLED = any(
    point.value == "twin_gait.testing.plugin" for point in importlib.metadata.entry_points(group="pytest11")
)
LOAD = [] if _INSTALLED else ["-p", "twin_gait.testing.plugin"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a gait table and a test of something else."""
    shutil.copy(FIVE_PHASES, tmp_path / "walk.yaml")
    (tmp_path / "test_other.py").write_text("def test_of_another_matter():\n    assert True\n")
    return tmp_path


def run(folder: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *LOAD, *arguments]
    env = os.environ | variables
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False, env=env
    )


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_table_is_tested_together_with_other_tests(folder: Path) -> None:
    done = run(folder, "--gait-table", "walk.yaml", "-v")
    assert done.returncode == 0, done.stdout
    lines = done.stdout.splitlines()
    name = "walk.yaml::late_stance→swing_flexion (trailing_limb)::holds just below hip.angle_deg < -2.8"
    assert any(line.startswith(f"{name} PASSED") for line in lines)
    assert any(line.startswith("test_other.py::test_of_another_matter PASSED") for line in lines)
    assert " skipped" not in lines[-1] and " failed" not in lines[-1]


NOT_STRICT = """#!/bin/sh
for word; do case $word in *.c) sed -i 's/return value > /return value >= /' "$word";; esac; done
exec "{compiler}" "$@"
"""


@pytest.mark.slow
def test_the_machine_in_c_takes_the_same_tests_and_its_own_mistakes_are_caught(folder: Path) -> None:
    """The mistake is one of the compiler: it makes a comparison that is not strict."""
    require_tools("gcc")
    in_python = run(folder, "--gait-table", "walk.yaml", "-q")
    in_c = run(folder, "--gait-table", "walk.yaml", "--machine", "c", "-q")
    assert in_python.returncode == in_c.returncode == 0, in_c.stdout
    passed = [re.search(r"\d+ passed", done.stdout)[0] for done in (in_python, in_c)]
    assert passed[0] == passed[1]

    (folder / "gcc").write_text(NOT_STRICT.format(compiler=shutil.which("gcc")))
    (folder / "gcc").chmod(0o755)
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    wrong = run(folder, "--gait-table", "walk.yaml", "--machine", "c", "-q", PATH=path)
    assert wrong.returncode == 1 and "holds on the threshold of hip.angle_deg < -2.8" in wrong.stdout


def test_without_a_compiler_one_line_names_the_package_to_install(folder: Path) -> None:
    done = run(folder, "--gait-table", "walk.yaml", "--machine", "c", PATH="")
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    (line,) = done.stderr.strip().splitlines()
    assert line == "ERROR: --gait-table walk.yaml: gcc is not installed: apt-get install gcc libc6-dev"


@pytest.mark.slow
def test_two_tables_and_a_selection(folder: Path) -> None:
    shutil.copy(named_file("bench_leg"), folder / "bench.yaml")
    done = run(
        folder, "--gait-table", "walk.yaml", "--gait-table", "bench.yaml", "-k", "closed and anew", "-v"
    )
    assert done.returncode == 0, done.stdout
    passed = sorted(line.split("::")[0] for line in done.stdout.splitlines() if "PASSED" in line)
    assert passed == ["bench.yaml", "walk.yaml"]


@pytest.mark.slow  # seven runs of pytest
def test_approved_text_is_written_compared_and_its_difference_shown(folder: Path) -> None:
    options = ["--gait-table", "walk.yaml", "--approved", "approved/walk.md", "-q", "-k", "approved"]
    missing = run(folder, *options)
    assert missing.returncode == 1
    assert "there is no approved text yet" in missing.stdout
    assert not (folder / "approved").exists()
    (folder / "bytes.md").write_bytes(b"\xff\xfe\x00")
    for path, *more in (["bytes.md"], ["bytes.md/inside.md", "--approve"]):
        broken = run(folder, "--gait-table", "walk.yaml", "--approved", path, "-q", "-k", "approved", *more)
        assert broken.returncode == 1 and f"{path}: " in broken.stdout and "Traceback" not in broken.stdout
    assert run(folder, *options, "--approve").returncode == 0
    assert run(folder, *options).returncode == 0
    edit(folder / "walk.yaml", "hip.angle_deg < 9.2", "hip.angle_deg < 9.3")
    changed = run(folder, *options)
    assert changed.returncode == 1
    for sign, threshold in (("-", 9.2), ("+", 9.3)):
        row = rf"^\{sign}\| early_stance +\| middle_stance +\| loaded .*`hip\.angle_deg < {threshold} and"
        assert re.search(row, changed.stdout, re.MULTILINE)
    assert "--approved approved/walk.md --approve" in changed.stdout
    assert "Traceback" not in changed.stdout and ".py:" not in changed.stdout


def test_condition_without_effect_is_skipped_with_the_reason(folder: Path) -> None:
    edit(folder / "walk.yaml", '"hip.angle_deg < -0.4"', '"hip.angle_deg < -0.4", "hip.angle_deg < 30"')
    done = run(folder, "--gait-table", "walk.yaml", "-rs")
    assert done.returncode == 0, done.stdout
    assert "there are no measurements with which this condition decides" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["--gait-table", "none.yaml"], ("none.yaml",)),
        (["--gait-table", "broken.yaml"], ("broken.yaml", "transitions[0]")),
        (["--gait-table", "walk.yaml", "--gait-table", "walk.yaml"], ("--gait-table",)),
        (["--approved", "walk.md"], ("--approved FILE", "--gait-table")),
        (["--gait-table", "walk.yaml", "--approve"], ("--approved FILE", "--approve")),
        (["--machine", "c"], ("--gait-table FILE", "--machine")),
    ],
    ids=["missing", "malformed", "twice", "approved alone", "approve alone", "machine alone"],
)
def test_mistake_ends_in_one_line(folder: Path, arguments: list[str], facts: tuple[str, ...]) -> None:
    shutil.copy(folder / "walk.yaml", folder / "broken.yaml")
    edit(folder / "broken.yaml", "hip.angle_deg < 9.2", "hip.angle_deg <= 9.2")
    done = run(folder, *arguments)
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("ERROR: ") and states(line, *facts)


def test_plugin_imports_nothing_and_adds_nothing_without_its_options(folder: Path) -> None:
    probe = (
        "import sys\ndef test_bare():\n    heavy = {'numpy', 'transitions', 'pydantic', 'twin_gait.gait'}\n"
    )
    (folder / "test_other.py").write_text(
        f"{probe}    assert not heavy & set(sys.modules)\n", encoding="utf-8"
    )
    done = run(folder, "-v", "-p", "no:hypothesispytest")
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout and "walk.yaml" not in done.stdout
