"""The motion of the plant over any scalars is the engine's."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from floor.plant import equations_of_motion
from numpy.testing import assert_allclose

from twin_gait import load_experiment
from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.friction import gear_loss_torque, rotational_friction_torque
from twin_gait.simulation.simulation_setup import build_setup


@pytest.mark.parametrize("guide", ["vertical", "harness"])
def test_acceleration_in_the_air_equals_pinocchio(guide):
    """By its articulated-body algorithm, with friction, stops, springs and motors handed to it as torques.

    The losses of the gears are those of the acceleration that is handed in.
    """
    # What a gear loses hangs on the acceleration; examples/validation.py has MuJoCo for that.
    lossless = [f"plant.actuators.{joint}.gear_efficiency=1" for joint in ("hip", "knee")]
    settings = [f"scenario.support.guide={guide}", *lossless]
    problem = build_setup(load_experiment("treadmill_guided", settings).experiment)
    world, generator = problem.world, np.random.default_rng(1)
    model, data = world.model.model.copy(), world.model.model.createData()
    motion = equations_of_motion(problem, {})
    for _ in range(5):
        q = world.start_q + 0.3 * generator.standard_normal(len(world.start_q))
        q[world.model.pelvis_index] = 3.0
        v, motor, before = generator.standard_normal((3, len(q)))
        torque, rotors = 20.0 * motor, world.model.model.armature.copy()
        for index, plant in enumerate(world.plant):
            law, stop, spring = plant.friction, plant.stop, plant.spring
            torque[index] += spring.force - spring.stiffness * q[index] - spring.damping * v[index]
            if law.law:
                torque[index] -= rotational_friction_torque(
                    v[index],
                    law.breakaway_torque,
                    law.coulomb_friction,
                    law.stribeck_velocity,
                    law.viscous_friction_forward,
                )
                load = 20.0 * motor[index] - plant.armature * 9.0 * before[index]
                slow = 0.1 * law.stribeck_velocity
                share = gear_loss_torque(v[index], load, law.gear_efficiency, slow) / load
                torque[index] -= share * 20.0 * motor[index]
                rotors[index] = (1.0 - share) * plant.armature
            if stop.stiffness:
                torque[index] += mechanical_stop_torque(
                    q[index], v[index], stop.lower, stop.upper, stop.stiffness, stop.dissipation
                )
        model.armature = rotors
        found = motion(q.tolist(), v.tolist(), (20.0 * motor).tolist(), (9.0 * before).tolist())
        assert_allclose(found.acceleration, pin.aba(model, data, q, v, torque), rtol=1e-9, atol=1e-8)
        assert all(point.upward == 0.0 and point.height > 1.0 for point in found.points)


def test_laws_passed_as_arguments_replace_the_laws_of_core():
    problem = build_setup(load_experiment("treadmill_guided").experiment)
    n = len(problem.world.start_q)
    laws = {"ground_contact_force": lambda ground, stiffness, dissipation, *motion: (1.0, stiffness)}
    found = equations_of_motion(problem, laws)(problem.world.start_q.tolist(), *[[0.0] * n] * 3)
    assert [(point.forward, point.upward) for point in found.points] == [(1.0, 3.0e5)] * 4
    assert found.acceleration[problem.world.model.pelvis_index] > 1e3
