"""What an inertial unit on a link reports, and the angular acceleration that follows from it."""

from __future__ import annotations

from twin_gait.core.elementary import sine_cosine


def tangential_specific_force(
    acceleration: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Specific force along the path of an accelerometer on a turning link.

    .. math::

        f_t = r\,\dot\omega - g \cos(\theta - \theta_h)

    An accelerometer measures the specific force, not gravity: on a link that falls freely it reads less than
    the acceleration by the share of gravity that lies along its path.

    Args:
        acceleration: :math:`\dot\omega` of the link in [rad] / [s²].
        angle: :math:`\theta` in [rad].
        lever: :math:`r` from the axis to the accelerometer in [m].
        gravity: :math:`g` in [m] / [s²].
        horizontal_angle: :math:`\theta_h` at which the link is level, in [rad].

    Returns:
        Specific force in [m] / [s²], positive in increasing angle.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return lever * acceleration - gravity * cosine


def angular_acceleration(
    specific_force: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Angular acceleration from an accelerometer on a link, gravity taken out by a measured angle.

    :math:`\dot\omega = [f_t + g \cos(\theta - \theta_h)] / r`, the inverse of
    :func:`tangential_specific_force` where the angle is the true one.

    Args:
        specific_force: :math:`f_t` in [m] / [s²].
        angle: Measured angle :math:`\theta` in [rad].
        lever: :math:`r` in [m], above 0.
        gravity: :math:`g` in [m] / [s²].
        horizontal_angle: :math:`\theta_h` in [rad].

    Returns:
        Angular acceleration in [rad] / [s²].
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return (specific_force + gravity * cosine) / lever
