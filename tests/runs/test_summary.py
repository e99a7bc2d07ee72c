"""Tests of the summary of a walk with known measures, of a one-legged run, and of an empty run."""

from __future__ import annotations

import json
import math
import platform
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio
import pytest
from synthetic_run import (
    CLEARANCE,
    CYCLE,
    DIP,
    ENERGY_SLIP,
    HIP_OFFSET,
    KNEE_AMPLITUDE,
    LAG,
    LENGTH,
    N_STRIDES,
    PHASE_TICKS,
    PHASES,
    STRIDE,
    SWING,
    synthetic_experiment,
    synthetic_run,
)

import twin_gait
from twin_gait import load_experiment, simulate
from twin_gait.control.safety import Trip, TripCause
from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.parameters.environment import BeltProfile
from twin_gait.report.formatting import (
    amount,
    belt_carries_note,
    extrapolation_note,
    format_table,
    walk_table,
)
from twin_gait.runs.summary import describe_identity, software_versions, summarise_run
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.treadmill import Treadmill


@pytest.fixture(scope="module")
def walk() -> Run:
    return synthetic_run()


@pytest.fixture(scope="module")
def summary(walk: Run) -> dict[str, Any]:
    return summarise_run(walk)


@pytest.fixture(scope="module")
def bench_run() -> Run:
    """Return a bench run with one stride in the air."""
    return simulate(replace(load_experiment("bench_leg").experiment, duration=3.0))


def leaves(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [leaf for item in value.values() for leaf in leaves(item)]
    return [value]


def test_summary_is_json_and_comes_back_equal(summary: dict[str, Any]) -> None:
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert {type(leaf) for leaf in leaves(summary)} <= {int, float, str, bool, type(None)}


def test_run_is_described(summary: dict[str, Any]) -> None:
    assert summary["name"] == "synthetic"
    assert summary["engine"] == "compiled"
    assert summary["status"] == "completed" and summary["fell"] is False and summary["reason"] == ""
    assert summary["duration_s"] == pytest.approx(LENGTH * TICK)
    assert summary["realtime_factor"] == pytest.approx(LENGTH * TICK / 3.6)


def test_versions_equal_the_imported_packages() -> None:
    found = software_versions()
    assert found["twin_gait"] == twin_gait.__version__
    assert found["python"] == platform.python_version()
    assert found["numpy"] == np.__version__
    assert found["pinocchio"] == pinocchio.__version__


@pytest.mark.parametrize("side", ["left", "right"])
def test_strides_of_the_known_walk(summary: dict[str, Any], side: str) -> None:
    values = summary["sides"][side]
    # Six heel strikes make five strides, of which the first two do not count.
    assert (values["strides"], values["strides_counted"]) == (N_STRIDES - 1, N_STRIDES - 3)
    assert values["stride_time_mean_s"] == pytest.approx(STRIDE * TICK)
    assert values["stride_time_variation"] == pytest.approx(0.0, abs=1e-12)
    assert values["swing_share"] == pytest.approx(SWING / STRIDE)
    assert values["toe_clearance_min_m"] == pytest.approx(DIP)
    assert DIP < CLEARANCE
    assert (values["further_contacts"], values["scuffs"]) == (0, 0)


@pytest.mark.parametrize("side", ["left", "right"])
def test_early_stance_leads_each_heel_strike_by_the_known_time(summary: dict[str, Any], side: str) -> None:
    values = summary["sides"][side]
    assert values["early_stance_lag_mean_s"] == pytest.approx(LAG * TICK)
    assert values["early_stance_lag_max_abs_s"] == pytest.approx(LAG * TICK)
    assert values["heel_strikes_without_early_stance"] == 0


@pytest.mark.parametrize("stop", [math.inf, 0.45 * LENGTH * TICK])
def test_only_a_contact_of_the_even_walk_can_be_missed(walk: Run, stop: float) -> None:
    missed = walk.leg_record(Side.LEFT).first_phase_entries[3]
    assert missed * TICK > 0.45 * LENGTH * TICK
    log = walk.log.copy()
    late = log["left_phase"].iloc[missed - 1]
    log.loc[missed : missed + STRIDE // 2, "left_phase"] = late
    belt = BeltProfile(start=0.0, stop=stop, ramp=TICK, delay=0.0)
    experiment = replace(walk.experiment, scenario=replace(walk.experiment.scenario, belt=belt))
    found = summarise_run(replace(walk, log=log, experiment=experiment))["sides"]["left"]
    assert found["heel_strikes_without_early_stance"] == (1 if stop == math.inf else 0)


@pytest.mark.parametrize("side", ["left", "right"])
def test_error_from_contact_equals_the_imposed_error(summary: dict[str, Any], side: str) -> None:
    values = summary["sides"][side]
    # Between ticks the curves are interpolated linearly, which errs by less than 1e-3 deg.
    assert values["rmse_hip_by_contact_deg"] == pytest.approx(math.degrees(HIP_OFFSET), abs=1e-3)
    expected = math.degrees(KNEE_AMPLITUDE / math.sqrt(2.0))
    assert values["rmse_knee_by_contact_deg"] == pytest.approx(expected, abs=1e-3)


def test_phases_of_the_known_walk(summary: dict[str, Any]) -> None:
    for values in summary["sides"].values():
        assert values["phases_in_order"] is True
        for name, ticks in zip(PHASES, PHASE_TICKS, strict=True):
            assert values["phase_duration_mean_s"][name] == pytest.approx(ticks * TICK)
        assert values["stride_time_by_phase_mean_s"] == pytest.approx(STRIDE * TICK)


def test_joint_motion_and_effort_of_the_known_walk(walk: Run, summary: dict[str, Any]) -> None:
    hip = summary["sides"]["left"]["joints"]["hip"]
    angle = np.degrees(walk.log["left_hip_angle_rad"].to_numpy()[LAG : LAG + STRIDE])
    assert hip["range_of_motion_deg"] == pytest.approx(angle.max() - angle.min())
    assert hip["peak_deg"] == pytest.approx(angle.max())
    # The motor torque is 20 sin: below every limit.
    assert hip["torque_peak_Nm"] == pytest.approx(20.0)
    assert hip["torque_rms_Nm"] == pytest.approx(20.0 / math.sqrt(2.0))
    assert hip["torque_continuous_share"] == pytest.approx(20.0 / math.sqrt(2.0) / 43.0)
    assert hip["saturated_share"] == 0.0


def test_symmetric_walk_has_no_asymmetry(summary: dict[str, Any]) -> None:
    assert all(value == pytest.approx(0.0, abs=1e-9) for value in summary["symmetry"].values())


def test_error_from_phase_entry_equals_the_error_of_a_shifted_curve(summary: dict[str, Any]) -> None:
    # A stride that begins 0.2 s early is compared with the reference 16.7 % of a cycle too late.
    assert summary["sides"]["left"]["rmse_knee_by_phase_deg"] > 10.0


def test_battery_and_energy_of_the_known_walk(summary: dict[str, Any]) -> None:
    assert summary["battery_power_mean_W"] == pytest.approx(40.0)
    assert summary["battery_power_peak_W"] == 100.0
    assert summary["battery_power_lowest_W"] == -20.0
    assert summary["battery_energy_J"] == pytest.approx(40.0 * LENGTH * TICK)
    assert summary["energy_residual_J"] == pytest.approx(ENERGY_SLIP)
    assert summary["energy_throughput_J"] == pytest.approx(60.0)
    assert summary["energy_residual_share"] == pytest.approx(ENERGY_SLIP / 60.0)


def test_torque_at_switches_is_evaluated_until_their_blends_end(walk: Run) -> None:
    log = walk.log.copy()
    command = log["right_knee_motor_command_torque_Nm"].to_numpy().copy()
    switch = next(item for item in walk.switches if item.side == "right" and item.tick > 3000)
    command[:] = 0.0
    command[switch.tick :] = 35.0
    command[switch.tick + 40] = -50.0  # within the 60 ticks of blending
    command[switch.tick + 90] = 500.0  # after them
    log["right_knee_motor_command_torque_Nm"] = command
    knee = summarise_run(replace(walk, log=log))["sides"]["right"]["joints"]["knee"]
    assert knee["switch_torque_change_Nm"] == 50.0
    assert knee["switch_torque_jump_Nm"] == 85.0  # from 35 to -50
    slow = {**walk.table.phases, switch.target: replace(walk.table.phases[switch.target], blending_ticks=90)}
    table = replace(walk.table, phases=slow)
    knee = summarise_run(replace(walk, log=log, table=table))["sides"]["right"]["joints"]["knee"]
    assert knee["switch_torque_change_Nm"] == 500.0  # a phase with a time of blending of its own


def stiffness_and_equilibrium_by_phase(walk: Run, equilibrium: float) -> Run:
    """Set the left knee to 0.2 rad with 300 N·m/rad in early stance, else to 0.1 rad with 100 N·m/rad."""
    early = (walk.log["left_phase"] == "early_stance").to_numpy()
    columns = {
        "measured_angle_rad": np.where(early, 0.2, 0.1),
        "stiffness_Nm_per_rad": np.where(early, 300.0, 100.0),
        "equilibrium_rad": np.where(early, equilibrium, 0.0),
    }
    log = walk.log.assign(**{f"left_knee_{name}": values for name, values in columns.items()})
    return replace(walk, log=log)


def test_net_spring_work_of_a_phase_depends_on_the_deflections_at_its_ends(walk: Run) -> None:
    knee = summarise_run(stiffness_and_equilibrium_by_phase(walk, 0.0))["sides"]["left"]["joints"]["knee"]
    assert knee["switch_energy_J"] == pytest.approx(0.5 * 200.0 * (0.2**2 - 0.1**2))


def test_energy_by_switching_counts_the_equilibrium_too(walk: Run) -> None:
    knee = summarise_run(stiffness_and_equilibrium_by_phase(walk, -0.1))["sides"]["left"]["joints"]["knee"]
    begins = 0.5 * 300.0 * 0.3**2 - 0.5 * 100.0 * 0.2**2
    ends = 0.5 * 100.0 * 0.1**2 - 0.5 * 300.0 * 0.2**2
    assert knee["switch_energy_J"] == pytest.approx(begins + ends)


def test_torque_jump_and_change_of_a_joint_are_over_its_counted_switches(walk: Run) -> None:
    first, counted = (LAG + 100, LAG + 3 * STRIDE)  # no switch, and within the third stride
    tick = next(item.tick for item in walk.switches if item.side == "left" and item.tick > counted)
    command = np.zeros(LENGTH)
    command[first:] += 200.0
    command[tick + 10 :] += 4.0
    command[tick + 20 :] += 3.0
    log = walk.log.assign(left_hip_motor_command_torque_Nm=command)
    hip = summarise_run(replace(walk, log=log))["sides"]["left"]["joints"]["hip"]
    assert hip["switch_torque_jump_Nm"] == 4.0
    assert hip["switch_torque_change_Nm"] == 7.0


def test_jerk_of_a_sine_is_the_closed_form(walk: Run) -> None:
    rate = 2.0 * math.pi / (STRIDE * TICK)
    velocity = 1.5 * np.sin(rate * np.arange(LENGTH) * TICK)
    log = walk.log.assign(right_hip_velocity_rad_per_s=velocity)
    hip = summarise_run(replace(walk, log=log))["sides"]["right"]["joints"]["hip"]
    # The filter takes less than 1e-3 at the frequency of the stride.
    assert hip["jerk_rms_rad_per_s3"] == pytest.approx(1.5 * rate**2 / math.sqrt(2.0), rel=1e-3)
    assert hip["jerk_dimensionless"] == pytest.approx((2.0 * math.pi) ** 4 / 2.0, rel=2e-3)


def test_command_beyond_the_limit_counts_as_saturated(walk: Run) -> None:
    log = walk.log.copy()
    command = log["left_hip_motor_command_torque_Nm"].to_numpy().copy()
    command[: LENGTH // 10] = 61.0
    log["left_hip_motor_command_torque_Nm"] = command
    hip = summarise_run(replace(walk, log=log))["sides"]["left"]["joints"]["hip"]
    assert hip["at_torque_limit_share"] == pytest.approx(0.1)
    assert hip["saturated_share"] == pytest.approx(0.1)


def test_share_of_any_joint_at_a_limit_differs_from_the_share_of_the_worst_joint(walk: Run) -> None:
    """Ticks 0 to 99 of one joint and 50 to 249 of another: 200 of the worst, 250 of any."""
    log = walk.log.copy()
    for name, ticks in (("left_hip", slice(0, 99)), ("right_knee", slice(50, 249))):
        log.loc[ticks, f"{name}_motor_command_torque_Nm"] = 61.0
    found, before = summarise_run(replace(walk, log=log)), summarise_run(walk)
    assert before["any_joint_saturated_share"] == before["worst_joint_saturated_share"] == 0.0
    assert found["worst_joint_saturated_share"] == pytest.approx(200 / len(log))
    assert found["any_joint_saturated_share"] == pytest.approx(250 / len(log))


@pytest.mark.parametrize("side", ["left", "right"])
def test_double_support_is_stance_less_the_other_swing(summary: dict[str, Any], side: str) -> None:
    """One foot or both are on the ground at any time of the known walk."""
    swings = [leg["swing_share"] for leg in summary["sides"].values()]
    assert summary["sides"][side]["double_support_share"] == pytest.approx(1.0 - sum(swings), abs=2e-3)
    assert 0.1 < summary["sides"][side]["double_support_share"] < 0.5


def test_timeouts_are_counted_in_all_and_once_the_gait_has_settled() -> None:
    into_extension = sum(PHASE_TICKS[:4])
    # The fourth left stride begins with the heel strike at 200 + 3 · 1200.
    early, late = into_extension + 2 * STRIDE, into_extension + 3 * STRIDE
    assert early < LAG + 3 * STRIDE < late
    values = summarise_run(synthetic_run(timed_out={early, late}))["sides"]["left"]
    assert (values["timeouts"], values["timeouts_after_third_stride"]) == (2, 1)
    assert (CYCLE[3][0], CYCLE[3][1]) == ("swing_flexion", "swing_extension")


def test_number_of_skipped_strides_is_an_option(walk: Run) -> None:
    summary = summarise_run(walk, skip_strides=0)
    assert summary["strides_skipped"] == 0
    assert summary["sides"]["left"]["strides_counted"] == N_STRIDES - 1


@pytest.mark.parametrize("belt_speed", [0.1, 1.9])
def test_no_reference_beyond_its_speeds(belt_speed: float) -> None:
    experiment = synthetic_experiment()
    scenario = replace(experiment.scenario, belt_speed=belt_speed)
    assert isinstance(scenario, Treadmill)
    run = replace(synthetic_run(), experiment=replace(experiment, scenario=scenario))
    values = summarise_run(run)["sides"]["left"]
    assert values["rmse_hip_by_contact_deg"] is None
    assert values["stride_time_mean_s"] == pytest.approx(STRIDE * TICK)


@pytest.mark.parametrize("rows", [0, 1, 2, 500])
def test_summary_of_an_immediately_ending_run_has_no_numbers(walk: Run, rows: int) -> None:
    cut = replace(walk, log=walk.log.iloc[:rows], switches=(), status=RunStatus.INTERRUPTED, reason="stopped")
    summary = summarise_run(cut)
    json.dumps(summary, allow_nan=False)
    left = summary["sides"]["left"]
    assert left["strides"] == 0
    assert left["stride_time_mean_s"] is None
    assert left["rmse_hip_by_contact_deg"] is None
    assert left["timeouts_after_third_stride"] is None
    knee = left["joints"]["knee"]
    for name in ("switch_torque_jump_Nm", "switch_energy_J", "jerk_rms_rad_per_s3", "jerk_dimensionless"):
        assert knee[name] is None
    assert summary["duration_s"] == pytest.approx(rows * TICK)


def test_bench_leg_has_strides_by_phase_only(bench_run: Run) -> None:
    summary = summarise_run(bench_run, skip_strides=0)
    json.dumps(summary, allow_nan=False)
    (values,) = summary["sides"].values()
    assert values["strides"] is None and values["further_contacts"] is None
    entries = [item.tick for item in bench_run.switches if item.target == "early_stance"]
    assert len(entries) >= 1
    assert values["strides_by_phase"] == len(entries)  # tick 0 begins the first
    assert values["stride_time_by_phase_mean_s"] == pytest.approx(entries[-1] * TICK / len(entries))
    assert values["rmse_hip_by_phase_deg"] is None
    knee = np.degrees(bench_run.log["right_knee_angle_rad"].to_numpy())
    edges = [0, *entries]
    peaks = [knee[start : end + 1].max() for start, end in pairwise(edges)]
    assert values["joints"]["knee"]["peak_deg"] == pytest.approx(np.mean(peaks))
    assert summary["symmetry"] is None and "guide_force_lowest_N" not in summary


def test_energy_of_a_simulated_run_balances(bench_run: Run) -> None:
    # What is left is the integrator's error; the wrong sign of one work is a hundred times as much.
    assert summarise_run(bench_run)["energy_residual_share"] < 1e-3
    wrong = bench_run.log.assign(friction_work_J=-bench_run.log["friction_work_J"])
    assert summarise_run(replace(bench_run, log=wrong))["energy_residual_share"] > 0.1


# ------------------------------------------------------------------ the walk beside healthy walking


def test_measures_have_the_units_of_their_names(walk: Run, summary: dict[str, Any]) -> None:
    left, healthy = summary["sides"]["left"], summary["walk_reference"]
    carried = 0.4 * walk.body_weight
    assert left["walk"]["load_peak"] == pytest.approx(400.0 / carried)
    assert left["walk"]["fore_aft_force_N"] == left["walk"]["belt_power_W"] == 0.0
    assert left["walk"]["cadence_per_min"] == pytest.approx(120.0 / (STRIDE * TICK))
    # Swing flexion is the fourth phase, and the first begins before heel strike.
    assert left["walk"]["swing_entry"] == pytest.approx((sum(PHASE_TICKS[:3]) - LAG) / STRIDE)
    assert left["walk"]["swing_load_N"] == 400.0
    # The knee of the walk begins at the reference and goes up in its first half.
    assert left["walk"]["knee_at_contact_deg"] == pytest.approx(healthy["knee_at_contact_deg"], abs=1e-3)
    assert left["walk"]["knee_yield_deg"] > healthy["knee_yield_deg"] > 5.0
    assert left["walk"].keys() >= healthy.keys() - {"stride_time_s", "double_support_share"}
    assert healthy["stride_time_s"] == pytest.approx(1.754, abs=0.0006)
    assert healthy["fore_aft_force_N"] == 0.0


def test_reference_of_the_ground_force_equals_the_table(summary: dict[str, Any]) -> None:
    """Winter (1991), slow cadence: 9.81 and 10.01 N/kg about a trough of 8.5 N/kg; 1.59 N/kg at 1 m/s."""
    healthy = summary["walk_reference"]
    assert healthy["loading_peak"] == pytest.approx(9.81 / 9.81, abs=1e-3)
    assert healthy["push_off_peak"] == pytest.approx(10.01 / 9.81, abs=1e-3)
    assert healthy["trough"] == pytest.approx(8.5 / 9.81, abs=1e-3)
    assert healthy["propulsion_peak"] == pytest.approx(1.59 / 9.81 * 1.5 / 3.6, abs=1e-3)
    assert healthy["braking_peak"] == pytest.approx(-1.52 / 9.81 * 1.5 / 3.6, abs=1e-3)


def test_errors_of_known_offset_and_wave_are_separated(summary: dict[str, Any]) -> None:
    errors = summary["sides"]["left"]["errors"]
    hip, knee = errors["hip"], errors["knee"]
    assert hip["offset_deg"] == pytest.approx(math.degrees(HIP_OFFSET))
    assert hip["total_deg"] == pytest.approx(summary["sides"]["left"]["rmse_hip_by_contact_deg"])
    assert (hip["timing_deg"], hip["shape_deg"], hip["shift_percent"]) == pytest.approx((0, 0, 0), abs=1e-3)
    assert knee["offset_deg"] == pytest.approx(0.0, abs=1e-6)
    parts = knee["timing_deg"] ** 2 + knee["shape_deg"] ** 2
    assert parts == pytest.approx(math.degrees(KNEE_AMPLITUDE) ** 2 / 2.0, rel=1e-4)


def test_table_is_shown_next_to_healthy_walking(summary: dict[str, Any]) -> None:
    head, *rows = walk_table(summary)
    assert head == ("", "left", "right", "healthy")
    cells = {row[0]: row[1:] for row in rows}
    assert cells["stride time [s]"] == ("1.20", "1.20", "1.75")
    assert cells["fore-aft force, mean [N]"] == ("0.000", "0.000", "0.000")
    assert cells["braking peak [carried weight]"] == ("0.000", "0.000", "−0.065")
    assert cells["slip on the belt [mm]"] == ("0.000", "0.000", "")
    assert cells["hip error against healthy gait, offset [°]"][0] == f"{math.degrees(HIP_OFFSET):.2f}"
    assert cells["hip error against healthy gait, timing [°]"] == ("0.000", "0.000", "")
    lines = list(format_table([head, *rows]))
    assert len(lines) == len(rows) + 1 and lines[0].endswith("healthy")
    assert len({line.find("1.75") for line in lines if "1.75" in line}) == 1


def test_leg_without_a_measure_has_a_dash(summary: dict[str, Any]) -> None:
    # Own muscles move the left leg only, as with a device that drives the whole right leg.
    left = summary["sides"]["left"]
    legs = {**summary["sides"], "left": {**left, "walk": {**left["walk"], "own_power_W": 6.5}}}
    for sides in (legs, dict(reversed(legs.items()))):
        head, *rows = walk_table({**summary, "sides": sides})
        cells = {row[0]: dict(zip(head, row, strict=True)) for row in rows}
        row = cells[label_of("own_power_W").title]
        assert (row["left"], row["right"]) == ("6.50", "–")


def dragged(walk: Run, force: float) -> dict[str, Any]:
    """Return the walk with a given backward force of the belt on the feet in stance."""
    log = walk.log.copy()
    for side in ("left", "right"):
        log[f"{side}_foot_friction_force_N"] = np.where(log[f"{side}_foot_normal_force_N"] > 0.0, -force, 0.0)
    log["guide_force_N"] = 2.0 * force * (1.0 - SWING / STRIDE)
    for name in [name for name in log if name.endswith("motor_torque_Nm")]:
        log[name] = 0.0
    return summarise_run(replace(walk, log=log))


def test_note_appears_only_if_the_belt_carries_the_walk(walk: Run) -> None:
    free = dragged(walk, 0.0)
    assert belt_carries_note(free) == "" and free["power"]["belt_driven"] is False
    pulled = dragged(walk, 20.0)
    mean = 2.0 * 20.0 * (1.0 - SWING / STRIDE)
    assert pulled["power"]["belt_W"] == pytest.approx(mean * 1.5 / 3.6)
    assert pulled["power"]["motors_W"] == 0.0
    note = belt_carries_note(pulled)
    assert note.startswith("The belt drives this walk") and f"{amount(mean)} N" in note
    assert belt_carries_note(dragged(walk, 5.0)) == ""  # 6 N are less than 2 % of 352 N


def test_bench_leg_has_no_walk_measures(bench_run: Run) -> None:
    summary = summarise_run(bench_run)
    assert "power" not in summary and "walk" not in summary["sides"]["right"]
    assert walk_table(summary) == [] and list(format_table([])) == []
    assert belt_carries_note(summary) == ""
    # A summary of an earlier version has none either.
    assert walk_table({"sides": {"left": {"strides": 3}}}) == []


def test_motion_in_the_hold_is_not_counted_as_gait(walk: Run, summary: dict[str, Any]) -> None:
    trip = Trip(LENGTH * 2 // 3, TripCause.DRIVE, Side.LEFT, JointName.HIP)
    log = walk.log.copy()
    for side in Side:
        log.loc[trip.tick :, f"{side}_phase"] = log[f"{side}_phase"].iloc[trip.tick]
        log.loc[trip.tick :, f"{side}_foot_clearance_m"] = -0.01
    for side, found in summarise_run(replace(walk, log=log, trip=trip))["sides"].items():
        whole = summary["sides"][side]
        assert 0 < found["strides"] < whole["strides"]
        assert found["heel_strikes_without_early_stance"] == 0
        assert found["early_stance_lag_max_abs_s"] == whole["early_stance_lag_max_abs_s"]
        assert found["toe_clearance_min_m"] > 0.0


def test_summary_states_a_wearer_for_whom_the_model_is_extrapolated() -> None:
    usual = describe_identity(load_experiment("treadmill_guided").experiment)
    assert usual["patient"]["notes"] == "" and extrapolation_note(usual) == ""
    heavy = describe_identity(load_experiment("treadmill_guided", ["patient.mass_kg=130"]).experiment)
    assert "mass 130 kg" in extrapolation_note(heavy) and "110 kg of the device" in extrapolation_note(heavy)
    assert extrapolation_note(describe_identity(load_experiment("bench_leg").experiment)) == ""
