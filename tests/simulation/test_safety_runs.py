"""The monitor in whole runs: it leaves walks alone, trips on faults, and holds."""

from __future__ import annotations

import numpy as np
import pytest
from errors import raises
from injected_faults.audit import audit, breach_tick, hold_start, stated_reaction
from test_treadmill_gait import CHANGES, NOISE

from twin_gait import load_experiment, simulate
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

# As without a word about it: one loop does for all runs under faults.
STEPS = "integration={method: rk4, step_ms: 1}"


def run_of(name: str, *settings: str, faults: tuple[str, ...] = ()):
    given = [f"faults={list(faults)}"] if faults else []
    return simulate(load_experiment(name, [*settings, *given]).experiment)


WALKS = {name: (name, ()) for name in ("treadmill_guided", "treadmill_40", "bench_leg")}
WALKS |= {f"{name} with noise": (name, NOISE) for name in WALKS}
WALKS |= {change: ("treadmill_guided", (setting, *NOISE)) for change, setting in CHANGES.items()}


@pytest.mark.parametrize("walk", WALKS.values(), ids=WALKS.keys())
def test_a_walk_without_a_fault_never_trips(walk):
    name, settings = walk
    run = run_of(name, *settings, "duration_s=10")
    assert run.trip is None and run.status == "completed"
    assert not run.log["safety_state"].any() and not run.log["trip_cause"].any()


@pytest.mark.parametrize("preset", ["treadmill_guided", "bench_leg"])
def test_a_monitor_with_cold_copper_resistance_does_not_trip_a_warm_motor(preset):
    """Copper warmed by 100 K has 1.39 times the resistance that the monitor reckons with."""
    assert run_of(preset, f"control.safety.model_resistance_ratio={1 / 1.39}", "duration_s=10").trip is None


@pytest.mark.parametrize("preset", ["treadmill_guided", "bench_leg"])
def test_a_run_without_a_fault_is_the_same_without_the_monitor(preset):
    watched = run_of(preset, "duration_s=3").log
    alone = run_of(preset, "duration_s=3", "control.safety.enabled=false").log
    for column in watched:
        assert watched[column].equals(alone[column]), column


BENCH_FAULTS = {
    "encoder_freeze:right_knee@0.7s": "encoder_frozen",
    "encoder_jump:right_hip@0.5s=5deg": "encoder_jump",
    "encoder_missing:right_knee@0.6s": "encoder_missing",
    "encoder_drift:right_knee@0.4s=60deg/s": "encoder_against_model",
    "encoder_offset:right_hip@0.4s=-4deg": "encoder_jump",
    "motor_dead:right_hip@0.5s": "drive",
    "motor_stuck:right_knee@0.3s=-20Nm": "drive",
    "controller_runaway:right_hip@0.2s=3000Nm/s": "command_against_setpoint",
    "supply_dip@0.4s=25V": None,
    "supply_loss_shorted@0.4s": None,
    "supply_loss_shorted@0.4s=0.88s": None,
    "supply_loss_open@0.4s": None,
}


@pytest.mark.parametrize("fault", BENCH_FAULTS)
def test_engines_agree_under_every_fault(fault):
    """To 1e-9 in every column, empty values at the same places, and the same trip."""
    settings = ("duration_s=1.2", STEPS, "sensors.ideal=false", "sensors.angle_noise_deg=0.001")
    ours = run_of("bench_leg", *settings, faults=(fault,))
    theirs = run_of("bench_leg", *settings, "engine=pinocchio", faults=(fault,))
    assert ours.trip == theirs.trip and ours.switches == theirs.switches
    if BENCH_FAULTS[fault] is not None:
        assert ours.trip.cause == BENCH_FAULTS[fault]
    for column in [name for name in theirs.log if not name.endswith("_phase")]:
        np.testing.assert_allclose(ours.log[column], theirs.log[column], atol=1e-9, rtol=1e-9, err_msg=column)


@pytest.mark.parametrize("fault", ["foot_load_stuck:left_foot@0.3s", "supply_dip@0.2s=20V"])
def test_engines_agree_under_faults_on_the_treadmill(fault):
    settings = ("duration_s=0.8", "integration={method: rk4, step_ms: 0.25}")
    ours = run_of("treadmill_guided", *settings, faults=(fault,))
    theirs = run_of("treadmill_guided", *settings, "engine=pinocchio", faults=(fault,))
    assert ours.trip == theirs.trip is not None
    for column in [name for name in theirs.log if not name.endswith("_phase")]:
        np.testing.assert_allclose(ours.log[column], theirs.log[column], atol=1e-9, rtol=1e-9, err_msg=column)


@pytest.fixture(scope="module")
def held():
    """A bench leg whose knee encoder vanishes while the leg is swung forward."""
    return run_of("bench_leg", "duration_s=6", faults=("encoder_missing:right_knee@3.45s",))


def test_a_missing_encoder_trips_in_its_first_tick(held):
    assert held.trip == (3450, TripCause.ENCODER_MISSING, Side.RIGHT, JointName.KNEE)
    assert held.log["right_knee_measured_angle_rad"].isna().to_numpy().nonzero()[0][0] == 3450


def test_only_measured_columns_are_empty(held):
    empty = {column for column in held.log if held.log[column].isna().any()}
    assert empty == {
        "right_knee_measured_angle_rad",
        "right_knee_velocity_fast_rad_per_s",
        "right_knee_velocity_slow_rad_per_s",
    }


def test_the_hold_is_damping_and_a_fading_share_of_the_weight(held):
    log, trip = held.log, held.trip.tick
    settings = held.experiment.control.safety
    model = held.experiment.build_control_model()
    q = log[["right_hip_measured_angle_rad", "right_knee_measured_angle_rad"]].to_numpy()[trip - 1]
    weight = model.gravity_torque(q)
    share = np.clip(1.0 - np.arange(len(log) - trip) * TICK / settings.lowering_time, 0.0, 1.0)
    for joint, torque in zip(("hip", "knee"), weight, strict=True):
        speed = log[f"right_{joint}_velocity_rad_per_s"].to_numpy()[trip - 1 : -1]
        command = log[f"right_{joint}_motor_command_torque_Nm"].to_numpy()[trip:]
        np.testing.assert_allclose(command, share * torque - settings.hold_damping * speed, atol=1e-9)


def test_the_parts_of_the_command_add_up_in_the_hold_too(held):
    parts = ("impedance", "friction_compensation", "gravity_compensation", "inertia_compensation", "target")
    for joint in ("hip", "knee"):
        total = sum(held.log[f"right_{joint}_{part}_torque_Nm"] for part in parts)
        np.testing.assert_allclose(held.log[f"right_{joint}_motor_command_torque_Nm"], total, atol=1e-12)


def test_the_hold_lowers_the_leg_slowly_and_never_releases_it(held):
    log, trip = held.log, held.trip.tick
    later = log.iloc[trip + 500 :]
    speed = later[["right_hip_velocity_rad_per_s", "right_knee_velocity_rad_per_s"]].abs().to_numpy()
    assert speed.max() < 0.5
    assert later["potential_energy_J"].iloc[-1] < later["potential_energy_J"].iloc[0]
    assert np.diff(later["potential_energy_J"]).max() < 1e-4  # it goes down all the way
    assert (log["safety_state"].iloc[trip:] == 1.0).all()
    assert max(item.tick for item in held.switches) < trip
    assert log["right_phase"].iloc[trip:].nunique() == 1


def test_without_support_a_raised_leg_goes_down_faster():
    heights, speeds = [], []
    for lowering in ("3", "0.001"):
        log = run_of(
            "bench_leg",
            "duration_s=1",
            "scenario.start={hip_deg: 70, knee_deg: 20}",
            f"control.safety.lowering_time_s={lowering}",
            faults=("encoder_missing:right_knee@0.001s",),
        ).log
        heights.append(log["potential_energy_J"].iloc[-1] - log["potential_energy_J"].iloc[0])
        speeds.append(log["right_hip_velocity_rad_per_s"].abs().max())
    assert heights[1] < 2.0 * heights[0] < 0.0
    assert speeds[1] > 2.0 * speeds[0]


def test_a_drive_that_does_not_follow_its_command_is_cut_off():
    run = run_of("bench_leg", "duration_s=1", faults=("motor_stuck:right_knee@0.3s=40Nm",))
    assert run.trip.cause is TripCause.DRIVE and run.trip.joint is JointName.KNEE
    torque = run.log["right_knee_motor_torque_Nm"].to_numpy()
    assert torque[run.trip.tick - 1] == pytest.approx(40.0)
    assert not torque[run.trip.tick :].any()


@pytest.mark.parametrize(
    ("cause", "setting"),
    [
        ("phase_timeout", "phase_timeout_s=0.3"),
        ("winding_heat", "thermal_time_constant_s=0.2"),
        ("torque", "torque_time_s=0.05"),
        ("joint_speed", "speed_share=0.4"),
        ("joint_range", "stopping_deceleration_rad_per_s2=1.0"),
        ("supply", "min_voltage_share=0.99"),
        ("command", "highest_command_Nm=61"),
        ("command_against_setpoint", "command_deviation_Nm=0.3"),
        ("encoder_against_model", "model_deviation_rad=1e-4"),
    ],
)
def test_a_tighter_bound_trips_when_the_log_exceeds_it(cause, setting):
    """The breach is looked for in whole columns, by other means than the monitor's."""
    run = run_of("bench_leg", "duration_s=8", f"control.safety.{setting}")
    assert run.trip is not None and run.trip.cause == cause
    found = audit(run)
    assert found.hold_kept and found.in_time
    for joint, limits in run.experiment.control.limits.items():
        torques = run.log[[name for name in run.log if str(name).endswith(f"{joint}_motor_torque_Nm")]]
        assert torques.notna().all(axis=None)
        assert (torques.abs() <= limits.torque + 1e-9).all(axis=None)
    breach = breach_tick(run, run.trip)
    needed = stated_reaction(run.trip.cause, run.experiment.control.safety) - TICK
    assert breach <= hold_start(run) <= breach + needed / TICK + 1.5


@pytest.mark.parametrize(
    "faults",
    [
        ("controller_runaway:right_knee@2.679s=397.27Nm/s",),
        ("controller_runaway:right_hip@2.325s=125.6Nm/s", "supply_dip@2.325s=2.398V"),
    ],
)
def test_a_runaway_that_ended_in_a_fall_without_a_trip_is_held(faults):
    unbounded = run_of(
        "treadmill_guided", "duration_s=6", "control.safety.command_deviation_Nm=1e3", faults=faults
    )
    assert unbounded.verdict.outcome == "fell" and unbounded.trip is None
    run = run_of("treadmill_guided", "duration_s=6", faults=faults)
    assert run.verdict.outcome == "held" and run.trip.cause is TripCause.SETPOINT
    assert run.trip.time < run.experiment.faults[0].time + 0.15
    found = audit(run)
    assert found.hold_kept and found.in_time


def test_without_a_monitor_nothing_trips():
    run = run_of(
        "bench_leg", "duration_s=1", "control.safety.enabled=false", faults=("motor_dead:right_hip@0.2s",)
    )
    assert run.trip is None
    assert not run.log["right_hip_motor_torque_Nm"].iloc[200:].any()


def test_a_missing_encoder_needs_the_monitor():
    with raises(TwinGaitError, "faults", "control.safety", "encoder_missing:right_hip@1.0s"):
        run_of("bench_leg", "control.safety.enabled=false", faults=("encoder_missing:right_hip@1s",))
