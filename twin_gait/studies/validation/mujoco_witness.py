"""MuJoCo as an independent witness: the same URDF and wearer, none of our code for the mechanics.

MuJoCo is optional. Everything here imports it on use and says how to install it.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.experiment import Experiment, IntegrationMethod
from twin_gait.leg_model import LegJoints, LegModel, PelvisGuide, device_sizes
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.leg_model.wearer import (
    TRUNK_CENTRE_OF_MASS,
    TRUNK_LENGTH,
    TRUNK_RADIUS_OF_GYRATION,
    Segment,
    foot_line,
    segments_of,
)
from twin_gait.parameters import FrictionParameters, Patient
from twin_gait.parameters.wearer import SHANK_LENGTH
from twin_gait.scenario.world import World
from twin_gait.simulation.pinocchio.plant import PinocchioPlant
from twin_gait.vocabulary import JointName

Item = TypeVar("Item")

EXTRA = "test"  # the extra of this package that installs MuJoCo
OLDEST = (3, 3)  # earlier ones cannot edit a model by the names of its joints
# MuJoCo would else merge links and mend inertias that it finds odd.
_COMPILER = (
    '<mujoco><compiler fusestatic="false" balanceinertia="false" boundmass="0" boundinertia="0"/></mujoco>'
)


def import_mujoco() -> Any:
    """The module ``mujoco``.

    Returns:
        The module.

    Raises:
        MissingOptionalDependency: If it is not installed or too old.
    """
    package = f"mujoco {'.'.join(map(str, OLDEST))} or newer"
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError as error:
        raise MissingOptionalDependency(package, EXTRA, "the comparison with MuJoCo") from error
    if tuple(int(number) for number in mujoco.__version__.split(".")[:2]) < OLDEST:
        raise MissingOptionalDependency(package, EXTRA, "the comparison with MuJoCo")
    return mujoco


# ---------------------------------------------------------------------- the rigid bodies


def witness_model(experiment: Experiment, model: LegModel) -> Any:
    """Read the URDF of an experiment with MuJoCo and put the wearer on it there.

    Limits, contacts and friction are off; the armature of the drives is in. The tables of the wearer
    and the sizes of the device are data that both sides share; how they become rigid bodies is done
    here a second time.

    Args:
        experiment: The experiment, with a vertical of z.
        model: Its leg model, for the file and the names of the joints.

    Returns:
        The ``MjModel``; its integrator is the semi-implicit Euler method.

    Raises:
        MissingOptionalDependency: If MuJoCo is not installed.
    """
    mujoco = import_mujoco()
    text = model.urdf_path.read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{_COMPILER}</robot>"))
    if model.pelvis is PelvisGuide.VERTICAL:
        spec.worldbody.first_body().add_joint(
            name=PELVIS_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0]
        )
    if experiment.patient is not None:
        _put_on(spec, experiment.patient, model, fit_device=experiment.leg.fit_device)
    witness = spec.compile()
    witness.opt.timestep = experiment.stepping.step
    witness.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    witness.opt.gravity[:] = [0.0, 0.0, -experiment.plant.gravity]
    witness.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    witness.dof_damping[:] = 0.0
    witness.dof_armature[:] = 0.0
    for leg in model.legs.values():
        for joint, name in leg.items():
            if joint in experiment.plant.actuators:
                address = witness.joint(name).dofadr[0]
                witness.dof_armature[address] = experiment.plant.actuators[joint].armature
    return witness


def _put_on(spec: Any, patient: Patient, model: LegModel, *, fit_device: bool) -> None:
    """Fit the device to the wearer and add the wearer's segments as bodies of their own."""
    segments = segments_of(patient)
    for leg in model.legs.values():
        if fit_device:
            _fit(spec, leg, patient)
        hip, knee = spec.joint(leg.hip).parent, spec.joint(leg.knee).parent
        thigh = np.array(knee.pos)
        _add_segment(hip, patient, segments["thigh"], np.zeros(3), thigh)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
            _add_segment(knee, patient, segments["shank"], np.zeros(3), shank)
            continue
        ankle = spec.joint(leg.ankle).parent
        _add_segment(knee, patient, segments["shank"], np.zeros(3), np.array(ankle.pos))
        start, axis = (np.array([forward, 0.0, up]) for forward, up in foot_line(patient))
        _add_segment(ankle, patient, segments["foot"], start, axis)
    if model.pelvis is PelvisGuide.VERTICAL:
        _add_trunk(spec.joint(PELVIS_JOINT).parent, patient)


def _fit(spec: Any, leg: LegJoints, patient: Patient) -> None:
    """Set waist, femur and tibia; a tube of the same mass and another length."""
    sizes = device_sizes(patient)
    hip, knee = spec.joint(leg.hip).parent, spec.joint(leg.knee).parent
    hip.pos = [hip.pos[0], np.sign(hip.pos[1]) * sizes.waist / 2.0, hip.pos[2]]
    tubes = [(hip, knee, sizes.femur)]
    if leg.ankle is not None:
        tubes.append((knee, spec.joint(leg.ankle).parent, sizes.tibia))
    for tube, distal, length in tubes:
        ratio = length / np.linalg.norm(distal.pos)
        distal.pos = ratio * np.array(distal.pos)
        tube.ipos = ratio * np.array(tube.ipos)
        tube.fullinertia = ratio * ratio * np.array(tube.fullinertia)


def _add_segment(body: Any, patient: Patient, segment: Segment, start: np.ndarray, axis: np.ndarray) -> None:
    """A limb: a transverse inertia across its axis, a longitudinal one along."""
    mass, length = segment.mass * patient.mass, float(np.linalg.norm(axis))
    radii = np.array([segment.transverse_radius, segment.transverse_radius, segment.longitudinal_radius])
    _add_mass(body, mass, start + segment.centre_of_mass * axis, mass * (radii * length) ** 2, axis)


def _add_trunk(pelvis: Any, patient: Patient) -> None:
    """Head, arms and trunk: what the legs leave over; a tenth of the inertia about the vertical."""
    limbs = sum(segment.mass for segment in segments_of(patient).values())
    mass, length = patient.mass * (1.0 - 2.0 * limbs), TRUNK_LENGTH * patient.height
    moment = mass * (TRUNK_RADIUS_OF_GYRATION * length) ** 2
    centre = np.array([0.0, 0.0, TRUNK_CENTRE_OF_MASS * length])
    _add_mass(pelvis, mass, centre, moment * np.array([1.0, 1.0, 0.1]), np.array([0.0, 0.0, 1.0]))


def _add_mass(body: Any, mass: float, centre: np.ndarray, moments: np.ndarray, axis: np.ndarray) -> None:
    """Moments about two axes across a direction, and about the direction itself."""
    turn = np.empty(4)
    import_mujoco().mju_quatZ2Vec(turn, axis)
    body.add_body(mass=mass, ipos=centre, iquat=turn, inertia=moments, explicitinertial=True)


class WitnessDynamics:
    """Mass matrix, bias and accelerations of MuJoCo, in the order of a leg model's coordinates."""

    def __init__(self, witness: Any, model: LegModel) -> None:
        """Find the coordinates of the leg model.

        Args:
            witness: From :func:`witness_model`.
            model: The leg model.
        """
        self._mujoco = import_mujoco()
        self._witness, self._data = witness, self._mujoco.MjData(witness)
        self._order = coordinate_order(witness, model)

    def at(
        self, q: np.ndarray, v: np.ndarray, torque: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate a state.

        Args:
            q: Coordinates, shape ``(nv,)``.
            v: Velocities, shape ``(nv,)``.
            torque: On the coordinates, shape ``(nv,)``.

        Returns:
            Mass matrix, bias (Coriolis, centrifugal and gravity) and acceleration.
        """
        data, order = self._data, self._order
        data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, v, torque
        self._mujoco.mj_forward(self._witness, data)
        # Row by row from MuJoCo's own product: how it stores the matrix differs between versions.
        rows, unit = np.zeros((len(order), len(order))), np.eye(len(order))
        for index in range(len(order)):
            self._mujoco.mj_mulM(self._witness, data, rows[index], unit[index])
        return rows[np.ix_(order, order)], np.array(data.qfrc_bias[order]), np.array(data.qacc[order])


def coordinate_order(witness: Any, model: LegModel) -> list[int]:
    """Position in MuJoCo's arrays of every coordinate of a leg model.

    Args:
        witness: From :func:`witness_model`.
        model: The leg model.

    Returns:
        Positions in the order of the leg model.
    """
    names = {
        model.index(side, joint): name for side, leg in model.legs.items() for joint, name in leg.items()
    }
    if model.pelvis_index is not None:
        names[model.pelvis_index] = PELVIS_JOINT
    return [int(witness.joint(names[index]).dofadr[0]) for index in range(model.nv)]


# ---------------------------------------------------------------------- the plant


def witness_friction(velocity: float, law: FrictionParameters) -> float:
    """Equation (3.1) of the thesis typed in a second time, on purpose: a witness shares no law.

    Args:
        velocity: In [rad] / [s].
        law: Parameters.

    Returns:
        Friction torque in [N m] with the sign of the velocity.
    """
    ratio = velocity / law.breakaway_velocity
    stribeck = math.sqrt(2.0) * math.exp(0.5 - ratio**2) * ratio
    return (
        (law.breakaway_torque - law.coulomb_friction) * stribeck
        + law.coulomb_friction * math.tanh(velocity / (law.breakaway_velocity / 10.0))
        + law.viscous_friction * velocity
    )


class MujocoPlant(PinocchioPlant):
    """A plant that MuJoCo integrates, to be put in the place of that of a Pinocchio engine.

    It knows motors and friction and neither stops, springs, hand nor ground; a run that touches one of
    those is no comparison. MuJoCo's Euler method is the semi-implicit one.
    """

    def __init__(self, world: World, experiment: Experiment) -> None:
        """Set the plant to the start of the world.

        Args:
            world: A bench leg.
            experiment: What is run.

        Raises:
            MissingOptionalDependency: If MuJoCo is not installed.
        """
        super().__init__(world)
        self._mujoco = import_mujoco()
        self._witness = witness_model(experiment, world.model)
        self._mujoco_data = self._mujoco.MjData(self._witness)
        self._order = coordinate_order(self._witness, world.model)
        self._friction = _per_coordinate(world.model, experiment.plant.true_friction())
        self._load_friction = np.array(_per_coordinate(world.model, experiment.plant.load_friction))
        self._mujoco_data.qpos[self._order] = self.q
        self._mujoco_data.qvel[self._order] = self.v

    def step(self, step: float, method: IntegrationMethod) -> None:
        """One step of MuJoCo; its length and method are those of the model."""
        assert step == self._witness.opt.timestep and method is IntegrationMethod.SEMI_IMPLICIT_EULER
        # Uses up the evaluation that the engine recorded, so that the next record is of the next state.
        self.acceleration(self.q, self.v, self.a)
        data = self._mujoco_data
        friction = [
            witness_friction(velocity, law)
            for velocity, law in zip(data.qvel[self._order].tolist(), self._friction, strict=True)
        ]
        turning = np.tanh(data.qvel[self._order] / [0.1 * law.breakaway_velocity for law in self._friction])
        load = self._load_friction * np.abs(self.motor) * turning
        data.qfrc_applied[self._order] = self.motor - np.array(friction) - load
        self._mujoco.mj_step(self._witness, data)
        self.q[:], self.v[:] = data.qpos[self._order], data.qvel[self._order]


def _per_coordinate(model: LegModel, items: Mapping[JointName, Item]) -> list[Item]:
    """What each joint has, in the order of the coordinates of one leg of hip and knee."""
    (side,) = model.sides
    joints = sorted(items, key=lambda joint: model.index(side, joint))
    return [items[joint] for joint in joints]
