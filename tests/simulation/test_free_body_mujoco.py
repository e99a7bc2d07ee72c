"""A free trunk, its harness and its crutches against MuJoCo, with all forces on it written a second time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from twin_gait import load_experiment
from twin_gait.core.plant import MechanicalStop, Plant, Spring
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.stages.motion import integrate

pytest.importorskip("mujoco")

import mujoco
from crosscheck.mujoco_legs import compiled_legs, coordinate_order, legs_spec  # needs MuJoCo

STEP, SUBSTEPS = 0.25e-3, 4
# Springs and dampers of hips, knees and ankles, without which the legs' motion would be chaotic.
STIFFNESS, DAMPING = 30.0, 3.0
SIDES, CRUTCH_MASS = ("left", "right"), 0.5
SHOULDER = 0.288 * 1.75  # [m] above the hips: Winter (2009), figure 4.1
TICKS = 2000


def started(high: float, *changes: str) -> tuple[SimulationSetup, Episode, Callable[[Episode, int], None]]:
    """Return the motion over the dynamics of Pinocchio, without drives; a body high above the floor."""
    settings = ["sensors.ideal=true", "integration={method: semi_implicit_euler, step_ms: 0.25}", *changes]
    problem = build_setup(load_experiment("overground", settings).experiment)
    _, e, structure = assemble(problem)
    e.recording.on = False
    model = problem.world.model
    guides = {model.forward_index, model.pelvis_index, model.pitch_index}
    for index in range(model.nv):
        spring = Spring() if index in guides else Spring(STIFFNESS, DAMPING)
        e.plant[index] = Plant(spring=spring, armature=e.plant[index].armature)
    e.q[model.pelvis_index] += high
    e.v[model.forward_index], e.v[model.pitch_index] = 0.3, 0.5
    kernel = PinocchioKernel(problem.world, problem.control_model).functions
    return problem, e, specialize(integrate, {**structure, **kernel, "FRICTION_INDICES": ()})


class Body:
    """The same body in MuJoCo, stepped by its own Euler method; crutches are bodies on two slides."""

    def __init__(self, problem: SimulationSetup, e: Episode) -> None:
        experiment, model = problem.experiment, problem.world.model
        spec = legs_spec(model, experiment.patient, manufactured=experiment.leg.sizes)
        for side in SIDES[: len(e.arms)]:
            tip = spec.worldbody.add_body(
                name=side, mass=CRUTCH_MASS, inertia=[1e-3] * 3, explicitinertial=True
            )
            for name, axis in (("x", [1.0, 0.0, 0.0]), ("z", [0.0, 0.0, 1.0])):
                tip.add_joint(name=f"{side}_{name}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        armature = {joint: item.armature for joint, item in experiment.plant.actuators.items()}
        self.model = compiled_legs(spec, model, armature, gravity=9.81, step=STEP)
        self.data = mujoco.MjData(self.model)
        tips = [f"{side}_{axis}" for side in SIDES[: len(e.arms)] for axis in ("x", "z")]
        self.order = [*coordinate_order(self.model, model), *(self.dof(name) for name in tips)]
        self.legs = [
            index
            for index in self.order[: model.nv]
            if self.model.joint(int(self.model.dof_jntid[index])).name not in GUIDES
        ]
        self.pelvis = int(self.model.jnt_bodyid[self.model.joint(PELVIS_JOINT).id])
        self.data.qpos[self.order], self.data.qvel[self.order] = e.q, e.v

    def dof(self, name: str) -> int:
        return int(self.model.joint(name).dofadr[0])

    @property
    def q(self) -> np.ndarray:
        return np.array(self.data.qpos[self.order])

    def on_trunk(self, up: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a point of the trunk in the world (forwards, upwards), and its Jacobian ``(2, nv)``."""
        frame = self.data.xmat[self.pelvis].reshape(3, 3)
        point, jacobian = self.data.xpos[self.pelvis] + up * frame[:, 2], np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, point, self.pelvis)
        return point[[0, 2]], jacobian[[0, 2]]

    def step(self, forces: Callable[[Body], np.ndarray]) -> None:
        data = self.data
        mujoco.mj_fwdPosition(self.model, data)
        data.qfrc_applied[:] = forces(self)
        data.qfrc_applied[self.legs] -= STIFFNESS * data.qpos[self.legs] + DAMPING * data.qvel[self.legs]
        mujoco.mj_step(self.model, data)


GUIDES = ("pelvis_forward", "pelvis_vertical", "pelvis_pitch")


def assert_together(
    problem: SimulationSetup,
    e: Episode,
    advance: Callable[[Episode, int], None],
    forces: Callable[[Body], np.ndarray],
) -> Body:
    body = Body(problem, e)
    for tick in range(TICKS):
        advance(e, tick)
        for _ in range(SUBSTEPS):
            body.step(forces)
        np.testing.assert_allclose(e.q, body.q, rtol=0.0, atol=1e-9, err_msg=f"tick {tick}")
    return body


def nothing(body: Body) -> np.ndarray:
    return np.zeros(body.model.nv)


@pytest.mark.slow
def test_a_trunk_that_falls_freely_turns_with_its_legs():
    problem, e, advance = started(30.0, "scenario.crutches=none")
    start = list(e.q)
    assert_together(problem, e, advance, nothing)
    model = problem.world.model
    assert e.q[model.pelvis_index] < start[model.pelvis_index] - 15.0
    assert abs(e.q[model.pitch_index] - start[model.pitch_index]) > 0.3


@pytest.mark.slow
def test_a_harness_pulls_upwards_where_it_is_attached():
    share, damping, height = 0.9, 200.0, 0.25 * 1.75
    settings = f"scenario.harness={{share: {share}, damping_Ns_per_m: {damping}, height: 0.25}}"
    problem, e, advance = started(10.0, "scenario.crutches=none", settings)
    e.trunk.harness.stop = MechanicalStop(e.q[problem.world.model.pelvis_index], math.inf, 3000.0, 0.5)
    lowest = e.trunk.harness.stop.lower

    def rope(body: Body) -> np.ndarray:
        point, jacobian = body.on_trunk(height)
        speed = float(jacobian[1] @ body.data.qvel)
        below = max(lowest - point[1], 0.0)
        weight = 9.81 * float(body.model.body_mass[body.model.body_weldid > 0].sum())
        pull = share * weight - damping * speed + 3000.0 * below * max(1.0 - 0.5 * speed, 0.0)
        return np.asarray(pull * jacobian[1])

    assert_together(problem, e, advance, rope)
    assert e.trunk.harness.pull > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("limits", [(400.0, 100.0, 60.0), (90.0, 5.0, 4.0)], ids=["wide", "narrow"])
def test_arms_push_crutches_by_virtual_work_in_polar_coordinates(limits):
    """A body that hangs in its harness on crutches that stand, slip and swing."""
    push_limit, pull_limit, moment_limit = limits
    words = f"push_limit_N: {push_limit}, pull_limit_N: {pull_limit}, moment_limit_Nm: {moment_limit}"
    words += ", length: 0.9, straight_stiffness_N_per_m: 2000"
    harness = "scenario.harness={share: 1.0, damping_Ns_per_m: 200, height: 0.25}"
    problem, e, advance = started(0.25, f"scenario.crutches={{{words}}}", harness)
    for arm in e.arms:
        arm.grip.length += 0.25
        arm.grip.shoulder_moment = 3.0
    grips = [arm.grip for arm in e.arms]
    contact, rubber = problem.experiment.scenario.contact, problem.experiment.scenario.crutches
    stuck: dict[str, float] = {}
    last: dict[str, float] = {}
    limited, slid = set(), set()

    def all_forces(body: Body) -> np.ndarray:
        v, found = body.data.qvel, np.zeros(body.model.nv)
        _, jacobian = body.on_trunk(0.25 * 1.75)
        weight = 9.81 * float(body.model.body_mass[body.model.body_weldid > 0].sum() - 2 * CRUTCH_MASS)
        found += (weight - 200.0 * float(jacobian[1] @ v)) * jacobian[1]
        shoulder, moved = body.on_trunk(SHOULDER)
        pitch = body.dof("pelvis_pitch")
        for side, grip in zip(SIDES, grips, strict=True):
            tip = [body.dof(f"{side}_x"), body.dof(f"{side}_z")]
            # ln(tip - shoulder) = ln ℓ + i (ψ - 90°), so that its derivatives are those of ln ℓ and of ψ.
            apart = complex(*(body.data.qpos[tip] - shoulder))
            way = -(moved[0] + 1j * moved[1])
            way[tip] += [1.0, 1j]
            logarithmic = way / apart
            length, angle = abs(apart), np.angle(apart * 1j) + body.data.qpos[pitch]
            of_length, of_angle = length * logarithmic.real, logarithmic.imag.copy()
            of_angle[pitch] += 1.0
            push = grip.axial_force + grip.stiffness * (grip.length - length) - grip.damping * of_length @ v
            moment = grip.shoulder_moment + length * (
                grip.transverse_stiffness * grip.length * math.sin(grip.angle - angle)
                - grip.transverse_damping * length * of_angle @ v
            )
            limited.add((push > push_limit, push < -pull_limit, abs(moment) > moment_limit))
            stretched = 2000.0 * max(length - 0.9 * 1.75, 0.0)
            found += (np.clip(push, -pull_limit, push_limit) - stretched) * of_length
            found += np.clip(moment, -moment_limit, moment_limit) * of_angle
            found[tip] += pressed(side, *body.data.qpos[tip], *v[tip])
        return found

    def pressed(side: str, position: float, height: float, along: float, up: float) -> np.ndarray:
        """Return the force of rubber that shears and slides, evaluated once per step."""
        normal = contact.stiffness * max(-height, 0.0) ** 1.5 * max(1.0 - 1.5 * contact.dissipation * up, 0.0)
        # What slid in the step before has the normal force of that step.
        reach = contact.friction_coefficient * last.get(side, 0.0) / rubber.tip_stiffness
        stuck[side] = np.clip(stuck.get(side, position), position - reach, position + reach)
        last[side] = normal
        sheared = rubber.tip_stiffness * (position - stuck[side]) + rubber.tip_damping * along
        most = contact.friction_coefficient * normal
        slid.add(abs(sheared) > most > 0.0)
        return np.array([-np.clip(sheared, -most, most), normal])

    body = assert_together(problem, e, advance, all_forces)
    assert min(point.height for point in e.points) > 0.0  # no foot has come down
    for beyond in map(set, zip(*limited, strict=True)):
        assert True not in beyond or limits[0] < 100.0
        assert beyond == {True, False} or limits[0] > 100.0
    assert slid == {True, False} or limits[0] < 100.0
    assert abs(float(body.q[problem.world.model.forward_index])) > 0.01
