"""A closed loop on the bench leg against MuJoCo: its dynamics, its integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from twin_gait.simulation.pinocchio.engine import PinocchioEngine

from twin_gait import load_experiment
from twin_gait.simulation.problem import build_problem

mujoco = pytest.importorskip("mujoco")

from crosscheck.mujoco_legs import legs_of  # noqa: E402  # needs MuJoCo


def plant_friction(v: float, a: float, b: float, c: float, d: float) -> float:
    """Equation (3.1) typed in a second time, on purpose: a cross-check must not share the code."""
    return (
        math.sqrt(2 * math.e) * (a - b) * math.exp(-((v / c) ** 2)) * v / c
        + b * math.tanh(10 * v / c)
        + d * v
    )


# Table 3.1 of the thesis times the default friction ratio of 0.5, hip and knee.
HALF_FRICTION = (
    (0.5 * 1.664, 0.5 * 4.2, 0.2252, 0.5 * 2.26),
    (0.5 * 1.743, 0.5 * 3.193, 0.2031, 0.5 * 2.06),
)


class MujocoPlantEngine(PinocchioEngine):
    """The same firmware on a plant that MuJoCo integrates."""

    load_friction = np.zeros(2)

    def prepare(self) -> None:
        experiment = self.problem.experiment
        self.mj_model = legs_of(experiment, self.problem.world.model)
        self.mj_data = mujoco.MjData(self.mj_model)
        self.mj_data.qpos[:] = self.plant.q

    def _integrate(self) -> None:
        for _ in range(self.problem.experiment.stepping.substeps):
            v = self.mj_data.qvel
            friction = [plant_friction(v[i], *HALF_FRICTION[i]) for i in range(2)]
            load = self.load_friction * np.abs(self.plant.motor)
            turning = [math.tanh(10 * v[i] / HALF_FRICTION[i][2]) for i in range(2)]
            self.mj_data.qfrc_applied[:] = self.plant.motor - np.array(friction) - load * turning
            mujoco.mj_step(self.mj_model, self.mj_data)
        self.plant.q[:] = self.mj_data.qpos
        self.plant.v[:] = self.mj_data.qvel


@pytest.mark.parametrize(("load_friction", "steps"), [((0.0, 0.0), 5), ((0.15, 0.08), 4)])
def test_closed_loop_of_two_seconds_equals_mujoco(load_friction, steps):
    hip, knee = load_friction
    loaded = f"plant.load_friction={{hip: {hip}, knee: {knee}}}"
    experiment = load_experiment("bench_leg", ["duration_s=2", "engine=pinocchio", loaded]).experiment
    ours = PinocchioEngine(build_problem(experiment))
    theirs = MujocoPlantEngine(build_problem(experiment))
    theirs.load_friction = np.array(load_friction)
    theirs.prepare()
    a, b = ours.run(), theirs.run()
    for joint in ("hip", "knee"):
        column = ours.layout.positions[f"right_{joint}_angle_rad"]
        # The stops are not in MuJoCo's model; the leg must not have touched them.
        assert not a.rows[:, ours.layout.positions[f"right_{joint}_stop_torque_Nm"]].any()
        np.testing.assert_allclose(a.rows[:, column], b.rows[:, column], atol=1e-9, rtol=0.0)
        column = ours.layout.positions[f"right_{joint}_motor_torque_Nm"]
        np.testing.assert_allclose(a.rows[:, column], b.rows[:, column], atol=1e-6, rtol=0.0)
    assert [item.target for item in a.switches] == [item.target for item in b.switches]
    assert len(a.switches) >= steps  # load-dependent gear friction makes the leg slower
