"""Test that the sizes on the page of the firmware match the current units."""

from __future__ import annotations

import json
from pathlib import Path

import firmware
import pytest

from twin_gait import load_experiment
from twin_gait.firmware.project import GAIT_CONTROLLER, JOINT_BOARD, print_project

RESULTS = Path(firmware.__file__).parent / "results" / "firmware" / "results.json"


@pytest.mark.parametrize("name", firmware.TABLES)
def test_the_stored_record_sizes_equal_a_new_print(name: str) -> None:
    preset, *changes = firmware.TABLES[name]
    (row,) = [row for row in json.loads(RESULTS.read_text(encoding="utf-8"))["rows"] if row["table"] == name]
    printed = print_project(load_experiment(preset, changes).experiment).record_bytes
    found = {"board: RAM [B]": printed[JOINT_BOARD], "controller: RAM [B]": printed[GAIT_CONTROLLER]}
    stored = {key: row[key] for key in found}
    assert stored == found, "run examples/firmware.py again, then docs/insert.py"
