"""The spring of the ankle-foot orthosis: where it is slack, what it stores, and MuJoCo's own spring."""

from __future__ import annotations

import math

import numpy as np
import pytest
from errors import raises
from numpy.testing import assert_allclose

from twin_gait import load_experiment, simulate
from twin_gait.core.plant import plant_torque
from twin_gait.exceptions import ParameterFileError
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import World

RESTS = [-8.0, 0.0, 5.0]  # [deg]


def world_of(*changes: str) -> World:
    return load_experiment("treadmill_guided", list(changes)).experiment.build_world()


@pytest.mark.parametrize("rest", RESTS)
def test_orthosis_pulls_towards_its_rest_angle_and_returns_its_stored_energy(rest: float) -> None:
    """Half a second of steps without support: the work of the spring is the drop of ½ k (θ − θ₀)²."""
    walk = simulate(
        load_experiment(
            "treadmill_guided",
            [
                "duration_s=0.5",
                "integration.step_ms=0.05",
                f"plant.ankle={{stiffness_Nm_per_rad: 150, damping_Nms_per_rad: 0, rest_deg: {rest}}}",
                "scenario.support={share: 0, damping_Ns_per_m: 0, guide: vertical}",
            ],
        ).experiment
    )
    stored = 0.0
    for side in Side:
        angle = walk.log[f"{side}_ankle_angle_rad"].to_numpy()
        torque = walk.log[f"{side}_ankle_orthosis_torque_Nm"].to_numpy()
        assert np.ptp(angle) > math.radians(3.0)
        assert_allclose(torque, 150.0 * (math.radians(rest) - angle), rtol=0.0, atol=1e-11)
        energy = 75.0 * (angle - math.radians(rest)) ** 2
        stored += energy[-1] - energy[0]
    work = walk.log["spring_work_J"].to_numpy()
    assert abs(stored) > 0.1
    assert_allclose(work[-1] - work[0], -stored, atol=1e-7)


@pytest.mark.parametrize("rest", RESTS)
def test_orthoses_start_slack_except_the_one_that_levels_the_feet(rest: float) -> None:
    world = world_of(
        f"plant.ankle.rest_deg={rest}",
        "scenario.leading_start={hip_deg: 20.4, knee_deg: 12.5}",
        "scenario.trailing_start={hip_deg: -10, knee_deg: 12}",
    )
    leading, trailing = (world.start_q[world.model.index(side, JointName.ANKLE)] for side in Side)
    bent = [angle for angle in (leading, trailing) if angle != math.radians(rest)]
    assert len(bent) == 1 and bent[0] > math.radians(rest)
    heights = [
        min(world.model.frame_position(world.start_q, name)[2] for name in leg.contact_frames)
        for leg in world.model.legs.values()
    ]
    assert_allclose(heights, 0.0, atol=1e-12)


@pytest.mark.parametrize("rest", RESTS)
def test_orthosis_accelerates_the_legs_as_a_spring_of_mujoco(rest: float, rng: np.random.Generator) -> None:
    mujoco = pytest.importorskip("mujoco")
    from crosscheck.mujoco_legs import coordinate_order, legs_dynamics, legs_of  # needs MuJoCo

    experiment = load_experiment(
        "treadmill_guided",
        [f"plant.ankle={{stiffness_Nm_per_rad: 90, damping_Nms_per_rad: 2, rest_deg: {rest}}}"],
    ).experiment
    world = experiment.build_world()
    model = world.model
    legs, ankles = legs_of(experiment, model), [model.index(side, JointName.ANKLE) for side in model.sides]
    for leg in model.legs.values():
        joint = mujoco.mj_name2id(legs, mujoco.mjtObj.mjOBJ_JOINT, leg.ankle)
        legs.jnt_stiffness[joint], legs.qpos_spring[joint] = 90.0, math.radians(rest)
        legs.dof_damping[joint] = 2.0
    for _ in range(5):
        q, v = rng.uniform(-0.4, 0.4, model.nv), rng.uniform(-3.0, 3.0, model.nv)
        torque = np.zeros(model.nv)
        for index in ankles:
            torque[index] = plant_torque(world.plant[index], 0.0, q[index], v[index], 0.0)
        accelerations = legs_dynamics(legs, coordinate_order(legs, model), q, v, np.zeros(model.nv))[2]
        assert_allclose(model.forward_dynamics(q, v, torque), accelerations, rtol=1e-9, atol=1e-9)


def test_rest_beyond_the_stops_is_refused_with_its_key_and_its_range() -> None:
    with raises(ParameterFileError, "plant.ankle.rest_deg", "-30", "30", "31 deg"):
        load_experiment("treadmill_guided", ["plant.ankle.rest_deg=31"])
