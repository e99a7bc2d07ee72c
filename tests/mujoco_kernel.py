"""Rigid-body dynamics by MuJoCo with the interface of the generated kernels.

MuJoCo reads the URDF itself, and the wearer comes from separate tables (:mod:`crosscheck.mujoco_legs`), so
that no number of the package's rigid bodies is used here. The contacts of MuJoCo are not used either: the
forces of the ground follow the law of the package and are applied to MuJoCo's bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from crosscheck.mujoco_legs import compiled_legs, coordinate_order, legs_spec

from twin_gait import Experiment, LegModel, Patient
from twin_gait.core.contact import ContactState, Ground, ground_contact_force
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.simulation.simulation_setup import SimulationSetup


class MujocoLegs:
    """Leg model in MuJoCo, in the order of the coordinates of the package."""

    def __init__(self, experiment: Experiment, model: LegModel, patient: Patient | None) -> None:
        """Build the model from the URDF and the tables of the literature."""
        leg = experiment.leg
        spec = legs_spec(
            model,
            patient,
            fit_device=leg.fit_device,
            manufactured=leg.sizes,
            attachment=leg.attachment,
        )
        armature = {joint: item.armature for joint, item in experiment.plant.actuators.items()}
        gravity, step = experiment.plant.gravity, experiment.resolved_integration.step
        self.model = compiled_legs(
            spec, model, armature, gravity=gravity, step=step, driven_sides=experiment.sides
        )
        self.data = mujoco.MjData(self.model)
        self.order = coordinate_order(self.model, model)

    def body(self, joint: str) -> int:
        """Return the number of the body that a joint moves."""
        return int(self.model.jnt_bodyid[self.model.joint(joint).id])

    def set_state(self, q: list[float], v: list[float] | None = None) -> None:
        """Set a state, at rest without ``v``; the last coordinates, tips of crutches, are not part of it."""
        own = len(self.order)
        self.data.qpos[self.order] = q[:own]
        self.data.qvel[self.order] = np.zeros(own) if v is None else v[:own]
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)

    def accelerate(self, torque: list[float], rotors: list[float]) -> np.ndarray:
        """Return the accelerations of the present state under torques and forces on the bodies.

        The inertias of the rotors at the joints are those that are given.
        """
        own = len(self.order)
        self.data.qfrc_applied[self.order] = torque[:own]
        mujoco.mj_fwdAcceleration(self.model, self.data)
        mass, unit = np.zeros((self.model.nv, self.model.nv)), np.eye(self.model.nv)
        for row, direction in zip(mass, unit, strict=True):
            mujoco.mj_mulM(self.model, self.data, row, direction)
        mass[self.order, self.order] += rotors[:own] - self.model.dof_armature[self.order]
        return np.array(np.linalg.solve(mass, self.data.qfrc_smooth)[self.order])


class MujocoKernel:
    """Functions of a kernel; see :mod:`twin_gait.simulation.backend`."""

    def __init__(self, problem: SimulationSetup) -> None:
        """Build the model of the plant and the model of the controller."""
        experiment, world = problem.experiment, problem.world
        assert world.braces is None
        known = experiment.patient if experiment.control.patient is None else experiment.control.patient
        self._legs = MujocoLegs(experiment, world.model, experiment.patient)
        self._control = MujocoLegs(experiment, problem.control_model, known)
        self._guide = None if world.model.pelvis_index is None else self._legs.body(PELVIS_JOINT)
        # Heels and toes are separate bodies without mass.
        names = [name for side in world.model.legs for name in world.contact_frames.get(side, ())]
        slope = world.slope
        self._belt = np.array([[np.cos(slope), np.sin(slope)], [-np.sin(slope), np.cos(slope)]])
        self._soles = [int(self._legs.model.body(name).id) for name in names]
        self._forefeet = [name.endswith("toe") for name in names]

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        """Functions of the kernel by name, for the specialisation of the engine."""
        found = (self.dynamics, self.contact_forces, self.observe, self.control_gravity, self.control_inertia)
        return {function.__name__: function for function in found}

    def dynamics(
        self,
        q: list[float],
        v: list[float],
        torque: list[float],
        rotors: list[float],
        bodies: list[float],
        gravity: float,
        ground: Ground,
        a: list[float],
        points: list[ContactState],
    ) -> float:
        """Write the accelerations with ground forces to ``a``; return the power of the ground [W]."""
        power = self.contact_forces(q, v, bodies, ground, points)
        found = self._legs.accelerate(torque, rotors).tolist()
        a[: len(found)] = found
        return power

    def contact_forces(
        self, q: list[float], v: list[float], bodies: list[float], ground: Ground, points: list[ContactState]
    ) -> float:
        """Write the forces on the soles, with velocities from MuJoCo's Jacobians; return their power [W]."""
        self._legs.set_state(q, v)
        model, data, jacobian, power = (
            self._legs.model,
            self._legs.data,
            np.zeros((3, len(self._legs.order))),
            0.0,
        )
        data.xfrc_applied[:] = 0.0
        heel = ground.stiffness, ground.dissipation
        toe = ground.forefoot_stiffness, ground.forefoot_dissipation
        for body, forefoot, point in zip(self._soles, self._forefeet, points, strict=False):
            point_position = data.xpos[body]
            mujoco.mj_jac(model, data, jacobian, None, point_position, body)
            along, away = self._belt @ (jacobian @ data.qvel)[[0, 2]]
            point.height = float(self._belt[1] @ point_position[[0, 2]])
            friction, normal = ground_contact_force(
                ground, *(toe if forefoot else heel), point.height, float(along), float(away)
            )
            point.forward, point.upward = (self._belt.T @ [friction, normal]).tolist()
            power += float(friction * along + normal * away)
            force = np.array([point.forward, 0.0, point.upward])
            data.xfrc_applied[body] = [*force, *np.cross(point_position - data.xipos[body], force)]
        return power

    def observe(
        self,
        q: list[float],
        v: list[float],
        a: list[float],
        bodies: list[float],
        gravity: float,
        points: object,
    ) -> tuple[float, float, float, float]:
        """Return energies, and force and moment of the pelvis guide, for the last state of the dynamics."""
        model, data = self._legs.model, self._legs.data
        mujoco.mj_energyVel(model, data)
        moving = model.body_weldid > 0
        potential = gravity * float(model.body_mass[moving] @ data.xipos[moving, 2])
        if self._guide is None:
            return float(data.energy[1]), potential, 0.0, 0.0
        data.qacc[self._legs.order] = a[: len(self._legs.order)]
        mujoco.mj_rnePostConstraint(model, data)
        moment, force = data.cfrc_int[self._guide].reshape(2, 3)
        centre = data.subtree_com[model.body_rootid[self._guide]]
        moment = moment + np.cross(centre - data.xpos[self._guide], force)
        return float(data.energy[1]), potential, float(force[0]), float(moment[1])

    def control_gravity(
        self, q: list[float], bodies: list[float], gravity: float, torque: list[float]
    ) -> None:
        """Write the gravity torques of the controller's model, which are its bias at rest."""
        self._control.set_state(q)
        torque[:] = self._control.data.qfrc_bias[self._control.order].tolist()

    def control_inertia(
        self, q: list[float], a: list[float], bodies: list[float], torque: list[float]
    ) -> None:
        """Write the inertia torques of the controller's model."""
        self._control.set_state(q)
        given, found = np.zeros((2, len(q)))
        given[self._control.order] = a
        mujoco.mj_mulM(self._control.model, self._control.data, found, given)
        torque[:] = found[self._control.order].tolist()
