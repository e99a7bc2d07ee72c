"""Tests of the kernel of a model, of its run-time inputs, and of the cache of compiled kernels."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import FunctionType

import numpy as np
import pinocchio as pin
import pytest
from errors import raises
from test_dynamics_pinocchio import assert_equal, kernel_of, source_of

from twin_gait import core, load_experiment, simulate, simulation
from twin_gait.control import device_schedule
from twin_gait.core.contact import ground_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.exceptions import ModelError
from twin_gait.kernels import generated as kernel
from twin_gait.leg_model.bodies import export_bodies
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import packaged_urdf
from twin_gait.simulation import code_cache, executors, schedule, stages
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble, kernel_names, run_ticks_at
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName, Side

GRAVITY = 9.81


def chain(joints: int) -> pin.Model:
    """An arm of equal links, its joints turning about y and z in turn."""
    model, parent = pin.Model(), 0
    for number in range(joints):
        kind = pin.JointModelRZ() if number % 2 else pin.JointModelRY()
        placement = pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0]) if number else np.zeros(3))
        parent = model.addJoint(parent, kind, placement, f"joint{number}")
        link = pin.Inertia(1.0, np.array([0.15, 0.0, 0.02]), 0.01 * np.eye(3))
        model.appendBodyToJoint(parent, link, pin.SE3.Identity())
    return model


def functions_of(text: str) -> dict:
    """Functions of a kernel as plain Python."""
    functions = {"sine_cosine": sine_cosine, "ground_contact_force": ground_contact_force}
    exec(compile(text, "kernel", "exec"), functions)
    return functions


# ------------------------------------------------------------------ the text


def test_a_model_of_more_joints_than_the_limit_is_refused():
    limit = kernel.STRAIGHT_LINE_LIMIT
    fits, too_many = (export_bodies(chain(joints)) for joints in (limit, limit + 1))
    control = export_bodies(chain(2))
    assert "def dynamics(" in kernel.write_kernel(kernel.KernelBodies(fits, [], control, "z"))
    assert kernel.kernel_key(kernel.KernelBodies(fits, [], control, "z"))
    with raises(ModelError, limit + 1, limit, "engine: pinocchio"):
        kernel.kernel_key(kernel.KernelBodies(too_many, [], control, "z"))


def test_the_largest_model_of_an_experiment_is_within_the_limit():
    """Every joint of both sides, on a pelvis that pitches in a harness, with the wearer in braces."""
    settings = ["patient.mass_kg=70", "interface=brace", "scenario.support.pitch=soft"]
    case = load_experiment("treadmill_guided", settings).experiment
    world = case.build_world()
    assert world.model.nv == len(Side) * len(JointName) + 3
    assert len(world.start_q) == 2 * world.model.nv <= kernel.STRAIGHT_LINE_LIMIT


def test_gravity_may_point_along_y(rng):
    model, q = chain(5), rng.uniform(-1.0, 1.0, 5)
    model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
    bodies, expected = export_bodies(model), pin.computeGeneralizedGravity(model, model.createData(), q)
    functions, torque = functions_of(source_of(bodies, (), "y")), np.zeros(5)
    functions["control_gravity"](q, np.array(kernel.body_values(bodies)), GRAVITY, torque)
    assert_equal(torque, np.array(expected))


def test_other_masses_lengths_and_armature_need_no_other_text(bench: LegModel, rng):
    changed = bench.model.copy()
    for joint in range(1, changed.njoints):
        inertia, placement = changed.inertias[joint], changed.jointPlacements[joint]
        placement.translation = 1.3 * placement.translation
        changed.inertias[joint] = pin.Inertia(2.0 * inertia.mass, 0.8 * inertia.lever, 3.0 * inertia.inertia)
        changed.jointPlacements[joint] = placement
    changed.armature = 0.7 * changed.armature
    before, after = export_bodies(bench.model), export_bodies(changed)
    text = source_of(before)
    assert source_of(after) == text
    q, v, torque = rng.uniform(-1.0, 1.0, (3, changed.nv))
    expected = np.array(pin.aba(changed, changed.createData(), q, v, torque))
    assert_equal(kernel_of(changed).accelerations(q, v, torque), expected)
    assert np.abs(kernel_of(bench.model).accelerations(q, v, torque) - expected).max() > 0.1


# ------------------------------------------------------------------ engines

STEPPING = "integration={method: semi_implicit_euler, step_ms: 0.5}"


@pytest.mark.parametrize("engine", ["compiled", "pinocchio"])
def test_a_leg_of_continuous_joints_runs_as_one_of_angles(engine, tmp_path):
    bounded = packaged_urdf("twin_leg.urdf").read_text()
    unbounded = bounded.replace('type="revolute"', 'type="continuous"')
    assert unbounded.count('type="continuous"') == 2
    (tmp_path / "leg.urdf").write_text(unbounded)
    case = ["duration_s=0.3", STEPPING, f"engine={engine}"]
    expected = simulate(load_experiment("bench_leg", case).experiment)
    found = simulate(load_experiment("bench_leg", [*case, f"leg.urdf={tmp_path / 'leg.urdf'}"]).experiment)
    assert found.log.equals(expected.log)


# ------------------------------------------------------------------ kept on disk

BUILD = """
import sys, time
from pathlib import Path
from twin_gait import load_experiment, simulate
folder, number, compilations = Path(sys.argv[1]), sys.argv[2], []
(folder / f"ready{number}").touch()
while not (folder / "go").exists():
    time.sleep(0.001)
experiment = load_experiment("bench_leg", ["duration_s=0.1"]).experiment
log = simulate(experiment, on_compile=lambda: compilations.append(1)).log
print(len(compilations), log["right_knee_angle_rad"].iloc[-1].hex())
"""


@pytest.mark.slow
def test_two_processes_may_build_the_same_kernel_at_once(tmp_path, monkeypatch):
    """Both start from one empty cache at the same instant; a third finds it built."""
    monkeypatch.setenv(code_cache.CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    both = [build(tmp_path, number) for number in range(2)]
    wait_for(tmp_path / "ready0", tmp_path / "ready1")
    (tmp_path / "go").touch()
    results = [finished(process) for process in both]
    compiled, third = finished(build(tmp_path, 2))
    assert compiled == "0"
    assert results[0][1] == results[1][1] == third
    assert len(list((tmp_path / "cache").iterdir())) == 1


def build(folder: Path, number: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", BUILD, str(folder), str(number)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(*files: Path) -> None:
    for _ in range(6000):
        if all(path.exists() for path in files):
            return
        time.sleep(0.01)
    pytest.fail("the processes did not start within a minute")


def finished(process: subprocess.Popen[str]) -> list[str]:
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    return output.split()


def hashed_sources() -> list[Path]:
    return [path.resolve() for path in code_cache.source_files()]


def test_every_module_of_core_and_of_the_stages_is_hashed():
    hashed = set(hashed_sources())
    for folder in (core, stages):
        modules = set(Path(folder.__file__).parent.glob("*.py"))
        assert len(modules) > 5 and modules <= hashed


@pytest.fixture
def copied_sources(tmp_path, monkeypatch) -> Path:
    """Return a folder with editable copies of the sources of a key."""
    home = Path(simulation.__file__).parent
    for part in ("simulation", "core"):
        shutil.copytree(home.parent / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(code_cache, "__file__", str(tmp_path / "simulation" / "code_cache.py"))
    return tmp_path


def key_of(text: str) -> str:
    for cache in (code_cache.source_key, code_cache._content):
        cache.cache_clear()
    key = code_cache.source_key(text)
    for cache in (code_cache.source_key, code_cache._content):
        cache.cache_clear()
    return key


def test_an_edit_of_any_source_changes_the_key(copied_sources):
    keys, sources = [key_of("text"), key_of("other text")], code_cache.source_files()
    for path in sources:
        assert path.is_relative_to(copied_sources)
        path.write_text(path.read_text() + "\n")
        keys.append(key_of("text"))
    assert len(set(keys)) == len(keys) == len(sources) + 2


@pytest.mark.parametrize("preset", ["bench_leg", "treadmill_guided", "overground"])
def test_every_compiled_function_is_in_a_hashed_source(preset):
    settings = ["control.mode=position", "control.assistance.adaptive=true"]
    problem = build_setup(load_experiment(preset, settings).experiment)
    bodies, _, structure = assemble(problem)
    bound: list[FunctionType] = []
    names = {**structure, **kernel_names(bodies), **problem.controller.tick_functions()}
    specialize(run_ticks_at, names, lambda function: bound.append(function) or function)
    hashed = set(hashed_sources())
    # Drivers are written by modules that are hashed; the key has the text of the kernel.
    written = {item for item in bound if item.__code__.co_filename.startswith("<schedule: ")}
    assert {item.__name__ for item in written} == {"sense", "control", "act"}
    assert {Path(module.__file__) for module in (executors, schedule, device_schedule)} <= hashed
    found = {Path(item.__code__.co_filename) for item in bound if item not in written}
    assert found - hashed == {Path("generated kernel")}
    assert {path.stem for path in found} >= {"schedule", "motion", "impedance", "contact", "compiled_engine"}
    assert {path.stem for path in found} >= {"position", "assistance"}


def test_steps_and_laws_take_constants_from_sources_that_are_hashed_alone():
    hashed = hashed_sources()
    home = Path(simulation.__file__).parents[1]
    names = {".".join(("twin_gait", *path.relative_to(home).with_suffix("").parts)) for path in hashed}
    for path in hashed:
        if path.parent.name in ("stages", "core"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("twin_gait"):
                    assert node.module in names, f"{path.name}: {node.module}"
