"""URDF files as people export them: encodings, extensions of simulators, trees, units and couplings."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from errors import raises, warns
from numpy.testing import assert_allclose, assert_array_equal

from twin_gait.configuration.experiments import load_experiment
from twin_gait.exceptions import ModelError
from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model, packaged_urdf
from twin_gait.leg_model.urdf_document import Mimic, UrdfWarning, mimic_joints
from twin_gait.vocabulary import JointName, Side

LINK = """<link name="{name}"><inertial><origin xyz="0 0 -0.2"/><mass value="3"/>
<inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>"""
JOINT = """<joint name="{name}" type="revolute"><origin xyz="0 0 {z}"/>
<parent link="{parent}"/><child link="{child}"/>
<axis xyz="0 {axis} 0"/><limit lower="-0.5" upper="2" effort="80" velocity="5"/>{more}</joint>"""
POSTURE = np.array([0.3, 0.7])


def leg_text(*, thigh: str = "", hip: str = "", knee: str = "", more: str = "", head: str = "") -> str:
    """A leg of 0.4 m segments with additions inside its elements."""
    links = [
        LINK.format(name=name, more=thigh if name == "thigh" else "") for name in ("pelvis", "thigh", "shank")
    ]
    joints = [
        JOINT.format(name="hip", z=0, parent="pelvis", child="thigh", axis=-1, more=hip),
        JOINT.format(name="knee", z=-0.4, parent="thigh", child="shank", axis=1, more=knee),
    ]
    return f'{head}<robot name="leg">{"".join(links + joints)}{more}</robot>'


def leg_of(path: Path, content: str | bytes, **joints: str) -> LegModel:
    """Write a URDF and build its only leg."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return LegModel(path, {Side.RIGHT: LegJoints(**{"hip": "hip", "knee": "knee", **joints})})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "leg.urdf"


@pytest.fixture
def plain_torque(path: Path) -> np.ndarray:
    return leg_of(path, leg_text()).gravity_torque(POSTURE)


TRANSMISSION = """<transmission name="t"><type>SimpleTransmission</type><joint name="knee">
<hardwareInterface>Effort</hardwareInterface></joint></transmission>
<gazebo><joint name="hip"/><link name="thigh"><inertial><mass value="-1"/></inertial></link></gazebo>"""
CAPSULE = '<{0}><geometry><capsule length="0.3" radius="0.05"/></geometry></{0}>'
GREY = '<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>'


@pytest.mark.parametrize(
    "content",
    [
        leg_text(more=TRANSMISSION),
        leg_text(thigh=CAPSULE.format("collision")),
        leg_text(thigh=CAPSULE.format("visual")),
        leg_text(more=2 * GREY),
        leg_text().replace(' effort="80" velocity="5"', ""),
        leg_text(head='<?xml version="1.0" encoding="ISO-8859-1"?><!-- l\u00e4nge -->').encode("latin-1"),
        leg_text(head='<?xml version="1.0"?>').encode("utf-16"),
        leg_text(head='<?xml version="1.0"?>').encode("utf-8-sig"),
    ],
    ids=["transmission", "collision", "visual", "material twice", "no effort", "latin-1", "utf-16", "mark"],
)
def test_content_that_the_dynamics_do_not_need_changes_nothing(
    content: str | bytes, path: Path, plain_torque: np.ndarray
) -> None:
    assert_array_equal(leg_of(path, content).gravity_torque(POSTURE), plain_torque)


def test_a_reversed_joint_is_found_next_to_a_transmission_of_its_name(
    path: Path, plain_torque: np.ndarray
) -> None:
    content = leg_text(more=TRANSMISSION).replace('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>')
    model = leg_of(path, content, knee="-knee")
    assert_allclose(model.gravity_torque(POSTURE), plain_torque, rtol=1e-12)
    assert model.position_limits(Side.RIGHT, JointName.KNEE) == (-2.0, 0.5)


def refused(path: Path, content: str | bytes, *parts: str, **joints: str) -> None:
    """Check that a leg is refused in one line with the file and some other words."""
    with pytest.raises(ModelError) as caught:
        leg_of(path, content, **joints)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    for part in (str(path), *parts):
        assert part in message


def test_a_link_with_two_parents_is_named_with_both_joints(path: Path) -> None:
    rod = LINK.format(name="rod", more="")
    joints = [
        JOINT.format(name=name, z=-0.1, parent=parent, child=child, axis=1, more="")
        for name, parent, child in (("pivot", "thigh", "rod"), ("end", "rod", "shank"))
    ]
    refused(path, leg_text(more=rod + "".join(joints)), "link 'shank'", "joint 'knee'", "joint 'end'")


@pytest.mark.parametrize(
    ("old", "new", "explained"),
    [
        ('<mass value="3"/>', '<mass value="0"/>', "no link of the legs has a mass"),
        (
            '<origin xyz="0 0 -0.4"/>',
            '<origin xyz="0 0 -40"/>',
            "'knee' is 40 m from 'hip'; expected 0.05 to 1 m",
        ),
        ('<origin xyz="0 0 -0.4"/>', '<origin xyz="0 0 -0.0004"/>', "'knee' is 0.0004 m from 'hip'"),
        (
            '<origin xyz="0 0 -0.2"/>',
            '<origin xyz="0 0 -20"/>',
            "joint 'hip' moves has its centre of mass 20 m",
        ),
        ('<mass value="3"/>', '<mass value="3000"/>', "a mass of 3000 kg; expected at most 100 kg"),
        ('ixx="0.03"', 'ixx="300"', "radius of gyration of at most 1 m"),
        ('izz="0.002"', 'izz="0.2"', "0.03, 0.03, 0.2 kg·m²; none is below 0, and none of a rigid body"),
        ('ixy="0"', 'ixy="0.05"', "-0.02, 0.002, 0.08 kg·m²; none is below 0"),
        ('ixx="0.03"', 'ixx="1e308"', "link 'pelvis': inertia ixx: expected at most 1e+06 in SI units"),
        (
            '<origin xyz="0 0 -0.4"/>',
            '<origin xyz="0 0 -1e200"/>',
            "joint 'knee': origin xyz: expected at most",
        ),
    ],
    ids=["massless", "cm", "mm", "lever", "mass", "inertia", "triangle", "indefinite", "overflow", "far"],
)
def test_a_leg_that_cannot_be_one_is_refused(old: str, new: str, explained: str, path: Path) -> None:
    assert old in leg_text()
    refused(path, leg_text().replace(old, new), explained)


def test_rounded_digits_of_a_drawing_program_are_accepted_as_inertia(path: Path) -> None:
    rod = leg_text().replace('izz="0.002"', 'izz="0"').replace('iyy="0.03"', 'iyy="0.0302"')
    assert leg_of(path, rod).total_mass == 9.0


def test_elements_nested_too_deeply_and_pointers_of_git_lfs_are_named(path: Path) -> None:
    refused(path, f'<robot name="r">{"<a>" * 50_000}{"</a>" * 50_000}</robot>', "nested too deeply")
    refused(
        path, "version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS pointer", "git lfs pull"
    )


MIMIC = '<mimic joint="{}" multiplier="{}" offset="0.1"/>'


def test_a_joint_of_a_leg_that_follows_another_one_is_refused(path: Path) -> None:
    refused(path, leg_text(knee=MIMIC.format("hip", 2)), "joint 'knee'", "mimics 'hip'", "remove its <mimic>")


def test_a_locked_joint_that_would_follow_the_leg_is_warned_of(path: Path) -> None:
    foot = LINK.format(name="foot", more="")
    ankle = JOINT.format(
        name="ankle", z=-0.4, parent="shank", child="foot", axis=-1, more=MIMIC.format("knee", 1)
    )
    with warns(UrdfWarning, "ankle", "knee"):
        leg_of(path, leg_text(more=foot + ankle))


def test_couplings_are_read_with_their_defaults_and_must_end_somewhere(path: Path) -> None:
    path.write_text(leg_text(knee='<mimic joint="hip"/>', more=TRANSMISSION))
    assert mimic_joints(path) == {"knee": Mimic("hip", 1.0, 0.0)}
    for hip, knee, explained in (
        (MIMIC.format("knee", 1), MIMIC.format("hip", 1), ("hip -> knee -> hip",)),
        ("", MIMIC.format("elbow", 1), ("knee", "elbow")),
        ("", MIMIC.format("hip", "two"), ("knee", "<mimic>", "two")),
    ):
        path.write_text(leg_text(hip=hip, knee=knee))
        with raises(ModelError, *explained):
            mimic_joints(path)


def test_friction_and_armature_of_the_file_are_named_as_unused(path: Path, plain_torque: np.ndarray) -> None:
    content = leg_text(hip='<dynamics armature="0.01"/>', knee='<dynamics damping="0" friction="0.0"/>')
    with warns(UrdfWarning, "hip", "0.01") as issued:
        model = leg_of(path, content)
    assert len(issued) == 1  # nothing is lost with the zeros of the knee
    assert_array_equal(model.gravity_torque(POSTURE), plain_torque)


def test_building_a_model_needs_no_plausible_leg(path: Path) -> None:
    path.write_text(leg_text().replace('<origin xyz="0 0 -0.4"/>', '<origin xyz="0 0 -40"/>'))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert build_model(path).nv == 2


def test_a_torque_limit_above_the_effort_limit_of_the_urdf_is_warned_of(tmp_path: Path) -> None:
    weaker = tmp_path / "weaker.urdf"
    text = packaged_urdf("twin_leg.urdf").read_text(encoding="utf-8")
    weaker.write_text(
        text.replace('effort="100" velocity="4.07"', 'effort="30" velocity="4.07"'), encoding="utf-8"
    )
    settings = [f"leg.urdf={weaker}", "control.limits.torque_Nm=40"]
    experiment = load_experiment("bench_leg", settings).experiment
    with warns(UrdfWarning, "right_knee", "30 N·m", "torque_Nm", "40"):
        experiment.build_world()
    lowered = load_experiment("bench_leg", [settings[0], "control.limits.torque_Nm=30"]).experiment
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lowered.build_world()
