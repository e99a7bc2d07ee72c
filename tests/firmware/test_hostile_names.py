"""Tests that no text of a user reaches the modules that execute generated code."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml

import twin_gait
from twin_gait import load_experiment, simulate
from twin_gait.firmware.project import print_project

PACKAGE = Path(twin_gait.__file__).parent
HOSTILE = "__import__('os').mkdir('owned')"


def renamed(value, old, new):
    """Replace a text in all keys and values of a document."""
    if isinstance(value, dict):
        return {renamed(key, old, new): renamed(item, old, new) for key, item in value.items()}
    if isinstance(value, list):
        return [renamed(item, old, new) for item in value]
    return value.replace(old, new) if isinstance(value, str) else value


def test_code_from_text_is_run_in_known_places_only():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("eval", "exec", "__import__"):
                found.add((path.relative_to(PACKAGE).as_posix(), node.func.id))
    written = {("simulation/binding.py", "exec"), ("simulation/executors.py", "exec")}
    # The environments for learning evaluate the expressions of the log, which are files of the package.
    read = {("learn/signals.py", "eval"), ("learn/signals.py", "exec")}
    assert found == {("firmware/source.py", "eval"), *written, *read}


@pytest.mark.parametrize("hostile", [HOSTILE, "*/ #include <x> /*"])
def test_names_of_a_table_reach_neither_the_kernel_nor_the_c(tmp_path, monkeypatch, hostile):
    monkeypatch.chdir(tmp_path)
    shipped = yaml.safe_load((PACKAGE / "configuration" / "tables" / "treadmill_guided.yaml").read_text())
    document = renamed(shipped, "middle_stance", hostile)
    document["name"] = hostile
    table = tmp_path / "table.yaml"
    table.write_text(yaml.safe_dump(document, sort_keys=False))
    experiment = load_experiment("treadmill_guided", [f"table={table}", "duration_s=0.05"]).experiment
    assert hostile in experiment.table.phases
    project = print_project(experiment)
    expected = print_project(load_experiment("treadmill_guided").experiment)
    assert project.exoskeleton.kernel == expected.exoskeleton.kernel
    assert project.program.files == expected.program.files
    simulate(experiment)
    assert not (tmp_path / "owned").exists()
