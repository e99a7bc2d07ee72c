"""Studies of a device on one leg: its measures are those of its drives, and the gait is that of both legs."""

import math

import numpy as np
import pytest

from twin_gait import Run, load_experiment, simulate
from twin_gait.live.controls import ControlPanel
from twin_gait.live.forecast import predict
from twin_gait.measures import effort, strides
from twin_gait.runs.leg_summary import MeasuredLeg
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.studies.accuracy import step_error
from twin_gait.studies.compare.measures import run_measures
from twin_gait.studies.fault_campaign import draw_faults, simulate_faults, violations
from twin_gait.vocabulary import JointName, Side

PRESET = "knee_orthosis"


@pytest.fixture(scope="module")
def walk() -> Run:
    return simulate(load_experiment(PRESET, ["duration_s=12"]).experiment)


def test_comparison_measures_the_gait_of_both_legs_and_the_effort_of_the_drives(walk: Run) -> None:
    found = run_measures(walk)
    assert found["walked"] == 1.0
    for name in ("stride_time_s", "hip_range_of_motion_deg", "left_knee_gvs_koopman_deg", "gps_koopman_deg"):
        assert math.isfinite(found[name]), name
    ranges = [found[f"{side}_knee_range_of_motion_deg"] for side in Side]
    assert found["knee_range_of_motion_deg"] == pytest.approx(np.mean(ranges))
    # The only drive is the left knee.
    leg = MeasuredLeg(walk, walk.leg_record(Side.LEFT))
    current = strides.values_in_strides(walk.log["left_knee_measured_current_A"].to_numpy(), leg.strides)
    assert found["knee_current_rms_A"] == pytest.approx(effort.root_mean_square(current))
    assert found["interaction_rms_Nm"] == pytest.approx(found["left_knee_interaction_rms_Nm"]) != 0.0
    assert "hip_interaction_rms_Nm" not in found and "right_knee_current_rms_A" not in found
    assert math.isnan(found["interaction_symmetry"])


@pytest.mark.slow  # compiles the loop of the lanes
def test_faults_are_those_of_the_device(walk: Run) -> None:
    faults = draw_faults(walk.experiment, 5, seed=0)
    table = simulate_faults(walk.experiment, faults[:2])
    assert {fault.joint for fault in faults} <= {JointName.KNEE, None}
    assert len(table) == 2 and violations(table).empty
    assert (table["torque_peak_Nm"] > 0.0).all()


def test_step_is_judged_by_all_joints_that_move() -> None:
    short = simulate(load_experiment(PRESET, ["duration_s=0.3"]).experiment)
    assert 0.0 < step_error(short)["largest_angle_error_rad"] < 1e-3


def test_forecast_has_the_deviation_of_both_legs_and_the_limits_of_the_drive() -> None:
    panel = ControlPanel(load_experiment(PRESET, ["duration_s=60"]).experiment)
    walking, ahead = SteppedRun(panel.simulation_setup), SteppedRun(panel.simulation_setup)
    walking.advance(6000)
    forecast = predict(ahead, walking.snapshot(), panel.preset)
    assert not forecast.bad and forecast.text.startswith("walks on")
    assert set(forecast.rmse_deg) == {"hip", "knee"}
    assert 0.0 <= forecast.saturated_share < 1.0
