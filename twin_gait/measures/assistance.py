r"""Who moves the leg: torque and work of the device beside those of the wearer.

Where braces bind the wearer to the device, their torque is what the device does on him, and the log has it.
Without braces the leg and the device's frame are one rigid body, so nothing is measured in a cuff. What the
device does on the leg at a joint is then what arrives behind its gear: the motor's torque less the friction
of motor and gear and less what accelerates the rotor,

.. math::

    \tau_{int} = \tau_{motor} + \tau_{friction} - J_{rotor}\,\dot\omega

A torque sensor between gear and frame would read it. The weight and inertia of the frame itself are still in
it, as they are in such a sensor.
"""

from __future__ import annotations

import math

import numpy as np


def interaction_torque(
    motor: np.ndarray, friction: np.ndarray, velocity: np.ndarray, rotor_inertia: float, tick: float
) -> np.ndarray:
    r"""What the device does on the leg at one joint.

    Args:
        motor: Motor torque at the joint in [N m], one value a tick, shape ``(n,)``.
        friction: Torque of the friction on the joint in [N m], shape ``(n,)``.
        velocity: Of the joint in [rad] / [s], shape ``(n,)``, n at least 2.
        rotor_inertia: Of motor and gear seen at the joint in [kg m²].
        tick: Sampling period in [s].

    Returns:
        Torque in [N m], positive in increasing angle, shape ``(n,)``; the acceleration is a central
        difference.
    """
    return np.asarray(motor + friction - rotor_inertia * np.gradient(velocity, tick))


def root_mean_square(values: np.ndarray) -> float:
    """Root mean square.

    Args:
        values: Shape ``(n,)``.

    Returns:
        In the unit of the values; NaN for an empty record.
    """
    return float(np.sqrt(np.mean(values * values))) if len(values) else math.nan


def positive_work(torque: np.ndarray, velocity: np.ndarray, tick: float) -> float:
    r"""Work that a torque puts into the motion, :math:`\int \max(0, \tau\omega)\,dt`.

    Args:
        torque: In [N m], one value a tick, shape ``(n,)``.
        velocity: In [rad] / [s], shape ``(n,)``.
        tick: Sampling period in [s].

    Returns:
        Work in [J].
    """
    return float(np.sum(np.maximum(torque * velocity, 0.0)) * tick)


def share_of_work(own: float, other: float) -> float:
    """Share of one of two in the positive work of both.

    Args:
        own: Positive work of one in [J].
        other: Positive work of the other in [J].

    Returns:
        Share in [0, 1]; NaN if neither does any.
    """
    total = own + other
    return own / total if total > 0.0 else math.nan


def opposing_torque(device: np.ndarray, wearer: np.ndarray) -> np.ndarray:
    r"""Torque with which device and wearer push against each other.

    .. math::

        \min(|\tau_d|, |\tau_w|) \quad\text{where their signs differ, else 0}

    Args:
        device: In [N m], shape ``(n,)``.
        wearer: In [N m], shape ``(n,)``.

    Returns:
        Magnitude in [N m], shape ``(n,)``.
    """
    against = device * wearer < 0.0
    return np.where(against, np.minimum(np.abs(device), np.abs(wearer)), 0.0)
