"""The guided walk, and the walk with one thing changed at a time.

The limits are those that the program promises in its documentation; the numbers come from the summary
that every run writes, whose measures have tests of their own.
"""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.log import WORK_SOURCES
from twin_gait.vocabulary import Outcome

SIDES = ("left", "right")


@pytest.fixture(scope="module", params=["compiled", pytest.param("pinocchio", marks=pytest.mark.slow)])
def walk(request):
    """The guided walk of each engine, at the engine's own integrator and step."""
    return simulate(load_experiment("treadmill_guided", [f"engine={request.param}"]).experiment)


@pytest.fixture(scope="module")
def summary(walk):
    return summarise_run(walk)


def test_twenty_seconds_without_a_fall(walk):
    assert walk.status is RunStatus.COMPLETED
    assert walk.duration == 20.0


def most_strides(duration, values):
    """Strides that would fit into a run, less those that do not count."""
    return duration / values["stride_time_mean_s"] - SKIPPED_STRIDES


@pytest.mark.parametrize("side", SIDES)
def test_strides_by_foot_contact(summary, side):
    values = summary["sides"][side]
    assert values["strides"] > most_strides(20.0, values) - 2.0
    assert 1.65 <= values["stride_time_mean_s"] <= 1.95
    assert 0.28 <= values["swing_share"] <= 0.42
    assert values["stride_time_variation"] <= 0.02
    assert values["further_contacts"] == 0


@pytest.mark.parametrize("side", SIDES)
def test_five_phases_in_order_in_every_stride(walk, summary, side):
    cycle = list(walk.table.phase_names)
    entered = [item.target for item in walk.switches if item.side == side]
    start = cycle.index(entered[0])
    assert entered == [cycle[(start + index) % 5] for index in range(len(entered))]
    assert summary["sides"][side]["phases_in_order"] is True


@pytest.mark.parametrize("side", SIDES)
def test_early_stance_begins_when_the_foot_lands(summary, side):
    assert summary["sides"][side]["heel_strikes_without_early_stance"] == 0
    assert abs(summary["sides"][side]["early_stance_lag_max_abs_s"]) <= 0.15


@pytest.mark.parametrize("side", SIDES)
def test_no_timeout_after_the_third_stride(summary, side):
    assert summary["sides"][side]["timeouts_after_third_stride"] == 0


@pytest.mark.parametrize("side", SIDES)
def test_joint_motion_is_that_of_a_walk(summary, side):
    joints = summary["sides"][side]["joints"]
    assert 25.0 <= joints["hip"]["range_of_motion_deg"] <= 45.0
    assert 45.0 <= joints["knee"]["peak_deg"] <= 70.0
    assert summary["sides"][side]["rmse_hip_by_contact_deg"] <= 4.5
    assert summary["sides"][side]["rmse_knee_by_contact_deg"] <= 6.5


@pytest.mark.parametrize("side", SIDES)
def test_ground_forces_are_near_those_of_healthy_walking(summary, side):
    walk, healthy = summary["sides"][side]["walk"], summary["walk_reference"]
    assert walk["load_peak"] <= 1.2
    assert walk["trough"] >= 0.7
    assert walk["min_load"] >= 0.4
    assert walk["propulsion_peak"] >= 0.5 * healthy["propulsion_peak"]
    assert walk["knee_at_contact_deg"] <= 9.0
    assert walk["knee_yield_deg"] >= 3.0
    assert walk["clearance_m"] >= 0.010


def test_gait_is_self_propelled(summary):
    """Neither the belt nor the harness drives it: on the mean the feet push as much as they brake."""
    assert abs(sum(summary["sides"][side]["walk"]["fore_aft_force_N"] for side in SIDES)) <= 5.0
    assert abs(summary["power"]["belt_W"]) <= 1.5
    assert summary["power"]["motors_W"] > 10.0
    assert not summary["power"]["belt_driven"]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_motors_stay_within_their_continuous_limits(summary, side, joint):
    values = summary["sides"][side]["joints"][joint]
    assert values["at_torque_limit_share"] <= 0.12
    assert values["torque_rms_Nm"] <= 43.0


def test_battery_stays_inside_its_continuous_power(summary):
    assert summary["battery_power_mean_W"] <= 330.0


def test_contact_never_pulls_and_friction_stays_in_its_cone(walk):
    friction_coefficient = walk.experiment.scenario.contact.friction_coefficient
    for side in SIDES:
        normal = walk.log[f"{side}_foot_normal_force_N"]
        assert normal.min() >= 0.0
        assert normal.max() > 300.0
        assert (walk.log[f"{side}_foot_friction_force_N"].abs() <= friction_coefficient * normal + 1e-9).all()


def test_friction_never_injects_power(walk):
    for side in SIDES:
        for joint in ("hip", "knee"):
            power = (
                walk.log[f"{side}_{joint}_friction_torque_Nm"]
                * walk.log[f"{side}_{joint}_velocity_rad_per_s"]
            )
            assert power.max() <= 0.0


def test_torque_parts_of_every_row_sum_to_the_command(walk):
    parts = ("impedance", "friction_compensation", "gravity_compensation", "inertia_compensation", "target")
    for side in SIDES:
        for joint in ("hip", "knee"):
            total = sum(walk.log[f"{side}_{joint}_{part}_torque_Nm"] for part in parts)
            np.testing.assert_allclose(
                walk.log[f"{side}_{joint}_motor_command_torque_Nm"], total, atol=1e-12, rtol=0
            )


def test_motor_torque_and_current_stay_inside_the_limits(walk):
    for side in SIDES:
        for joint in ("hip", "knee"):
            limits = walk.experiment.control.limits[joint]
            assert walk.log[f"{side}_{joint}_motor_torque_Nm"].abs().max() <= limits.torque + 1e-9
            assert walk.log[f"{side}_{joint}_measured_current_A"].abs().max() <= limits.current


def test_energy_balance_closes(walk):
    log = walk.log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy()
    residual = np.abs(energy - energy[0] - works.sum(axis=1)).max()
    throughput = np.abs(np.diff(works, axis=0)).sum()
    # First-order integration at 0.25 ms through stiff contacts: half a percent of what went through.
    assert residual < {"pinocchio": 5e-3, "compiled": 1e-6}[walk.experiment.engine] * throughput


def test_the_force_of_the_pelvis_guide_equals_the_log(walk):
    """Newton on the whole body: belt forces are balanced by support, guide, weight and inertia."""
    log = walk.log
    mass = walk.body_weight / walk.experiment.plant.gravity
    vertical = (
        log["left_foot_normal_force_N"] + log["right_foot_normal_force_N"] + log["support_force_N"]
    ) - walk.body_weight
    # Momentum of the body over the walk returns to where it was: mean net force is (nearly) zero.
    assert abs(vertical.iloc[4000:].mean()) < 0.01 * walk.body_weight
    horizontal = log["left_foot_friction_force_N"] + log["right_foot_friction_force_N"] + log["guide_force_N"]
    assert abs(horizontal.iloc[4000:].mean()) < 0.01 * walk.body_weight
    assert mass == pytest.approx(90.0)


NOISE = ("sensors.ideal=false", "sensors.angle_noise_deg=0.006")
CHANGES = {
    "60 kg": "patient.mass_kg=60",
    "80 kg": "patient.mass_kg=80",
    "1.65 m": "patient.height_m=1.65",
    "1.85 m": "patient.height_m=1.85",
    "0.36 m/s": "scenario.belt_speed_m_per_s=0.36",
    "0.45 m/s": "scenario.belt_speed_m_per_s=0.45",
    "50 % support": "scenario.support.share=0.5",
    "70 % support": "scenario.support.share=0.7",
    "friction 0.35": "plant.friction_ratio={hip: 0.35, knee: 0.35}",
    "friction 1.0": "plant.friction_ratio={hip: 1.0, knee: 1.0}",
    "24 V": "plant.battery.voltage_V=24",
    "40 % support": "scenario.support.share=0.4",
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_still_walks_thirty_seconds_with_noise_and_one_thing_changed(change):
    settings = [change, *NOISE, "duration_s=30"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    assert run.status is RunStatus.COMPLETED, run.reason
    assert run.verdict.outcome is Outcome.WALKED, run.verdict
    for values in summarise_run(run)["sides"].values():
        assert values["strides"] > most_strides(30.0, values) - 2.0  # to the end
        assert values["phases_in_order"] is True
