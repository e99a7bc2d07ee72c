"""Losses of the gears under load: solved together with the accelerations of the same instant."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.core.friction import FRICTIONLESS, PlantFriction, friction_torque, gear_loss_torque
from twin_gait.measures.effort import energy_balance
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble, kernel_names
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.stages.motion import MOST_SOLUTIONS, compute_accelerations, integrate

GEARS = ("plant.actuators.hip.gear_efficiency=0.85", "plant.actuators.knee.gear_efficiency=0.6")
LUGRE = (
    "plant.friction.knee={law: lugre, coulomb_friction_Nm: 3, breakaway_torque_Nm: 4, "
    "bristle_stiffness_Nm_per_rad: 4000, stribeck_velocity_rad_per_s: 0.1}"
)


def problem_of(preset: str, *settings: str) -> SimulationSetup:
    return build_setup(load_experiment(preset, [*GEARS, *settings]).experiment)


def motion_of(problem: SimulationSetup, function: Any = compute_accelerations) -> tuple[Any, Any]:
    """Episode as a plain tree, and a function of the motion that is bound to the generated kernel."""
    bodies, episode, structure = assemble(problem)
    return episode, specialize(function, {**structure, **kernel_names(bodies)})


def transition_velocity(law: PlantFriction) -> float:
    return 0.1 * law.stribeck_velocity


def loads_of(e: Any) -> np.ndarray:
    """Torques through the gears at the accelerations of an episode."""
    return np.array([m - p.armature * a for m, p, a in zip(e.motor, e.plant, e.a, strict=True)])


@pytest.mark.parametrize("more", [(), (LUGRE,)], ids=["equation-3.1", "lugre"])
def test_accelerations_equal_pinocchio_with_the_gear_loss_at_these_accelerations(
    more: tuple[str, ...], rng: np.random.Generator
) -> None:
    """Pinocchio keeps the whole inertia of the rotors, and receives the loss as a torque."""
    problem = problem_of("bench_leg", *more)
    e, evaluate = motion_of(problem)
    model, data, changes = problem.world.model.model, problem.world.model.model.createData(), 0
    for _ in range(100):
        e.q = problem.world.start_q + 0.1 * rng.standard_normal(2)
        e.v, e.motor = 0.1 * rng.standard_normal(2), (30.0 * rng.standard_normal(2)).tolist()
        before = [plant.load_sign for plant in e.plant]
        evaluate(e, 0.0, False)
        changes += before != [plant.load_sign for plant in e.plant]
        torque = np.array(e.motor)
        for i, load in enumerate(loads_of(e)):
            plant, law = e.plant[i], e.plant[i].friction
            friction = friction_torque(law, e.v[i], plant.deflection)
            loss = gear_loss_torque(e.v[i], load, law.gear_efficiency, transition_velocity(law))
            assert plant.friction_torque == pytest.approx(-friction - loss, rel=1e-12, abs=1e-12)
            torque[i] += plant.friction_torque + plant.stop_torque + plant.spring_torque
        expected = pin.aba(model, data, np.array(e.q), np.array(e.v), torque)
        np.testing.assert_allclose(e.a, expected, rtol=1e-11, atol=1e-11)
    assert changes > 30


def test_signs_of_the_previous_evaluation_have_no_influence(rng: np.random.Generator) -> None:
    problem = problem_of("treadmill_guided")
    e, evaluate = motion_of(problem)
    geared = [i for i, plant in enumerate(e.plant) if plant.friction.law != FRICTIONLESS]
    assert len(geared) == 4
    for _ in range(10):
        e.q = (problem.world.start_q + 0.05 * rng.standard_normal(len(e.q))).tolist()
        e.v, motor = rng.standard_normal(len(e.q)).tolist(), np.zeros(len(e.q))
        motor[geared] = 20.0 * rng.standard_normal(4)
        e.motor, found = motor.tolist(), []
        for signs in itertools.product((-1.0, 1.0), repeat=4):
            for i, sign in zip(geared, signs, strict=True):
                e.plant[i].load_sign = sign
            evaluate(e, 0.0, False)
            assert [e.plant[i].load_sign for i in geared] == np.sign(loads_of(e)[geared]).tolist()
            found.append([*e.a, *(plant.friction_torque for plant in e.plant)])
        np.testing.assert_allclose(found, found[:1] * 16, rtol=1e-11, atol=1e-10)
    assert MOST_SOLUTIONS > 4  # each of four signs can change


def test_runge_kutta_is_of_fourth_order_under_the_losses() -> None:
    """The error falls by more than 2^3.5 when the step is halved, while no load changes its sign."""
    problem = problem_of("bench_leg")
    ends = {}
    for steps in (5, 10, 20, 40, 320):
        e, advance = motion_of(problem, integrate)
        e.v, e.motor, e.recording.on = [1.5, -2.0], [25.0, 10.0], False
        e.step, e.substeps = 0.1 / steps, steps
        advance(e, 0)
        assert loads_of(e)[0] > 5.0 and loads_of(e)[1] < -5.0 and e.v[0] > 0.5 and e.v[1] < -0.5
        ends[steps] = np.array([*e.q, *e.v])
    errors = [float(np.abs(ends[steps] - ends[320]).max()) for steps in (5, 10, 20, 40)]
    assert errors[-1] > 1e-13  # above rounding
    assert all(coarse > 2.0**3.5 * fine for coarse, fine in itertools.pairwise(errors))


def test_energy_is_balanced_and_the_gears_only_take_it() -> None:
    run = simulate(load_experiment("treadmill_guided", [*GEARS, "duration_s=2"]).experiment)
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    balance = energy_balance(energy, run.log.filter(like="_work_J").to_numpy().T)
    assert balance["energy_residual_share"] < 1e-9
    for side, joint in itertools.product(("left", "right"), ("hip", "knee")):
        friction = run.log[f"{side}_{joint}_friction_torque_Nm"]
        assert (friction * run.log[f"{side}_{joint}_velocity_rad_per_s"]).max() <= 1e-12
