"""Values of the device that a preset or a default leaves next to those of the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from errors import states

from twin_gait import load_experiment, presets
from twin_gait.cli import main
from twin_gait.configuration.inheritance import inherited_values

BATTERY = {"internal_resistance_Ohm": 0.2, "continuous_power_W": 330.0, "energy_J": 92.2 * 3600.0}
QUICK = ("--duration", "0.02", "--engine", "pinocchio", "--no-pictures")


def inherited(*settings: str, source: str | Path = "bench_leg") -> dict[str, dict[str, Any]]:
    loaded = load_experiment(source, settings)
    return inherited_values(loaded.document, loaded.user_values)


def test_keys_missing_in_a_battery_pack_are_inherited_from_the_preset() -> None:
    assert inherited("plant.battery.voltage_V=48") == {"plant.battery": BATTERY}


def test_an_own_friction_law_keeps_the_ratio_of_its_joint() -> None:
    law = "{breakaway_torque_Nm: 2, coulomb_friction_Nm: 3, breakaway_velocity_rad_per_s: 0.1}"
    assert inherited(f"plant.friction.knee={law}") == {
        "plant.friction_ratio": {"knee": 0.5},
        "plant.friction.knee": {"viscous_friction_Nms_per_rad": 2.06},
    }


def test_own_gears_keep_the_efficiency_of_the_base_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "preset: treadmill_ankle\nplant: {actuators: {hip: {gear_ratio: 50}}}\n", encoding="utf-8"
    )
    found = inherited(source=path)
    assert set(found) == {"plant.actuators.hip", "plant.friction_ratio"}
    assert {"gear_efficiency", "rotor_inertia_kgm2"} <= set(found["plant.actuators.hip"])
    assert "gear_ratio" not in found["plant.actuators.hip"]


def test_values_of_file_and_settings_are_not_inherited(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("preset: treadmill\nplant: {battery: {voltage_V: 48, energy_J: 1e6}}\n", encoding="utf-8")
    rest = inherited("plant.battery.continuous_power_W=500", source=path)
    assert rest == {"plant.battery": {"internal_resistance_Ohm": 0.2}}


def test_a_quantity_in_another_unit_is_given() -> None:
    ankle = inherited("plant.ankle.stiffness_Nm_per_deg=2")["plant.ankle"]
    assert ankle == {"relative_stiffness": 0.0, "damping_Nms_per_rad": 6, "rest_deg": 7}


@pytest.mark.parametrize(
    "settings",
    [[], ["patient.mass_kg=80"], ["plant.gravity_m_per_s2=9.8"], ["plant.friction_ratio.knee=1"], ["seed=3"]],
)
def test_settings_outside_the_device_components_inherit_nothing(settings: list[str]) -> None:
    assert inherited(*settings) == {}


@pytest.mark.parametrize("name", sorted(presets()))
def test_a_preset_by_its_name_inherits_nothing(name: str) -> None:
    assert inherited(source=name) == {}


def test_simulate_prints_inherited_values_on_one_line_and_stores_all_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, again = tmp_path / "run", tmp_path / "again"
    setting = "plant.battery.voltage_V=48"
    assert main(["simulate", "bench_leg", *QUICK, "--set", setting, "--out", str(run)]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert states(line, "plant.battery")
    assert "energy_J 331920" in line
    assert main(["simulate", str(run), "--no-pictures", "--out", str(again)]) == 0
    assert capsys.readouterr().err == ""
