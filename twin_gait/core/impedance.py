"""The virtual spring and damper laid over the compensated joint."""

import math


def impedance_torque(
    angle: float, velocity: float, stiffness: float, damping: float, equilibrium_angle: float
) -> float:
    r"""Torque of the virtual spring-damper on the joint.

    Equation (2.17) of the thesis with the damping of its chapter 5, as a torque *on the joint*:

    .. math::

        \tau = -\left[k\,(\theta - \theta_0) + b\,\omega\right]

    ``angle``: joint angle in [rad]. ``velocity``: joint velocity in [rad] / [s]. ``stiffness``: :math:`k` in
    [N m] / [rad]. ``damping``: :math:`b` in [N m s] / [rad]. ``equilibrium_angle``: :math:`\theta_0` in
    [rad]. Returns the torque in [N m], positive in the direction of increasing angle.
    """
    return -(stiffness * (angle - equilibrium_angle) + damping * velocity)


def damping_from_ratio(damping_ratio: float, stiffness: float, inertia: float) -> float:
    r"""Damping that gives a joint the damping ratio :math:`\zeta`.

    .. math::

        b = 2\,\zeta\,\sqrt{k\,I}

    ``damping_ratio``: :math:`\zeta`, 1 is critical. ``stiffness``: :math:`k` in [N m] / [rad]. ``inertia``:
    :math:`I`, effective joint inertia with armature, in [kg m²]. Returns the damping in [N m s] / [rad].
    """
    return 2.0 * damping_ratio * math.sqrt(stiffness * inertia)


def damping_ratio_of(damping: float, stiffness: float, inertia: float) -> float:
    r"""Damping ratio :math:`\zeta = b / (2\sqrt{k I})` of a joint, the inverse of the above.

    ``damping``: :math:`b` in [N m s] / [rad]. ``stiffness``: :math:`k` in [N m] / [rad], not zero.
    ``inertia``: effective joint inertia in [kg m²], not zero.
    """
    return damping / (2.0 * math.sqrt(stiffness * inertia))
