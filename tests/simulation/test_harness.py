"""A pelvis that moves fore-aft in a soft harness, by closed forms: momentum, energy, limits."""

from __future__ import annotations

import numpy as np
import pytest
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.exceptions import TwinGaitError
from twin_gait.measures.effort import energy_balance
from twin_gait.simulation.log import work_sources

HARNESS = "scenario.support.guide=harness"
# The wearer of test_braces.py, so that one loop is compiled for both.
COUPLED = ("interface=brace", "patient=stroke_left", "integration.step_ms=0.1")


def walk_of(*changes: str):
    return simulate(
        load_experiment(
            "treadmill_guided", ["duration_s=3", "sensors.ideal=true", HARNESS, *changes]
        ).experiment
    )


@pytest.fixture(scope="module")
def walk():
    return walk_of("integration.method=rk4")


def feet_forward(log):
    return sum(log[f"{side}_foot_friction_force_N"] for side in ("left", "right"))


def test_harness_is_a_spring_with_a_damper(walk):
    log, support = walk.log, walk.experiment.scenario.support
    force = -support.forward_stiffness * log["pelvis_forward_m"]
    force -= support.forward_damping * log["pelvis_forward_velocity_m_per_s"]
    # The column is what inverse dynamics find between the world and all bodies.
    np.testing.assert_allclose(log["guide_force_N"], force, atol=1e-8)
    assert log["pelvis_forward_m"].abs().max() > 0.01


def test_forces_forwards_change_the_momentum(walk):
    """The impulse of feet and harness is the change of momentum of all bodies, from Pinocchio's centroid."""
    import pinocchio as pin

    from twin_gait.simulation.log import state_columns

    log, world = walk.log, walk.experiment.build_world()
    positions, velocities = (log[list(names)].to_numpy() for names in state_columns(world.model))
    model, data = world.model.model, world.model.data
    momentum = [
        pin.computeCentroidalMomentum(model, data, positions[tick], velocities[tick]).linear[0]
        for tick in (500, 2500)
    ]
    force = (log["guide_force_N"] + feet_forward(log)).to_numpy()[500:2501]
    impulse = np.trapezoid(force, dx=1e-3)
    assert np.abs(force).sum() * 1e-3 > 20.0
    assert momentum[1] - momentum[0] == pytest.approx(impulse, abs=0.02)


@pytest.mark.parametrize("changes", [(), COUPLED], ids=["rigid", "braced"])
def test_energy_closes(changes):
    log = walk_of("integration.method=rk4", "duration_s=2", *changes).log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = np.array([log[f"{source}_work_J"].to_numpy() for source in work_sources(log)])
    assert energy_balance(energy, works)["energy_residual_share"] < 1e-4


@pytest.mark.slow
def test_a_stiff_harness_is_a_vertical_guide():
    stiff = walk_of(
        "scenario.support.forward_stiffness_N_per_m=1e7",
        "scenario.support.forward_damping_Ns_per_m=6e4",
        "duration_s=1",
    ).log
    guided = walk_of("scenario.support.guide=vertical", "duration_s=1").log
    assert "pelvis_forward_m" not in guided
    for name in ("left_hip_angle_rad", "right_knee_angle_rad", "pelvis_height_m"):
        assert (stiff[name] - guided[name]).abs().max() < 1e-4


def test_a_soft_harness_lets_the_belt_take_the_walker_along():
    soft, firm = (
        walk_of(f"scenario.support.forward_stiffness_N_per_m={stiffness}").log["pelvis_forward_m"].min()
        for stiffness in (500, 2000)
    )
    assert soft < firm < -0.005


def test_a_wearer_in_braces_is_attached_to_the_harness():
    log = walk_of(*COUPLED, "duration_s=1").log
    apart = log["pelvis_forward_m"] - log["wearer_pelvis_forward_m"]
    rate = log["pelvis_forward_velocity_m_per_s"] - log["wearer_pelvis_forward_velocity_m_per_s"]
    brace = load_experiment("treadmill_guided", [HARNESS, *COUPLED]).experiment.build_world().braces.braces[0]
    np.testing.assert_allclose(
        log["pelvis_forward_brace_force_N"], brace.stiffness * apart + brace.damping * rate, atol=1e-8
    )
    assert apart.abs().max() > 1e-5


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        ("support.guide=fixed", ("guide", "vertical", "harness", "fixed")),
        ("support.guide=loose", ("guide", "fixed", "vertical", "harness", "free", "loose")),
        ("support.forward_stiffness_N_per_m=0", ("forward_stiffness_N_per_m", "0")),
        ("support.forward_damping_Ns_per_m=-1", ("forward_damping_Ns_per_m", "-1")),
    ],
)
def test_an_impossible_harness_is_refused(change, facts):
    with raises(TwinGaitError, *facts):
        load_experiment("treadmill_guided", [f"scenario.{change}"])
