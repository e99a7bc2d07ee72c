"""The examples run, and show what they say they show."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_first_gait(tmp_path, capsys):
    load("first_gait").main(tmp_path, duration=6.5)
    assert (tmp_path / "first_gait.png").read_bytes().startswith(b"\x89PNG")
    assert "completed" in capsys.readouterr().out


def test_a_shifted_equilibrium_flexes_the_knee_further(capsys):
    load("change_the_table").main(duration=4.5)
    normal, shifted = (float(value) for value in re.findall(r"flexion ([\d.]+)°", capsys.readouterr().out))
    assert shifted > normal + 2.0


def test_the_hand_needs_less_with_more_compensation(capsys):
    load("bench_leg").main()
    work = [float(value) for value in re.findall(r"N m\s+([\d.]+) J", capsys.readouterr().out)]
    assert len(work) == 3
    assert work[0] > work[1] > work[2] > 0.0
