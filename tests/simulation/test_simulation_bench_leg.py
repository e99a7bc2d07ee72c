"""Physical facts of the bench leg in closed loop."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from errors import raises

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Integration, IntegrationMethod
from twin_gait.simulation.log import WORK_SOURCES

# The safety monitor would end a motion that runs away or reaches for a stop.
UNWATCHED = "control.safety.enabled=false"


def run_bench(*settings: str):
    return simulate(load_experiment("bench_leg", settings).experiment)


FREE = (
    UNWATCHED,
    "table.phases.early_stance.gravity_compensation=0",
    "control.mode=transparent",
    "plant.friction_ratio={hip: 0, knee: 0}",
    "control.limits.torque_Nm=1e-9",
    "plant.stops.stiffness_Nm_per_rad=0",
)


def total_energy(log):
    return (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()


def work(log):
    return log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy().sum(axis=1)


@pytest.fixture(scope="module")
def stepping():
    return run_bench("duration_s=5")


def test_steps_through_the_five_phases_in_order(stepping):
    cycle = list(stepping.table.phase_names)
    entered = [item.target for item in stepping.switches]
    expected = [cycle[(1 + index) % 5] for index in range(len(entered))]
    assert entered == expected
    assert len(entered) >= 10


def test_no_timeout_moves_the_leg(stepping):
    assert {item.cause for item in stepping.switches}.isdisjoint({"timeout"})


def test_torque_parts_of_every_row_sum_to_the_command(stepping):
    log = stepping.log
    parts = ("impedance", "friction_compensation", "gravity_compensation", "inertia_compensation", "target")
    for joint in ("hip", "knee"):
        total = sum(log[f"right_{joint}_{part}_torque_Nm"] for part in parts)
        np.testing.assert_allclose(log[f"right_{joint}_motor_command_torque_Nm"], total, atol=1e-12, rtol=0)


def test_impedance_column_is_the_spring_and_damper_of_its_own_row(stepping):
    log = stepping.log
    for joint in ("hip", "knee"):
        column = f"right_{joint}_"
        expected = (
            -log[column + "stiffness_Nm_per_rad"]
            * (log[column + "measured_angle_rad"] - log[column + "equilibrium_rad"])
            - log[column + "damping_Nms_per_rad"] * log[column + "velocity_fast_rad_per_s"]
        )
        np.testing.assert_allclose(log[column + "impedance_torque_Nm"], expected, atol=1e-12)


def test_motor_torque_stays_inside_the_limit():
    log = run_bench("duration_s=3", "control.limits.torque_Nm=15").log
    for joint in ("hip", "knee"):
        assert log[f"right_{joint}_motor_torque_Nm"].abs().max() <= 15.0 + 1e-12
        assert log[f"right_{joint}_motor_command_torque_Nm"].abs().max() > 15.0  # the limit was needed


def test_friction_never_injects_power(stepping):
    for joint in ("hip", "knee"):
        power = (
            stepping.log[f"right_{joint}_friction_torque_Nm"]
            * stepping.log[f"right_{joint}_velocity_rad_per_s"]
        )
        assert power.max() <= 0.0
        assert power.min() < -1.0  # and it does dissipate


def test_energy_balance_closes_and_tightens_with_the_step():
    euler = "integration.method=semi_implicit_euler"
    log = run_bench("duration_s=5", euler, "integration.step_ms=0.25").log
    coarse = np.abs(total_energy(log) - total_energy(log)[0] - work(log)).max()
    fine_log = run_bench("duration_s=5", euler, "integration.step_ms=0.125").log
    fine = np.abs(total_energy(fine_log) - total_energy(fine_log)[0] - work(fine_log)).max()
    throughput = np.abs(np.diff(log["motor_work_J"])).sum()
    assert coarse < 1e-3 * throughput
    assert fine == pytest.approx(coarse / 2.0, rel=0.2)  # first order in the step


def test_energy_balance_of_rk4_closes_to_rounding():
    log = run_bench("duration_s=2", "integration.method=rk4", "integration.step_ms=1").log
    residual = np.abs(total_energy(log) - total_energy(log)[0] - work(log)).max()
    assert residual < 1e-5


def test_frictionless_free_leg_keeps_its_energy():
    run = run_bench("duration_s=3", *FREE, "integration.method=rk4", "integration.step_ms=0.5")
    energy = total_energy(run.log)
    assert run.log["right_hip_velocity_rad_per_s"].abs().max() > 0.5  # it swings
    assert np.abs(energy - energy[0]).max() < 1e-8


# Without rotors a leg let go from high up moves fast enough for the error to stand out of rounding.
LIVELY = (
    *FREE,
    "plant.actuators.hip.rotor_inertia_kgm2=0",
    "plant.actuators.hip.gear_inertia_kgm2=0",
    "plant.actuators.knee.rotor_inertia_kgm2=0",
    "plant.actuators.knee.gear_inertia_kgm2=0",
    "scenario.start={hip_deg: 100, knee_deg: 60}",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "order"), [(IntegrationMethod.SEMI_IMPLICIT_EULER, 1.0), (IntegrationMethod.RK4, 4.0)]
)
def test_free_leg_converges_with_the_order_of_the_integrator(method, order):
    base = load_experiment("bench_leg", ["duration_s=1", *LIVELY]).experiment

    def end(step: float, chosen: IntegrationMethod) -> float:
        integration = Integration(method=chosen, step=step)
        log = simulate(dataclasses.replace(base, integration=integration)).log
        return float(log["right_knee_angle_rad"].iloc[-1])

    steps = (1e-3, 5e-4, 2.5e-4)
    exact = end(1e-3 / 16, IntegrationMethod.RK4)
    errors = [abs(end(step, method) - exact) for step in steps]
    assert min(errors) > 1e-13  # above rounding
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.15)


def hand_settings(gain: float, joint: str = "knee") -> list[str]:
    """Imposed motion of one joint in transparent mode; the other is held by its own weight (no gravity)."""
    phases = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")
    gains = [f"table.phases.{phase}.{joint}.friction_compensation_gain={gain}" for phase in phases]
    return [
        "control.mode=transparent",
        "plant.gravity_m_per_s2=0",
        f"scenario.imposed_motion={{joint: {joint}, amplitude_deg: 40, frequency_Hz: 0.25}}",
        "scenario.start={hip_deg: 20, knee_deg: 20}",
        *gains,
    ]


def mean_hand_power(log, joint: str = "knee") -> float:
    """Work of the hand per time over whole periods: what the person has to spend."""
    whole = log[log["time_s"] >= 4.0]
    return float(
        (whole[f"right_{joint}_external_torque_Nm"] * whole[f"right_{joint}_velocity_rad_per_s"]).mean()
    )


def test_the_hand_needs_less_torque_with_more_friction_compensation():
    efforts = []
    for gain in (0.0, 0.2, 0.4):
        log = run_bench("duration_s=8", *hand_settings(gain)).log
        efforts.append(mean_hand_power(log))
    assert efforts[0] > 1.25 * efforts[1] > 0.0
    assert efforts[1] > 1.5 * efforts[2] > 0.0


def settled_speed_after_release(gain: float) -> float:
    free = ("scenario.imposed_motion.release_s=1", "plant.stops.stiffness_Nm_per_rad=0", UNWATCHED)
    log = run_bench("duration_s=6", *hand_settings(gain), *free).log
    return abs(float(log["right_knee_velocity_rad_per_s"].iloc[-1]))


def test_beyond_the_friction_ratio_the_joint_runs_on_by_itself():
    at_release = abs(
        float(run_bench("duration_s=1", *hand_settings(0.4)).log["right_knee_velocity_rad_per_s"].iloc[-1])
    )
    assert settled_speed_after_release(0.4) < 0.5 * at_release  # below s = 0.5 it comes to rest
    assert settled_speed_after_release(0.7) > 1.2 * at_release  # beyond it speeds up


def test_the_same_experiment_gives_the_same_log_bit_for_bit():
    settings = ("duration_s=1", "sensors.ideal=false", "sensors.angle_noise_deg=0.01", "seed=3")
    first, second = run_bench(*settings), run_bench(*settings)
    for name in first.log.columns:
        assert first.log[name].equals(second.log[name]), name


def test_another_seed_gives_another_log():
    settings = ("duration_s=0.5", "sensors.ideal=false", "sensors.angle_noise_deg=0.01")
    first, second = run_bench(*settings, "seed=1"), run_bench(*settings, "seed=2")
    assert not first.log["right_hip_angle_rad"].equals(second.log["right_hip_angle_rad"])


def test_inertia_compensation_has_an_effect_and_is_off_by_default():
    without = run_bench("duration_s=0.3")
    assert not without.log["right_hip_inertia_compensation_torque_Nm"].any()
    with_it = run_bench("duration_s=0.3", "control.inertia_compensation=0.3")
    peak = with_it.log["right_hip_inertia_compensation_torque_Nm"].abs().max()
    assert peak > 0.5


def test_gravity_compensation_holds_a_limp_leg_up():
    settings = (
        "duration_s=2",
        "control.mode=transparent",
        "scenario.start={hip_deg: 40, knee_deg: 30}",
        "table.phases.early_stance.hip.friction_compensation_gain=0",
        "table.phases.early_stance.knee.friction_compensation_gain=0",
    )
    held = run_bench(*settings).log["right_hip_angle_rad"]
    assert abs(held.iloc[-1] - held.iloc[0]) < 1e-3
    without = "table.phases.early_stance.gravity_compensation=0"
    fallen = run_bench(*settings, without).log["right_hip_angle_rad"]
    assert abs(fallen.iloc[-1] - fallen.iloc[0]) > math.radians(5)


def test_stops_hold_the_knee_inside_its_range():
    log = run_bench(
        "duration_s=2",
        "control.mode=transparent",
        "control.target_torque_Nm={hip: 0, knee: -30}",
        "plant.gravity_m_per_s2=0",
        UNWATCHED,
    ).log
    knee = np.degrees(log["right_knee_angle_rad"])
    assert knee.min() < -4.0  # it does reach the stop at -4 degrees
    # A static 30 N·m sinks 0.015 rad = 0.9 degrees into 2000 N·m/rad; arriving with speed, a few more.
    assert knee.min() > -14.0
    assert log["right_knee_stop_torque_Nm"].max() > 30.0


def test_a_diverging_run_stops_and_keeps_its_log():
    beyond_the_stop = "scenario.start={hip_deg: 20, knee_deg: -20}"
    run = run_bench("duration_s=2", "plant.stops.stiffness_Nm_per_rad=1e7", beyond_the_stop)
    assert run.status is RunStatus.DIVERGED
    assert 1 <= len(run.log) < 2000
    assert "smaller integration step" in run.reason


def test_a_request_to_stop_ends_the_run_and_keeps_its_log():
    experiment = load_experiment("bench_leg", ["duration_s=2", "engine=pinocchio"]).experiment
    calls = []

    def stop_at_third() -> bool:
        calls.append(None)
        return len(calls) >= 3

    run = simulate(experiment, should_stop=stop_at_third)
    assert run.status is RunStatus.INTERRUPTED
    assert len(run.log) == 200


def test_the_name_of_a_preset_is_refused_as_an_experiment():
    with raises(ParameterError, "Experiment", "bench_leg", "load_experiment"):
        simulate("bench_leg")
