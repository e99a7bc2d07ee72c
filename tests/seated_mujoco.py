"""Free body on a seat by MuJoCo, with the forces of the seat on MuJoCo's bodies by its Jacobians."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import mujoco_kernel
import numpy as np
from crosscheck import mujoco_legs
from mujoco_kernel import MujocoKernel

from twin_gait.leg_model.joints import FORWARD_JOINT, PELVIS_JOINT, PITCH_JOINT
from twin_gait.simulation.simulation_setup import SimulationSetup

TRUNK_LENGTH, GYRATION = 0.288, 0.496  # head, arms and trunk (Winter 2009, table 4.1)


def free_spec(model: Any, patient: Any, **options: Any) -> mujoco.MjSpec:
    """Return the legs with a pelvis that also moves forwards and pitches, and a trunk with inertia."""
    spec = mujoco_legs.legs_spec(model, patient, **options)
    if model.pitch_index is None or any(joint.name == PITCH_JOINT for joint in spec.joints):
        return spec  # the model is that of the controller, or its pelvis is free already
    pelvis = spec.joint(PELVIS_JOINT).parent
    pelvis.add_joint(name=FORWARD_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    pelvis.add_joint(name=PITCH_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    trunk = max(pelvis.bodies, key=lambda body: body.mass)
    radius = GYRATION * TRUNK_LENGTH * patient.height
    trunk.inertia = trunk.mass * radius**2 * np.array([1.0, 1.0, 0.1])
    return spec


def free_order(legs: mujoco.MjModel, model: Any) -> list[int]:
    """Return the index of every coordinate in the arrays of MuJoCo."""
    if model.pitch_index is None:
        return mujoco_legs.coordinate_order(legs, model)
    guides = FORWARD_JOINT, PELVIS_JOINT, PITCH_JOINT
    names = dict(zip((model.forward_index, model.pelvis_index, model.pitch_index), guides, strict=True))
    for side, leg in model.legs.items():
        names |= {model.index(side, joint): name for joint, name in leg.items()}
    return [int(legs.joint(names[index]).dofadr[0]) for index in range(model.nv)]


class SeatedMujocoKernel(MujocoKernel):
    """Kernel with a seat that the loop does not model."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Build plant and controller model of a free body."""
        kept = mujoco_kernel.legs_spec, mujoco_kernel.coordinate_order
        mujoco_kernel.legs_spec, mujoco_kernel.coordinate_order = free_spec, free_order
        try:
            super().__init__(problem)
        finally:
            mujoco_kernel.legs_spec, mujoco_kernel.coordinate_order = kept
        self._chair = problem.experiment.scenario.chair
        legs = problem.world.model.legs.values()
        self._thighs = [self._legs.body(leg.hip) for leg in legs]
        shank = self._legs.body(next(iter(legs)).knee)
        self._femur = float(np.linalg.norm(self._legs.model.body_pos[shank]))

    def dynamics(self, q, v, torque, rotors, bodies, gravity, ground, a, points) -> float:
        """Write the accelerations under ground and seat to ``a``; return the power of both [W]."""
        power = self.contact_forces(q, v, bodies, ground, points)
        chair, data = self._chair, self._legs.data
        pelvis, share = self._guide, chair.thigh_share
        below = data.xpos[pelvis] - [0.0, 0.0, chair.hip_height]
        power += self._press(pelvis, below, (1.0 - share) * chair.stiffness)
        for thigh in self._thighs:
            local = [-chair.thigh_thickness, 0.0, -chair.thigh_position * self._femur]
            point = data.xpos[thigh] + data.xmat[thigh].reshape(3, 3) @ local
            power += self._press(thigh, point, 0.5 * share * chair.stiffness)
        a[:] = self._legs.accelerate(torque, rotors).tolist()
        return power

    def _press(self, body: int, point: np.ndarray, stiffness: float) -> float:
        """Apply the force of the seat to a point of a body; return its power in [W]."""
        chair, model, data = self._chair, self._legs.model, self._legs.data
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        velocity = jacobian @ data.qvel
        ramp = min(chair.front - point[0], point[0] - chair.front + chair.depth) / chair.rounding
        deep = max(0.0, chair.height - point[2]) * min(max(ramp, 0.0), 1.0)
        normal = stiffness * deep * max(0.0, 1.0 - chair.dissipation * velocity[2])
        rubbing = -chair.friction_coefficient * normal * math.tanh(velocity[0] / chair.transition_velocity)
        force = np.array([rubbing, 0.0, normal])
        data.xfrc_applied[body] += [*force, *np.cross(point - data.xipos[body], force)]
        return float(force @ velocity)
