"""Readings of an inertial unit on a link, and the acceleration or the pitch estimated from them."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import first_order_step


def tangential_specific_force(
    acceleration: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Compute the specific force in [m/s²] along the path of an accelerometer on a turning link.

    :math:`f_t = r\,\dot\omega - g \cos(\theta - \theta_h)`, positive in the direction of increasing angle,
    with the ``lever`` r from the axis in [m] and the angle θ_h at which the link is level.

    An accelerometer measures the specific force, which excludes gravity: on a link that falls freely it reads
    less than the acceleration by the share of gravity that acts along its path.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return lever * acceleration - gravity * cosine


def angular_acceleration(
    specific_force: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Compute the angular acceleration in [rad/s²] from an accelerometer and a measured angle.

    :math:`\dot\omega = [f_t + g \cos(\theta - \theta_h)] / r`: the angle serves to remove gravity. This is
    the inverse of :func:`tangential_specific_force` if the angle is the true one.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return (specific_force + gravity * cosine) / lever


@dataclass(slots=True)
class TrunkUnit:
    """Inertial unit on a trunk, with the pitch estimate of its filter."""

    height: float  # Height of the unit above the hips, along the trunk, in [m].
    behind: float  # Distance behind the line from hips to shoulders in [m].
    gyroscope_bias: float  # Bias of the angular rate in [rad/s].
    accelerometer_bias: float  # Bias of the forward axis in [m/s²].
    gain: float  # Gain of the correction, from :func:`~twin_gait.core.estimation.first_order_gain`.
    pitch: float  # Pitch estimate in [rad], forwards positive.


def trunk_specific_force(
    unit: TrunkUnit, pitch: float, rate: float, turning: float, forward: float, upward: float, gravity: float
) -> tuple[float, float]:
    r"""Compute the specific force in [m/s²] at an inertial unit, forwards and up along the trunk.

    With the unit h above and d behind the hips, which accelerate with :math:`(a_x, a_z)` (``forward``,
    ``upward``), and the pitch θ (``rate``, ``turning``), forwards positive,

    .. math::

        f_x = a_x \cos\theta - (a_z + g) \sin\theta + h\,\ddot\theta + d\,\dot\theta^2, \qquad
        f_z = a_x \sin\theta + (a_z + g) \cos\theta + d\,\ddot\theta - h\,\dot\theta^2
    """
    sine, cosine = sine_cosine(pitch)
    lifted, spun = upward + gravity, rate * rate
    return (
        forward * cosine - lifted * sine + unit.height * turning + unit.behind * spun,
        forward * sine + lifted * cosine + unit.behind * turning - unit.height * spun,
    )


def update_pitch_estimate(unit: TrunkUnit, rate: float, ahead: float, up: float, period: float) -> None:
    r"""Update the pitch estimate by one step of the complementary filter.

    The filter integrates the gyroscope and corrects the estimate towards the measured direction of gravity:

    .. math::

        \hat\theta^- = \hat\theta + T \omega, \qquad
        \hat\theta \leftarrow \hat\theta^- + \alpha
            \frac{-f_x \cos\hat\theta^- - f_z \sin\hat\theta^-}{\sqrt{f_x^2 + f_z^2}}

    The fraction is the sine of the difference to the pitch at which a trunk at rest would measure this force,
    so that small errors decay with the time constant of the gain (the passive complementary filter of Mahony,
    Hamel and Pflimlin 2008, in the plane). The filter does not distinguish the acceleration of the trunk from
    gravity. The readings ``rate``, ``ahead`` and ``up`` come without their biases; in free fall there is no
    direction and no correction. ``period``: T in [s].
    """
    pitch = unit.pitch + period * (rate + unit.gyroscope_bias)
    sine, cosine = sine_cosine(pitch)
    felt = ahead + unit.accelerometer_bias
    size = math.sqrt(felt * felt + up * up)
    error = (-felt * cosine - up * sine) / size if size > 0.0 else 0.0
    unit.pitch = first_order_step(pitch, pitch + error, unit.gain)
