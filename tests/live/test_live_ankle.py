"""The panel of a live walk sets a driven ankle as it sets hip and knee."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait import load_experiment
from twin_gait.checking.published_ranges import STIFFNESS_RANGES
from twin_gait.live.controls import ControlPanel, action_specs, action_values
from twin_gait.live.forecast import find_errors
from twin_gait.live.protocol import DoAction
from twin_gait.simulation.settings import loop_numbers
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.vocabulary import JointName, Side

WALK = "treadmill_ankle"


@pytest.fixture(scope="module")
def panel() -> ControlPanel:
    return ControlPanel(load_experiment(WALK, ["duration_s=60"]).experiment)


def test_every_phase_has_four_controls_of_the_ankle_in_its_ranges(panel: ControlPanel) -> None:
    controls = [item for item in panel.controls(panel.preset) if item.joint == "ankle"]
    table = [item for item in controls if item.group == "table"]
    assert len(table) == 4 * len(panel.preset.table.phases)
    assert len([item for item in controls if item.group == "monitor"]) == 2 * 5
    by_name = {item.name: item for item in table}
    limit = panel.preset.experiment.control.limits[JointName.ANKLE].torque
    # The spring alone reaches the torque limit at a deflection of 4 deg.
    assert by_name["late_stance.ankle.stiffness"].maximum == pytest.approx(limit / 4.0)
    # Beyond the stops at 30 deg, as far as the stiffest published spring takes to reach the limit.
    angle, beyond = by_name["late_stance.ankle.equilibrium"], limit / STIFFNESS_RANGES[JointName.ANKLE].high
    assert angle.minimum == pytest.approx(-30.0 - beyond, abs=1.0)
    assert angle.maximum == pytest.approx(30.0 + beyond, abs=1.0)


def test_a_control_of_the_ankle_reaches_its_numbers_and_no_other(panel: ControlPanel) -> None:
    changed = panel.set(panel.preset, "late_stance.ankle.stiffness", 2.5)
    begun = np.radians(panel.preset.table.phases["late_stance"].joints["ankle"].stiffness)
    before, after = (np.array(loop_numbers(item)["phase_rows"]) for item in (panel.preset, changed))
    phase = panel.simulation_setup.table.phase_index("late_stance")
    assert np.argwhere(before != after).tolist() == [[0, phase, 8], [1, phase, 8]]
    # The table's law scales both by the mass that is carried.
    assert after[0, phase, 8] / before[0, phase, 8] == pytest.approx(2.5 / begun)
    assert panel.revert(changed, "late_stance.ankle.stiffness") == panel.preset


@pytest.mark.slow
def test_the_monitor_drives_the_ankle(panel: ControlPanel) -> None:
    driving = panel.set(panel.preset, "mode", "torque_control")
    settings = panel.set(driving, "monitor.right.ankle.torque", -3.0)
    assert loop_numbers(settings)["target_torque"] == [0.0] * 5 + [-3.0]
    loose = panel.set(panel.preset, "monitor.left.ankle.damping", 0.0)
    assert loose.monitor[Side.LEFT].joints["ankle"].damping == 0.0
    assert find_errors(panel.preset) == {}


@pytest.mark.slow
def test_a_push_on_the_ankle_moves_it(panel: ControlPanel) -> None:
    message = DoAction(action="push", values={"joint": "left_ankle", "torque": 20.0}, id="1", user="")
    values = action_values(action_specs(panel.simulation_setup), message)
    assert (panel.simulation_setup.joints[2].side, panel.simulation_setup.joints[2].joint) == (
        "left",
        "ankle",
    )
    pushed, free = SteppedRun(panel.simulation_setup), SteppedRun(panel.simulation_setup)
    pushed.push(2, float(values["torque"]), 100)
    column = pushed.layout.names.index("left_ankle_angle_rad")
    first, second = (run.advance(100)[-1, column] for run in (pushed, free))
    assert first > second + 0.01
