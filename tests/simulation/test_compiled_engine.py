"""The compiled engine against Pinocchio: its dynamics, its whole episodes, and its cache."""

from __future__ import annotations

import ast
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from errors import raises
from hypothesis import given, settings
from hypothesis import strategies as st
from log_rows import log_matrix, run_result

import twin_gait
from twin_gait import load_experiment, simulate
from twin_gait.exceptions import ModelError
from twin_gait.kernels import rigid_body
from twin_gait.kernels.generated import KernelBodies, body_values, kernel_key, write_kernel
from twin_gait.kernels.tracing import Trace, TraceStep, rename_results, symbolic_sine_cosine
from twin_gait.leg_model.bodies import contact_points, export_bodies
from twin_gait.simulation import code_cache, compiled_engine
from twin_gait.simulation.compiled_engine import CompiledEngine, assemble, kernel_names
from twin_gait.simulation.log import WORK_SOURCES
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun

GRAVITY = 9.81


def random_model(seed: int, joints: int, *, armature: bool = True) -> pin.Model:
    """A random tree of revolute and prismatic joints with random axes, placements and inertias."""
    generator = np.random.default_rng(seed)
    model = pin.Model()
    joint = 0
    for index in range(joints):
        # Pinocchio numbers a tree depth first: a new joint hangs on the last one or on one above it.
        parent = joint
        while parent > 0 and generator.random() < 0.3:
            parent = int(model.parents[parent])
        axis = generator.standard_normal(3)
        axis /= np.linalg.norm(axis)
        kinds = [
            pin.JointModelRX(),
            pin.JointModelRY(),
            pin.JointModelRZ(),
            pin.JointModelPZ(),
            pin.JointModelRevoluteUnaligned(axis),
            pin.JointModelPrismaticUnaligned(axis),
        ]
        joint = model.addJoint(
            parent, kinds[int(generator.integers(len(kinds)))], pin.SE3.Random(), f"joint{index}"
        )
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    if armature:
        model.armature = generator.uniform(0.0, 2.0, model.nv)
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    return model


def plain_kernel(model: pin.Model):
    """The generated functions as plain Python, and what they are called with."""
    bodies = export_bodies(model)
    return kernel_names(KernelBodies(bodies, [], bodies, "z")), body_values(bodies)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31), joints=st.integers(1, 8))
def test_energies_and_root_wrench_of_any_tree_equal_pinocchio(seed, joints):
    pin.seed(seed)
    model = random_model(seed, joints)
    data = model.createData()
    names, values = plain_kernel(model)
    generator = np.random.default_rng(seed)
    q, v, tau = (generator.uniform(-2.0, 2.0, joints) for _ in range(3))
    a = np.array(pin.aba(model, data, q, v, tau))
    kinetic, potential, force, moment = names["observe"](q, v, a, values, GRAVITY, [])
    assert kinetic == pytest.approx(0.5 * v @ pin.crba(model, data, q) @ v, rel=1e-11, abs=1e-12)
    assert potential == pytest.approx(pin.computePotentialEnergy(model, data, q), rel=1e-11, abs=1e-10)
    pin.rnea(model, data, q, v, a)
    assert force == pytest.approx(data.f[1].linear[0], rel=1e-9, abs=1e-8)
    assert moment == pytest.approx(data.f[1].angular[1], rel=1e-9, abs=1e-8)


def test_another_wearer_needs_no_other_kernel():
    texts = set()
    for mass in (60, 80):
        model = (
            load_experiment("treadmill_guided", [f"patient.mass_kg={mass}"]).experiment.build_world().model
        )
        frames = [name for leg in model.legs.values() for name in leg.contact_frames]
        bodies = export_bodies(model.model)
        texts.add(write_kernel(KernelBodies(bodies, contact_points(model.model, frames), bodies, "z")))
    assert len(texts) == 1


def test_results_of_a_kernel_are_named_by_joint_and_quantity_in_commented_blocks():
    model = load_experiment("treadmill_guided").experiment.build_world().model
    frames = [name for leg in model.legs.values() for name in leg.contact_frames]
    bodies = export_bodies(model.model)
    longest = bodies[-1]._replace(name="a joint, of a very long name: 0123456789")
    for each in (bodies, [*bodies[:-1], longest]):
        text = write_kernel(KernelBodies(each, contact_points(model.model, frames), bodies, "z"))
        for function in ast.parse(text).body:
            assert isinstance(function, ast.FunctionDef) and ast.get_docstring(function)
            names = [item for item in ast.walk(function) if isinstance(item, ast.Name)]
            stored = [item.id for item in names if isinstance(item.ctx, ast.Store)]
            assert len(stored) == len(set(stored)), "a name is assigned twice"
            assert stored
            for name in stored:
                assert len(name) <= 31 and name.isascii() and not re.fullmatch(r"[a-z]\d+(_\d+)?", name)
    dynamics = text[text.index("def dynamics(") : text.index("def contact_forces(")]
    for comment in (
        "'Forward pass, velocity: left_knee.'",
        "'Contact: ",
        "'Row of the mass matrix: left_hip.'",
    ):
        assert comment in dynamics
    assert re.search(r"\bsine_left_knee = |\bsine_left_knee, ", dynamics)


def test_names_of_joints_belong_to_the_structure_of_a_kernel():
    bodies = export_bodies(load_experiment("treadmill_guided").experiment.build_world().model.model)
    renamed = [bodies[0]._replace(name="other"), *bodies[1:]]
    first, second = (kernel_key(KernelBodies(each, [], each, "z")) for each in (bodies, renamed))
    assert first != second


def test_names_that_end_in_a_number_are_not_confused():
    trace = Trace()
    x = trace.input("q[0]")
    trace.block = TraceStep("Leg.", "force", "leg")
    results = [x * 2.0, x * 3.0]
    trace.block = TraceStep("Leg 1.", "force", "leg_1")
    results.append(x * 4.0)
    lines = rename_results(trace.live_lines(results), trace)
    assert lines == [
        "'Leg.'",
        "force_leg_2 = q[0] * 2.0",
        "force_leg_3 = q[0] * 3.0",
        "'Leg 1.'",
        "force_leg_1 = q[0] * 4.0",
    ]


def test_a_joint_of_three_degrees_of_freedom_is_refused():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with raises(ModelError, "ball", "Spherical"):
        export_bodies(model)


def test_trace_folds_constants_and_shares_expressions():
    trace = Trace()
    x = trace.input("x")
    assert x * 0.0 == 0.0
    assert (x + 0.0) is x
    assert (x * 1.0) is x
    assert (x - x) == 0.0
    assert symbolic_sine_cosine(x)[1] is symbolic_sine_cosine(x)[1]
    assert symbolic_sine_cosine(0.0) == (0.0, 1.0)
    assert len(trace.lines) == 1


def test_joint_rotation_of_a_slanted_axis_is_rodrigues():
    axis = np.array([1.0, 2.0, -0.5])
    axis /= np.linalg.norm(axis)
    ours = rigid_body.joint_rotation(list(axis), 0.7).astype(float)
    np.testing.assert_allclose(ours, pin.exp3(0.7 * axis), atol=1e-15)


EULER = "integration={method: semi_implicit_euler, step_ms: 0.25}"
LIFTED_SOON = (  # a crutch, and a leg
    "scenario={arms: {planted_s: 0.05, lift_ahead_m: 0.5}, leading_phase: early_stance,"
    " trailing_phase: late_stance}"
)
WORN = "patient={mass_kg: 70, effort_noise: 0.1, effort_delay_ms: 20}"
ACTIVE = (
    "patient.both={hip: {passive: 1, contracture_deg: 6, effort: 0.5}, knee: {passive: 1.2, effort: 0.5,"
    " stretch_reflex_gain_Nms_per_rad: 2, stretch_reflex_threshold_deg_per_s: 30}}"
)
SENSED = "sensors={ideal: false, angle_noise_deg: 0.001}"
CRUTCHES = ("overground", "integration={method: rk4, step_ms: 0.5}", SENSED, LIFTED_SOON)
CASES = {
    "treadmill_guided": ("treadmill_guided", "duration_s=3", EULER),
    "treadmill, rk4": (
        "treadmill_guided",
        "duration_s=0.6",
        "integration.method=rk4",
        "integration.step_ms=0.25",
    ),
    "overground": (*CRUTCHES, "duration_s=0.4"),
    "bench leg": ("bench_leg", "duration_s=10", EULER),
    "bench leg, rk4": ("bench_leg", "duration_s=3", "integration.method=rk4", "integration.step_ms=1"),
    "bench leg with a hand": (
        "bench_leg",
        "duration_s=2",
        EULER,
        "control.mode=transparent",
        "scenario.imposed_motion={joint: knee, amplitude_deg: 40, release_s: 1.5}",
    ),
    "gears that lose under load": (
        "treadmill_guided",
        "duration_s=2",
        EULER,
        "plant.actuators.hip.gear_efficiency=0.85",
        "plant.actuators.knee.gear_efficiency=0.9",
    ),
    # The structures of cases further down, whose loops are compiled anyway.
    "uphill, commands late": (
        "treadmill_guided",
        "duration_s=1",
        EULER,
        "scenario.slope_deg=4",
        "control.delay_ms=2",
        WORN,
        ACTIVE,
        "faults=['encoder_drift:left_knee@0.02s=5deg/s', 'motor_stuck:right_hip@0.95s=20Nm']",
    ),
    "inertia compensation and noise": (
        "bench_leg",
        "duration_s=1",
        "integration={method: rk4, step_ms: 0.5}",
        "scenario.imposed_motion={joint: knee, amplitude_deg: 40, release_s: 0.2}",
        "control.inertia_compensation=0.2",
        SENSED,
    ),
}


@pytest.mark.parametrize(
    "case",
    [
        # That commands come late on a slope is checked over MuJoCo too.
        pytest.param(case, id=name, marks=[pytest.mark.slow] if name == "uphill, commands late" else [])
        for name, case in CASES.items()
    ],
)
def test_engines_agree_in_every_column(case):
    name, *changes = case
    ours = simulate(load_experiment(name, [*changes, "engine=compiled"]).experiment)
    theirs = simulate(load_experiment(name, [*changes, "engine=pinocchio"]).experiment)
    assert ours.status is theirs.status
    assert ours.switches == theirs.switches
    for column in theirs.log.columns:
        if column.endswith("_phase"):
            assert (ours.log[column] == theirs.log[column]).all()
        else:
            np.testing.assert_allclose(
                ours.log[column], theirs.log[column], atol=1e-9, rtol=1e-9, err_msg=column
            )


@pytest.mark.slow
def test_engines_agree_over_the_default_walk():
    """Twenty seconds on the belt: angles to 1e-9 rad and every switch in the same tick."""
    ours = simulate(load_experiment("treadmill_guided", [EULER, "engine=compiled"]).experiment)
    theirs = simulate(load_experiment("treadmill_guided", [EULER, "engine=pinocchio"]).experiment)
    assert ours.switches == theirs.switches
    for column in [name for name in theirs.log.columns if name.endswith("_angle_rad")]:
        np.testing.assert_allclose(ours.log[column], theirs.log[column], atol=1e-9, rtol=0, err_msg=column)


@pytest.mark.slow
def test_engines_pass_the_same_phases_with_quantised_sensors():
    """Five strides of either leg: a count of the encoder may flip, a phase may not."""
    changes = ["duration_s=12", EULER, "sensors.ideal=false"]
    runs = [
        simulate(load_experiment("treadmill_guided", [*changes, f"engine={engine}"]).experiment)
        for engine in ("compiled", "pinocchio")
    ]
    for side in ("left", "right"):
        ours, theirs = ([item.target for item in run.switches if item.side == side] for run in runs)
        assert ours.count("early_stance") >= 5
        strides = [number for number, target in enumerate(ours) if target == "early_stance"]
        assert ours[: strides[4] + 1] == theirs[: strides[4] + 1]


def test_a_fall_and_a_divergence_end_the_compiled_run_too():
    fall = ["duration_s=4", "scenario.support={share: 0, lock_stiffness_N_per_m: 0}", "engine=compiled"]
    limp = "table.phases.middle_stance.knee.stiffness_Nm_per_deg=0.01"
    assert simulate(load_experiment("treadmill_guided", [*fall, limp]).experiment).status == "fell"
    stiff = ["duration_s=1", "plant.stops.stiffness_Nm_per_rad=1e7", "engine=compiled"]
    beyond = "scenario.start={hip_deg: 20, knee_deg: -20}"
    run = simulate(load_experiment("bench_leg", [*stiff, beyond]).experiment)
    assert run.status == "diverged"
    assert 1 <= len(run.log) < 1000


def test_energy_balance_of_the_compiled_engine_closes():
    log = simulate(load_experiment("bench_leg", ["duration_s=3", "engine=compiled"]).experiment).log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    work = log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy().sum(axis=1)
    assert np.abs(energy - energy[0] - work).max() < 2e-3


def test_progress_and_interruption():
    seen = []
    run = simulate(
        load_experiment("bench_leg", ["duration_s=10", "engine=compiled"]).experiment,
        progress=lambda done, total: seen.append((done, total)),
        should_stop=lambda: len(seen) > 2,
    )
    assert run.status == "interrupted"
    assert 0 < len(run.log) < 10_000
    assert seen[0] == (0, 10_000)


EDIT = """
import sys
sys.path.insert(0, {folder!r})
from twin_gait import load_experiment, simulate
run = simulate(load_experiment("bench_leg", ["duration_s=0.2", "engine=compiled"]).experiment)
print(repr(float(run.log["right_knee_impedance_torque_Nm"].iloc[-1])))
"""


@pytest.mark.slow
def test_an_edit_in_core_is_used_by_the_next_run(tmp_path, monkeypatch):
    """A copy of the package is edited between two runs that share one cache."""
    source = Path(twin_gait.__file__).parent
    shutil.copytree(source, tmp_path / "twin_gait", ignore=shutil.ignore_patterns("__pycache__"))
    if not (tmp_path / "twin_gait" / "urdf").is_dir():
        shutil.copytree(source.parent / "urdf", tmp_path / "twin_gait" / "urdf")
    monkeypatch.setenv(code_cache.CACHE_VARIABLE, str(tmp_path / "cache"))

    def run() -> float:
        code = EDIT.format(folder=str(tmp_path))
        return float(subprocess.check_output([sys.executable, "-c", code], text=True, cwd=tmp_path))

    before = run()
    law = tmp_path / "twin_gait" / "core" / "impedance.py"
    text = law.read_text()
    assert "return -(stiffness" in text
    law.write_text(text.replace("return -(stiffness", "return -0.5 * (stiffness"))
    after = run()
    assert before != after
    assert abs(after) < abs(before)


@pytest.mark.parametrize(
    ("preset", "setting"),
    [
        ("treadmill_guided", "patient=stroke_left"),
        ("treadmill_guided", "patient=complete_sci"),
        ("bench_leg", "patient=stroke_left"),
        ("overground", "sensors.ideal=false"),
    ],
)
def test_a_setting_of_the_run_needs_no_other_loop(preset, setting, monkeypatch):
    monkeypatch.setattr(compiled_engine, "load_or_compile_loop", lambda *arguments: None)
    plain, changed = (
        CompiledEngine(build_setup(load_experiment(preset, settings).experiment)).specialization_key
        for settings in ([], [setting])
    )
    assert plain == changed


def test_a_live_session_with_room_for_faults_needs_no_other_loop(monkeypatch):
    monkeypatch.setattr(compiled_engine, "load_or_compile_loop", lambda *arguments: None)
    setup = build_setup(load_experiment("bench_leg").experiment)
    assert SteppedRun(setup).engine.specialization_key == CompiledEngine(setup).specialization_key


def test_an_edit_of_any_source_changes_the_key(tmp_path, monkeypatch):
    monkeypatch.setattr(code_cache, "__file__", str(tmp_path / "simulation" / "code_cache.py"))
    package = Path(twin_gait.__file__).parent
    keys = set()
    for edited in (None, "core/impedance.py", "simulation/stages/motion.py", "control/gait_controller.py"):
        shutil.copytree(package, tmp_path, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
        if edited is not None:
            (tmp_path / edited).write_text((package / edited).read_text() + "\n")
        for kept in (code_cache.source_key, code_cache._content):
            kept.cache_clear()
        keys.add(code_cache.source_key("loop"))
    monkeypatch.undo()
    for kept in (code_cache.source_key, code_cache._content):
        kept.cache_clear()
    assert len(keys) == 4


LATER = """
import sys
from twin_gait import load_experiment, simulate
seen = []
run = simulate(load_experiment("bench_leg", ["duration_s=0.1"]).experiment, on_compile=lambda: seen.append(1))
print(len(run.log), len(seen), "numba" in sys.modules)
"""


def test_a_later_start_needs_no_compiler():
    simulate(load_experiment("bench_leg", ["duration_s=0.1"]).experiment)
    found = subprocess.check_output([sys.executable, "-c", LATER], text=True)
    assert found.split() == ["100", "0", "False"]


# ------------------------------------------------------------------ what is compiled is what is written


PLAIN_CASES = {
    "bench leg, rk4, a hand and inertia compensation": (
        "bench_leg",
        "integration={method: rk4, step_ms: 0.5}",
        "scenario.imposed_motion={joint: knee, amplitude_deg: 40, release_s: 0.2}",
        "control.inertia_compensation=0.2",
    ),
    "a free trunk by an inertial unit, on crutches": CRUTCHES,
    "treadmill with a wearer who acts, under faults": (
        "treadmill_guided",
        EULER,
        SENSED,
        "sensors.offset.left.knee_deg=-2",
        "control.delay_ms=4",
        "scenario.slope_deg=3",
        WORN,
        ACTIVE,
        "faults=['encoder_drift:left_knee@0.02s=5deg/s', 'motor_stuck:right_hip@0.15s=20Nm']",
    ),
    "treadmill in braces, rk4": (
        "treadmill_guided",
        "integration={method: rk4, step_ms: 0.5}",
        "patient=stroke_left",
        "interface=brace",
        "duration_s=0.1",
    ),
    "treadmill, a path and adaptive help": (
        "treadmill_guided",
        EULER,
        "control.mode=position",
        "control.assistance={adaptive: true, hip: 0.9}",
    ),
    "treadmill that starts": ("treadmill_start_stop", EULER),
    "bench leg with bristles that swings": (
        "bench_leg",
        "scenario.start_phase=swing_flexion",
        SENSED,
        "plant.friction.knee={law: lugre, coulomb_friction_Nm: 3, bristle_stiffness_Nm_per_rad: 900}",
        "plant.actuators.hip.gear_efficiency=0.85",
        "plant.actuators.knee.gear_efficiency=0.9",
    ),
}


# Each compiles a loop of its own; a user's change breaks the others as soon.
SLOW_CASES = (
    "treadmill in braces, rk4",
    "treadmill, a path and adaptive help",
    "treadmill that starts",
    "a free trunk by an inertial unit, on crutches",
)
TRIED = [
    pytest.param(case, id=name, marks=[pytest.mark.slow] if name in SLOW_CASES else [])
    for name, case in PLAIN_CASES.items()
]


@pytest.mark.parametrize("case", TRIED)
def test_uncompiled_steps_over_the_generated_kernel_give_the_same_log_bit_for_bit(case):
    """Short, for plain Python is slow and a bit that differs shows at once."""
    name, *changes = case
    problem = build_setup(load_experiment(name, ["duration_s=0.3", *changes]).experiment)
    compiled = CompiledEngine(problem).run()
    plain = ReferenceEngine(problem, kernel=kernel_names(assemble(problem)[0])).run()
    rows, theirs = log_matrix(compiled), log_matrix(plain)
    assert rows.shape == theirs.shape and rows.shape[0] > 50
    assert rows.tobytes() == theirs.tobytes()
    assert run_result(compiled) == run_result(plain)


@pytest.mark.parametrize("case", TRIED)
def test_the_code_of_every_such_loop_is_kept_for_the_next_process(case, monkeypatch):
    """An array that is counted needs more than the C library, and the loop would be compiled every time."""
    name, *changes = case
    problem = build_setup(load_experiment(name, ["duration_s=0.3", *changes]).experiment)
    CompiledEngine(problem)
    monkeypatch.setattr(code_cache, "_loops", {})
    compilations = []
    CompiledEngine(problem, on_compile=lambda: compilations.append(1))
    assert not compilations


# Functions of the C library under their names there.
MATHEMATICS = {name.encode() for name, item in vars(math).items() if callable(item)} | {b"sincos"}


@pytest.mark.parametrize("case", TRIED)
def test_no_loop_calls_the_mathematics_of_the_c_library(case, monkeypatch):
    """Its last bits differ between versions; the power of the speed in some laws of friction is left."""
    name, *changes = case
    problem = build_setup(load_experiment(name, ["duration_s=0.3", *changes]).experiment)
    CompiledEngine(problem)
    monkeypatch.setattr(code_cache, "_loops", {})
    codes = []
    monkeypatch.setattr(code_cache, "load_function", lambda code: codes.append(code))
    CompiledEngine(problem)
    (code,) = codes
    called = {word.lstrip(b"_") for word in code.split(b"\0")} & MATHEMATICS
    assert called == ({b"pow"} if "lugre" in repr(case) else set())


@pytest.mark.parametrize("preset", ["bench_leg", "treadmill_guided"])
def test_the_cases_above_change_phase(preset):
    cases = [
        changes for case, (name, *changes) in PLAIN_CASES.items() if name == preset and case not in SLOW_CASES
    ]
    runs = [simulate(load_experiment(preset, ["duration_s=0.3", *changes]).experiment) for changes in cases]
    assert any(run.switches for run in runs)
    assert any(run.trip for run in runs) == (preset == "treadmill_guided")
