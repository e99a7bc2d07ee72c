"""Legs of the device and their wearer as a MuJoCo model, built independently.

The sources are the URDF and the tables of the literature, typed in again; from the package only the names of
joints and the sizes of the device are used. Needs MuJoCo (``pip install 'twin-gait[test]'``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from twin_gait import Experiment, JointName, LegModel, Patient, Side
from twin_gait.leg_model.anthropometry import DeviceSizes, ManufacturedSizes, device_sizes
from twin_gait.leg_model.attachments import Attachment
from twin_gait.leg_model.joints import FORWARD_JOINT, PELVIS_JOINT, PITCH_JOINT, LegJoints


class Segment(NamedTuple):
    """Limb: share of the body mass; centre of mass and radii of gyration as shares of its length."""

    mass: float
    centre: float
    transverse: float
    longitudinal: float


# de Leva (1996), J Biomech 29(9), table 4, and Winter (2009), table 4.1, which lacks longitudinal radii.
SEGMENTS = {
    "male": {
        "thigh": Segment(0.1416, 0.4095, 0.329, 0.149),
        "shank": Segment(0.0433, 0.4395, 0.246, 0.102),
        "foot": Segment(0.0137, 0.4415, 0.245, 0.124),
    },
    "female": {
        "thigh": Segment(0.1478, 0.3612, 0.364, 0.162),
        "shank": Segment(0.0481, 0.4352, 0.263, 0.092),
        "foot": Segment(0.0129, 0.4014, 0.279, 0.139),
    },
    "winter": {
        "thigh": Segment(0.100, 0.433, 0.323, 0.149),
        "shank": Segment(0.0465, 0.433, 0.302, 0.102),
        "foot": Segment(0.0145, 0.500, 0.475, 0.124),
    },
}
# Shares of the body height (Winter, figure 4.1), and what a shank without a foot is measured by.
THIGH_LENGTH, SHANK_LENGTH, FOOT_LENGTH, FOOT_HEIGHT, HIP_BREADTH = 0.245, 0.246, 0.152, 0.039, 0.191
# Of head, arms and trunk between hip and shoulder (Winter, figure 4.1 and table 4.1).
TRUNK_LENGTH, TRUNK_CENTRE, TRUNK_RADIUS = 0.288, 0.626, 0.496
DRAWN_HEIGHT = 1.75  # [m] of the wearer for whom the feet of the URDF are drawn
# MuJoCo would else merge links and mend inertias that it finds odd.
COMPILER = (
    '<mujoco><compiler fusestatic="false" balanceinertia="false" boundmass="0" boundinertia="0"/></mujoco>'
)


def legs_spec(
    model: LegModel,
    patient: Patient | None,
    *,
    fit_device: bool = True,
    manufactured: ManufacturedSizes | None = None,
    attachment: Attachment | None = None,
) -> mujoco.MjSpec:
    """Read the URDF of a leg model with MuJoCo and put the wearer on there.

    Args:
        model: For the file and the names of the joints.
        patient: The wearer, or None.
        fit_device: Whether waist, femur, tibia and foot are set to the wearer.
        manufactured: Sizes in which the device is made; None for those of the wearer.
        attachment: Parts of the device on the wearer's segments, or None.

    Returns:
        The legs before they are compiled, so that a ground can be added.
    """
    text = model.urdf_path.read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{COMPILER}</robot>"))
    slide, pelvis = mujoco.mjtJoint.mjJNT_SLIDE, spec.worldbody.first_body()
    if model.forward_index is not None:
        pelvis.add_joint(name=FORWARD_JOINT, type=slide, axis=[1.0, 0.0, 0.0])
    if model.pelvis != "fixed":
        pelvis.add_joint(name=PELVIS_JOINT, type=slide, axis=[0.0, 0.0, 1.0])
    if model.pitch_index is not None:
        pelvis.add_joint(name=PITCH_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    if patient is not None:
        sizes = None
        if fit_device:
            sizes = device_sizes(patient, manufactured) if manufactured else _own_sizes(patient)
        _put_on(spec, model, patient, sizes, attachment or Attachment())
    return spec


def compiled_legs(
    spec: mujoco.MjSpec,
    model: LegModel,
    armature: Mapping[JointName, float],
    *,
    gravity: float,
    step: float,
    driven_sides: Sequence[Side] = (),
) -> mujoco.MjModel:
    """Compile legs without limits, contacts and friction, for the semi-implicit Euler method.

    Args:
        spec: From :func:`legs_spec`.
        model: For the names of the joints.
        armature: Inertia of the drives in [kg·m²].
        gravity: In [m/s²], against z.
        step: Length of an integration step in [s].
        driven_sides: Legs with drives; empty for all.
    """
    legs = spec.compile()
    legs.opt.timestep = step
    legs.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    legs.opt.gravity[:] = [0.0, 0.0, -gravity]
    legs.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    legs.dof_damping[:] = legs.dof_frictionloss[:] = legs.dof_armature[:] = 0.0
    for side, leg in model.legs.items():
        for joint, name in leg.items():
            if joint in armature and side in (driven_sides or model.sides):
                legs.dof_armature[legs.joint(name).dofadr[0]] = armature[joint]
    return legs


def legs_of(experiment: Experiment, model: LegModel) -> mujoco.MjModel:
    """Return legs and wearer of an experiment, without ground."""
    leg = experiment.leg
    spec = legs_spec(model, experiment.patient, fit_device=leg.fit_device, manufactured=leg.sizes)
    armature = {joint: item.armature for joint, item in experiment.plant.actuators.items()}
    plant, step = experiment.plant, experiment.resolved_integration.step
    return compiled_legs(spec, model, armature, gravity=plant.gravity, step=step)


def coordinate_order(legs: mujoco.MjModel, model: LegModel) -> list[int]:
    """Return the index in MuJoCo's arrays of every coordinate of a leg model."""
    names = {
        model.index(side, joint): name for side, leg in model.legs.items() for joint, name in leg.items()
    }
    if model.pelvis_index is not None:
        names[model.pelvis_index] = PELVIS_JOINT
    if model.forward_index is not None:
        names[model.forward_index] = FORWARD_JOINT
    if model.pitch_index is not None:
        names[model.pitch_index] = PITCH_JOINT
    return [int(legs.joint(names[index]).dofadr[0]) for index in range(model.nv)]


def legs_dynamics(
    legs: mujoco.MjModel, order: list[int], q: np.ndarray, v: np.ndarray, torque: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute mass matrix, bias (Coriolis, centrifugal, gravity) and accelerations of a state."""
    data = mujoco.MjData(legs)
    data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, v, torque
    mujoco.mj_forward(legs, data)
    # Row by row from MuJoCo's own product: how it stores the matrix differs between versions.
    rows, unit = np.zeros((legs.nv, legs.nv)), np.eye(legs.nv)
    for row, direction in zip(rows, unit, strict=True):
        mujoco.mj_mulM(legs, data, row, direction)
    return rows[np.ix_(order, order)], np.array(data.qfrc_bias[order]), np.array(data.qacc[order])


# ---------------------------------------------------------------------- the wearer


def _own_sizes(patient: Patient) -> DeviceSizes:
    shares = {"femur": THIGH_LENGTH, "tibia": SHANK_LENGTH, "waist": HIP_BREADTH, "foot": FOOT_LENGTH}
    return DeviceSizes(**{name: share * patient.height for name, share in shares.items()})


def _put_on(
    spec: mujoco.MjSpec,
    model: LegModel,
    patient: Patient,
    sizes: DeviceSizes | None,
    attachment: Attachment,
) -> None:
    """Fit the device, and add the wearer's segments and attached masses as bodies of their own."""
    winter = patient.segment_model == "winter"
    segments = SEGMENTS["winter" if winter else str(patient.sex)]
    for side, leg in model.legs.items():
        if sizes is not None:
            _fit(spec, leg, patient, sizes)

        def rest(name: str, side: Side = side) -> float:
            """Return the share of a segment that a prosthesis leaves."""
            return 1.0 - attachment.replaced.get(f"{side}_{name}", 0.0)

        def attach(name: str, body: Any, start: np.ndarray, axis: np.ndarray, side: Side = side) -> None:
            part = attachment.masses.get(f"{side}_{name}")
            if part is not None:
                centre = start + part.along * axis + np.array([part.forward, 0.0, 0.0])
                _add_mass(body, part.mass, centre, part.mass * part.radius_of_gyration**2 * np.ones(3), axis)

        hip, knee = spec.joint(leg.hip).parent, spec.joint(leg.knee).parent
        thigh = np.array(knee.pos)
        _add_limb(hip, patient, segments["thigh"], np.zeros(3), thigh, rest("thigh"))
        attach("thigh", hip, np.zeros(3), thigh)
        if leg.ankle is None:
            shank = SHANK_LENGTH * patient.height * thigh / np.linalg.norm(thigh)
            _add_limb(knee, patient, segments["shank"], np.zeros(3), shank)
            continue
        ankle = spec.joint(leg.ankle).parent
        _add_limb(knee, patient, segments["shank"], np.zeros(3), np.array(ankle.pos), rest("shank"))
        attach("shank", knee, np.zeros(3), np.array(ankle.pos))
        length, drop = FOOT_LENGTH * patient.height, -0.5 * FOOT_HEIGHT * patient.height
        # de Leva measures from heel to toe, Winter from the ankle to the second metatarsal.
        start, axis = np.array([-0.25 * length, 0.0, drop]), np.array([length, 0.0, 0.0])
        if winter:
            start, axis = np.zeros(3), np.array([0.47 * length, 0.0, drop])
        _add_limb(ankle, patient, segments["foot"], start, axis, rest("foot"))
        attach("foot", ankle, start, axis)
    if model.pelvis != "fixed":
        trunk = patient.mass * (1.0 - 2.0 * sum(item.mass for item in segments.values()))
        up = np.array([0.0, 0.0, 1.0])
        length = TRUNK_LENGTH * patient.height
        moment = trunk * (TRUNK_RADIUS * length) ** 2
        # In the sagittal plane nothing turns it about its own axis.
        moments = moment * np.array([1.0, 1.0, 0.5])
        pelvis = spec.joint(PELVIS_JOINT).parent
        _add_mass(pelvis, trunk, TRUNK_CENTRE * length * up, moments, up)
        part = attachment.masses.get("pelvis")
        if part is not None:
            centre = part.along * length * up + np.array([part.forward, 0.0, 0.0])
            _add_mass(pelvis, part.mass, centre, part.mass * part.radius_of_gyration**2 * np.ones(3), up)


def _fit(spec: mujoco.MjSpec, leg: LegJoints, patient: Patient, sizes: DeviceSizes) -> None:
    """Set waist, femur, tibia and foot; a link of the same mass and another length."""
    hip, knee = spec.joint(leg.hip).parent, spec.joint(leg.knee).parent
    hip.pos = [hip.pos[0], np.sign(hip.pos[1]) * sizes.waist / 2.0, hip.pos[2]]
    tubes = [(hip, knee, sizes.femur)]
    if leg.ankle is not None:
        foot = spec.joint(leg.ankle).parent
        tubes.append((knee, foot, sizes.tibia))
        for end in foot.bodies:  # heel and toe
            end.pos = patient.height / DRAWN_HEIGHT * np.array(end.pos)
        _grow(foot, patient.height / DRAWN_HEIGHT)
    for tube, distal, length in tubes:
        ratio = length / np.linalg.norm(distal.pos)
        distal.pos = ratio * np.array(distal.pos)
        _grow(tube, ratio)


def _grow(link: Any, ratio: float) -> None:
    link.ipos = ratio * np.array(link.ipos)
    link.fullinertia = ratio * ratio * np.array(link.fullinertia)


def _add_limb(
    body: Any, patient: Patient, segment: Segment, start: np.ndarray, axis: np.ndarray, rest: float = 1.0
) -> None:
    """Add the share ``rest`` of the mass of a limb, unless nothing is left of it."""
    if rest == 0.0:
        return
    mass, length = rest * segment.mass * patient.mass, float(np.linalg.norm(axis))
    radii = length * np.array([segment.transverse, segment.transverse, segment.longitudinal])
    _add_mass(body, mass, start + segment.centre * axis, mass * radii**2, axis)


def _add_mass(body: Any, mass: float, centre: np.ndarray, moments: np.ndarray, axis: np.ndarray) -> None:
    """Add a body with given moments of inertia about two transverse axes and the longitudinal axis."""
    turn = np.empty(4)
    mujoco.mju_quatZ2Vec(turn, axis)
    body.add_body(mass=mass, ipos=centre, iquat=turn, inertia=moments, explicitinertial=True)
