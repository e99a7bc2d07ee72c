"""The kernel against Pinocchio: accelerations, gravity, mass matrix, points, on any model.

Pinocchio's ``aba``, ``rnea`` and ``crba`` are the reference, MuJoCo a second one on some of the same URDFs.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from example_robots import robot_urdf
from hypothesis import event, given, settings
from hypothesis import strategies as st

from twin_gait.core.contact import ContactState, Ground, ground_contact_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.kernels import generated as kernel
from twin_gait.leg_model.bodies import ContactPoint, export_bodies
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model

GRAVITY = 9.81
TOLERANCE = 1e-12
# Two algorithms differ by some ten roundings times the condition number; beyond this one the difference of
# their accelerations is not significant at 1e-12, and only the residual of the equation of motion counts.
WELL_CONDITIONED = 1e3
NO_GROUND = Ground()


class Kernel(NamedTuple):
    """Generated functions as plain Python, and the model that they are called with."""

    functions: dict[str, Callable[..., float]]
    bodies: np.ndarray
    rotors: np.ndarray
    n: int
    n_points: int

    def accelerations(self, q, v, torque):
        a = np.full(self.n, np.nan)
        points = [ContactState() for _ in range(self.n_points)]
        self.functions["dynamics"](q, v, torque, self.rotors, self.bodies, GRAVITY, NO_GROUND, a, points)
        return a

    def gravity(self, q):
        torque = np.full(self.n, np.nan)
        self.functions["control_gravity"](q, self.bodies, GRAVITY, torque)
        return torque

    def mass_matrix(self, q):
        """Column by column: torques of one acceleration alone."""
        columns = np.full((self.n, self.n), np.nan)
        for acceleration, column in zip(np.eye(self.n), columns, strict=True):
            self.functions["control_inertia"](q, acceleration, self.bodies, column)
        return columns.T

    def point_motion(self, q, v):
        """Forward and upward velocity and height of every point, under :func:`telling_law`."""
        points = [ContactState(np.nan, np.nan, np.nan) for _ in range(self.n_points)]
        self.functions["contact_forces"](q, v, self.bodies, NO_GROUND, points)
        return np.array([[point.forward, point.upward, point.height] for point in points])


def velocity_law(
    ground: Ground, stiffness: float, dissipation: float, height: float, forward: float, upward: float
) -> tuple[float, float]:
    """Return the velocities as forces, in place of a contact law."""
    return forward, upward


def source_of(bodies: list, points: tuple[ContactPoint, ...] = (), up_axis: str = "z") -> str:
    """Return the source of all functions of a kernel with a contact law and a law of motion."""
    shape = kernel.KernelBodies(bodies, points, bodies, up_axis)
    functions = [
        kernel.write_dynamics(shape),
        kernel.write_contact_forces(shape),
        kernel.write_control_gravity(bodies, up_axis),
        kernel.write_control_inertia(bodies),
    ]
    return "\n\n".join([*kernel.write_merged_functions("".join(functions)), *functions])


def kernel_of(model: pin.Model, points: tuple[ContactPoint, ...] = (), law=ground_contact_force) -> Kernel:
    bodies = export_bodies(model)
    functions = {"sine_cosine": sine_cosine, "ground_contact_force": law}
    exec(compile(source_of(bodies, points), "kernel", "exec"), functions)
    values, rotors = np.array(kernel.body_values(bodies, points)), np.array(model.armature)
    return Kernel(functions, values, rotors, len(bodies), len(points))


def assert_equal(found: np.ndarray, expected: np.ndarray) -> None:
    """Check that arrays are equal to 1e-12 of the largest entry."""
    assert np.abs(found - expected).max() <= TOLERANCE * np.abs(expected).max()


def condition(mass: np.ndarray) -> float:
    """Condition number of a mass matrix scaled to a unit diagonal: free of the units of the joints."""
    scale = 1.0 / np.sqrt(np.diag(mass))
    return float(np.linalg.cond(mass * np.outer(scale, scale)))


def check_dynamics(
    model: pin.Model, reference: pin.Model, rng: np.random.Generator, states: int = 1
) -> float:
    """Compare the kernel of a model with Pinocchio on a reference.

    It is the same model, but may describe a continuous joint by cosine and sine.

    Returns:
        The worst condition number of the mass matrix.
    """
    worst, data = 0.0, reference.createData()
    reference.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    made = kernel_of(model)
    for _ in range(states):
        q, v, torque = (rng.uniform(-1.5, 1.5, model.nv) for _ in range(3))
        configuration = configuration_of(reference, q)
        mass = np.array(pin.crba(reference, data, configuration))
        bias = np.array(pin.rnea(reference, data, configuration, v, np.zeros(model.nv)))
        gravity = np.array(pin.computeGeneralizedGravity(reference, data, configuration))
        accelerations = np.array(pin.aba(reference, data, configuration, v, torque))
        worst = max(worst, condition(mass))
        assert_equal(made.mass_matrix(q), mass)
        assert_equal(made.gravity(q), gravity)
        a = made.accelerations(q, v, torque)
        residual = np.abs(mass @ a + bias - torque)
        terms = np.abs(mass) @ np.abs(a) + np.abs(bias) + np.abs(torque)
        assert (residual <= TOLERANCE * terms).all()
        if condition(mass) <= WELL_CONDITIONED:
            assert_equal(a, accelerations)
    return worst


def configuration_of(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Pinocchio's coordinates of joint angles: cosine and sine for an unbounded joint."""
    values: list[float] = []
    for joint, angle in zip(list(model.joints)[1:], q, strict=True):
        values += [angle] if joint.nq == 1 else [math.cos(angle), math.sin(angle)]
    return np.array(values)


# ------------------------------------------------------------------ real robots

ROBOTS = {
    "double_pendulum_description/urdf/double_pendulum.urdf": 2,
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf": 2,
    "finger_edu_description/robots/finger_edu.urdf": 3,
    "iris_description/robots/iris.urdf": 4,
    "hextilt_description/urdf/hextilt_flying_arm_5.urdf": 5,
    "kinova_description/robots/kinova.urdf": 6,
    "so_arm_description/urdf/so101.urdf": 6,
    "ur_description/urdf/ur5_robot.urdf": 6,
    "xarm_description/urdf/xarm7.urdf": 7,
    "solo_description/robots/solo.urdf": 8,
    "panda_description/urdf/panda.urdf": 9,
    "hyq_description/robots/hyq_no_sensors.urdf": 12,
    "tiago_description/robots/tiago_no_hand.urdf": 12,
    "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf": 13,
    "allegro_hand_description/urdf/allegro_left_hand.urdf": 16,
    "anymal_b_simple_description/robots/anymal-kinova.urdf": 18,
    "baxter_description/urdf/baxter.urdf": 19,
    "alex_description/urdf/alex_sake_hands.urdf": 23,
    "g1_description/urdf/g1_29dof_rev_1_0.urdf": 29,
    "pr2_description/urdf/pr2.urdf": 30,
    "romeo_description/urdf/romeo_small.urdf": 31,
    "icub_description/robots/icub.urdf": 32,
    "talos_data/robots/talos_reduced.urdf": 32,
}
# A hip link without inertia of its own.
ILL_CONDITIONED = {"icub_description/robots/icub.urdf"}


@pytest.mark.parametrize(("name", "joints"), ROBOTS.items(), ids=[Path(item).stem for item in ROBOTS])
def test_kernels_of_real_robots_equal_pinocchio(name, joints, rng):
    path = robot_urdf(name)
    model = build_model(path)
    assert model.nv == joints
    worst = check_dynamics(model, pin.buildModelFromUrdf(str(path)), rng, states=3)
    assert (worst <= WELL_CONDITIONED) == (name not in ILL_CONDITIONED)


@pytest.mark.parametrize("fixture", ["twin", "worn_twin", "bench"])
def test_kernels_of_the_shipped_urdfs_equal_pinocchio(fixture, request, rng):
    model: LegModel = request.getfixturevalue(fixture)
    assert check_dynamics(model.model, model.model.copy(), rng, states=10) <= WELL_CONDITIONED


# ------------------------------------------------------------------ random trees


class RandomTree(NamedTuple):
    """A URDF of a random tree and the armature of its joints."""

    urdf: str
    armature: dict[str, float]


def random_rotation(rng: np.random.Generator) -> str:
    return " ".join(repr(float(angle)) for angle in rng.uniform(-3.0, 3.0, 3))


def random_vector(rng: np.random.Generator, size: float) -> str:
    return " ".join(repr(float(entry)) for entry in rng.uniform(-size, size, 3))


def random_link(name: str, rng: np.random.Generator) -> str:
    """A link with the inertia of a random box, in a random place and attitude."""
    mass, (x, y, z) = float(rng.uniform(0.2, 5.0)), rng.uniform(0.05, 0.4, 3) ** 2
    ixx, iyy, izz = (float(mass / 12.0 * term) for term in (y + z, x + z, x + y))
    return (
        f'<link name="{name}"><inertial>'
        f'<origin xyz="{random_vector(rng, 0.2)}" rpy="{random_rotation(rng)}"/><mass value="{mass!r}"/>'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )


def random_axis(rng: np.random.Generator) -> str:
    """A coordinate axis of either sign, or any direction."""
    if rng.random() < 0.4:
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    else:
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
    return " ".join(repr(float(entry)) for entry in axis)


def random_joint(kind: str, name: str, parent: str, child: str, rng: np.random.Generator) -> str:
    limit = (
        '<limit lower="-9" upper="9" effort="9" velocity="9"/>' if kind in ("revolute", "prismatic") else ""
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{random_vector(rng, 0.4)}" rpy="{random_rotation(rng)}"/>'
        f'<axis xyz="{random_axis(rng)}"/>{limit}</joint>'
    )


@st.composite
def random_trees(draw: st.DrawFn) -> RandomTree:
    """Trees of up to eight links on a fixed base: branching, of all four kinds of joint, one that moves."""
    kinds = draw(
        st.lists(
            st.sampled_from(["revolute", "prismatic", "continuous", "fixed"]), min_size=1, max_size=8
        ).filter(lambda kinds: set(kinds) != {"fixed"})
    )
    parents = [draw(st.integers(0, number)) for number in range(len(kinds))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts, armature = ['<link name="link0"/>'], {}
    for number, (kind, parent) in enumerate(zip(kinds, parents, strict=True), 1):
        parts.append(random_link(f"link{number}", rng))
        parts.append(random_joint(kind, f"joint{number}", f"link{parent}", f"link{number}", rng))
        if kind != "fixed":
            armature[f"joint{number}"] = float(rng.choice([0.0, rng.uniform(0.0, 2.0)]))
    return RandomTree(f'<robot name="tree">{"".join(parts)}</robot>', armature)


def models_of(tree: RandomTree) -> tuple[pin.Model, pin.Model]:
    """The tree as this package reads it and as Pinocchio does."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.urdf"
        path.write_text(tree.urdf)
        model = build_model(path)
    reference = pin.buildModelFromXML(tree.urdf)
    for item in (model, reference):
        item.armature = np.array([tree.armature[name] for name in list(item.names)[1:]])
    return model, reference


@given(tree=random_trees(), seed=st.integers(0, 2**32 - 1))
def test_kernels_of_any_tree_equal_pinocchio(tree, seed):
    model, reference = models_of(tree)
    worst = check_dynamics(model, reference, np.random.default_rng(seed))
    event("well conditioned" if worst <= WELL_CONDITIONED else "ill conditioned")


@settings(max_examples=25)
@given(tree=random_trees(), seed=st.integers(0, 2**32 - 1))
def test_a_model_with_unbounded_joints_is_exported_by_its_angles(tree, seed):
    _, reference = models_of(tree)
    check_dynamics(reference, reference, np.random.default_rng(seed))


@settings(max_examples=25)
@given(tree=random_trees(), seed=st.integers(0, 2**32 - 1))
def test_points_of_any_tree_move_as_in_pinocchio(tree, seed):
    model, reference = models_of(tree)
    data, rng = reference.createData(), np.random.default_rng(seed)
    positions = rng.uniform(-0.5, 0.5, (model.nv, 3))
    points = tuple(ContactPoint(body, position.tolist()) for body, position in enumerate(positions))
    q, v = rng.uniform(-1.5, 1.5, (2, model.nv))
    pin.forwardKinematics(reference, data, configuration_of(reference, q), v)
    expected = []
    for joint, position in enumerate(positions, 1):
        turned = data.oMi[joint].rotation @ position
        velocity = pin.getVelocity(reference, data, joint, pin.LOCAL_WORLD_ALIGNED)
        forward, _, upward = velocity.linear + np.cross(velocity.angular, turned)
        expected.append([forward, upward, (data.oMi[joint].translation + turned)[2]])
    assert_equal(kernel_of(model, points, velocity_law).point_motion(q, v), np.array(expected))


@settings(max_examples=25)
@given(tree=random_trees(), seed=st.integers(0, 2**32 - 1))
def test_accelerations_of_any_tree_equal_mujoco(tree, seed):
    mujoco = pytest.importorskip("mujoco", reason="mujoco is in the extra [test]")
    options = '<compiler fusestatic="false" balanceinertia="false" boundmass="0" boundinertia="0"/>'
    theirs = mujoco.MjModel.from_xml_string(
        tree.urdf.replace("</robot>", f"<mujoco>{options}</mujoco></robot>")
    )
    theirs.opt.gravity[:] = [0.0, 0.0, -GRAVITY]
    theirs.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for name, armature in tree.armature.items():
        theirs.dof_armature[theirs.joint(name).dofadr[0]] = armature
    model, _ = models_of(tree)
    order = [int(theirs.joint(name).dofadr[0]) for name in list(model.names)[1:]]
    q, v, torque = np.random.default_rng(seed).uniform(-1.5, 1.5, (3, model.nv))
    data = mujoco.MjData(theirs)
    data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, v, torque
    mujoco.mj_forward(theirs, data)
    # MuJoCo turns inertias to their principal axes, by an iteration that ends at 1e-12.
    np.testing.assert_allclose(
        kernel_of(model).accelerations(q, v, torque),
        data.qacc[order],
        atol=1e-9 * np.abs(data.qacc).max(),
        rtol=0.0,
    )
