"""The rigid-body model: physics by independent cross-checks, fitting to a wearer, and errors that help."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from errors import raises
from example_robots import twin_joints
from numpy.testing import assert_allclose
from twin_device import TWIN_SIZES

from twin_gait.exceptions import ModelError, ParameterError
from twin_gait.leg_model.anthropometry import device_sizes
from twin_gait.leg_model.joints import BodySelection, LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model, find_urdf, packaged_urdf, urdf_hash
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, PelvisGuide, Sex, Side

GRAVITY = 9.81

# Two rods of 0.4 m on y axes, hip flexion and knee flexion positive; masses of 3 and 2 kg.
PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <joint name="hip" type="{kind}">
    <parent link="base"/><child link="thigh"/><origin xyz="0 0.1 0"/><axis xyz="0 -1 0"/>
    <limit lower="-1" upper="2" effort="100" velocity="10"/>
  </joint>
  <link name="thigh"><inertial><mass value="3"/><origin xyz="0 0 -0.2"/>
    <inertia ixx="0.04" iyy="0.04" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="knee" type="{kind}">
    <parent link="thigh"/><child link="shank"/><origin xyz="0 0 {knee}"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="100" velocity="10"/>
  </joint>
  <link name="shank"><inertial><mass value="2"/><origin xyz="0 0 -0.2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="sole"/>
  <joint name="sole_fixed" type="fixed">
    <parent link="shank"/><child link="sole"/><origin xyz="0 0 -0.4"/>
  </joint>
</robot>"""
PENDULUM_LEG = {Side.RIGHT: LegJoints(hip="hip", knee="knee", contact_frames=("sole",))}


def pendulum(
    folder: Path, *, kind: str = "revolute", knee: float = -0.4, text: str | None = None, **options: Any
) -> LegModel:
    path = folder / "pendulum.urdf"
    path.write_text(text or PENDULUM.format(kind=kind, knee=knee))
    return LegModel(path, PENDULUM_LEG, **options)


@pytest.fixture(params=["bench", "twin", "worn_twin"])
def model(request: pytest.FixtureRequest) -> LegModel:
    return request.getfixturevalue(request.param)


def postures(model: LegModel, rng: np.random.Generator, count: int = 5) -> Iterator[tuple[np.ndarray, ...]]:
    for _ in range(count):
        yield (
            rng.uniform(-1.0, 1.5, model.nv),
            rng.uniform(-4.0, 4.0, model.nv),
            rng.uniform(-20.0, 20.0, model.nv),
        )


# ---------------------------------------------------------------------------------- masses


@pytest.mark.parametrize("pelvis", list(PelvisGuide))
def test_device_weighs_20_kg(both_legs: dict[Side, LegJoints], pelvis: PelvisGuide) -> None:
    """Table 2.1 of the thesis; how the pelvis is held does not change the mass of all links."""
    assert_allclose(LegModel("twin.urdf", both_legs, pelvis=pelvis).total_mass, 20.0, rtol=1e-12)


@pytest.mark.parametrize(("mass", "height", "sex"), [(70.0, 1.75, Sex.MALE), (52.5, 1.60, Sex.FEMALE)])
def test_device_and_wearer_weigh_their_sum(
    both_legs: dict[Side, LegJoints], mass: float, height: float, sex: Sex
) -> None:
    patient = Patient(mass=mass, height=height, sex=sex)
    model = LegModel("twin.urdf", both_legs, patient=patient, pelvis=PelvisGuide.VERTICAL)
    assert_allclose(model.total_mass, 20.0 + mass, rtol=1e-12)


def test_legs_of_the_device_are_the_same(twin: LegModel, rng: np.random.Generator) -> None:
    """Left and right at the same angles have the same gravity torques and inertias."""
    for _ in range(3):
        leg = rng.uniform(-1.0, 1.0, 3)
        q = np.concatenate([leg, leg])
        gravity, inertia = twin.gravity_torque(q), twin.mass_matrix(q)
        assert_allclose(gravity[:3], gravity[3:], rtol=1e-12)
        assert_allclose(inertia[:3, :3], inertia[3:, 3:], rtol=1e-12)


# ---------------------------------------------------------------------------------- dynamics


def test_mass_matrix_is_symmetric_and_positive_definite(model: LegModel, rng: np.random.Generator) -> None:
    for q, _, _ in postures(model, rng):
        inertia = model.mass_matrix(q)
        assert_allclose(inertia, inertia.T, rtol=0.0, atol=1e-12)
        assert np.linalg.eigvalsh(inertia).min() > 0.0


def test_forward_dynamics_inverts_inverse_dynamics(model: LegModel, rng: np.random.Generator) -> None:
    for q, v, a in postures(model, rng):
        tau = model.inverse_dynamics(q, v, a)
        assert_allclose(model.forward_dynamics(q, v, tau), a, rtol=1e-9, atol=1e-9)


def test_inverse_dynamics_is_inertia_plus_nonlinear_effects(
    model: LegModel, rng: np.random.Generator
) -> None:
    for q, v, a in postures(model, rng):
        expected = model.mass_matrix(q) @ a + model.nonlinear_effects(q, v)
        assert_allclose(model.inverse_dynamics(q, v, a), expected, rtol=1e-10, atol=1e-10)
        assert_allclose(model.inertia_torque(q, a), model.mass_matrix(q) @ a, rtol=1e-12)


def gradient(energy, q: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences of a function of the posture; errs by step² times the third derivative."""
    unit = np.eye(q.size)
    return np.array([(energy(q + step * e) - energy(q - step * e)) / (2.0 * step) for e in unit])


def test_gravity_torque_is_the_gradient_of_the_potential_energy(
    model: LegModel, rng: np.random.Generator
) -> None:
    for q, _, _ in postures(model, rng):
        assert_allclose(model.gravity_torque(q), gradient(model.potential_energy, q), rtol=1e-6, atol=1e-5)


def test_raising_the_leg_overhead_costs_weight_times_height(tmp_path: Path) -> None:
    """By hand: twice (3 kg · 0.2 m + 2 kg · 0.6 m) times g."""
    model = pendulum(tmp_path)
    work = model.potential_energy(np.array([math.pi, 0.0])) - model.potential_energy(np.zeros(2))
    assert_allclose(work, 3.6 * GRAVITY, rtol=1e-12)


def test_nonlinear_effects_match_lagrange_by_finite_differences(
    model: LegModel, rng: np.random.Generator
) -> None:
    """h = Ṁ v − ∂(½ vᵀ M v)/∂q + ∂U/∂q, all derivatives of energies by central differences."""
    for q, v, _ in postures(model, rng, 3):
        step = 1e-5
        rate = (model.mass_matrix(q + step * v) - model.mass_matrix(q - step * v)) / (2.0 * step)
        kinetic = gradient(lambda x, v=v: model.kinetic_energy(x, v), q)
        expected = rate @ v - kinetic + gradient(model.potential_energy, q)
        assert_allclose(model.nonlinear_effects(q, v), expected, rtol=1e-6, atol=1e-5)


def test_at_rest_only_gravity_is_left_of_the_nonlinear_effects(
    model: LegModel, rng: np.random.Generator
) -> None:
    for q, _, _ in postures(model, rng, 2):
        assert_allclose(model.nonlinear_effects(q, np.zeros(model.nv)), model.gravity_torque(q), atol=1e-12)


def test_power_of_the_torques_is_the_rate_of_the_energy(bench: LegModel) -> None:
    """d(T + U)/dt = τ·v, by a central difference along the motion."""
    q, v, tau = np.array([0.4, 0.9]), np.array([1.1, -2.0]), np.array([3.0, -1.0])
    a = bench.forward_dynamics(q, v, tau)

    def energy(time: float) -> float:
        x, y = q + time * v + 0.5 * time**2 * a, v + time * a
        return bench.kinetic_energy(x, y) + bench.potential_energy(x)

    h = 1e-4
    assert_allclose((energy(h) - energy(-h)) / (2.0 * h), tau @ v, rtol=1e-5)


def test_effective_inertia_relates_torque_to_acceleration_with_other_joints_held(
    model: LegModel, rng: np.random.Generator
) -> None:
    for q, _, _ in postures(model, rng, 2):
        for index in range(model.nv):
            unit = np.eye(model.nv)[index]
            at_rest = np.zeros(model.nv)
            held = model.inverse_dynamics(q, at_rest, unit) - model.inverse_dynamics(q, at_rest, at_rest)
            assert_allclose(model.effective_inertia(q, index), held[index], rtol=1e-10)


def test_straight_leg_swings_as_a_compound_pendulum(tmp_path: Path) -> None:
    """By hand: M_hh = 0.04 + 3·0.2² + 0.03 + 2·0.6² and g_h = (3·0.2 + 2·0.6) g sin θ."""
    model = pendulum(tmp_path)
    angle = 0.6
    q = np.array([angle, 0.0])
    assert_allclose(model.effective_inertia(q, 0), 0.04 + 0.12 + 0.03 + 0.72, rtol=1e-12)
    assert_allclose(model.effective_inertia(q, 1), 0.03 + 2.0 * 0.2**2, rtol=1e-12)
    assert_allclose(model.gravity_torque(q)[0], 1.8 * GRAVITY * math.sin(angle), rtol=1e-12)


def test_flexion_is_positive(tmp_path: Path) -> None:
    """Hip flexion brings the foot forward, knee flexion backward, both up."""
    model = pendulum(tmp_path)
    straight = model.frame_position(np.zeros(2), "sole")
    hip = model.frame_position(np.array([0.3, 0.0]), "sole")
    knee = model.frame_position(np.array([0.0, 0.3]), "sole")
    assert_allclose(straight, [0.0, 0.1, -0.8], atol=1e-15)
    assert_allclose(hip, [0.8 * math.sin(0.3), 0.1, -0.8 * math.cos(0.3)], atol=1e-12)
    assert_allclose(knee, [-0.4 * math.sin(0.3), 0.1, -0.4 - 0.4 * math.cos(0.3)], atol=1e-12)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    ("joint", "frame", "forward"), [("hip", "ankle", 1.0), ("knee", "ankle", -1.0), ("ankle", "toe", 0.0)]
)
def test_flexion_of_the_device_is_positive(
    twin: LegModel, side: Side, joint: str, frame: str, forward: float
) -> None:
    """Flexion and dorsiflexion lift what lies below the joint."""
    q = np.zeros(twin.nv)
    straight = twin.frame_position(q, f"{side}_{frame}")
    q[twin.index(side, JointName(joint))] = 0.3
    moved = twin.frame_position(q, f"{side}_{frame}") - straight
    assert moved[2] > 0.0
    assert forward * moved[0] >= 0.0


def test_gravity_is_a_parameter(tmp_path: Path) -> None:
    q = np.array([0.5, 0.8])
    earth, moon = pendulum(tmp_path).gravity_torque(q), pendulum(tmp_path, gravity=1.62).gravity_torque(q)
    assert_allclose(moon, earth * 1.62 / 9.81, rtol=1e-12)
    assert_allclose(pendulum(tmp_path, gravity=0.0).gravity_torque(q), 0.0, atol=1e-15)


def test_armature_acts_on_hip_and_knee_only(both_legs: dict[Side, LegJoints], twin: LegModel) -> None:
    """3.342 kg·m²: rotor 3.06e-4 and wave generator 0.282e-4 kg·m² through 100:1."""
    bare = LegModel("twin.urdf", both_legs)
    q = np.linspace(-0.4, 0.6, twin.nv)
    expected = np.zeros(twin.nv)
    for side in Side:
        for joint in (JointName.HIP, JointName.KNEE):
            expected[twin.index(side, joint)] = 3.342
    assert_allclose(twin.mass_matrix(q) - bare.mass_matrix(q), np.diag(expected), atol=1e-12)
    assert_allclose(twin.gravity_torque(q), bare.gravity_torque(q), rtol=1e-14)
    assert expected.sum() == pytest.approx(4 * 3.342)


def test_armature_slows_forward_dynamics(bench: LegModel, bench_leg: dict[Side, LegJoints]) -> None:
    bare = LegModel("twin_leg.urdf", bench_leg)
    q, v = np.array([0.2, 0.5]), np.zeros(2)
    tau = bare.gravity_torque(q) + np.array([0.0, 10.0])
    assert 0.0 < bench.forward_dynamics(q, v, tau)[1] < 0.1 * bare.forward_dynamics(q, v, tau)[1]


# ---------------------------------------------------------------------------------- indices


def test_indices_follow_the_joints(worn_twin: LegModel) -> None:
    assert worn_twin.pelvis_index == 0
    names = [f"{side}_{joint}" for side in Side for joint in JointName]
    indices = [worn_twin.index(side, joint) for side in Side for joint in JointName]
    assert [worn_twin.model.names[worn_twin.model.getJointId(name)] for name in names] == names
    assert sorted(indices) == list(range(1, 7))
    assert worn_twin.sides == (Side.LEFT, Side.RIGHT)


def test_fixed_pelvis_has_no_coordinate(twin: LegModel) -> None:
    assert twin.pelvis_index is None
    assert twin.nv == 6


def test_pelvis_carries_everything(worn_twin: LegModel) -> None:
    """Its coordinate is the height: gravity pulls with the whole weight, whatever the posture."""
    q = np.linspace(0.1, 0.7, worn_twin.nv)
    assert_allclose(worn_twin.gravity_torque(q)[0], 90.0 * GRAVITY, rtol=1e-12)
    assert_allclose(worn_twin.effective_inertia(q, 0), 90.0, rtol=1e-12)
    lifted = q.copy()
    lifted[0] += 0.25
    difference = worn_twin.frame_position(lifted, "left_heel") - worn_twin.frame_position(q, "left_heel")
    assert_allclose(difference, [0.0, 0.0, 0.25], atol=1e-12)


def test_limits_equal_the_limits_of_the_urdf(bench: LegModel, tmp_path: Path) -> None:
    model = pendulum(tmp_path)
    assert model.position_limits(Side.RIGHT, JointName.KNEE) == (-1.0, 2.0)
    lower, upper = bench.position_limits(Side.RIGHT, JointName.HIP)
    assert lower < 0.0 < upper


def test_joint_or_leg_that_is_not_there_is_named(bench: LegModel) -> None:
    with raises(ModelError, "right", "ankle"):
        bench.index(Side.RIGHT, JointName.ANKLE)
    with raises(ModelError, "left"):
        bench.index(Side.LEFT, JointName.HIP)


def test_words_select_pelvis_and_bodies(both_legs: dict[Side, LegJoints]) -> None:
    with raises(ValueError, "floating", "PelvisGuide"):
        LegModel("twin.urdf", both_legs, pelvis="floating")  # type: ignore[arg-type]
    words: Any = {"pelvis": "vertical", "bodies": "wearer"}
    wearer = LegModel("twin.urdf", both_legs, patient=Patient(), **words)
    assert wearer.pelvis is PelvisGuide.VERTICAL and wearer.total_mass == pytest.approx(70.0)


def test_unknown_frame_lists_the_frames(bench: LegModel) -> None:
    with raises(ModelError, "right_thigh"):
        bench.frame_position(np.zeros(2), "right_little_toe")


def test_equal_models_share_the_bodies_and_no_buffers(bench_leg: dict[Side, LegJoints]) -> None:
    wearer = Patient(mass=81.0)
    first, second = (LegModel("twin_leg.urdf", bench_leg, patient=wearer) for _ in range(2))
    assert first.model is second.model and first.data is not second.data
    heavier = LegModel("twin_leg.urdf", bench_leg, patient=replace(wearer, mass=82.0))
    assert heavier.total_mass > first.total_mass


def test_results_are_copies(bench: LegModel) -> None:
    q = np.array([0.3, 0.4])
    first = bench.gravity_torque(q), bench.mass_matrix(q), bench.forward_dynamics(q, q, q)
    kept = [item.copy() for item in first]
    bench.gravity_torque(2 * q), bench.mass_matrix(2 * q), bench.forward_dynamics(2 * q, q, q)
    for item, copy in zip(first, kept, strict=True):
        assert np.array_equal(item, copy)


# ---------------------------------------------------------------------------------- fitting


def hip_to_knee(model: LegModel, side: Side) -> float:
    return float(
        np.linalg.norm(model.model.jointPlacements[model.model.getJointId(f"{side}_knee")].translation)
    )


@pytest.mark.parametrize("height", [1.50, 1.62, 1.75, 1.88, 1.95])
def test_fitting_moves_knees_ankles_and_hips(both_legs: dict[Side, LegJoints], height: float) -> None:
    patient = Patient(height=height)
    model = LegModel("twin.urdf", both_legs, patient=patient, manufactured=TWIN_SIZES)
    sizes = device_sizes(patient, TWIN_SIZES)
    assert model.sizes == sizes
    q = np.zeros(model.nv)
    for side in Side:
        hip, knee, ankle, heel, toe = (
            model.frame_position(q, f"{side}_{name}") for name in ("hip", "knee", "ankle", "heel", "toe")
        )
        assert_allclose(np.linalg.norm(knee - hip), sizes.femur, rtol=1e-12)
        assert_allclose(np.linalg.norm(ankle - knee), sizes.tibia, rtol=1e-12)
        assert_allclose(abs(hip[1]), sizes.waist / 2.0, rtol=1e-12)
        # Shares of the height: 0.05, 0.17 and 0.08 m of 1.75 m.
        assert_allclose(heel - ankle, height * np.array([-1.0, 0.0, -1.6]) / 35.0, atol=1e-12)
        assert_allclose(toe - ankle, height * np.array([3.4, 0.0, -1.6]) / 35.0, atol=1e-12)
    left, right = (model.frame_position(q, f"{side}_hip") for side in Side)
    assert left[1] > 0.0 > right[1]


def test_feet_as_they_are_drawn_fit_a_wearer_of_175_cm_to_the_bit(
    both_legs: dict[Side, LegJoints], twin: LegModel
) -> None:
    model = LegModel("twin.urdf", both_legs, patient=Patient(height=1.75), bodies=BodySelection.DEVICE).model
    for leg in both_legs.values():
        for name in leg.contact_frames:
            drawn, fitted = (item.frames[item.getFrameId(name)].placement for item in (twin.model, model))
            assert np.array_equal(fitted.translation, drawn.translation)
        foot = model.getJointId(leg.ankle)
        assert model.inertias[foot] == twin.model.inertias[foot]


@pytest.mark.parametrize("share", [0.77, 0.74])
def test_distance_of_heel_and_forefoot_is_a_share_of_the_foot(
    both_legs: dict[Side, LegJoints], share: float
) -> None:
    """A foot has 0.152 of the height (Winter); only the forefoot moves, on the level line from the heel."""
    patient = Patient(height=1.6)
    drawn = LegModel("twin.urdf", both_legs, patient=patient)
    model = LegModel("twin.urdf", both_legs, patient=patient, heel_to_forefoot=share)
    for leg in both_legs.values():
        heel, toe = (model.frame_position(np.zeros(model.nv), name) for name in leg.contact_frames)
        assert_allclose(toe - heel, [share * 0.152 * 1.6, 0.0, 0.0], atol=1e-15)
        assert np.array_equal(heel, drawn.frame_position(np.zeros(model.nv), leg.contact_frames[0]))
    assert all(
        ours == theirs for ours, theirs in zip(model.model.inertias, drawn.model.inertias, strict=True)
    )


def test_plate_of_a_longer_foot_has_its_mass_farther_out(both_legs: dict[Side, LegJoints]) -> None:
    """0.6 kg, centre 0.05 m ahead of the ankle and 0.065 m below, 0.0034 kg·m² about it, at 1.75 m."""
    model = LegModel("twin.urdf", both_legs, patient=Patient(height=1.925), bodies=BodySelection.DEVICE).model
    plate = model.inertias[model.getJointId("left_ankle")]
    assert plate.mass == 0.6
    assert_allclose(plate.lever, [0.055, 0.0, -0.0715], rtol=1e-12)
    assert_allclose(plate.inertia[1, 1], 1.21 * 0.0034, rtol=1e-12)


def test_without_fitting_the_urdf_stays_as_it_is(both_legs: dict[Side, LegJoints], twin: LegModel) -> None:
    model = LegModel("twin.urdf", both_legs, patient=Patient(height=1.5), fit_device=False)
    assert model.sizes is None
    assert hip_to_knee(model, Side.LEFT) == hip_to_knee(twin, Side.LEFT)


def test_fitting_keeps_the_mass_of_the_device_and_stretches_its_inertia(
    bench_leg: dict[Side, LegJoints],
) -> None:
    """A rod of the same mass and other length: centre of mass ∝ L, inertia about it ∝ L²."""
    patient = Patient(height=1.50)
    fitted = LegModel("twin_leg.urdf", bench_leg, patient=patient, manufactured=TWIN_SIZES)
    worn = LegModel("twin_leg.urdf", bench_leg, patient=patient, fit_device=False)
    assert_allclose(fitted.total_mass, worn.total_mass, rtol=1e-12)
    ratio = hip_to_knee(fitted, Side.RIGHT) / hip_to_knee(worn, Side.RIGHT)
    assert ratio < 0.95
    hip = fitted.model.getJointId("right_hip")
    assert_allclose(fitted.model.inertias[hip].lever, ratio * worn.model.inertias[hip].lever, rtol=1e-12)
    assert_allclose(
        fitted.model.inertias[hip].inertia[1, 1],
        ratio**2 * worn.model.inertias[hip].inertia[1, 1],
        rtol=1e-12,
    )


def test_wearer_adds_the_gravity_torque_of_the_segments(bench_leg: dict[Side, LegJoints]) -> None:
    """Thigh, shank of de Leva (1996) for 70 kg, male, hung from the joints of the unfitted leg.

    The bench leg has no foot: shank 0.246 H long, 1.75 m; hip and knee straight at 30° of flexion.
    """
    model, bare = (
        LegModel("twin_leg.urdf", bench_leg, patient=patient, fit_device=False)
        for patient in (Patient(mass=70.0, height=1.75), None)
    )
    q = np.array([math.radians(30.0), 0.0])
    femur = hip_to_knee(bare, Side.RIGHT)
    thigh, shank = 0.1416 * 70.0, 0.0433 * 70.0
    shank_arm = 0.4395 * 0.246 * 1.75
    moment = thigh * 0.4095 * femur + shank * (femur + shank_arm)
    added = model.gravity_torque(q) - bare.gravity_torque(q)
    assert_allclose(added[0], GRAVITY * moment * math.sin(q[0]), rtol=1e-9)
    # Knee flexion bends the other way: at a hip flexion of 30° gravity flexes the knee.
    assert_allclose(added[1], -GRAVITY * shank * shank_arm * math.sin(q[0]), rtol=1e-9)


def test_wearer_adds_the_inertia_of_the_segments(bench_leg: dict[Side, LegJoints]) -> None:
    """About the knee: m (r² + c²) L² with the radius of gyration and centre of mass of the shank."""
    worn, bare = (
        LegModel("twin_leg.urdf", bench_leg, patient=patient, fit_device=False)
        for patient in (Patient(mass=70.0, height=1.75), None)
    )
    q = np.array([0.2, 0.3])
    added = worn.effective_inertia(q, 1) - bare.effective_inertia(q, 1)
    assert_allclose(added, 0.0433 * 70.0 * (0.246**2 + 0.4395**2) * (0.246 * 1.75) ** 2, rtol=1e-9)


def test_heavier_wearer_has_a_heavier_leg_everywhere(both_legs: dict[Side, LegJoints]) -> None:
    light, heavy = (LegModel("twin.urdf", both_legs, patient=Patient(mass=mass)) for mass in (60.0, 90.0))
    q = np.full(6, 0.3)
    assert np.all(np.diag(heavy.mass_matrix(q)) > np.diag(light.mass_matrix(q)))


def test_wearer_that_the_device_cannot_fit_is_refused(both_legs: dict[Side, LegJoints]) -> None:
    with raises(ParameterError, "height", "tibia", "0.36", "0.48 m", "2.05"):
        LegModel("twin.urdf", both_legs, patient=Patient(height=2.05), manufactured=TWIN_SIZES)


# ---------------------------------------------------------------------------------- any URDF


def test_continuous_joints_become_angles(tmp_path: Path, rng: np.random.Generator) -> None:
    """Pinocchio gives a continuous joint two coordinates; here each joint is one angle."""
    turning, bounded = pendulum(tmp_path, kind="continuous"), pendulum(tmp_path)
    assert turning.nv == turning.model.nq == 2
    for q, v, tau in postures(bounded, rng, 3):
        assert_allclose(turning.forward_dynamics(q, v, tau), bounded.forward_dynamics(q, v, tau), rtol=1e-12)
    lower, upper = turning.position_limits(Side.RIGHT, JointName.HIP)
    assert lower < -2.0 * math.pi < 2.0 * math.pi < upper


def test_continuous_joint_without_a_limit_element_is_read(tmp_path: Path) -> None:
    text = PENDULUM.format(kind="continuous", knee=-0.4)
    text = text.replace('<limit lower="-1" upper="2" effort="100" velocity="10"/>', "")
    assert pendulum(tmp_path, text=text).nv == 2


def test_unrequested_joints_are_locked_at_zero(both_legs: dict[Side, LegJoints], twin: LegModel) -> None:
    """One leg without its ankle out of the whole device: the rest hangs stiffly."""
    one = LegModel("twin.urdf", {Side.RIGHT: twin_joints(Side.RIGHT, foot=False)})
    assert one.nv == 2
    q = np.zeros(6)
    hip, knee = (twin.index(Side.RIGHT, joint) for joint in (JointName.HIP, JointName.KNEE))
    q[hip], q[knee] = 0.4, 0.7
    assert_allclose(one.gravity_torque(np.array([0.4, 0.7])), twin.gravity_torque(q)[[hip, knee]], rtol=1e-12)
    bare = LegModel("twin.urdf", both_legs)
    expected = bare.mass_matrix(q)[np.ix_([hip, knee], [hip, knee])]
    assert_allclose(one.mass_matrix(np.array([0.4, 0.7])), expected, rtol=1e-12)


def test_model_with_vertical_y_has_the_same_gravity(tmp_path: Path) -> None:
    """The pendulum with its axes renamed x→x, z→y, y→−z."""
    turned = PENDULUM.format(kind="revolute", knee=-0.4)
    for old, new in (
        ('origin xyz="0 0.1 0"', 'origin xyz="0 0 -0.1"'),
        ('origin xyz="0 0 -0.4"', 'origin xyz="0 -0.4 0"'),
        ('origin xyz="0 0 -0.2"', 'origin xyz="0 -0.2 0"'),
        ('axis xyz="0 -1 0"', 'axis xyz="0 0 1"'),
        ('axis xyz="0 1 0"', 'axis xyz="0 0 -1"'),
        ('iyy="0.04" izz="0.001"', 'iyy="0.001" izz="0.04"'),
        ('iyy="0.03" izz="0.001"', 'iyy="0.001" izz="0.03"'),
    ):
        assert old in turned
        turned = turned.replace(old, new)
    upright = pendulum(tmp_path, patient=Patient(), pelvis=PelvisGuide.VERTICAL)
    model = pendulum(tmp_path, text=turned, patient=Patient(), pelvis=PelvisGuide.VERTICAL, up_axis="y")
    assert model.sizes == upright.sizes
    q, v, tau = np.array([0.3, 0.4, 0.9]), np.array([0.1, -1.0, 2.0]), np.array([100.0, 5.0, -3.0])
    assert_allclose(model.forward_dynamics(q, v, tau), upright.forward_dynamics(q, v, tau), rtol=1e-10)


def refused(path: Path | str, *parts: str, legs: dict[Side, LegJoints] | None = None, **options: Any) -> None:
    with pytest.raises(ModelError) as caught:
        LegModel(path, legs or PENDULUM_LEG, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    for part in (str(path), *parts):
        assert part in message


def test_missing_file_is_named_with_the_packaged_ones(tmp_path: Path) -> None:
    refused(tmp_path / "nowhere.urdf", "no such URDF", "twin.urdf")
    refused(tmp_path, "no such URDF")


@pytest.mark.parametrize(
    ("content", "explained"),
    [
        (b"", "not a URDF"),
        (b"<robot name='a'>", "not a URDF"),
        (b"just text", "not a URDF"),
        (b"\xff\xfe\x81", "not a URDF"),
        (b"<sdf/>", "<sdf>"),
        (b"<robot/>", "Pinocchio cannot build"),
        (b"<robot name='a'><link name='b'/></robot>", "no joints"),
    ],
    ids=["empty", "cut off", "text", "binary", "other XML", "no link", "no joint"],
)
def test_file_without_a_robot_is_refused(content: bytes, explained: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.urdf"
    path.write_bytes(content)
    refused(path, explained)


MISFITS = {
    "joint": (
        '<joint name="knee"',
        '<joint name="elbow"',
        "no joint 'knee' for the right knee; the file has hip",
    ),
    "link": ('<link name="sole"/>', '<link name="tip"/>', "child link [sole] of joint"),
    "child": ('<child link="thigh"/>', "", "missing a parent and/or child link"),
    "no limit": (
        '<limit lower="-1" upper="2" effort="100" velocity="10"/>',
        "",
        "Joint [hip] is of type REVOLUTE but it does not specify limits",
    ),
    "limit in words": ('lower="-1"', 'lower="low"', "lower value (low) is not a valid float"),
    "limits": ('lower="-1" upper="2"', 'lower="2" upper="-1"', "can turn from 2 to -1 rad; expected lower"),
    "degrees": (
        'lower="-1" upper="2"',
        'lower="-4" upper="120"',
        "can turn by 120 rad; expected radians in its <limit>, and the type",
    ),
    "no range": ('lower="-1" upper="2" ', "", "can turn from 0 to 0 rad; expected lower"),
    "kind": ('type="revolute"', 'type="hinge"', "has no known type [hinge]"),
    "no mass": ('<mass value="3"/>', "", "Inertial element must have a mass element"),
    "half an inertia": ('ixx="0.04"', "", "inertia element missing ixx attribute"),
    "floating": ('type="revolute"', 'type="floating"', "one"),
    "planar": ('type="revolute"', 'type="planar"', "one"),
    "sliding": ('type="revolute"', 'type="prismatic"', "revolute"),
    "negative mass": ('<mass value="3"/>', '<mass value="-3"/>', "mass"),
    "undefined mass": ('<mass value="3"/>', '<mass value="nan"/>', "Inertial: mass [nan] is not a float"),
    "mass with a unit": ('<mass value="3"/>', '<mass value="3kg"/>', "Inertial: mass [3kg] is not a float"),
    "inertia in words": ('ixx="0.04"', 'ixx="small"', "inertia"),
    "negative inertia": ('ixx="0.04"', 'ixx="-0.04"', "inertia"),
    "axis": ('<axis xyz="0 -1 0"/>', '<axis xyz="0 0 0"/>', "joint 'hip' has an axis of zeros"),
    "half an axis": ('<axis xyz="0 -1 0"/>', '<axis xyz="0 -1"/>', "Malformed axis element for joint [hip]"),
    "axis that is no number": ('<axis xyz="0 -1 0"/>', '<axis xyz="0 nan 0"/>', "Malformed axis element"),
}


@pytest.mark.parametrize(("old", "new", "explained"), MISFITS.values(), ids=list(MISFITS))
def test_model_that_the_laws_do_not_fit_is_refused(
    old: str, new: str, explained: str, tmp_path: Path
) -> None:
    """The URDF parser itself drops a mass that it cannot read, and the link weighs nothing."""
    text = PENDULUM.format(kind="revolute", knee=-0.4)
    assert old in text
    path = tmp_path / "pendulum.urdf"
    path.write_text(text.replace(old, new, 1))
    refused(path, explained)


def test_contact_frame_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM.format(kind="revolute", knee=-0.4))
    legs = {Side.RIGHT: LegJoints(hip="hip", knee="knee", contact_frames=("heel",))}
    refused(path, "no frame 'heel' for the right foot", "sole", legs=legs)


CHAINS = {
    "a joint twice": ({"knee": "left_hip"}, "joint 'left_hip' is both left hip and left knee"),
    "a leg upside down": (
        {"hip": "left_knee", "knee": "left_hip"},
        "joint 'left_hip' of the left knee is not below 'left_knee'; the joints above it are left_hip",
    ),
    "the other leg's": (
        {"knee": "right_knee"},
        "below 'left_hip'; the joints above it are right_hip, ",
    ),
    "the other foot": (
        {"contact_frames": ("left_heel", "right_toe")},
        "frame 'right_toe' of the left foot is not below 'left_ankle'",
    ),
}


@pytest.mark.parametrize(("names", "explained"), CHAINS.values(), ids=list(CHAINS))
def test_legs_with_disconnected_parts_are_refused(names: dict[str, Any], explained: str) -> None:
    refused("twin.urdf", explained, legs={Side.LEFT: replace(twin_joints(Side.LEFT), **names)})


def test_joints_that_coincide_cannot_carry_a_segment(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM.format(kind="revolute", knee=0.0))
    refused(path, "joint 'knee' and the one above it coincide", patient=Patient())


def test_wrong_options_are_refused(tmp_path: Path) -> None:
    with raises(ParameterError, "up_axis", "y", "z", "x"):
        pendulum(tmp_path, up_axis="x")
    with raises(ParameterError, "gravity", "nan"):
        pendulum(tmp_path, gravity=math.nan)
    with raises(ParameterError, "legs", "leg", "{}"):
        LegModel("twin.urdf", {})


def test_packaged_urdfs_are_found_by_name() -> None:
    for name in ("twin.urdf", "twin_leg.urdf", "twin_ankle.urdf"):
        assert packaged_urdf(name).is_file()
        assert find_urdf(name) == packaged_urdf(name)
    with raises(ModelError, "twin.urdf", "twin_leg.urdf"):
        packaged_urdf("nao.urdf")


def test_hash_distinguishes_edited_urdfs(tmp_path: Path, bench: LegModel) -> None:
    copy = tmp_path / "copy.urdf"
    copy.write_bytes(packaged_urdf("twin_leg.urdf").read_bytes())
    assert urdf_hash(copy) == urdf_hash(bench.urdf_path)
    copy.write_bytes(copy.read_bytes() + b"\n")
    assert urdf_hash(copy) != urdf_hash(bench.urdf_path)


# ---------------------------------------------------------------------------------- second subject


def test_axis_of_a_joint_that_does_not_move_may_be_zero(tmp_path: Path) -> None:
    """Real URDFs, Talos for one, write ``0 0 0`` for fixed joints."""
    text = """<robot name="r"><link name="a"/><link name="b"/>
    <joint name="weld" type="fixed"><parent link="a"/><child link="b"/><axis xyz="0 0 0"/></joint></robot>"""
    path = tmp_path / "weld.urdf"
    path.write_text(text)
    assert build_model(path).njoints == 1


def test_inertia_that_is_zero_but_for_rounding_is_accepted(tmp_path: Path) -> None:
    """The iCub's hip has ``ixx="-5.42101e-20"``."""
    text = """<robot name="r"><link name="a"><inertial><mass value="1"/>
    <inertia ixx="-5.4e-20" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link></robot>"""
    path = tmp_path / "hip.urdf"
    path.write_text(text)
    assert build_model(path).njoints == 1


def human_urdf() -> Path:
    """The human model of example-robot-data; the package holds data only."""
    try:
        recorded = files("example-robot-data") or []
    except PackageNotFoundError:
        pytest.skip("example-robot-data (400 MB) is not installed: pip install 'twin-gait[robots]'")
    for item in recorded:
        if item.parts[-3:] == ("human_description", "robots", "human.urdf"):
            return Path(str(item.locate()))
    pytest.skip("this version of example-robot-data has no human_description/robots/human.urdf")


@pytest.fixture
def human() -> LegModel:
    """Hip and knee of a whole human model (ISB axes, y upwards) with all other joints locked."""
    legs = {side: LegJoints(hip=f"{side}_hip_Z", knee=f"{side}_knee_Z") for side in Side}
    return LegModel(human_urdf(), legs, up_axis="y")


def test_human_model_is_a_second_subject(human: LegModel, rng: np.random.Generator) -> None:
    assert human.nv == 4
    for q, v, a in postures(human, rng, 3):
        assert np.linalg.eigvalsh(human.mass_matrix(q)).min() > 0.0
        tau = human.inverse_dynamics(q, v, a)
        assert_allclose(human.forward_dynamics(q, v, tau), a, rtol=1e-9, atol=1e-9)
        assert_allclose(human.gravity_torque(q), gradient(human.potential_energy, q), rtol=1e-6, atol=1e-5)


def test_human_model_flexes_in_the_positive_direction(human: LegModel) -> None:
    """Forward is x, up is y; the knee lies 0.439 m below the hip in that file."""
    for side in Side:
        hip, knee = (human.index(side, joint) for joint in (JointName.HIP, JointName.KNEE))
        flexed = np.zeros(4)
        flexed[hip] = 0.5
        foot = f"{side}_foot"
        straight = human.frame_position(np.zeros(4), foot)
        moved = human.frame_position(flexed, foot) - straight
        assert moved[0] > 0.0
        assert moved[1] > 0.0
        assert human.gravity_torque(flexed)[hip] > 0.0  # gravity extends a flexed hip
        flexed[hip], flexed[knee] = 0.0, 0.5
        moved = human.frame_position(flexed, foot) - straight
        assert moved[0] < 0.0
        assert moved[1] > 0.0
        assert_allclose(
            human.frame_position(np.zeros(4), f"{side}_hip_Z")[1]
            - human.frame_position(np.zeros(4), f"{side}_knee_Z")[1],
            0.439,
            atol=1e-12,
        )
