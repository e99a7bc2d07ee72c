"""The steps of a tick over MuJoCo's dynamics against the compiled engine: one loop, other rigid bodies."""

from __future__ import annotations

import numpy as np
import pytest
from log_rows import log_matrix

from twin_gait import load_experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

pytest.importorskip("mujoco")

from mujoco_kernel import MujocoKernel  # needs MuJoCo

EULER, RK4 = "integration.method=semi_implicit_euler", "integration.method=rk4"
# Cases whose loop no other test compiles, and that repeat the proof of a shorter one.
SLOW = {
    "hip exoskeleton, knees moved by the wearer",
    "bench leg, inertia compensation",
    "treadmill, Euler",
    "treadmill, harness",
    "treadmill, downhill in a harness, by encoders askew and commands that come late",
    "knee orthosis on one leg",
    "prosthesis that replaces segments of one leg",
    "overground, a free trunk on crutches",
}
CASES = {
    "bench leg, Euler": ("bench_leg", "duration_s=2", EULER, "integration.step_ms=1"),
    "bench leg, RK4": ("bench_leg", "duration_s=2", RK4, "integration.step_ms=1"),
    "bench leg, inertia compensation": (
        "bench_leg",
        "duration_s=1",
        EULER,
        "control.inertia_compensation=0.2",
    ),
    "treadmill, Euler": ("treadmill_guided", "duration_s=1", EULER, "integration.step_ms=0.25"),
    "treadmill, RK4": ("treadmill_guided", "duration_s=0.3", RK4, "integration.step_ms=0.25"),
    "treadmill, harness": (
        "treadmill_guided",
        "duration_s=1",
        EULER,
        "integration.step_ms=0.25",
        "scenario.support.guide=harness",
    ),
    "treadmill, downhill in a harness, by encoders askew and commands that come late": (
        "treadmill_guided",
        "duration_s=0.5",
        EULER,
        "integration.step_ms=0.25",
        "scenario.support.guide=harness",
        "scenario.slope_deg=-5",
        "sensors.offset.left={hip_deg: 2, knee_deg: -1}",
        "control.delay_ms=3",
    ),
    "overground, a free trunk on crutches": (
        "overground",
        "duration_s=0.4",
        EULER,
        "integration.step_ms=0.25",
        "scenario.harness={share: 0.2, damping_Ns_per_m: 90}",
        "scenario.contact.transition_velocity_m_per_s=1",  # a stiffer law turns 1e-12 m/s into 1e-8 N
        "scenario.leading_phase=early_stance",
        "scenario.trailing_phase=late_stance",
        "scenario.arms={planted_s: 0.05, lift_ahead_m: 0.5}",
    ),
    "treadmill, a short wearer with short feet": (
        "treadmill_guided",
        "duration_s=0.5",
        EULER,
        "integration.step_ms=0.25",
        "patient.height_m=1.5",
    ),
    "hip exoskeleton, knees moved by the wearer": (
        "hip_exoskeleton",
        "duration_s=1",
        EULER,
        "integration.step_ms=0.25",
    ),
    "knee orthosis on one leg": (
        "knee_orthosis",
        "duration_s=1",
        EULER,
        "integration.step_ms=0.25",
    ),
    "prosthesis that replaces segments of one leg": (
        "osl_prosthesis",
        "duration_s=1",
        EULER,
        "integration.step_ms=0.25",
    ),
    "treadmill, a wearer whom the controller takes for another": (
        "treadmill_guided",
        "duration_s=0.5",
        EULER,
        "integration.step_ms=0.25",
        "control.patient.mass_kg=60",
    ),
}


def problem_of(preset: str, *changes: str) -> SimulationSetup:
    return build_setup(load_experiment(preset, ["sensors.ideal=true", *changes]).experiment)


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=name, marks=[pytest.mark.slow] * (name in SLOW)) for name, case in CASES.items()],
)
def test_mujoco_dynamics_give_the_log_of_the_compiled_engine(case):
    problem = problem_of(*case)
    compiled = CompiledEngine(problem)
    ours, theirs = compiled.run(), ReferenceEngine(problem, kernel=MujocoKernel(problem).functions).run()
    assert ours.switches == theirs.switches != ()
    np.testing.assert_allclose(log_matrix(ours), log_matrix(theirs), atol=1e-9, rtol=0.0)


@pytest.mark.parametrize("change", ["patient.mass_kg=71", "patient.height_m=1.76"])
def test_another_wearer_in_mujoco_is_detected(change):
    problem, changed = (
        problem_of("treadmill_guided", EULER, "duration_s=0.01", *changes) for changes in ((), (change,))
    )
    same, other = (
        ReferenceEngine(problem, kernel=MujocoKernel(worn).functions).run().log for worn in (problem, changed)
    )
    speeds = [log["pelvis_velocity_m_per_s"].iloc[-1] for log in (same, other)]
    assert abs(speeds[0] - speeds[1]) > 1e-5
