"""What a generated kernel offers to the episode loop.

These functions only state the interface; :mod:`twin_gait.simulation.kernel` writes the real ones for
one structure of rigid bodies, and :mod:`twin_gait.simulation.compiling` puts them in their place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


def dynamics(
    q: Array, v: Array, torque: Array, bodies: Array, gravity: float, contact: Array, a: Array, points: Array
) -> float:
    """Accelerations under joint torques and contact forces.

    Args:
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        torque: On the coordinates, shape ``(n,)``.
        bodies: Masses, inertias, lengths and armature, from :func:`~twin_gait.simulation.kernel.body_values`.
        gravity: In [m] / [s²].
        contact: Belt speed, stiffness, dissipation, friction coefficient, transition velocity.
        a: Accelerations, shape ``(n,)``; changed in place.
        points: Forward and upward force and height of every contact point, shape ``(n_points, 3)``;
            changed in place.

    Returns:
        Power of the contact forces in [W].
    """
    raise NotImplementedError


def contact_forces(q: Array, v: Array, bodies: Array, contact: Array, points: Array) -> float:
    """Contact forces of a state; as :func:`dynamics` without the accelerations."""
    raise NotImplementedError


def observe(
    q: Array, v: Array, a: Array, bodies: Array, gravity: float, points: Array
) -> tuple[float, float, float, float]:
    """Kinetic and potential energy in [J], force [N] and moment [N m] of the pelvis guides."""
    raise NotImplementedError


def control_gravity(q: Array, bodies: Array, gravity: float, torque: Array) -> None:
    """Gravity torques of the controller's model; ``torque`` is changed in place."""
    raise NotImplementedError


def control_inertia(q: Array, a: Array, bodies: Array, torque: Array) -> None:
    """Inertia torques of the controller's model, armature included; ``torque`` is changed in place."""
    raise NotImplementedError
