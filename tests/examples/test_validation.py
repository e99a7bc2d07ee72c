"""The checks of an installation can fail, and what they compare with is right on its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from crosscheck import checks, closed_forms

from twin_gait import load_experiment, simulate

ROUNDING, SAME_MOTION = 1e-10, 1e-9  # limits of examples/validation.py


@pytest.fixture
def experiment():
    return load_experiment("bench_leg").experiment


def test_the_free_double_pendulum_conserves_its_energy(experiment):
    """With the numbers of the URDF, energy stays as it moves."""
    pendulum = closed_forms.pendulum_of(experiment)

    def energy(state: np.ndarray) -> float:
        hip, knee, hip_rate, knee_rate = state
        shank, armature = hip - knee, 3.342
        thigh_motion = 0.5 * (0.0615533 + 3.2 * 0.315**2) * hip_rate**2
        shank_rate, turn = hip_rate - knee_rate, 0.5 * 0.0351719 * (hip_rate - knee_rate) ** 2
        along = 0.42 * hip_rate * math.cos(hip) + 0.273421 * shank_rate * math.cos(shank)
        up = 0.42 * hip_rate * math.sin(hip) + 0.273421 * shank_rate * math.sin(shank)
        heights = 3.2 * 0.315 * math.cos(hip) + 1.9 * (0.42 * math.cos(hip) + 0.273421 * math.cos(shank))
        drives = 0.5 * armature * (hip_rate**2 + knee_rate**2)
        return thigh_motion + turn + 0.5 * 1.9 * (along**2 + up**2) + drives - 9.81 * heights

    states = closed_forms.pendulum_motion(pendulum, np.array([1.2, 0.3]), np.array([0.0, 0.3, 0.7, 1.5])).T
    assert np.abs(states[-1] - states[0]).max() > 0.5
    np.testing.assert_allclose([energy(state) for state in states[1:]], energy(states[0]), rtol=1e-10)


@pytest.mark.slow
def test_another_gravity_in_the_closed_form_is_detected(monkeypatch):
    original = checks.pendulum_of
    assert checks.pendulum_error() <= ROUNDING
    monkeypatch.setattr(checks, "pendulum_of", lambda item: original(item)._replace(gravity=9.80665))
    assert checks.pendulum_error() > ROUNDING
    assert checks.free_leg("rk4", 0.25)[1] > 1e3 * ROUNDING


@pytest.mark.parametrize("preset", ["bench_leg", "treadmill_guided"])
def test_another_thigh_in_mujoco_is_detected(preset, monkeypatch):
    mujoco_legs = pytest.importorskip("crosscheck.mujoco_legs")
    original = mujoco_legs.legs_of

    def longer(experiment, model):
        """The knee sits a tenth of a millimetre lower."""
        legs = original(experiment, model)
        legs.body("right_shank").pos[2] -= 1e-4
        return legs

    experiment = load_experiment(preset).experiment
    assert max(checks.dynamics_errors(experiment).values()) <= ROUNDING
    monkeypatch.setattr(mujoco_legs, "legs_of", longer)
    assert min(checks.dynamics_errors(experiment).values()) > ROUNDING


@pytest.mark.parametrize(
    "settings",
    [
        ["plant.gravity_m_per_s2=9.80999"],
        ["plant.friction_ratio={hip: 0.5001, knee: 0.5}"],
        ["plant.actuators.hip.gear_efficiency=0.9999"],
    ],
)
def test_another_plant_is_detected_by_the_replay_in_mujoco(settings, experiment):
    pytest.importorskip("mujoco")
    stepping = "integration={method: semi_implicit_euler, step_ms: 1}"
    run = simulate(load_experiment("bench_leg", ["duration_s=2", stepping]).experiment)
    assert checks.replay_difference(run) <= SAME_MOTION
    changed = simulate(load_experiment("bench_leg", ["duration_s=2", stepping, *settings]).experiment)
    assert checks.replay_difference(replace(changed, experiment=run.experiment)) > SAME_MOTION


@pytest.mark.slow
def test_other_engines_and_other_switches_are_detected(monkeypatch):
    def shorter(experiment):
        run = simulate(experiment)
        return replace(run, switches=run.switches[:-1]) if experiment.engine == "compiled" else run

    def lighter(experiment):
        if experiment.engine == "compiled":
            experiment = replace(experiment, plant=replace(experiment.plant, gravity=9.81 * (1.0 + 1e-6)))
        return simulate(experiment)

    monkeypatch.setattr(checks, "simulate", lighter)
    assert SAME_MOTION < checks.engine_difference("bench_leg", 2.0) < math.inf
    monkeypatch.setattr(checks, "simulate", shorter)
    assert checks.engine_difference("bench_leg", 2.0) == math.inf


def test_omitted_energy_is_detected(experiment):
    run = simulate(replace(experiment, duration=2.0))
    residual = checks.energy_residual(run)
    assert residual < 1e-3
    without_friction = replace(run, log=run.log.drop(columns="friction_work_J"))
    assert checks.energy_residual(without_friction) > 100.0 * residual
    driving = run.log.assign(right_hip_friction_torque_Nm=-run.log["right_hip_friction_torque_Nm"])
    assert (
        checks.largest_friction_power(run) <= 0.0 < checks.largest_friction_power(replace(run, log=driving))
    )
