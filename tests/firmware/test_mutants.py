"""Tests that the test of a printed project detects a changed constant in each of its units."""

from __future__ import annotations

import json
from pathlib import Path

import firmware
import pytest
from firmware_tools import require_tools
from printed_c.changed_constants import Unit, classified

from twin_gait.cli.program import main

BOARD = (
    "lower upper highest_speed stop_distance_factor angle_step frozen_speed frozen_ticks model_gain "
    "model_deviation highest_torque torque_ticks highest_current heating cooling drive_deviation drive_ticks "
    "emf_constant model_resistance hold_damping lowering_ticks fast_gain decimation period breakaway_torque "
    "coulomb_friction viscous_friction"
)
NOTICED = {
    "joint_board": f"{BOARD} controller_timeout highest_command command_deviation command_gain",
    "gait_controller": "phase_ticks frozen_load_ticks board_timeout lowering_ticks hold_damping stiffness "
    "damping threshold least_voltage low_ticks frozen_speed timeout_ticks debounce_ticks operation "
    "n_transitions",
    "exoskeleton": f"{BOARD} stiffness damping frozen_speed",
    "can_codec": "identifier length half start mask sign missing scale offset lowest highest",
}
# Fields of the constants for which neither an effect nor a reason was shown.
NOT_NOTICED = {"gait_controller": ["operand", "factor_a", "threshold"]}
RESULTS = Path(firmware.__file__).parent / "results" / "firmware" / "results.json"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("firmware") / "c"
    assert main(["firmware", "treadmill_guided", "--out", str(out)]) == 0
    return out


@pytest.mark.parametrize("name", NOTICED)
def test_one_changed_constant_of_each_field_is_noticed(folder, tmp_path, name):
    require_tools("gcc")
    unit, first = Unit(folder, name, tmp_path / "build"), dict[str, int]()
    for number, change in enumerate(unit.changes, 1):
        if ".mask = 0," not in change.entry and f".{change.field} = -1" not in change.entry:
            first.setdefault(change.field, number)
    assert not unit.detects(0)
    assert [field for field in NOTICED[name].split() if not unit.detects(first[field])] == []


@pytest.mark.parametrize("name", NOTICED)
def test_the_stored_table_has_every_constant(folder, tmp_path, name):
    require_tools("gcc")
    rows = json.loads(RESULTS.read_text(encoding="utf-8"))["constants"]
    (row,) = [row for row in rows if row["unit"] == f"`{name}`"]
    counts = {key: value for key, value in row.items() if key != "unit"}
    assert (
        counts.pop("constants") == len(Unit(folder, name, tmp_path / "build").changes) == sum(counts.values())
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["joint_board", "gait_controller", "can_codec"])
def test_a_changed_constant_is_noticed_or_has_no_effect(folder, tmp_path, name):
    require_tools("gcc")
    counts, unexplained = classified(Unit(folder, name, tmp_path / "build"))
    assert [change.field for change in unexplained] == NOT_NOTICED.get(name, [])
    assert counts["noticed"] > 100
