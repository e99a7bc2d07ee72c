"""Which values of an experiment the DBC file has no room for."""

from __future__ import annotations

import pytest

from twin_gait.checking.check import load_case
from twin_gait.checking.finding import Severity
from twin_gait.checking.network import bus_value_range
from twin_gait.configuration.experiments import load_experiment, presets
from twin_gait.files import shipped_file
from twin_gait.parameters.network import BOARD_JOINTS

ON_THE_BUS = [name for name in presets() if tuple(load_experiment(name).experiment.joints) == BOARD_JOINTS]


@pytest.mark.parametrize("preset", ON_THE_BUS)
def test_the_shipped_file_carries_what_ships(preset):
    assert bus_value_range(load_case(None, preset, ["network=can"])) == []


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("control.limits.current_A=20", "control.limits.current_A times control.safety.current_share: 24 A"),
        ("control.safety.hold_damping_Nms_per_rad=300", "hold_damping_Nms_per_rad: 300 Nms/rad is outside 0"),
        ("control.target_torque_Nm.hip=-110", "control.target_torque_Nm.hip: -110 Nm is outside -102.375 to"),
        (
            "table.phases.early_stance.knee.stiffness_Nm_per_deg=20",
            "table.phases.early_stance.knee: stiffness: 1145.92 Nm/rad is outside 0 to 1023.75 Nm/rad",
        ),
        (
            "table.phases.late_stance.hip.equilibrium_deg=-50",
            "table.phases.late_stance.hip: equilibrium: -0.872665 rad is outside -0.8 to 2.4764 rad",
        ),
    ],
)
def test_a_value_without_room_is_said_once_with_range_and_way_out(setting, said):
    (finding,) = bus_value_range(load_case(None, "bench_leg", [setting, "network=can"]))
    assert said in finding.reason and "the range of right_" in finding.reason


def test_springs_of_the_control_unit_do_not_go_over_the_bus():
    stiff = "table.phases.early_stance.knee.stiffness_Nm_per_deg=20"
    for place, n_lines in (("board", 1), ("ccu", 0)):
        case = load_case(None, "bench_leg", [stiff, f"network.impedance={place}"])
        assert len(bus_value_range(case)) == n_lines


def test_check_refuses_what_a_network_has_no_room_for():
    settings = ["control.limits.current_A=20"]
    assert bus_value_range(load_case(None, "treadmill", settings)) == []
    (finding,) = bus_value_range(load_case(None, "treadmill", [*settings, "network=can"]))
    assert finding.severity is Severity.ERROR and "24 A is outside" in finding.reason
    assert finding.suggestion == "take a value within it, or a DBC file with a wider one"


def test_narrower_files_have_less_room(tmp_path):
    text, path = shipped_file("twin.dbc").read_text(encoding="ascii"), tmp_path / "narrow.dbc"
    torque, small = "(0.025,0) [-102.375|102.375]", "(0.01,0) [-40.95|40.95]"
    path.write_text(text.replace(torque, small), encoding="ascii")
    found = bus_value_range(load_case(None, "treadmill", [f"network={{dbc: {path}}}"]))
    assert [finding.reason.partition(": ")[0] for finding in found] == ["control.limits.torque_Nm"]
