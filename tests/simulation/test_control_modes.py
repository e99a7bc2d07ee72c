"""Controllers that can be compared: their files, their rows, the path that is followed, help that adapts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from errors import raises
from numpy.testing import assert_allclose, assert_array_equal
from twin_device import KNEE_ACTUATOR

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.control.controller import ReferencePath as Walk
from twin_gait.control.controller import find_cycle_interval
from twin_gait.control.controllers.assistance import AssistanceParameters, adapted_assistance
from twin_gait.control.controllers.position import KNEE_HIGHEST, KNEE_LOWEST
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, GAIN, STIFFNESS
from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.table import TICK
from twin_gait.measures.reference import reference_curve, reference_cycle_time
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName, Outcome, Side

SIDES = (Side.LEFT, Side.RIGHT)
# One wearer in all runs, so that fewer loops have to be compiled.
WEARER = "patient=stroke_left"
STIFF_ANKLE = "plant.ankle={stiffness_Nm_per_rad: 200, rest_deg: 0}"
MODES = {
    "table": (),
    "position": ("control.mode=position",),
    "twincare": ("control.assistance.hip=0.7", "control.assistance.knee=0.9"),
    "assist_as_needed": ("control.assistance.adaptive=true", "control.assistance.hip=0.9"),
    "transparent": ("control.mode=transparent",),
    "gravity": ("control.mode=gravity",),
    "constant": ("control.mode=constant",),
}


def experiment(*settings: str) -> Experiment:
    return load_experiment("treadmill_guided", [WEARER, *settings]).experiment


def reference_path(config: Experiment) -> Walk:
    """The walk that is followed, or against which the tracking error is measured."""
    problem = build_setup(config)
    path = problem.controller.reference_path(problem.plan)
    return replace(path, angles=np.array(path.angles))


# ---------------------------------------------------------------- files


def test_keys_become_parameters_in_si():
    control = experiment(
        "control.mode=position",
        "control.path.stiffness_Nm_per_deg={hip: 5, knee: 6}",
        "control.path.damping_ratio=0.9",
        "control.assistance={hip: 0.5, knee: 0.6, adaptive: true, forgetting_factor: 0.8}",
        "control.assistance.gain_per_rad=2",
        "control.assistance.min_assistance=0.1",
        "control.assistance.error_deadband_deg=3",
    ).control
    assert control.mode == "position"
    assert_allclose([control.path.stiffness[joint] for joint in ("hip", "knee")], np.degrees([5.0, 6.0]))
    assert control.path.damping_ratio == 0.9
    assistance = control.assistance
    assert dict(assistance.share) == {JointName.HIP: 0.5, JointName.KNEE: 0.6} and assistance.adaptive
    assert (assistance.forgetting_factor, assistance.gain, assistance.min_assistance) == (0.8, 2.0, 0.1)
    assert assistance.error_deadband == pytest.approx(math.radians(3.0))


@pytest.mark.parametrize("mode", MODES)
def test_experiment_survives_its_own_document(mode):
    config = experiment(*MODES[mode])
    assert experiment_from_mapping(experiment_document(config), "document", Path()) == config


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("control.mode=magic", ("control.mode", "position", "magic")),
        ("control.assistance.knee=1.5", ("control.assistance.knee", "0", "1", "1.5")),
        ("control.assistance.help=1", ("control.assistance.help", "hip", "knee", "ankle")),
        ("control.path.damping_ratio=-1", ("control.path.damping_ratio", "0", "10", "-1")),
        (
            "control.path.stiffness_Nm_per_deg={hip: -5}",
            ("control.path.stiffness_Nm_per_deg.hip", "0", "-5 Nm/deg"),
        ),
    ],
)
def test_mistake_in_the_control_block_is_one_line(setting, message):
    with raises(TwinGaitError, *message) as caught:
        experiment(setting)
    assert "\n" not in str(caught.value)


def test_stiffness_in_two_units_is_refused():
    document = experiment_document(experiment())
    document["control"]["path"]["stiffness_Nm_per_deg"] = {"hip": 5, "knee": 5}
    with raises(TwinGaitError, "control.path", "stiffness_Nm_per_rad", "stiffness_Nm_per_deg"):
        experiment_from_mapping(document, "file", Path())


# ---------------------------------------------------------------- rows


def test_phase_rows_of_the_modes_differ_from_the_table_as_documented():
    rows = {mode: build_setup(experiment(*settings)).phase_rows for mode, settings in MODES.items()}
    table, last = rows["table"], rows["table"].shape[2] - 1
    columns = [COLUMNS_PER_JOINT * joint for joint in range(2)]
    for mode in ("transparent", "gravity"):
        for first in columns:
            assert not rows[mode][:, :, first + STIFFNESS].any()
            assert not rows[mode][:, :, first + DAMPING].any()
            assert_array_equal(rows[mode][:, :, first + GAIN], table[:, :, first + GAIN])
    assert_array_equal(rows["transparent"][:, :, last], table[:, :, last])
    assert (rows["gravity"][:, :, last] == 1.0).all()
    for phase in range(table.shape[1]):
        assert_allclose(rows["constant"][:, phase], sum(table[:, i] for i in range(5)) / 5.0)
    assert_array_equal(rows["assist_as_needed"], table)  # a share of them is given tick by tick


def test_path_spring_is_damped_by_its_ratio():
    problem = build_setup(experiment("control.mode=position", "control.path.damping_ratio=0.6"))
    path = problem.experiment.control.path
    for number, joint in enumerate((JointName.HIP, JointName.KNEE)):
        first = COLUMNS_PER_JOINT * number
        stiffness, damping = (
            problem.phase_rows[0, 0, first + STIFFNESS],
            problem.phase_rows[0, 0, first + DAMPING],
        )
        assert stiffness == path.stiffness[joint]
        index = problem.joints[number].control_coordinate
        inertia = problem.control_model.effective_inertia(np.zeros(problem.control_model.nv), index)
        assert damping == pytest.approx(2.0 * 0.6 * math.sqrt(stiffness * inertia))


# ---------------------------------------------------------------- the path


def accelerations(angles: np.ndarray, cycle_ticks: int) -> np.ndarray:
    """Greatest magnitude over a path that closes, by central differences on its own samples."""
    step = cycle_ticks * TICK / (len(angles) - 1)
    open_path = angles[:-1]
    second = np.roll(open_path, 1, axis=0) - 2.0 * open_path + np.roll(open_path, -1, axis=0)
    return np.abs(second / step**2).max(axis=0)


def test_followed_path_closes_and_stays_between_its_ends():
    path = reference_path(experiment("control.mode=position"))
    assert_allclose(path.angles[0], path.angles[-1])
    assert np.array_equal(path.starts, [0.0, 0.5])
    knee = path.angles[:, 1]
    assert knee.min() == pytest.approx(KNEE_LOWEST) and knee.max() == pytest.approx(KNEE_HIGHEST)


def test_motor_can_accelerate_its_rotor_along_the_followed_knee_and_not_along_the_healthy_one():
    config = experiment("control.mode=position")
    available = config.control.limits[JointName.KNEE].torque / KNEE_ACTUATOR.armature
    followed = reference_path(config)
    healthy = reference_path(experiment())
    assert accelerations(followed.angles, followed.cycle_ticks)[1] < 0.8 * available
    assert accelerations(healthy.angles, healthy.cycle_ticks)[1] > 2.0 * available


def test_tracking_is_compared_with_the_healthy_walk():
    path = reference_path(experiment())
    percent = np.linspace(0.0, 100.0, 101)
    for number, joint in enumerate((JointName.HIP, JointName.KNEE)):
        expected = reference_curve(joint, percent, speed=1.5 / 3.6, height=1.75)
        assert_array_equal(path.angles[:, number], expected)
    assert path.cycle_ticks == round(1e3 * reference_cycle_time(1.5 / 3.6, 1.75))


@pytest.mark.parametrize("leading", SIDES)
def test_legs_begin_on_the_path(leading):
    problem = build_setup(experiment("control.mode=position", f"scenario.leading={leading}"))
    angles = np.array(problem.controller.reference_path(problem.plan).angles)
    for joint in problem.joints:
        number = 0 if joint.joint is JointName.HIP else 1
        percent = 0 if joint.side is leading else 50
        assert problem.world.start_q[joint.coordinate] == pytest.approx(angles[percent, number], abs=1e-12)


def test_other_modes_begin_in_the_posture_of_the_scenario():
    config = experiment()
    problem = build_setup(config)
    begin = {joint.coordinate: problem.world.start_q[joint.coordinate] for joint in problem.joints}
    assert set(begin.values()) == {
        *config.scenario.leading_angles.values(),
        *config.scenario.trailing_angles.values(),
    }


@pytest.mark.slow
@pytest.mark.compile
def test_position_tracking_walks_a_minute():
    """The default wearer in the soft harness, limits and the monitor as they are; no fall, no trip, a walk.

    With the ankle orthosis for which the path was chosen; with that of the preset the walk ends in a trip.
    """
    config = load_experiment(
        "treadmill_guided", ["control.mode=position", "duration_s=60", STIFF_ANKLE]
    ).experiment
    assert config.control.safety.enabled
    run = simulate(config)
    assert run.status is RunStatus.COMPLETED and run.trip is None and run.verdict.outcome is Outcome.WALKED
    late = run.log.iloc[5000:]
    for side in SIDES:
        for joint, allowed in (("hip", 3.0), ("knee", 7.0)):
            error = late[f"{side}_{joint}_angle_rad"] - late[f"{side}_{joint}_equilibrium_rad"]
            assert math.degrees(math.sqrt((error**2).mean())) < allowed


def test_equilibrium_in_the_log_is_the_path_at_the_instant():
    config = experiment("control.mode=position", "duration_s=0.5", "engine=pinocchio")
    path = reference_path(config)
    log = simulate(config).log
    share = np.arange(101) / 100.0
    for side, start in zip(SIDES, path.starts, strict=True):
        progress = (start + np.arange(len(log)) / path.cycle_ticks) % 1.0
        for number, joint in enumerate(("hip", "knee")):
            expected = np.interp(progress, share, path.angles[:, number])
            assert_allclose(log[f"{side}_{joint}_equilibrium_rad"], expected, rtol=0.0, atol=1e-12)


# ---------------------------------------------------------------- help


def test_assistance_decays_and_returns_as_computed_by_hand():
    law = AssistanceParameters(forgetting_factor=0.9, gain=0.5, error_deadband=0.1, min_assistance=0.2)
    assert adapted_assistance(law, 1.0, 0.05) == pytest.approx(0.9)
    assert adapted_assistance(law, 0.5, 0.3) == pytest.approx(0.45 + 0.5 * 0.2)
    assert adapted_assistance(law, 0.21, 0.0) == 0.2
    assert adapted_assistance(law, 1.0, 9.0) == 1.0


def test_constant_error_leads_to_the_fixed_point_of_the_law():
    share, law = (
        1.0,
        AssistanceParameters(forgetting_factor=0.9, gain=0.6, error_deadband=0.1, min_assistance=0.0),
    )
    for _ in range(400):
        share = adapted_assistance(law, share, 0.15)
    assert share == pytest.approx(0.6 * 0.05 / (1.0 - 0.9))


@pytest.mark.parametrize(
    ("progress", "sample", "share"), [(0.0, 0, 0.0), (0.255, 25, 0.5), (1.255, 25, 0.5), (0.999, 99, 0.9)]
)
def test_phase_in_a_repeating_cycle(progress, sample, share):
    before, after = find_cycle_interval(progress, 101)
    assert before == sample and after == pytest.approx(share, abs=1e-9)


def test_spring_share_scales_the_springs_of_the_table():
    config = experiment(*MODES["twincare"], "duration_s=0.01", "engine=pinocchio")
    log = simulate(config).log
    row = build_setup(experiment()).phase_rows[0, log["left_phase"].cat.codes.iloc[0]]
    for number, (joint, share) in enumerate((("hip", 0.7), ("knee", 0.9))):
        full = row[COLUMNS_PER_JOINT * number + STIFFNESS]
        assert log[f"left_{joint}_stiffness_Nm_per_rad"].iloc[0] == pytest.approx(share * full, rel=1e-12)


@pytest.mark.slow
def test_assistance_of_a_walk_follows_from_the_errors_in_its_log():
    """By brute force from the log: errors of every stride, the law, and the stiffness that came of it."""
    config = experiment("control.assistance.adaptive=true", "duration_s=10")
    run = simulate(config)
    assert run.status is RunStatus.COMPLETED
    settings, path = config.control.assistance, reference_path(config)
    codes = np.asarray(run.log["left_phase"].cat.codes)
    entries = [tick for tick in range(1, len(codes)) if codes[tick] == 0 and codes[tick - 1] != 0]
    assert len(entries) >= 4
    angle = run.log["left_hip_measured_angle_rad"].to_numpy()
    phase = run.table.phases_of(Side.LEFT)
    given = run.log["left_hip_stiffness_Nm_per_rad"].to_numpy()
    share, begin, length = 1.0, 0, float(path.cycle_ticks)
    for entry in entries:
        progress = (np.arange(begin, entry) - begin) / length % 1.0
        wanted = np.interp(progress, np.arange(101) / 100.0, path.angles[:, 0])
        error = float(np.abs(angle[begin:entry] - wanted).mean())
        share = max(
            settings.min_assistance,
            min(
                1.0,
                settings.forgetting_factor * share
                + settings.gain * max(0.0, error - settings.error_deadband),
            ),
        )
        if begin > 0:
            length = float(entry - begin)
        begin = entry
        later = entry + int(np.argmax(codes[entry:] != 0)) - 1  # the last tick of early stance
        if codes[later] == 0:
            asked_for = phase[run.table.phase_names[0]].joints["hip"].stiffness
            assert given[later] / asked_for == pytest.approx(share, rel=1e-9)


# ---------------------------------------------------------------- engines


@pytest.mark.parametrize(
    "mode",
    # A share of the springs is a part of assistance as needed, and its own loop.
    [
        pytest.param(
            mode, marks=[pytest.mark.slow] if mode in ("position", "twincare", "assist_as_needed") else []
        )
        for mode in MODES
    ],
)
def test_engines_agree_on_every_mode(mode):
    """0.3 s in all columns; Runge-Kutta, as the walks of the other tests, so that one compilation serves."""
    config = replace(
        experiment(*MODES[mode], "duration_s=0.3"),
        integration=Integration(method=IntegrationMethod.RK4, step=0.5e-3),
    )
    first, second = (
        simulate(replace(config, engine=engine)).log.select_dtypes("number") for engine in Engine
    )
    assert list(first) == list(second) and len(first) == len(second)
    scale = np.maximum(1.0, np.abs(first.to_numpy()).max(axis=0))
    assert (np.abs(first.to_numpy() - second.to_numpy()) / scale).max() < 1e-9
