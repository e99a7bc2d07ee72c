"""The rigid-body model against MuJoCo, an engine that shares no code with Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest
from example_robots import twin_joints
from numpy.testing import assert_allclose
from twin_device import HIP_ACTUATOR, KNEE_ACTUATOR

from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, PelvisGuide, SegmentModel, Sex, Side

mujoco = pytest.importorskip("mujoco", reason="mujoco is in the extra [test]")

from crosscheck.mujoco_legs import (  # noqa: E402  # needs MuJoCo
    compiled_legs,
    coordinate_order,
    legs_dynamics,
    legs_spec,
)

ARMATURE = {JointName.HIP: HIP_ACTUATOR.armature, JointName.KNEE: KNEE_ACTUATOR.armature}
TICK = 1e-3


def mujoco_legs_of(model: LegModel, patient: Patient | None = None) -> mujoco.MjModel:
    """MuJoCo's own model of the legs; the wearer is built there from the tables of the literature."""
    return compiled_legs(legs_spec(model, patient), model, ARMATURE, gravity=9.81, step=TICK)


PATIENTS = [
    pytest.param(Patient(mass=70.0, height=1.75, sex=Sex.MALE), id="70kg-male"),
    pytest.param(Patient(mass=55.0, height=1.58, sex=Sex.FEMALE), id="55kg-female"),
    pytest.param(Patient(mass=75.0, height=1.80, segment_model=SegmentModel.WINTER), id="75kg-winter"),
]


def legs_of(name: str) -> dict[Side, LegJoints]:
    if name == "twin_leg.urdf":
        return {Side.RIGHT: twin_joints(Side.RIGHT, foot=False)}
    return {side: twin_joints(side) for side in Side}


def compare(model: LegModel, legs: mujoco.MjModel, rng: np.random.Generator) -> None:
    """Mass matrix, Coriolis, centrifugal and gravity torques, and accelerations at random states."""
    order = coordinate_order(legs, model)
    for _ in range(5):
        q, v = rng.uniform(-1.0, 1.5, model.nv), rng.uniform(-4.0, 4.0, model.nv)
        tau = rng.uniform(-40.0, 40.0, model.nv)
        inertia, bias, accelerations = legs_dynamics(legs, order, q, v, tau)
        assert_allclose(model.mass_matrix(q), inertia, rtol=1e-9, atol=1e-9)
        assert_allclose(model.nonlinear_effects(q, v), bias, rtol=1e-9, atol=1e-9)
        assert_allclose(model.forward_dynamics(q, v, tau), accelerations, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf", "twin_ankle.urdf"])
def test_device_has_the_dynamics_that_mujoco_finds(name: str, rng: np.random.Generator) -> None:
    model = LegModel(name, legs_of(name), armature=ARMATURE)
    compare(model, mujoco_legs_of(model), rng)


def test_device_on_a_guided_pelvis_has_the_dynamics_that_mujoco_finds(rng: np.random.Generator) -> None:
    model = LegModel("twin.urdf", legs_of("twin.urdf"), armature=ARMATURE, pelvis=PelvisGuide.VERTICAL)
    compare(model, mujoco_legs_of(model), rng)


@pytest.mark.parametrize("patient", PATIENTS)
@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf", "twin_ankle.urdf"])
def test_worn_and_fitted_device_has_the_dynamics_that_mujoco_finds(
    name: str, patient: Patient, rng: np.random.Generator
) -> None:
    model = LegModel(name, legs_of(name), patient=patient, armature=ARMATURE)
    compare(model, mujoco_legs_of(model, patient), rng)


def test_the_comparison_detects_another_wearer(rng: np.random.Generator) -> None:
    """It is not blind: a wearer who is 1 kg heavier is found out."""
    model = LegModel("twin.urdf", legs_of("twin.urdf"), patient=Patient(mass=71.0), armature=ARMATURE)
    with pytest.raises(AssertionError):
        compare(model, mujoco_legs_of(model, Patient(mass=70.0)), rng)


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_free_motion_equals_mujoco(name: str, rng: np.random.Generator) -> None:
    """Half a second of free fall at 1 ms: MuJoCo's Euler method is the semi-implicit one."""
    patient = Patient()
    model = LegModel(name, legs_of(name), patient=patient, armature=ARMATURE)
    legs = mujoco_legs_of(model, patient)
    order, data = coordinate_order(legs, model), mujoco.MjData(legs)
    q, v = rng.uniform(0.0, 1.0, model.nv), rng.uniform(-1.0, 1.0, model.nv)
    data.qpos[order], data.qvel[order] = q, v
    tau = np.zeros(model.nv)

    start = q.copy()
    for _ in range(500):
        v += TICK * model.forward_dynamics(q, v, tau)
        q += TICK * v
        mujoco.mj_step(legs, data)
    assert np.abs(q - start).max() > 0.2
    assert_allclose(q, data.qpos[order], rtol=0.0, atol=1e-9)
    assert_allclose(v, data.qvel[order], rtol=0.0, atol=1e-9)
