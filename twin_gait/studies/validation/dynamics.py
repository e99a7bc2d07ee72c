"""Checks of the rigid-body dynamics: MuJoCo, a double pendulum on paper, and the generated kernel."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from twin_gait.configuration import load_experiment
from twin_gait.core.contact import ground_contact_force
from twin_gait.experiment import Experiment
from twin_gait.leg_model import LegModel, packaged_urdf
from twin_gait.leg_model.bodies import contact_points, export_bodies
from twin_gait.simulation.kernel import body_values, write_dynamics
from twin_gait.studies.validation.check import CheckPlan, Finding
from twin_gait.studies.validation.mujoco_witness import WitnessDynamics, witness_model
from twin_gait.vocabulary import JointName

N_STATES = 100
SEED = 20240607
SUBJECTS = {"twin": "treadmill", "bench": "bench_leg"}  # name of the checks: preset
QUANTITIES = ("mass_matrix", "bias", "acceleration")


class State(NamedTuple):
    """A random state.

    Attributes:
        q: Coordinates in [rad] or [m].
        v: Velocities.
        torque: On the coordinates in [N m] or [N].
    """

    q: np.ndarray
    v: np.ndarray
    torque: np.ndarray


def random_states(n: int) -> Iterator[State]:
    """States that cover the range of a leg, the same at every call.

    Args:
        n: Number of coordinates.

    Yields:
        States.
    """
    generator = np.random.default_rng(SEED)
    for _ in range(N_STATES):
        yield State(
            q=generator.uniform(-1.0, 1.5, n),
            v=generator.uniform(-4.0, 4.0, n),
            torque=generator.uniform(-40.0, 40.0, n),
        )


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest magnitude that is expected."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _model(preset: str) -> tuple[Experiment, LegModel]:
    experiment = load_experiment(preset).experiment
    return experiment, experiment.build_world().model


# ---------------------------------------------------------------------- MuJoCo


def mujoco_error(subject: str, quantity: str) -> Finding:
    """Difference of one quantity of the dynamics from MuJoCo's, over random states.

    Args:
        subject: Key of ``SUBJECTS``.
        quantity: One of ``QUANTITIES``.

    Returns:
        The largest relative error.

    Raises:
        MissingOptionalDependency: If MuJoCo is not installed.
    """
    experiment, model = _model(SUBJECTS[subject])
    witness = WitnessDynamics(witness_model(experiment, model), model)
    number = QUANTITIES.index(quantity)
    errors = []
    for q, v, torque in random_states(model.nv):
        ours = (
            model.mass_matrix(q),
            model.nonlinear_effects(q, v),
            model.forward_dynamics(q, v, torque),
        )
        errors.append(relative_error(ours[number], witness.at(q, v, torque)[number]))
    return Finding(max(errors), f"{_described(experiment, model)}, {N_STATES} states")


def _described(experiment: Experiment, model: LegModel) -> str:
    patient = experiment.patient
    worn = f"worn by {patient.mass:g} kg, {patient.height:g} m" if patient is not None else "not worn"
    return f"{model.urdf_path.name} {worn}"


# ---------------------------------------------------------------------- closed form


class Pendulum(NamedTuple):
    """Two links in a vertical plane.

    Attributes:
        thigh_inertia: Of the thigh, and of the shank as a point at the knee, about the hip in [kg m²].
        shank_inertia: Of the shank about the knee in [kg m²].
        coupling: Mass of the shank times distance of its centre from the knee times thigh length.
        thigh_moment: First moment of the thigh, and of the shank as a point at the knee, in [kg m].
        shank_moment: First moment of the shank about the knee in [kg m].
        armature: Of hip and knee drive in [kg m²], shape ``(2,)``.
        gravity: In [m] / [s²].
    """

    thigh_inertia: float
    shank_inertia: float
    coupling: float
    thigh_moment: float
    shank_moment: float
    armature: np.ndarray
    gravity: float


def pendulum_of(experiment: Experiment) -> Pendulum:
    """Read the bench leg as a double pendulum, straight from its URDF.

    Args:
        experiment: On the bench leg, without a wearer.

    Returns:
        Its constants.
    """
    root = ElementTree.parse(packaged_urdf("twin_leg.urdf")).getroot()
    (m1, c1, i1), (m2, c2, i2) = (_link(root, name) for name in ("right_thigh", "right_shank"))
    length = -_third(root, "joint[@name='right_knee']/origin")
    return Pendulum(
        thigh_inertia=i1 + m1 * c1 * c1 + m2 * length * length,
        shank_inertia=i2 + m2 * c2 * c2,
        coupling=m2 * c2 * length,
        thigh_moment=m1 * c1 + m2 * length,
        shank_moment=m2 * c2,
        armature=np.array(
            [experiment.plant.actuators[joint].armature for joint in (JointName.HIP, JointName.KNEE)]
        ),
        gravity=experiment.plant.gravity,
    )


def _link(root: ElementTree.Element, name: str) -> tuple[float, float, float]:
    """Mass, distance of the centre below the joint, and inertia about the lateral axis."""
    inertial = f"link[@name='{name}']/inertial"
    mass, inertia = root.find(f"{inertial}/mass"), root.find(f"{inertial}/inertia")
    assert mass is not None and inertia is not None  # our own file
    return float(mass.attrib["value"]), -_third(root, f"{inertial}/origin"), float(inertia.attrib["iyy"])


def _third(root: ElementTree.Element, path: str) -> float:
    element = root.find(path)
    assert element is not None  # our own file
    return float(element.attrib["xyz"].split()[2])


def pendulum_acceleration(pendulum: Pendulum, state: State) -> np.ndarray:
    r"""Acceleration of a double pendulum from Lagrange's equations, written out by hand.

    With hip flexion :math:`\theta_1` and knee flexion :math:`\theta_2` positive, thigh and shank stand
    at :math:`\theta_1` and :math:`\theta_1 - \theta_2` from the vertical.

    Args:
        pendulum: The constants.
        state: Hip and knee.

    Returns:
        Hip and knee in [rad] / [s²], shape ``(2,)``.
    """
    (hip, knee), (hip_rate, knee_rate) = state.q.tolist(), state.v.tolist()
    h = pendulum.coupling * math.cos(knee)
    k = pendulum.coupling * math.sin(knee)
    m11 = pendulum.thigh_inertia + pendulum.shank_inertia + 2.0 * h + pendulum.armature[0]
    m12 = -pendulum.shank_inertia - h
    m22 = pendulum.shank_inertia + pendulum.armature[1]
    shank = pendulum.gravity * pendulum.shank_moment * math.sin(hip - knee)
    thigh = pendulum.gravity * pendulum.thigh_moment * math.sin(hip)
    r1 = state.torque[0] + k * knee_rate * (2.0 * hip_rate - knee_rate) - thigh - shank
    r2 = state.torque[1] - k * hip_rate * hip_rate + shank
    determinant = m11 * m22 - m12 * m12
    return np.asarray(np.array([m22 * r1 - m12 * r2, m11 * r2 - m12 * r1]) / determinant)


def pendulum_error() -> Finding:
    """Difference of the bench leg's accelerations from those of the double pendulum."""
    experiment, model = _model(SUBJECTS["bench"])
    pendulum = pendulum_of(experiment)
    errors = [
        relative_error(model.forward_dynamics(*state), pendulum_acceleration(pendulum, state))
        for state in random_states(model.nv)
    ]
    return Finding(max(errors), f"accelerations of the bench leg, {N_STATES} states")


# ---------------------------------------------------------------------- the generated kernel


def kernel_error(subject: str) -> Finding:
    """Difference of the generated kernel's accelerations from Pinocchio's articulated-body algorithm.

    Args:
        subject: Key of ``SUBJECTS``.

    Returns:
        The largest relative error.
    """
    experiment, model = _model(SUBJECTS[subject])
    frames = [name for leg in model.legs.values() for name in leg.contact_frames]
    bodies, points = export_bodies(model.model), contact_points(model.model, frames)
    dynamics = _kernel_function(write_dynamics(bodies, points, model.up_axis), "dynamics")
    values, no_ground = np.array(body_values(bodies, points)), np.zeros(5)
    found, room = np.zeros(model.nv), np.zeros((max(len(points), 1), 3))
    errors = []
    for state in random_states(model.nv):
        dynamics(*state, values, experiment.plant.gravity, no_ground, found, room)
        errors.append(relative_error(found, model.forward_dynamics(*state)))
    return Finding(max(errors), f"{_described(experiment, model)}, {N_STATES} states")


def _kernel_function(source: str, name: str) -> Callable[..., Any]:
    """A function of a kernel as plain Python, the text that the compiled engine compiles."""
    names: dict[str, Any] = {"math": math, "ground_contact_force": ground_contact_force}
    exec(compile(source, "kernel", "exec"), names)
    function: Callable[..., Any] = names[name]
    return function


# Rounding of 2e-16 is magnified by the condition of the mass matrix, 7e3 for the worn device (a pelvis of
# 60 kg beside a foot of 0.01 kg m²): 1.5e-12. The rest is room for other processors and versions.
ROUNDING = 1e-10

DYNAMICS_CHECKS = (
    *(
        CheckPlan(
            name=f"{subject}-{quantity.replace('_', '-')}",
            witness="MuJoCo",
            unit="1",
            tolerance=ROUNDING,
            find=partial(mujoco_error, subject, quantity),
        )
        for subject in SUBJECTS
        for quantity in QUANTITIES
    ),
    CheckPlan(
        name="bench-double-pendulum",
        witness="Lagrange's equations by hand",
        unit="1",
        tolerance=ROUNDING,
        find=pendulum_error,
    ),
    *(
        CheckPlan(
            name=f"{subject}-kernel",
            witness="Pinocchio (ABA)",
            unit="1",
            tolerance=ROUNDING,
            find=partial(kernel_error, subject),
        )
        for subject in SUBJECTS
    ),
)
