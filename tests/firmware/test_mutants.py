"""The test of a printed project notices a changed constant in each of its units."""

from __future__ import annotations

from pathlib import Path

import pytest
from c_mutants import copied_project, mutants
from firmware_tools import require_tools

from twin_gait.cli.program import main

# Bounds, heat model and limits of a board, and what the gait controller compares and counts.
NOTICED = {
    "joint_board": "lower upper highest_speed stop_distance_factor angle_step frozen_speed frozen_ticks "
    "model_gain model_deviation highest_torque torque_ticks highest_command highest_current heating cooling "
    "drive_deviation drive_ticks emf_constant model_resistance controller_silence lowering_ticks "
    "hold_damping fast_gain decimation period breakaway_torque coulomb_friction viscous_friction",
    "gait_controller": "phase_ticks frozen_load_ticks board_silence lowering_ticks hold_damping stiffness "
    "damping threshold least_voltage low_ticks frozen_speed time_out_ticks",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("firmware") / "c"
    assert main(["firmware", "--out", str(out)]) == 0
    return out


@pytest.mark.parametrize("unit", NOTICED)
def test_one_changed_constant_of_each_field_is_noticed(folder, tmp_path, unit):
    require_tools("gcc")
    project, first = copied_project(folder, tmp_path / "c", unit), {}
    for mutant in mutants((folder / f"{unit}.c").read_text()):
        name, value = mutant.name.split()
        if value != "1":  # A time-out of -1 tick is none, as any other below 0.
            first.setdefault(name.rpartition(".")[2], mutant)
    wanted = NOTICED[unit].split()
    assert [name for name in wanted if not project.notices(first[name])] == []
