"""A belt that rises or falls: where it is, what it gives, and that nothing else has turned with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.exceptions import ParameterFileError
from twin_gait.kernels.generated import kernel_key, write_kernel
from twin_gait.measures.effort import energy_balance
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.log import state_columns, work_sources
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName

HARNESS = "scenario.support.guide=harness"


def walk_of(*changes: str, preset: str = "treadmill_guided"):
    return simulate(load_experiment(preset, changes).experiment)


@pytest.fixture(scope="module", params=[-4.0, 3.0])
def walk(request):
    return walk_of(f"scenario.slope_deg={request.param}", "integration.method=rk4", HARNESS, "duration_s=2")


def feet(log, column):
    return sum(log[f"{side}_foot_{column}_N"].to_numpy() for side in ("left", "right"))


def in_world(run):
    """Forward and upward force on both feet."""
    slope = run.experiment.scenario.slope
    along, away = (feet(run.log, name) for name in ("friction_force", "normal_force"))
    return (
        along * math.cos(slope) - away * math.sin(slope),
        away * math.cos(slope) + along * math.sin(slope),
    )


def test_energy_closes(walk):
    log = walk.log
    assert walk.trip is None
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = np.array([log[f"{source}_work_J"].to_numpy() for source in work_sources(log)])
    assert energy_balance(energy, works)["energy_residual_share"] < 1e-4


def test_columns_of_a_foot_are_in_the_axes_of_the_belt(walk):
    """Momentum of all bodies, by Pinocchio's centroid, changes by their level and vertical parts."""
    import pinocchio as pin

    log, world = walk.log, walk.experiment.build_world()
    positions, velocities = (log[list(names)].to_numpy() for names in state_columns(world.model))
    model, data = world.model.model, world.model.data
    momenta = [
        pin.computeCentroidalMomentum(model, data, positions[tick], velocities[tick]).linear[[0, 2]]
        for tick in (300, 1700)
    ]
    forward, upward = in_world(walk)
    forces = np.array([forward + log["guide_force_N"], upward + log["support_force_N"] - world.body_weight])
    impulse = np.trapezoid(forces[:, 300:1701], dx=1e-3)
    assert np.abs(forces).sum() * 1e-3 > 50.0
    np.testing.assert_allclose(momenta[1] - momenta[0], impulse, rtol=0.0, atol=0.05)


def test_clearance_is_the_distance_of_the_sole_from_the_belt(walk):
    world, slope = walk.experiment.build_world(), walk.experiment.scenario.slope
    away = np.array([-math.sin(slope), 0.0, math.cos(slope)])
    positions = walk.log[list(state_columns(world.model)[0])].to_numpy()
    for side, frames in world.contact_frames.items():
        for tick in range(0, len(walk.log), 97):
            lowest = min(away @ world.model.frame_position(positions[tick], name) for name in frames)
            assert walk.log[f"{side}_foot_clearance_m"][tick] == pytest.approx(lowest, abs=1e-12)


@pytest.mark.parametrize("slope", [-8.0, 0.0, 9.0])
def test_both_feet_stand_on_the_belt_at_the_start_as_on_level_ground(slope):
    world = load_experiment("treadmill_guided", [f"scenario.slope_deg={slope}"]).experiment.build_world()
    level = load_experiment("treadmill_guided", []).experiment.build_world()
    away = np.array([-math.sin(math.radians(slope)), 0.0, math.cos(math.radians(slope))])
    for frames in world.contact_frames.values():
        lowest = min(away @ world.model.frame_position(world.start_q, name) for name in frames)
        assert lowest == pytest.approx(0.0, abs=1e-12)
    for side in world.model.sides:
        ankle = world.model.index(side, JointName.ANKLE)
        assert world.start_q[ankle] == pytest.approx(level.start_q[ankle], abs=1e-12)


@pytest.mark.slow  # a loop of its own; the energy balance on a slope has the same forces
@pytest.mark.parametrize("slope", [-3.0, 4.0])
def test_weight_on_a_slope_without_a_forward_guide_is_split(slope):
    r"""Friction and normal force are as :math:`\sin\alpha` to :math:`\cos\alpha`."""
    loose = ("scenario.support.forward_stiffness_N_per_m=0.01", "scenario.support.forward_damping_Ns_per_m=0")
    run = walk_of(
        f"scenario.slope_deg={slope}", HARNESS, *loose, "duration_s=2", preset="treadmill_start_stop"
    )
    carried = run.experiment.build_world().body_weight * (1.0 - run.experiment.scenario.support.share)
    angle, last = math.radians(slope), slice(1500, None)
    assert np.mean(feet(run.log, "normal_force")[last]) == pytest.approx(carried * math.cos(angle), rel=0.01)
    assert np.mean(feet(run.log, "friction_force")[last]) == pytest.approx(
        carried * math.sin(angle), rel=0.05
    )


def test_level_ground_has_a_kernel_without_slope():
    level, sloped = (
        assemble(build_setup(load_experiment("treadmill_guided", [f"scenario.slope_deg={slope}"]).experiment))
        for slope in (0, 2)
    )
    assert "slope" not in write_kernel(level[0])
    assert "slope_sine" in write_kernel(sloped[0])
    assert kernel_key(level[0]) != kernel_key(sloped[0])
    assert (level[2]["WITH_SLOPE"], sloped[2]["WITH_SLOPE"]) == (False, True)


@pytest.mark.parametrize("setting", ["slope_deg=10.1", "slope_rad=-0.2"])
def test_a_belt_that_is_too_steep_is_refused_in_one_line(setting):
    with raises(
        ParameterFileError, "scenario." + setting.partition("=")[0], setting.partition("=")[2]
    ) as caught:
        load_experiment("treadmill_guided", [f"scenario.{setting}"])
    assert len(str(caught.value).splitlines()) == 1
