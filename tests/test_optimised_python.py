"""``python -OO`` removes docstrings and assertions; the program and its help work without them."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from errors import raises

import twin_gait
from twin_gait.configuration.validation import merge, quantity_of
from twin_gait.docstrings import docstring_of, summary_of
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.drives import ActuatorParameters
from twin_gait.parameters.quantities import EXCHANGEABLE, QuantityUnits

PACKAGE = Path(twin_gait.__file__).parent


def run(*arguments: str, optimised: bool) -> subprocess.CompletedProcess[str]:
    options = ["-OO"] if optimised else []
    command = [sys.executable, *options, "-m", "twin_gait", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_a_walk_runs_without_docstrings(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    quick = ("--engine", "pinocchio", "--duration", "0.05", "--no-pictures")
    done = run("simulate", "bench_leg", *quick, "--out", out, optimised=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "summary.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("check", "treadmill_guided"), ("--help",)])
def test_the_program_prints_the_same_without_docstrings(arguments: tuple[str, ...]) -> None:
    usual, optimised = (run(*arguments, optimised=item) for item in (False, True))
    assert len(usual.stdout) > 500
    assert (optimised.returncode, optimised.stdout) == (usual.returncode, usual.stdout)


def test_docstrings_are_read_from_the_source_if_python_removed_them(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = docstring_of(ActuatorParameters)
    assert "Attributes:" in usual
    docstring_of.cache_clear()
    monkeypatch.setattr("twin_gait.docstrings.sys.flags", type("Flags", (), {"optimize": 2}))
    assert docstring_of(ActuatorParameters) == usual
    assert summary_of(int) == ""  # has no source
    docstring_of.cache_clear()


def trees() -> list[tuple[Path, ast.Module]]:
    paths = sorted(PACKAGE.rglob("*.py"))
    return [(path.relative_to(PACKAGE), ast.parse(path.read_text(encoding="utf-8"))) for path in paths]


def test_docstrings_are_read_in_one_place_only() -> None:
    found = {
        str(path)
        for path, tree in trees()
        for node in ast.walk(tree)
        if (isinstance(node, ast.Attribute) and node.attr == "__doc__" and isinstance(node.ctx, ast.Load))
        or (isinstance(node, ast.Attribute) and node.attr == "getdoc")
    }
    assert found == {"docstrings.py"}


def test_no_behaviour_depends_on_an_assert_statement() -> None:
    """Assertions only narrow types; the test kit and messages need a raise."""
    deciding = [
        f"{path}:{node.lineno}"
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Assert) and (path.parts[0] == "testing" or node.msg is not None)
    ]
    known = ["simulation/views.py"]  # mistakes of authors of laws, found when a test compiles the law
    assert [location for location in deciding if location.partition(":")[0] not in known] == []


def test_units_that_are_declared_after_the_import_are_known() -> None:
    assert quantity_of("grip_stone_per_ell") == "grip_stone_per_ell"
    before = set(EXCHANGEABLE)
    try:
        QuantityUnits("kg_per_m", stone_per_ell=5.6)
        assert quantity_of("grip_stone_per_ell") == quantity_of("grip_kg_per_m") == "grip"
        assert merge({"grip_kg_per_m": 1.0}, {"grip_stone_per_ell": 2.0}) == {"grip_stone_per_ell": 2.0}
        with raises(ParameterError, "grip_kg_per_m", "grip_stone_per_ell"):
            merge({}, {"grip_kg_per_m": 1.0, "grip_stone_per_ell": 2.0})
    finally:
        EXCHANGEABLE.intersection_update(before)
