"""A motor at the ankle by data alone: URDF, drive, friction and gait table; and tables for fewer joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle
import pytest
from errors import raises
from log_rows import log_matrix

from twin_gait import load_experiment, simulate
from twin_gait.configuration.documents import experiment_document
from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation import lane_engine
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import LaneEngine
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.vocabulary import JointName, Side

WALK = "treadmill_ankle"
HARD = (
    "control.inertia_compensation=0.3",
    "control.assistance={hip: 0.9, knee: 0.9, ankle: 0.8, adaptive: true}",
)
STEP = "integration={method: semi_implicit_euler, step_ms: 0.5}"
PLAIN = "engine=pinocchio"  # for short runs, which take less than a loop takes to compile


def experiment(*settings: str) -> Experiment:
    return load_experiment(WALK, [STEP, *settings]).experiment


def problem(*settings: str) -> SimulationSetup:
    return build_setup(experiment(*settings))


def assert_near(ours: Run, theirs: Run, tolerance: float) -> None:
    assert ours.switches == theirs.switches != ()
    np.testing.assert_allclose(log_matrix(ours), log_matrix(theirs), atol=tolerance, rtol=0.0)


@pytest.fixture(scope="module")
def run():
    return simulate(load_experiment(WALK, ["duration_s=12"]).experiment)


def test_three_controlled_joints_walk_and_the_log_has_the_ankle_as_another_joint(run):
    assert run.verdict.outcome == "walked"
    assert run.trip is None
    ankle, knee = (
        {name.removeprefix(f"left_{joint}_") for name in run.log if name.startswith(f"left_{joint}_")}
        for joint in ("ankle", "knee")
    )
    assert ankle - knee == {"orthosis_torque_Nm"}
    assert knee <= ankle
    assert np.abs(run.log["left_ankle_motor_torque_Nm"]).max() > 5.0
    assert np.abs(run.log["left_ankle_orthosis_torque_Nm"]).max() > 5.0  # it stays


def test_the_motor_of_the_ankle_is_in_the_balance_of_energy_and_in_the_summary(run):
    summary = summarise_run(run)
    assert summary["energy_residual_share"] < 1e-8
    found = summary["sides"]["left"]["joints"]["ankle"]
    strides = run.leg_record("left").strides()
    power = (run.log["left_ankle_motor_torque_Nm"] * run.log["left_ankle_velocity_rad_per_s"]).to_numpy()
    works = [np.maximum(power[first:last], 0.0).sum() * 1e-3 for first, last in strides]
    assert found["positive_work_J_per_kg"] == pytest.approx(np.mean(works) / 70.0)
    assert found["power_peak_W"] > 1.0 > found["negative_work_J_per_kg"]
    assert found["range_of_motion_deg"] > 5.0
    assert "saturated_share" in found
    assert "rmse_ankle_by_contact_deg" in summary["sides"]["left"]


def ankle_work(run):
    """Work on the ankle over a stride, and the largest power in its second half, means over strides."""
    works, peaks = [], []
    for side in run.sides:
        torque = run.log.filter(regex=f"{side}_ankle_(motor|friction|orthosis)_torque_Nm").sum(axis="columns")
        power = (torque * run.log[f"{side}_ankle_velocity_rad_per_s"]).to_numpy()
        for first, last in run.leg_record(side).strides()[2:]:
            works.append(power[first:last].sum() * 1e-3)
            peaks.append(power[(first + last) // 2 : last].max())
    return np.mean(works), np.mean(peaks)


def test_the_motor_pushes_off_and_the_orthosis_alone_does_not(run):
    passive = simulate(load_experiment("treadmill_guided", ["duration_s=12"]).experiment)
    (net, peak), (net_alone, peak_alone) = ankle_work(run), ankle_work(passive)
    assert net > 1.0 > 0.0 > net_alone  # [J]; a spring and a damper give back less than they took
    assert peak > 2.0 * peak_alone > 0.0


def test_other_wearers_walk_with_it():
    for mass, height in ((55, 1.65), (90, 1.85)):
        settings = [f"patient.mass_kg={mass}", f"patient.height_m={height}", "duration_s=12"]
        other = simulate(load_experiment(WALK, settings).experiment)
        assert other.verdict.outcome == "walked"
        assert ankle_work(other)[0] > 0.0


def test_orthosis_and_motor_act_in_parallel():
    log = simulate(
        experiment(
            PLAIN,
            "duration_s=1",
            "plant.ankle={stiffness_Nm_per_rad: 40, damping_Nms_per_rad: 3, rest_deg: 5}",
        )
    ).log
    angle, velocity = log["left_ankle_angle_rad"], log["left_ankle_velocity_rad_per_s"]
    assert np.abs(log["left_ankle_motor_torque_Nm"]).max() > 1.0
    expected = -40.0 * (angle - np.radians(5.0)) - 3.0 * velocity
    np.testing.assert_allclose(log["left_ankle_orthosis_torque_Nm"], expected, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [pytest.param((), marks=pytest.mark.slow, id="plain"), pytest.param(HARD, id="all that is shared")],
)
def test_the_reference_engine_agrees_with_the_compiled_one(settings):
    laid_out = problem("duration_s=0.8", *settings)
    compiled = CompiledEngine(laid_out)
    assert_near(compiled.run(), ReferenceEngine(laid_out).run(), 1e-7)


@pytest.mark.slow  # a loop of its own
def test_mujoco_dynamics_give_the_log_of_the_compiled_engine():
    pytest.importorskip("mujoco")
    from mujoco_kernel import MujocoKernel  # needs MuJoCo

    laid_out = problem("duration_s=0.8", *HARD)
    compiled, kernel = CompiledEngine(laid_out), MujocoKernel(laid_out)
    assert_near(compiled.run(), ReferenceEngine(laid_out, kernel=kernel.functions).run(), 1e-9)


@pytest.mark.slow
def test_the_second_loop_gives_the_same_motion_of_three_joints():
    laid_out = problem(
        "duration_s=0.5",
        "plant.actuators.ankle.gear_efficiency=0.8",
        "control.target_torque_Nm={hip: 0, knee: 0, ankle: 2}",
    )
    ours, theirs = CompiledEngine(laid_out).run(), oracle.motion(laid_out, 500)
    angles = ours.log[state_columns(laid_out.world.model)[0]]
    np.testing.assert_allclose(angles, theirs.q, atol=1e-12, rtol=0.0)
    motors = ours.log[[f"{item.side}_{item.joint}_motor_torque_Nm" for item in laid_out.joints]]
    coordinates = [item.coordinate for item in laid_out.joints]
    np.testing.assert_allclose(motors, theirs.motor[:, coordinates], atol=1e-10, rtol=0.0)
    assert ours.switches


@pytest.mark.slow
@pytest.mark.compile
def test_lanes_with_powered_ankles_equal_their_single_runs(monkeypatch):
    monkeypatch.setattr(lane_engine, "MIN_BLOCK_SIZE", 2)
    settings = [f"patient.mass_kg={mass}" for mass in range(60, 78)]
    ours, theirs = ([CompiledEngine(problem("duration_s=5", item)) for item in settings] for _ in range(2))
    for together, engine in zip(LaneEngine(ours).run(), theirs, strict=True):
        alone = engine.run()
        assert together.switches == alone.switches != ()
        assert log_matrix(together).tobytes() == log_matrix(alone).tobytes()


@pytest.mark.parametrize(
    "settings",
    [
        ("faults=['encoder_freeze:left_ankle@0.5s']",),
        ("faults=['motor_dead:right_ankle@0.2s']", "control.safety.enabled=false"),
    ],
)
def test_faults_at_an_ankle_are_detected(settings):
    run = simulate(experiment(PLAIN, "duration_s=0.7", *settings))
    if run.experiment.control.safety.enabled:
        assert run.trip is not None
        assert run.trip.location == "left ankle"
    else:
        assert not run.log["right_ankle_measured_current_A"].to_numpy()[200:].any()


def test_an_encoder_of_an_ankle_may_be_out_of_calibration():
    log = simulate(experiment(PLAIN, "duration_s=0.05", "sensors.offset.left.ankle_deg=2")).log
    difference = log["left_ankle_measured_angle_rad"] - log["left_ankle_angle_rad"]
    np.testing.assert_allclose(difference, np.radians(2.0), atol=1e-12)


def test_a_file_with_an_ankle_is_written_and_read_back():
    document = experiment_document(experiment("sensors.offset.left.ankle_deg=2"))
    assert set(document["plant"]["actuators"]) == {"hip", "knee", "ankle"}
    assert document["sensors"]["offset"]["left"]["ankle_rad"] == pytest.approx(np.radians(2.0))
    assert "right" not in document["sensors"]["offset"]


# ------------------------------------------------------------------ fewer joints


@pytest.mark.slow
def test_a_drive_that_the_table_does_not_control_keeps_friction_and_rotor_but_gets_no_current():
    driven, free = (problem("duration_s=0.4", *settings) for settings in ((), ("table=treadmill_guided",)))
    index = free.world.model.index(Side.LEFT, JointName.ANKLE)
    assert free.world.plant[index].friction == driven.world.plant[index].friction
    assert free.world.plant[index].armature == driven.world.plant[index].armature > 0.0
    log = simulate(experiment(PLAIN, "duration_s=0.4", "table=treadmill_guided")).log
    assert "left_ankle_motor_torque_Nm" not in log
    assert log["left_ankle_angle_rad"].std() > 0.0


def controlling(joints: list[str], *settings: str) -> Experiment:
    """Return the walk with a table of some joints that changes phase by time."""
    base = experiment("duration_s=0.5", "patient=stroke_left", *settings)
    table = replace(
        base.table,
        joints=tuple(joints),
        phases={
            name: replace(phase, joints={joint: phase.joints[joint] for joint in joints})
            for name, phase in base.table.phases.items()
        },
        transitions=tuple(
            replace(item, guard=type(item.guard)(guards=()), timeout_ticks=200)
            for item in base.table.transitions
        ),
    )
    return replace(base, table=table)


@pytest.mark.parametrize(
    "joints", [["hip"], ["knee"], pytest.param(["knee", "ankle"], marks=pytest.mark.slow)]
)
def test_a_table_may_control_fewer_joints(joints):
    run = simulate(controlling(joints, PLAIN))
    log = run.log
    for joint in ("hip", "knee", "ankle"):
        assert (f"left_{joint}_motor_torque_Nm" in log) == (joint in joints)
        assert f"left_{joint}_angle_rad" in log
    assert summarise_run(run)["sides"]["left"]["joints"].keys() == set(joints)


@pytest.mark.slow
@pytest.mark.compile
@pytest.mark.parametrize("joints", [["hip"], ["knee"], ["knee", "ankle"]])
def test_engines_agree_on_fewer_joints(joints):
    laid_out = build_setup(controlling(joints))
    compiled = CompiledEngine(laid_out)
    assert_near(compiled.run(), ReferenceEngine(laid_out).run(), 1e-7)


# ------------------------------------------------------------------ refusals


@pytest.mark.parametrize(
    ("preset", "settings", "message"),
    [
        (
            "treadmill_guided",
            ["table=treadmill_ankle"],
            ("plant.actuators.ankle", "treadmill_ankle"),
        ),
        (WALK, ["plant.friction.ankle=null"], ("friction.ankle",)),
        (
            WALK,
            ["control.friction_model.ankle=null"],
            ("control.friction_model.ankle", "treadmill_ankle"),
        ),
        (
            WALK,
            ["plant.actuators.ankle.resistance_Ohm=null"],
            ("plant.actuators.ankle.resistance_Ohm", "None"),
        ),
        (
            WALK,
            ["leg.left.ankle=null"],
            ("leg.left.ankle", "treadmill_ankle"),
        ),
        (
            WALK,
            ["control.mode=position"],
            ("control.mode", "position", "hip", "knee"),
        ),
        (
            "treadmill_guided",
            ["faults=['motor_dead:left_ankle@1s']"],
            ("left_hip", "left_ankle"),
        ),
        ("treadmill_guided", ["sensors.offset.left.ankle_deg=1"], ("sensors offset", "hip", "knee", "ankle")),
    ],
)
def test_missing_parameters_of_an_ankle_are_reported_in_one_line(preset, settings, message):
    with raises(TwinGaitError, *message) as refused:
        build_setup(load_experiment(preset, [*settings]).experiment)
    assert "\n" not in str(refused.value)
