"""A wearer who is bound to the device by braces: two chains, and what they do to each other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cohorts.shipped import stiffened
from errors import raises, states
from idealised import idealised
from numpy.testing import assert_allclose

from twin_gait import load_experiment, simulate
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.conventions import RAJAGOPAL
from twin_gait.core.plant import Brace, brace_torque
from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.export.motion import export_motion
from twin_gait.gait.table import TICK
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.measures.effort import energy_balance
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.strides import normalise_strides, root_mean_square_error, stride_extremes
from twin_gait.parameters.environment import BraceParameters, SpringDamper
from twin_gait.report.reference import reference_cycle
from twin_gait.report.run_figures import draw_angles
from twin_gait.runs.log_files import read_log_table
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.log import WORK_SOURCES
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stages.motion import integrate
from twin_gait.studies.compare.measures import run_measures
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.bracing import is_step_stable

FINE = Integration(method=IntegrationMethod.RK4, step=0.1e-3)
JOINTS = [(side, joint) for side in Side for joint in JointName]


def bench(*settings: str, **changes: object) -> Experiment:
    """A worn leg on its stand, stepped in Python on two Pinocchio models."""
    wanted = ["patient.mass_kg=70", "interface=brace", "duration_s=0.4", "sensors.ideal=true", *settings]
    experiment = load_experiment("bench_leg", wanted).experiment
    return replace(experiment, **{"engine": Engine.PINOCCHIO, "integration": FINE, **changes})


def without_motors(
    experiment: Experiment, step: float, method: IntegrationMethod
) -> tuple[Episode, Callable[[Episode, int], None]]:
    """Device and wearer by themselves on Pinocchio, and what moves them by one step."""
    problem = build_setup(experiment)
    _, e, structure = assemble(problem)
    e.step, e.substeps, e.recording.on = step, 1, False
    structure["WITH_RK4"] = method is IntegrationMethod.RK4
    kernel = PinocchioKernel(problem.world, problem.control_model).functions
    return e, specialize(integrate, {**structure, **kernel})


@pytest.fixture(scope="module")
def bench_run():
    return simulate(bench())


@pytest.fixture(scope="module")
def walk():
    settings = ["interface=brace", "patient=stroke_left", "duration_s=14"]  # the strides that a verdict needs
    return simulate(load_experiment("treadmill_guided", settings).experiment)


# ---------------------------------------------------------------------- the bodies


@pytest.mark.parametrize("preset", ["treadmill_guided", "bench_leg"])
def test_device_and_wearer_add_up_to_the_whole(preset):
    world = load_experiment(preset, ["patient.mass_kg=62", "interface=brace"]).experiment.build_world()
    assert world.braces is not None
    q = np.random.default_rng(1).uniform(-0.8, 0.8, world.model.nv)
    parts = world.braces.device, world.braces.wearer
    assert_allclose(sum(part.mass_matrix(q) for part in parts), world.model.mass_matrix(q), atol=1e-12)
    assert_allclose(sum(part.gravity_torque(q) for part in parts), world.model.gravity_torque(q), atol=1e-11)
    assert sum(part.total_mass for part in parts) == pytest.approx(world.model.total_mass)
    assert not world.braces.wearer.model.armature.any()
    assert world.braces.device.model.armature.any()


# ---------------------------------------------------------------------- closed form


def test_two_inertias_oscillate_as_the_closed_form_predicts():
    """The hip alone: a rotor of a million kg·m² holds the device's knee, a stiff brace the wearer's."""
    brace = BraceParameters(
        hip=SpringDamper(stiffness=700.0, damping=11.0),
        knee=idealised(SpringDamper(stiffness=1.0, damping=0.0), stiffness=1e7),
    )
    experiment = bench(interface=brace)
    plant = experiment.plant
    locked = idealised(plant.actuators[JointName.KNEE], gear_inertia=1e6)
    actuators = {**plant.actuators, JointName.KNEE: locked}
    free = replace(plant, actuators=actuators, gravity=0.0, friction_ratio=dict.fromkeys(actuators, 0.0))
    alone = replace(experiment, plant=free)
    world = alone.build_world()
    assert world.braces is not None
    hip = world.model.index(Side.RIGHT, JointName.HIP)
    q, inertia = world.start_q[: world.model.nv], []
    for chain in world.chains:
        inertia.append(float(chain.mass_matrix(q)[hip, hip]))
    both = 1.0 / inertia[0] + 1.0 / inertia[1]
    decay = 0.5 * brace.hip.damping * both
    frequency = math.sqrt(brace.hip.stiffness * both - decay * decay)
    amplitude, (leg, step) = 1e-4, without_motors(alone, FINE.step, FINE.method)
    leg.q[hip] += amplitude
    apart, times = [], np.arange(3000) * FINE.step
    for tick in range(len(times)):
        apart.append(leg.q[hip] - leg.q[hip + world.wearer_offset])
        step(leg, tick)
    expected = amplitude * np.exp(-decay * times)
    expected *= np.cos(frequency * times) + decay / frequency * np.sin(frequency * times)
    assert frequency * times[-1] > 2.0 * math.pi  # more than one whole swing
    assert_allclose(apart, expected, atol=2e-3 * amplitude)


def test_the_braces_pull_a_lagging_wearer():
    assert brace_torque(Brace(50.0, 0.0), 0.1, 0.0) == pytest.approx(5.0)
    assert brace_torque(Brace(0.0, 2.0), 0.0, -2.0) == pytest.approx(-4.0)


def test_error_against_the_rigid_leg_is_inversely_proportional_to_brace_stiffness():
    rigid = simulate(bench("duration_s=0.3", interface=None)).log["right_hip_angle_rad"]
    factors, errors = (1.0, 20.0, 400.0), []
    for factor in factors:
        braced = simulate(bench("duration_s=0.3", interface=stiffened(factor)))
        errors.append(np.abs(braced.log["right_hip_angle_rad"] - rigid).max())
    slope = np.polyfit(np.log(factors), np.log(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.1)


# ---------------------------------------------------------------------- forces and energy


def derivative(values: np.ndarray) -> np.ndarray:
    """Central differences of the fourth order, shape ``(n - 4,)``."""
    return (values[:-4] - 8.0 * values[1:-3] + 8.0 * values[3:-1] - values[4:]) / (12.0 * TICK)


def test_torque_of_the_device_on_the_wearer_is_subtracted_from_the_device(bench_run):
    """Inverse dynamics of the logged motion of each by itself."""
    log, world = bench_run.log, bench_run.experiment.build_world()
    assert world.braces is not None

    def columns(name: str) -> np.ndarray:
        return log[[f"right_{joint}_{name}" for joint in ("hip", "knee")]].to_numpy()

    brace = columns("brace_torque_Nm")
    on_device = sum(columns(f"{name}_torque_Nm") for name in ("motor", "friction", "stop")) - brace
    sides = (
        (world.braces.device, "", on_device),
        (world.braces.wearer, "wearer_", brace + columns("external_torque_Nm")),
    )
    for model, prefix, torque in sides:
        q, v = columns(f"{prefix}angle_rad"), columns(f"{prefix}velocity_rad_per_s")
        a = np.column_stack([derivative(column) for column in v.T])
        needed = [model.inverse_dynamics(*item) for item in zip(q[2:-2], v[2:-2], a, strict=True)]
        # The motor holds its torque for a tick and then steps, at which the differences blur.
        error = np.abs(np.array(needed) - torque[2:-2])
        assert np.median(error, axis=0).max() < 1e-2 * np.abs(brace).max()


def test_energy_taken_by_the_braces_is_stored_or_dissipated(bench_run):
    log, brace = bench_run.log, BraceParameters()
    stored, dissipated = np.zeros(len(log)), np.zeros(len(log))
    for joint in (JointName.HIP, JointName.KNEE):
        name, item = f"right_{joint}", brace.joint_brace(joint)
        apart = (log[f"{name}_angle_rad"] - log[f"{name}_wearer_angle_rad"]).to_numpy()
        speed = (log[f"{name}_velocity_rad_per_s"] - log[f"{name}_wearer_velocity_rad_per_s"]).to_numpy()
        stored += 0.5 * item.stiffness * apart**2
        power = item.damping * speed**2
        dissipated[1:] += np.cumsum(0.5 * (power[1:] + power[:-1])) * TICK
    assert dissipated[-1] > 1e-3
    # The trapezoids of 1 ms are the error: a twelfth of the square of some 0.05 rad a tick.
    assert_allclose(log["brace_work_J"], -stored - dissipated, atol=1e-3 * dissipated[-1])


@pytest.mark.parametrize("run", ["bench_run", pytest.param("walk", marks=pytest.mark.slow)])
def test_energy_of_both_changes_by_all_the_work(run, request):
    log = request.getfixturevalue(run).log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    balance = energy_balance(
        energy, log[[f"{name}_work_J" for name in (*WORK_SOURCES, "brace")]].to_numpy().T
    )
    assert balance["energy_residual_share"] < 1e-7
    without = energy_balance(energy, log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy().T)
    assert without["energy_residual_share"] > 1e-3


@pytest.mark.slow
def test_the_brace_at_the_pelvis_carries_the_weight_of_the_device(walk):
    assert walk.status == "completed"
    world = walk.experiment.build_world()
    assert world.braces is not None
    weight = world.braces.device.total_mass * walk.experiment.plant.gravity
    settled = walk.log["pelvis_brace_force_N"].iloc[2000:].mean()
    assert settled == pytest.approx(-weight, rel=0.01)  # 8 s, so that bobbing hardly counts
    assert (walk.log["wearer_pelvis_height_m"] > walk.log["pelvis_height_m"]).iloc[100:].all()


# ---------------------------------------------------------------------- engines


@pytest.mark.slow
def test_both_engines_walk_the_same_walk():
    settings = ["interface=brace", "patient=stroke_left", "duration_s=0.8", "sensors.ideal=true"]
    compiled = load_experiment("treadmill_guided", settings).experiment
    plain = replace(compiled, engine=Engine.PINOCCHIO, integration=compiled.resolved_integration)
    first, second = simulate(compiled), simulate(plain)
    assert first.switches == second.switches and len(first.switches) > 2
    numbers = first.log.select_dtypes("number").columns
    for name in numbers:
        largest = np.abs(first.log[name]).max()
        assert_allclose(first.log[name], second.log[name], atol=1e-9 * max(largest, 1.0), err_msg=name)


def test_logs_have_columns_of_braces_only_with_braces(bench_run):
    rigid = simulate(bench("interface=rigid", "duration_s=0.01"))
    extra = set(bench_run.log.columns) - set(rigid.log.columns)
    joints = {f"right_{joint}_" for joint in ("hip", "knee")}
    names = ("wearer_angle_rad", "wearer_velocity_rad_per_s", "brace_torque_Nm")
    assert extra == {joint + name for joint in joints for name in names} | {"brace_work_J"}
    assert "interaction" not in summarise_run(rigid)


# ---------------------------------------------------------------------- the step


@pytest.mark.parametrize("method", list(IntegrationMethod))
def test_a_step_is_stable_up_to_the_stated_brace_stiffness(method):
    def braced(stiffness: float) -> Experiment:
        knee = idealised(SpringDamper(stiffness=1.0, damping=0.5), stiffness=stiffness)
        brace = BraceParameters(knee=knee)
        angles = {JointName.HIP: 0.0, JointName.KNEE: 1.0}
        bent = replace(load_experiment("bench_leg").experiment.scenario, start_angles=angles)
        experiment = bench(interface=brace, scenario=bent, integration=replace(FINE, step=1e-5))
        plant = replace(
            experiment.plant, gravity=0.0, friction_ratio=dict.fromkeys(experiment.plant.friction, 0.0)
        )
        return replace(experiment, plant=plant)

    def growth(stiffness: float) -> float:
        leg, advance = without_motors(braced(stiffness), step, method)
        leg.q[knee] += 1e-8
        for tick in range(3000):
            advance(leg, tick)
            apart = abs(leg.q[knee] - leg.q[knee + shift]) / 1e-8
            if apart > 1e4:
                break  # before numbers overflow
        return apart

    step, low, high = 1e-3, 1e3, 1e7
    made = braced(low).build_world()
    knee, shift = made.model.index(Side.RIGHT, JointName.KNEE), made.wearer_offset
    for _ in range(20):
        middle = math.sqrt(low * high)
        if is_step_stable(braced(middle).build_world(), step, runge_kutta=method is IntegrationMethod.RK4):
            low = middle
        else:
            high = middle
    assert 1e3 < low < 9e6
    assert growth(0.9 * low) < 2.0
    assert growth(1.1 * low) > 1e3


@pytest.mark.parametrize("engine", list(Engine))
def test_the_lightest_wearer_needs_no_finer_step(engine):
    """Of the sizes that the device is made for."""
    settings = ["patient.mass_kg=30", "patient.height_m=1.47", "interface=brace", f"engine={engine}"]
    for preset in ("treadmill_guided", "bench_leg"):
        assert load_experiment(preset, settings).experiment.build_world().braces is not None


# ---------------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("value", "facts"),
    [
        ("soft", ("interface", "rigid", "brace", "soft")),
        ("3", ("interface", "3")),
        ("{kind: rigid, hip: {stiffness_Nm_per_rad: 5}}", ("interface", "rigid")),
        (
            "{kind: brace, hip: {stiffness_Nm_per_rad: -5}}",
            ("interface.hip.stiffness_Nm_per_rad", "0", "-5"),
        ),
        (
            "{kind: brace, knee: {stiffness_Nm_per_rad: 0}}",
            ("interface.knee.stiffness_Nm_per_rad", "0"),
        ),
        ("{kind: brace, knee: {damping_Nms_per_rad: .nan}}", ("interface.knee.damping_Nms_per_rad", "nan")),
        (
            "{kind: brace, pelvis: {damping_Ns_per_m: -1}}",
            ("interface.pelvis.damping_Ns_per_m", "0", "-1"),
        ),
        ("{kind: brace, thigh: {}}", ("interface.thigh",)),
        ("{kind: brace, ankle: {damping_Nms_per_rad: 1000}}", ("integration.step_ms",)),
        ("{kind: brace, ankle: {stiffness_Nm_per_rad: 1.0e+8}}", ("1e+06",)),
    ],
)
def test_a_mistake_is_one_line_with_its_location(value, facts):
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill_guided", [f"interface={value}"]).experiment.build_world()
    assert states(str(caught.value), *facts) and "\n" not in str(caught.value)


def test_braces_too_stiff_for_any_step_are_refused_with_a_softer_value():
    endless = BraceParameters(ankle=idealised(SpringDamper(stiffness=1.0, damping=3.0), stiffness=1e300))
    with raises(TwinGaitError, "interface", "0.25 ms", "rk4"):
        replace(load_experiment("treadmill_guided").experiment, interface=endless).build_world()


def test_the_suggested_step_is_stable_for_the_braces():
    stiff = "interface={kind: brace, ankle: {damping_Nms_per_rad: 1000}}"
    with raises(TwinGaitError, "interface", "0.25 ms", "integration.step_ms") as caught:
        load_experiment("treadmill_guided", [stiff]).experiment.build_world()
    step = str(caught.value).split("step_ms to ")[1].split()[0]
    world = load_experiment(
        "treadmill_guided", [stiff, f"integration.step_ms={step}"]
    ).experiment.build_world()
    assert world.braces is not None


def test_braces_need_a_wearer():
    with raises(TwinGaitError, "interface", "rigid"):
        load_experiment("bench_leg", ["interface=brace"])


def test_braces_survive_their_file(tmp_path):
    chosen = "interface={kind: brace, hip: {stiffness_Nm_per_rad: 812.5}}"
    experiment = load_experiment("treadmill_guided", [chosen]).experiment
    assert experiment.interface is not None
    assert experiment.interface.hip == replace(BraceParameters().hip, stiffness=812.5)
    assert experiment_from_mapping(experiment_document(experiment), "made", tmp_path) == experiment


def test_presets_have_rigid_braces():
    plain = load_experiment("treadmill_guided").experiment
    assert plain.interface is None
    braced = ["interface=brace", "interface=rigid"]
    assert load_experiment("treadmill_guided", braced).experiment == plain


# ---------------------------------------------------------------------- measures


def test_summary_has_the_power_through_the_braces(walk):
    found = summarise_run(walk)["interaction"]
    assert set(found) == {f"{side}_{joint}" for side, joint in JOINTS} | {"pelvis"}
    torque = walk.log["left_knee_brace_torque_Nm"]
    assert found["left_knee"]["torque_rms_Nm"] == pytest.approx(math.sqrt((torque**2).mean()))
    assert found["left_knee"]["torque_peak_Nm"] == torque.abs().max()
    apart = walk.log["left_knee_angle_rad"] - walk.log["left_knee_wearer_angle_rad"]
    assert found["left_knee"]["motion_peak_deg"] == pytest.approx(math.degrees(apart.abs().max()))
    sag = (walk.log["pelvis_height_m"] - walk.log["wearer_pelvis_height_m"]).abs().max()
    assert found["pelvis"]["motion_peak_mm"] == pytest.approx(1e3 * sag)


def error_of(run, column):
    """Distance of the left knee from healthy walking in [deg], from a column of the log."""
    record = leg_record(run.log, Side.LEFT, run.table.phase_names, TICK, steady=run.steady_spans)
    cycles = normalise_strides(run.log[column].to_numpy(), record.strides())
    return math.degrees(root_mean_square_error(cycles, reference_cycle(run.experiment, JointName.KNEE)))


def test_the_gait_is_the_wearers_and_the_device_gait_is_available(walk):
    summary, numbers = summarise_run(walk), run_measures(walk)
    wearers, devices = (error_of(walk, f"left_knee_{name}angle_rad") for name in ("wearer_", ""))
    assert abs(wearers - devices) > 0.1
    assert summary["sides"]["left"]["rmse_knee_by_contact_deg"] == pytest.approx(wearers, rel=1e-12)
    assert summary["interaction"]["left_knee"]["rmse_of_device_deg"] == pytest.approx(devices, rel=1e-12)
    record = leg_record(
        walk.log, Side.LEFT, walk.table.phase_names, TICK, steady=(walk.experiment.scenario.steady,)
    )
    extremes = np.degrees(
        stride_extremes(walk.log["left_knee_wearer_angle_rad"].to_numpy(), record.strides())
    )
    moved = float(np.mean(extremes[:, 1] - extremes[:, 0]))
    assert numbers["left_knee_range_of_motion_deg"] == pytest.approx(moved)
    assert summary["sides"]["left"]["joints"]["knee"]["range_of_motion_deg"] == pytest.approx(moved)


def test_an_exported_motion_is_the_wearers_by_default(walk, tmp_path):
    for device, column in ((False, "left_knee_wearer_angle_rad"), (True, "left_knee_angle_rad")):
        path = tmp_path / f"{device}.sto"
        export_motion(walk.log, path, RAJAGOPAL, unit="rad", device=device)
        motion = read_log_table(path)
        assert (motion.numbers("knee_angle_l") == walk.log[column]).all()


def test_the_picture_of_the_angles_has_both(walk):
    figure = draw_angles(walk)
    knee = next(axes for axes in figure.axes if axes.get_title().startswith("left knee"))
    shown = {line.get_label(): np.radians(line.get_ydata()) for line in knee.get_lines()}
    assert_allclose(shown["angle"], walk.log["left_knee_wearer_angle_rad"])
    assert_allclose(shown["angle of the device"], walk.log["left_knee_angle_rad"])


def test_the_comparison_takes_the_torque_of_the_braces(walk):
    log = walk.log.assign(left_hip_brace_torque_Nm=7.0)
    assert run_measures(replace(walk, log=log))["left_hip_interaction_rms_Nm"] == pytest.approx(7.0)
