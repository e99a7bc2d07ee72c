"""The rigid-body model against MuJoCo, an engine that shares no code with Pinocchio."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose

from twin_gait.core.integrators import semi_implicit_euler_step
from twin_gait.leg_model import LegJoints, LegModel, PelvisGuide, device_sizes, packaged_urdf
from twin_gait.parameters import HIP_ACTUATOR, KNEE_ACTUATOR, Patient
from twin_gait.vocabulary import JointName, SegmentModel, Sex, Side

mujoco = pytest.importorskip("mujoco", reason="mujoco is in the extra [test]")

ARMATURE = {JointName.HIP: HIP_ACTUATOR.armature, JointName.KNEE: KNEE_ACTUATOR.armature}
ARMATURE_OF = {"hip": 3.342, "knee": 3.342, "ankle": 0.0, "vertical": 0.0}  # [kg m²]
TICK = 1e-3

# de Leva (1996), table 4: mass, centre of mass, transverse and longitudinal radius of gyration.
DE_LEVA = {
    Sex.MALE: {
        "thigh": (0.1416, 0.4095, 0.329, 0.149),
        "shank": (0.0433, 0.4395, 0.246, 0.102),
        "foot": (0.0137, 0.4415, 0.245, 0.124),
    },
    Sex.FEMALE: {
        "thigh": (0.1478, 0.3612, 0.364, 0.162),
        "shank": (0.0481, 0.4352, 0.263, 0.092),
        "foot": (0.0129, 0.4014, 0.279, 0.139),
    },
}
# Winter (2009), table 4.1; longitudinal radii of de Leva's men.
WINTER = {
    "thigh": (0.100, 0.433, 0.323, 0.149),
    "shank": (0.0465, 0.433, 0.302, 0.102),
    "foot": (0.0145, 0.500, 0.475, 0.124),
}


def mujoco_model(urdf: str, *, vertical_pelvis: bool = False) -> mujoco.MjModel:
    """Compile a URDF without limits, contacts and friction, with the armature of the drives."""
    options = '<compiler fusestatic="false" balanceinertia="false" boundmass="0" boundinertia="0"/>'
    spec = mujoco.MjSpec.from_string(urdf.replace("</robot>", f"<mujoco>{options}</mujoco></robot>"))
    if vertical_pelvis:
        spec.body("pelvis").add_joint(
            name="pelvis_vertical", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0]
        )
    for joint in spec.joints:
        joint.limited = 0
    model = spec.compile()
    model.opt.timestep = TICK
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.gravity[:] = [0.0, 0.0, -9.81]
    model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.dof_damping[:] = 0.0
    for index in range(model.njnt):
        name = model.joint(index).name
        model.dof_armature[model.joint(index).dofadr[0]] = ARMATURE_OF[name.rsplit("_", 1)[-1]]
    return model


def joint_order(model: LegModel, witness: mujoco.MjModel) -> list[int]:
    """Position in MuJoCo's arrays of every coordinate of the model."""
    names = {
        model.model.joints[index].idx_v: name for index, name in enumerate(model.model.names) if index > 0
    }
    return [int(witness.joint(names[index]).dofadr[0]) for index in range(model.nv)]


def urdf_text(name: str) -> str:
    """URDF without <dynamics>, which MuJoCo would add as damping and friction."""
    root = ElementTree.parse(packaged_urdf(name)).getroot()
    for joint in root.iter("joint"):
        for element in joint.findall("dynamics"):
            joint.remove(element)
    return ElementTree.tostring(root, encoding="unicode")


def numbers(element: ElementTree.Element, attribute: str) -> np.ndarray:
    return np.array([float(word) for word in element.get(attribute, "0 0 0").split()])


def words(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


class WornUrdf:
    """A URDF of the device rewritten for a wearer, as the documentation of the fit describes it.

    Written for this test from the anthropometric tables; only the sizes of the device come from the
    package. The wearer's segments are links of their own, fixed to those of the device.
    """

    def __init__(self, name: str, patient: Patient) -> None:
        self.root = ElementTree.fromstring(urdf_text(name))
        self.patient = patient
        sizes = device_sizes(patient)
        for side in Side:
            if self._joint(f"{side}_hip") is None:
                continue
            self._set_waist(f"{side}_hip", sizes.waist)
            thigh = self._stretch(f"{side}_thigh", f"{side}_knee", sizes.femur)
            self._add("thigh", f"{side}_thigh", np.zeros(3), thigh)
            if self._joint(f"{side}_ankle") is None:
                shank = 0.246 * patient.height * thigh / np.linalg.norm(thigh)
                self._add("shank", f"{side}_shank", np.zeros(3), shank)
            else:
                shank = self._stretch(f"{side}_shank", f"{side}_ankle", sizes.tibia)
                self._add("shank", f"{side}_shank", np.zeros(3), shank)
                length, sole = 0.152 * patient.height, 0.039 * patient.height
                start, axis = np.array([-0.25 * length, 0.0, -0.5 * sole]), np.array([length, 0.0, 0.0])
                if patient.segment_model is SegmentModel.WINTER:  # ankle to second metatarsal
                    start, axis = np.zeros(3), np.array([0.47 * length, 0.0, -0.5 * sole])
                self._add("foot", f"{side}_foot", start, axis)

    @property
    def text(self) -> str:
        return ElementTree.tostring(self.root, encoding="unicode")

    def _joint(self, name: str) -> ElementTree.Element | None:
        return self.root.find(f"joint[@name='{name}']")

    def _origin(self, joint: str) -> ElementTree.Element:
        found = self._joint(joint)
        assert found is not None
        origin = found.find("origin")
        assert origin is not None
        return origin

    def _set_waist(self, hip: str, waist: float) -> None:
        origin = self._origin(hip)
        place = numbers(origin, "xyz")
        place[1] = np.sign(place[1]) * waist / 2.0
        origin.set("xyz", words(place))

    def _stretch(self, link: str, distal: str, length: float) -> np.ndarray:
        """Tube of the same mass and other length; returns the vector to the distal joint."""
        origin = self._origin(distal)
        old = numbers(origin, "xyz")
        ratio = length / float(np.linalg.norm(old))
        origin.set("xyz", words(ratio * old))
        inertial = self.root.find(f"link[@name='{link}']/inertial")
        assert inertial is not None
        centre, inertia = inertial.find("origin"), inertial.find("inertia")
        assert centre is not None
        assert inertia is not None
        centre.set("xyz", words(ratio * numbers(centre, "xyz")))
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
            inertia.set(key, repr(ratio**2 * float(inertia.get(key, "0"))))
        return np.asarray(ratio * old)

    def _add(self, segment: str, link: str, start: np.ndarray, axis: np.ndarray) -> None:
        """A body segment from a point of a link along an axis of the sagittal plane, where its z points."""
        assert axis[1] == 0.0
        pitch = math.atan2(axis[0], axis[2])
        winter = self.patient.segment_model is SegmentModel.WINTER
        table = WINTER if winter else DE_LEVA[self.patient.sex]
        share, centre, transverse, longitudinal = table[segment]
        mass, length = share * self.patient.mass, float(np.linalg.norm(axis))
        moments = np.array([transverse, transverse, longitudinal]) ** 2 * mass * length**2
        name = f"{link}_wearer"
        element = ElementTree.SubElement(self.root, "link", name=name)
        inertial = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=repr(mass))
        diagonal = dict(zip(("ixx", "iyy", "izz"), (repr(float(item)) for item in moments), strict=True))
        ElementTree.SubElement(inertial, "inertia", {"ixy": "0", "ixz": "0", "iyz": "0", **diagonal})
        joint = ElementTree.SubElement(self.root, "joint", name=f"{name}_fixed", type="fixed")
        ElementTree.SubElement(joint, "parent", link=link)
        ElementTree.SubElement(joint, "child", link=name)
        turned = words(np.array([0.0, pitch, 0.0]))
        ElementTree.SubElement(joint, "origin", xyz=words(start + centre * axis), rpy=turned)


PATIENTS = [
    pytest.param(Patient(mass=70.0, height=1.75, sex=Sex.MALE), id="70kg-male"),
    pytest.param(Patient(mass=55.0, height=1.58, sex=Sex.FEMALE), id="55kg-female"),
    pytest.param(Patient(mass=75.0, height=1.80, segment_model=SegmentModel.WINTER), id="75kg-winter"),
]


def legs_of(name: str) -> dict[Side, LegJoints]:
    if name == "twin_leg.urdf":
        return {Side.RIGHT: LegJoints.of_twin(Side.RIGHT, foot=False)}
    return {side: LegJoints.of_twin(side) for side in Side}


def compare(model: LegModel, witness: mujoco.MjModel, rng: np.random.Generator) -> None:
    """Mass matrix, Coriolis, centrifugal and gravity torques, and accelerations at random states."""
    order = joint_order(model, witness)
    data = mujoco.MjData(witness)
    for _ in range(5):
        q, v = rng.uniform(-1.0, 1.5, model.nv), rng.uniform(-4.0, 4.0, model.nv)
        tau = rng.uniform(-40.0, 40.0, model.nv)
        data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, v, tau
        mujoco.mj_forward(witness, data)
        inertia = dense_mass_matrix(witness, data)[np.ix_(order, order)]
        assert_allclose(model.mass_matrix(q), inertia, rtol=1e-9, atol=1e-9)
        assert_allclose(model.nonlinear_effects(q, v), data.qfrc_bias[order], rtol=1e-9, atol=1e-9)
        assert_allclose(model.forward_dynamics(q, v, tau), data.qacc[order], rtol=1e-9, atol=1e-9)


def dense_mass_matrix(witness: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Column by column from MuJoCo's own product, which all its versions have."""
    columns = np.zeros((witness.nv, witness.nv))
    for index in range(witness.nv):
        mujoco.mj_mulM(witness, data, columns[index], np.eye(witness.nv)[index])
    return columns.T


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_device_has_the_dynamics_that_mujoco_finds(name: str, rng: np.random.Generator) -> None:
    model = LegModel(name, legs_of(name), armature=ARMATURE)
    compare(model, mujoco_model(urdf_text(name)), rng)


def test_device_on_a_guided_pelvis_has_the_dynamics_that_mujoco_finds(rng: np.random.Generator) -> None:
    model = LegModel("twin.urdf", legs_of("twin.urdf"), armature=ARMATURE, pelvis=PelvisGuide.VERTICAL)
    compare(model, mujoco_model(urdf_text("twin.urdf"), vertical_pelvis=True), rng)


@pytest.mark.parametrize("patient", PATIENTS)
@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_worn_and_fitted_device_has_the_dynamics_that_mujoco_finds(
    name: str, patient: Patient, rng: np.random.Generator
) -> None:
    model = LegModel(name, legs_of(name), patient=patient, armature=ARMATURE)
    compare(model, mujoco_model(WornUrdf(name, patient).text), rng)


def test_witness_would_notice_another_wearer(rng: np.random.Generator) -> None:
    """The comparison is not blind: a wearer who is 1 kg heavier is found out."""
    model = LegModel("twin.urdf", legs_of("twin.urdf"), patient=Patient(mass=71.0), armature=ARMATURE)
    witness = mujoco_model(WornUrdf("twin.urdf", Patient(mass=70.0)).text)
    with pytest.raises(AssertionError):
        compare(model, witness, rng)


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_free_motion_is_that_of_mujoco(name: str, rng: np.random.Generator) -> None:
    """Half a second of free fall at 1 ms: MuJoCo's Euler method is the semi-implicit one."""
    patient = Patient()
    model = LegModel(name, legs_of(name), patient=patient, armature=ARMATURE)
    witness = mujoco_model(WornUrdf(name, patient).text)
    order = joint_order(model, witness)
    data = mujoco.MjData(witness)
    q, v = rng.uniform(0.0, 1.0, model.nv), rng.uniform(-1.0, 1.0, model.nv)
    data.qpos[order], data.qvel[order] = q, v
    tau = np.zeros(model.nv)

    def acceleration(
        context: object, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray
    ) -> None:
        out[:] = model.forward_dynamics(q, v, tau)

    start, room = q.copy(), np.zeros(model.nv)
    for _ in range(500):
        semi_implicit_euler_step(acceleration, None, q, v, TICK, room)
        mujoco.mj_step(witness, data)
    assert np.abs(q - start).max() > 0.2
    assert_allclose(q, data.qpos[order], rtol=0.0, atol=1e-9)
    assert_allclose(v, data.qvel[order], rtol=0.0, atol=1e-9)
