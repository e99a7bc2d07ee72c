"""Bench leg as a double pendulum, from Lagrange's equations derived by hand."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from twin_gait import Experiment
from twin_gait.leg_model.urdf import packaged_urdf


class Pendulum(NamedTuple):
    """Two links in a vertical plane.

    Attributes:
        thigh_inertia: Inertia of thigh and shank (as a point at the knee) about the hip in [kg·m²].
        shank_inertia: Inertia of the shank about the knee in [kg·m²].
        coupling: Mass of the shank times distance of its centre from the knee times thigh length.
        thigh_moment: First moment of the thigh, and of the shank as a point at the knee, in [kg·m].
        shank_moment: First moment of the shank about the knee in [kg·m].
        armature: Inertia of hip and knee drive in [kg·m²].
        gravity: Acceleration in [m/s²].
    """

    thigh_inertia: float
    shank_inertia: float
    coupling: float
    thigh_moment: float
    shank_moment: float
    armature: tuple[float, float]
    gravity: float


def pendulum_of(experiment: Experiment) -> Pendulum:
    """Return the constants of the bench leg without a wearer from its URDF."""
    root = ElementTree.parse(packaged_urdf("twin_leg.urdf")).getroot()

    def below(path: str) -> float:
        return -float(root.find(path).attrib["xyz"].split()[2])

    def link(name: str) -> tuple[float, float, float]:
        path = f"link[@name='{name}']/inertial"
        mass, inertia = root.find(f"{path}/mass"), root.find(f"{path}/inertia")
        return float(mass.attrib["value"]), below(f"{path}/origin"), float(inertia.attrib["iyy"])

    (m1, c1, i1), (m2, c2, i2) = link("right_thigh"), link("right_shank")
    length = below("joint[@name='right_knee']/origin")
    return Pendulum(
        thigh_inertia=i1 + m1 * c1 * c1 + m2 * length * length,
        shank_inertia=i2 + m2 * c2 * c2,
        coupling=m2 * c2 * length,
        thigh_moment=m1 * c1 + m2 * length,
        shank_moment=m2 * c2,
        armature=tuple(experiment.plant.actuators[joint].armature for joint in ("hip", "knee")),
        gravity=experiment.plant.gravity,
    )


def pendulum_acceleration(pendulum: Pendulum, q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    r"""Compute the accelerations of hip and knee in [rad/s²].

    With hip flexion :math:`\theta_1` and knee flexion :math:`\theta_2` positive, thigh and shank are
    at :math:`\theta_1` and :math:`\theta_1 - \theta_2` from the vertical.
    """
    (hip, knee), (hip_rate, knee_rate) = q, v
    h = pendulum.coupling * math.cos(knee)
    k = pendulum.coupling * math.sin(knee)
    m11 = pendulum.thigh_inertia + pendulum.shank_inertia + 2.0 * h + pendulum.armature[0]
    m12 = -pendulum.shank_inertia - h
    m22 = pendulum.shank_inertia + pendulum.armature[1]
    shank = pendulum.gravity * pendulum.shank_moment * math.sin(hip - knee)
    thigh = pendulum.gravity * pendulum.thigh_moment * math.sin(hip)
    r1 = torque[0] + k * knee_rate * (2.0 * hip_rate - knee_rate) - thigh - shank
    r2 = torque[1] - k * hip_rate * hip_rate + shank
    determinant = m11 * m22 - m12 * m12
    return np.array([m22 * r1 - m12 * r2, m11 * r2 - m12 * r1]) / determinant


def pendulum_motion(pendulum: Pendulum, start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Integrate the free motion from rest by scipy's method of eighth order: angles and rates, ``(4, n)``."""

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:2], state[2:]
        return np.concatenate([v, pendulum_acceleration(pendulum, q, v, np.zeros(2))])

    first, rest = np.concatenate([start, np.zeros(2)]), (times[0], times[-1])
    return solve_ivp(slope, rest, first, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-13).y
