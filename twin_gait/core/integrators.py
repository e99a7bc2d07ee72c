"""Fixed-step integrators of ``q̈ = a(q, q̇)`` on plain arrays.

The acceleration is a function ``acceleration(context, offset, weight, q, v, out)`` that writes into
``out``. ``context`` is whatever it needs, handed through. ``offset`` is the share of the step that has
passed at this evaluation and ``weight`` the share of the step that it stands for, so that the function
can integrate powers along with the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
Work = Array | tuple[Array, Array, Array, Array, Array]
Acceleration = Callable[[Any, float, float, Array, Array, Array], None]

RK4_STAGES = 4


def semi_implicit_euler_step(
    acceleration: Acceleration, context: Any, q: Array, v: Array, step: float, a: Array
) -> None:
    """Advance by one step of the semi-implicit (symplectic) Euler method, of first order.

    ``v ← v + h a(q, v)``, then ``q ← q + h v`` with the new velocity.

    Args:
        acceleration: Writes the acceleration of ``(q, v)`` into its last argument.
        context: Handed to it.
        q: Coordinates, shape ``(n,)``; changed in place.
        v: Velocities, shape ``(n,)``; changed in place.
        step: h in [s].
        a: Room for the acceleration, shape ``(n,)``; changed in place.
    """
    acceleration(context, 0.0, 1.0, q, v, a)
    for i in range(q.shape[0]):
        v[i] += step * a[i]
        q[i] += step * v[i]


def rk4_step(acceleration: Acceleration, context: Any, q: Array, v: Array, step: float, work: Work) -> None:
    """Advance by one step of the classical Runge-Kutta method, of fourth order.

    Args:
        acceleration: Writes the acceleration of ``(q, v)`` into its last argument; called once a
            stage, in order, with offsets 0, 1/2, 1/2, 1 and weights 1/6, 1/3, 1/3, 1/6.
        context: Handed to it.
        q: Coordinates, shape ``(n,)``; changed in place.
        v: Velocities, shape ``(n,)``; changed in place.
        step: h in [s].
        work: Room for the stages: five arrays of shape ``(n,)``; changed in place.
    """
    n = q.shape[0]
    stage_q, stage_v, a, sum_v, sum_a = work
    for i in range(n):
        stage_q[i] = q[i]
        stage_v[i] = v[i]
        sum_v[i] = 0.0
        sum_a[i] = 0.0
    for stage in range(RK4_STAGES):
        outer = stage == 0 or stage == RK4_STAGES - 1
        weight = 1.0 / 6.0 if outer else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (1.0 if stage == RK4_STAGES - 1 else 0.5)
        acceleration(context, offset, weight, stage_q, stage_v, a)
        ahead = step if stage == 2 else 0.5 * step
        for i in range(n):
            sum_v[i] += weight * stage_v[i]
            sum_a[i] += weight * a[i]
            if stage < RK4_STAGES - 1:
                stage_q[i] = q[i] + ahead * stage_v[i]
                stage_v[i] = v[i] + ahead * a[i]
    for i in range(n):
        q[i] += step * sum_v[i]
        v[i] += step * sum_a[i]
