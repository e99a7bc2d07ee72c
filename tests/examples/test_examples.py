"""The short examples show what they say they show."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"


def results_of(name, folder):
    """Results of the quick form of a script."""
    subprocess.run([sys.executable, EXAMPLES / f"{name}.py", "--quick", "--out", folder], check=True)
    return json.loads((folder / "results.json").read_text())


def test_first_gait(tmp_path):
    found = results_of("first_gait", tmp_path)
    assert found["outcome"] == "walked" and 1.5 < found["stride_s"] < 2.5
    assert (tmp_path / "first_gait.png").read_bytes().startswith(b"\x89PNG")


def test_a_shifted_equilibrium_flexes_the_knee_further(tmp_path):
    normal, shifted = (row["peak_flexion_deg"] for row in results_of("change_the_table", tmp_path)["rows"])
    assert shifted > normal + 2.0


def test_imposing_a_motion_takes_less_with_more_compensation(tmp_path):
    work = [row["work_J"] for row in results_of("bench_leg", tmp_path)["rows"]]
    assert work[0] > work[1] > work[2] > 0.0


def test_a_knee_that_sticks_stays_where_a_static_law_creeps(tmp_path):
    found = results_of("friction_presliding", tmp_path)
    assert found["lugre"]["let_go_way_in_the_second_half_deg"] < 1e-3
    assert found["static"]["let_go_way_in_the_second_half_deg"] > 1.0
    assert found["lugre"]["largest_friction_Nm"] < found["breakaway_torque_Nm"]
    assert found["lugre"]["slips"] >= 3
    assert (tmp_path / "friction_presliding.png").read_bytes().startswith(b"\x89PNG")


def test_the_table_of_the_firmware_is_of_tables_that_are_proven():
    found = json.loads((EXAMPLES / "results" / "firmware" / "results.json").read_text())
    for row in found["rows"]:
        assert row["other bits in double"] == row["on the target"] == 0 < row["numbers compared"]
        assert row["board: flash [B]"] <= 4096 and row["board: RAM [B]"] <= 512
        assert row["controller: flash [B]"] <= 12 * 1024 and row["controller: RAM [B]"] <= 2048
        most = 7500 if row["table"] == "treadmill_ankle" else 5000  # of six boards, of four
        assert row["worst tick"] <= min(found["worst_instructions"], most)
        assert row["processor in the loop"] == "walked"
