"""The wearer's own gait: joints without a drive, perception, strength and energy, in all engines.

The independent checks of whole walks are in test_oracle.py and test_mujoco_loop.py.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from errors import raises, warns
from log_rows import log_matrix

from twin_gait import load_experiment, simulate
from twin_gait.configuration.validation import packaged
from twin_gait.core.control_tick import ImpedanceSetpoint
from twin_gait.core.estimation import new_delay_line
from twin_gait.core.own_gait import OwnJoint, muscle_torque
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.leg_model.attachments import AddedMass, Attachment, BodySegment
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import StartPhaseWarning, build_setup, start_phase
from twin_gait.simulation.simulator import simulate_blocks
from twin_gait.studies.batch import override_experiment

# A table of a device, with its friction compensation.
TREADMILL = packaged("tables")["treadmill_guided"]
# A knee orthosis whose table needs one joint and the foot under it.
KNEE_TABLE = """
schema_version: 2
name: one_knee
joints: [knee]
cycles: [[early_stance, swing_flexion]]
phases:
  early_stance:
    knee:
      {stiffness_Nm_per_rad: 150, damping_Nms_per_rad: 5, equilibrium_deg: 8, friction_compensation_gain: 0}
  swing_flexion:
    knee:
      {stiffness_Nm_per_rad: 20, damping_Nms_per_rad: 2, equilibrium_deg: 30, friction_compensation_gain: 0}
transitions:
  - {from: early_stance, to: swing_flexion, cause: unloaded, all: [foot.load_bw < 0.2], after_s: 0.3}
  - {from: swing_flexion, to: early_stance, cause: loaded, all: [foot.load_bw > 0.25], after_s: 0.3}
"""


def experiment_of(preset: str = "hip_exoskeleton", *settings: str) -> Experiment:
    return load_experiment(preset, list(settings)).experiment


@pytest.fixture
def one_knee(tmp_path: Path) -> str:
    """Return an experiment file with a knee orthosis on the left leg."""
    (tmp_path / "one_knee.yaml").write_text(KNEE_TABLE, encoding="utf-8")
    file = tmp_path / "walk.yaml"
    content = "{schema_version: 2, preset: hip_exoskeleton, device: knee_orthosis, table: one_knee.yaml}"
    file.write_text(content, encoding="utf-8")
    return str(file)


def test_all_engines_give_the_same_log() -> None:
    short = experiment_of("hip_exoskeleton", "duration_s=0.4", "own_gait.angle_noise_deg=0.2")
    problem = build_setup(short)
    compiled, reference = CompiledEngine(problem).run(), ReferenceEngine(problem).run()
    np.testing.assert_allclose(log_matrix(compiled), log_matrix(reference), atol=1e-9, rtol=0.0)
    heavier = [replace(short, patient=replace(short.patient, mass=70.0 + number)) for number in range(40)]
    for number, run in simulate_blocks(heavier):
        alone = compiled if number == 0 else simulate(heavier[number])
        np.testing.assert_array_equal(log_matrix(run), log_matrix(alone))


@pytest.mark.slow  # compiles a loop
def test_muscles_act_at_once_whatever_the_delay_of_the_decisions() -> None:
    late, prompt = (
        simulate(experiment_of("hip_exoskeleton", "duration_s=0.5", f"own_gait.delay_ms={delay}"))
        for delay in (500, 0)
    )
    assert not np.array_equal(log_matrix(late), log_matrix(prompt))
    for run in (late, prompt):
        for side in ("left", "right"):
            column = {name: run.log[f"{side}_knee_{name}"].to_numpy() for name in (
                "angle_rad", "velocity_rad_per_s", "own_torque_Nm",
                "own_stiffness_Nm_per_rad", "own_damping_Nms_per_rad", "own_equilibrium_rad",
            )}  # fmt: skip
            away = column["angle_rad"] - column["own_equilibrium_rad"]
            spring = -column["own_stiffness_Nm_per_rad"] * away
            damper = -column["own_damping_Nms_per_rad"] * column["velocity_rad_per_s"]
            np.testing.assert_allclose(column["own_torque_Nm"], spring + damper, atol=1e-12)


def test_noise_of_perception_follows_the_seed() -> None:
    noisy = ("duration_s=0.6", "own_gait.angle_noise_deg=1")
    first, again, other = (
        simulate(experiment_of("hip_exoskeleton", *noisy, f"seed={seed}")) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(log_matrix(first), log_matrix(again))
    assert not np.array_equal(log_matrix(first), log_matrix(other))


def test_weak_muscles_limit_their_torque() -> None:
    setpoint = ImpedanceSetpoint(stiffness=100.0, damping=10.0, equilibrium=0.5, gain=0.0)
    line = new_delay_line(0)
    joint = OwnJoint(0, 12.0, [setpoint], setpoint, setpoint, line, line)
    assert muscle_torque(joint, 0.45, 0.1) == pytest.approx(100.0 * 0.05 - 10.0 * 0.1)
    assert muscle_torque(joint, -1.0, 0.0) == 12.0
    assert muscle_torque(joint, 2.0, 0.0) == -12.0
    strength = ("patient.both.knee.strength=0.1", "own_gait.peak_torque_Nm.knee=80", "duration_s=0.5")
    log = simulate(experiment_of("hip_exoskeleton", *strength)).log
    torques = log[["left_knee_own_torque_Nm", "right_knee_own_torque_Nm"]].abs().to_numpy()
    assert torques.max() == pytest.approx(0.1 * 80.0)


def work_of_knees(log: pd.DataFrame, prefix: str) -> float:
    """Integrate torque times velocity of both knees; the impedance is constant during each tick."""
    work = 0.0
    for side in ("left", "right"):
        angle = log[f"{side}_knee_{prefix}angle_rad"].to_numpy()
        velocity = log[f"{side}_knee_{prefix}velocity_rad_per_s"].to_numpy()
        stiffness = log[f"{side}_knee_own_stiffness_Nm_per_rad"].to_numpy()[:-1]
        damping = log[f"{side}_knee_own_damping_Nms_per_rad"].to_numpy()[:-1]
        equilibrium = log[f"{side}_knee_own_equilibrium_rad"].to_numpy()[:-1]
        for end in (slice(None, -1), slice(1, None)):  # start and end of each tick
            torque = -stiffness * (angle[end] - equilibrium) - damping * velocity[end]
            work += 0.5 * TICK * float(np.sum(torque * velocity[end]))
    return work


def test_work_of_the_muscles_closes_the_energy_balance() -> None:
    run = simulate(experiment_of("hip_exoskeleton", "duration_s=4"))
    summary = summarise_run(run)
    assert summary["energy_residual_share"] < 1e-7
    assert abs(run.log["own_gait_work_J"].iloc[-1]) > 1.0
    # The trapezoidal rule over whole ticks, to which 4e-6 of the work is lost.
    assert run.log["own_gait_work_J"].iloc[-1] == pytest.approx(work_of_knees(run.log, ""), rel=2e-5)
    assert set(summary["sides"]["left"]["joints"]) == {"hip"}
    assert set(summary["sides"]["left"]["own_gait"]) == {"knee"}


@pytest.mark.slow
def test_device_on_the_right_is_the_mirror_image_of_one_on_the_left(one_knee: str) -> None:
    left = simulate(load_experiment(one_knee, ["duration_s=1.8"]).experiment)
    mass = "leg.attachment.masses"
    mirrored = simulate(
        load_experiment(
            one_knee,
            [
                "duration_s=1.8",
                "scenario.leading=right",
                "leg.driven_sides=[right]",
                *(f"{mass}.left_{part}.mass_kg=0" for part in ("thigh", "shank")),
                f"{mass}.right_thigh={{mass_kg: 1.9, along: 0.8, radius_of_gyration_m: 0.1}}",
                f"{mass}.right_shank={{mass_kg: 0.8, along: 0.3, radius_of_gyration_m: 0.1}}",
            ],
        ).experiment
    )
    assert {item.side for item in left.switches} == {"left"}
    assert {item.side for item in mirrored.switches} == {"right"}
    assert [item.tick for item in left.switches] == [item.tick for item in mirrored.switches] != []
    for name in ("hip_angle_rad", "knee_angle_rad", "ankle_angle_rad", "foot_normal_force_N"):
        for side, other in (("left", "right"), ("right", "left")):
            ours, theirs = left.log[f"{side}_{name}"], mirrored.log[f"{other}_{name}"]
            np.testing.assert_allclose(ours, theirs, atol=1e-6, rtol=0.0)


def test_parts_of_the_device_are_masses_on_the_segments() -> None:
    base = experiment_of()
    part = AddedMass(mass=2.0, along=0.25, forward=0.1, radius_of_gyration=0.2)
    models = []
    for attachment in (
        Attachment(),
        Attachment(masses={BodySegment.LEFT_SHANK: part}),
        Attachment(replaced={BodySegment.LEFT_SHANK: 1.0, BodySegment.LEFT_FOOT: 1.0}),
    ):
        changed = replace(base, leg=replace(base.leg, attachment=attachment))
        models.append(changed.leg_model(changed.patient, changed.scenario.pelvis))
    bare, loaded, amputated = models
    assert loaded.total_mass == pytest.approx(bare.total_mass + 2.0)
    # de Leva: shank and foot of a man have 4.33 and 1.37 % of the body mass.
    assert amputated.total_mass == pytest.approx(bare.total_mass - 70.0 * (0.0433 + 0.0137))
    knee = bare.index("left", "knee")
    shank = 0.246 * 1.75
    added = 2.0 * ((0.25 * shank) ** 2 + 0.1**2 + 0.2**2)  # Steiner, about the axis of the knee
    inertia = [model.effective_inertia(np.zeros(model.nv), knee) for model in (bare, loaded)]
    assert inertia[1] - inertia[0] == pytest.approx(added)


@pytest.mark.slow
def test_device_in_braces_can_leave_joints_to_the_wearer() -> None:
    hips = (
        "device=twin",
        "own_gait=own_gait",
        "table=hip_exoskeleton",
        "interface=brace",
        "plant.actuators={knee: null}",
        "duration_s=0.5",
    )
    run = simulate(experiment_of("treadmill_guided", *hips))
    # In braces the wearer's knees oscillate, so that the trapezoidal rule loses 3e-4 of the work.
    assert run.log["own_gait_work_J"].iloc[-1] == pytest.approx(work_of_knees(run.log, "wearer_"), rel=1e-3)
    assert summarise_run(run)["energy_residual_share"] < 1e-6


@pytest.mark.parametrize(
    ("setting", "facts"),
    [
        ("patient=null", ["own_gait", "null"]),
        ("patient.left.knee.effort=0.5", ["patient.left.knee.effort", "0", "0.5"]),
        (
            f"own_gait.table={TREADMILL}",
            ["own_gait.table.phases.early_stance.hip.friction_compensation_gain", "0", "0.28"],
        ),
        ("own_gait.delay_ms=600", ["own_gait.delay_ms", "500", "600"]),
        ("leg.driven_sides=[right, left]", ["driven_sides", "left, right", "right, left"]),
        (
            "scenario.leading_phase=flight",
            ["scenario.leading_phase", "hip_exoskeleton", "own_gait", "flight"],
        ),
    ],
)
def test_own_gait_that_does_not_fit_is_refused(setting: str, facts: list[str]) -> None:
    with raises((ParameterError, ParameterFileError), *facts):
        build_setup(experiment_of("hip_exoskeleton", setting))


def test_device_that_lacks_the_phase_of_the_start_says_where_it_starts(one_knee: str) -> None:
    experiment = experiment_of(one_knee, "scenario.leading_phase=middle_stance")
    with warns(StartPhaseWarning, "scenario.leading_phase", "middle_stance", "early_stance", "swing_flexion"):
        setup = build_setup(experiment)
    assert start_phase(setup.table, "middle_stance") == 0
    assert setup.own_table is not None and start_phase(setup.own_table, "middle_stance") == 1


def test_own_gait_walks_on_a_treadmill_only() -> None:
    with raises((ParameterError, ParameterFileError), "own_gait", "null", "treadmill"):
        experiment_of("overground", "device=ak80_9_hip", "table=hip_exoskeleton", "own_gait=own_gait")


def test_own_gait_needs_a_joint_without_a_drive() -> None:
    with raises((ParameterError, ParameterFileError), "own_gait.table.joints", "hip, knee"):
        experiment_of("treadmill_guided", "own_gait=own_gait")


def test_own_gait_in_a_persons_file_refers_to_the_folder_of_the_person(tmp_path: Path) -> None:
    people, walks = tmp_path / "people", tmp_path / "walks"
    people.mkdir()
    walks.mkdir()
    table = packaged("own_gaits")["own_gait"].read_text(encoding="utf-8")
    limping = table.replace("name: own_gait", "name: limping")
    (people / "limping.yaml").write_text(limping, encoding="utf-8")
    person = people / "ann.yaml"
    person.write_text("{schema_version: 2, mass_kg: 72, own_gait: limping.yaml}", encoding="utf-8")
    walk = walks / "walk.yaml"
    content = "{schema_version: 2, preset: hip_exoskeleton, patient: ../people/ann.yaml}"
    walk.write_text(content, encoding="utf-8")
    in_file = load_experiment(str(walk)).experiment
    in_setting = load_experiment("hip_exoskeleton", [f"patient={person}"]).experiment
    in_study = override_experiment(load_experiment("hip_exoskeleton").experiment, {"patient": str(person)})
    for experiment in (in_file, in_setting, in_study):
        assert experiment.patient is not None and experiment.own_gait is not None
        assert experiment.patient.mass == 72.0
        assert experiment.own_gait.table.name == "limping"
