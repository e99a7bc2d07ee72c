"""The virtual spring and damper of a joint, in addition to the compensation of friction and gravity."""

import math


def impedance_torque(
    angle: float, velocity: float, stiffness: float, damping: float, equilibrium_angle: float
) -> float:
    r"""Compute the torque in [N·m] of the virtual spring-damper, positive in increasing angle.

    Equation (2.17) of the thesis with the damping of its chapter 5, as a torque *on the joint*, to which
    (2.18) adds :math:`G\,T_{fr}`:

    :math:`\tau = -\left[k\,(\theta - \theta_0) + b\,\omega\right]`
    """
    return -(stiffness * (angle - equilibrium_angle) + damping * velocity)


def damping_from_ratio(damping_ratio: float, stiffness: float, inertia: float) -> float:
    r"""Compute the damping in [N·m·s/rad] that gives a joint a damping ratio.

    :math:`b = 2\,\zeta\,\sqrt{k\,I}` with the ``damping_ratio`` ζ, the ``stiffness`` k in [N·m/rad] and
    the ``inertia`` I, the effective joint inertia with armature, in [kg·m²].
    """
    return 2.0 * damping_ratio * math.sqrt(stiffness * inertia)


def ratio_from_damping(damping: float, stiffness: float, inertia: float) -> float:
    r"""Compute the damping ratio :math:`\zeta = b / (2\sqrt{k I})`, the inverse of the above."""
    return damping / (2.0 * math.sqrt(stiffness * inertia))
