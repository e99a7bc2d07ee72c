"""Tests of the check for values of an experiment outside the ranges of the DBC file."""

from __future__ import annotations

import re

import pytest
from errors import states

from twin_gait.checking.check import load_case
from twin_gait.checking.finding import Severity
from twin_gait.checking.network import bus_value_range
from twin_gait.configuration.experiments import presets
from twin_gait.files import shipped_file
from twin_gait.network.dbc import PACKAGED_DBC

SHIPPED = f"network={{dbc: {PACKAGED_DBC}}}"


@pytest.mark.parametrize("preset", presets())
def test_generated_ranges_cover_the_presets(preset):
    assert bus_value_range(load_case(None, preset, ["network=can"])) == []


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        (
            "control.limits.current_A=20",
            ("control.limits.current_A", "control.safety.current_share", "24 A"),
        ),
        (
            "control.safety.hold_damping_Nms_per_rad=300",
            ("hold_damping_Nms_per_rad", "300", "0"),
        ),
        ("control.target_torque_Nm.hip=-110", ("control.target_torque_Nm.hip", "-110", "-102.375")),
        (
            "table.phases.early_stance.knee.stiffness_Nm_per_deg=20",
            ("table.phases.early_stance.knee", "stiffness", "1145.92", "0", "1023.75"),
        ),
        (
            "table.phases.late_stance.hip.equilibrium_deg=-50",
            ("table.phases.late_stance.hip", "equilibrium", "-0.872665 rad", "-0.8", "2.4764 rad"),
        ),
    ],
)
def test_a_value_outside_its_range_is_reported_once_with_range_and_suggestion(setting, expected):
    (finding,) = bus_value_range(load_case(None, "bench_leg", [setting, SHIPPED]))
    assert states(finding.reason, *expected) and re.search(r"\bright_\w+", finding.reason)


def test_springs_of_the_control_unit_are_not_sent_over_the_bus():
    stiff = "table.phases.early_stance.knee.stiffness_Nm_per_deg=20"
    for impedance, n_lines in (("board", 1), ("ccu", 0)):
        case = load_case(None, "bench_leg", [stiff, f"network.impedance={impedance}"])
        assert len(bus_value_range(case)) == n_lines


def test_check_refuses_values_outside_the_ranges_of_the_network():
    settings = ["control.limits.current_A=20"]
    assert bus_value_range(load_case(None, "treadmill_guided", settings)) == []
    (finding,) = bus_value_range(load_case(None, "treadmill_guided", [*settings, SHIPPED]))
    assert finding.severity is Severity.ERROR and states(finding.reason, "24 A")
    assert (
        bus_value_range(load_case(None, "treadmill_guided", [*settings, "network=can"])) == []
    )  # the range widens
    assert states(finding.suggestion, "DBC")


def test_narrower_dbc_files_reject_more_values(tmp_path):
    text, path = shipped_file("twin.dbc").read_text(encoding="ascii"), tmp_path / "narrow.dbc"
    torque, small = "(0.025,0) [-102.375|102.375]", "(0.01,0) [-40.95|40.95]"
    path.write_text(text.replace(torque, small), encoding="ascii")
    found = bus_value_range(load_case(None, "treadmill_guided", [f"network={{dbc: {path}}}"]))
    assert [finding.reason.partition(": ")[0] for finding in found] == ["control.limits.torque_Nm"]
