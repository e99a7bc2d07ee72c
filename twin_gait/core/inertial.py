"""What an inertial unit on a link reports, and the acceleration or the pitch that follows from it."""

import math
from dataclasses import dataclass

from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import first_order_step


def tangential_specific_force(
    acceleration: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Specific force along the path of an accelerometer on a turning link.

    .. math::

        f_t = r\,\dot\omega - g \cos(\theta - \theta_h)

    An accelerometer measures the specific force, not gravity: on a link that falls freely it reads less than
    the acceleration by the share of gravity that lies along its path.

    ``acceleration``: :math:`\dot\omega` of the link in [rad] / [s²]. ``angle``: :math:`\theta` in [rad].
    ``lever``: :math:`r` from the axis to the accelerometer in [m]. ``gravity``: :math:`g` in [m] / [s²].
    ``horizontal_angle``: :math:`\theta_h` at which the link is level, in [rad]. Returns the specific force in
    [m] / [s²], positive in increasing angle.
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return lever * acceleration - gravity * cosine


def angular_acceleration(
    specific_force: float, angle: float, lever: float, gravity: float, horizontal_angle: float
) -> float:
    r"""Angular acceleration from an accelerometer on a link, gravity taken out by a measured angle.

    :math:`\dot\omega = [f_t + g \cos(\theta - \theta_h)] / r`, the inverse of
    :func:`tangential_specific_force` where the angle is the true one.

    ``specific_force``: :math:`f_t` in [m] / [s²]. ``angle``: measured angle :math:`\theta` in [rad].
    ``lever``: :math:`r` in [m], above 0. ``gravity``: :math:`g` in [m] / [s²]. ``horizontal_angle``:
    :math:`\theta_h` in [rad]. Returns the angular acceleration in [rad] / [s²].
    """
    _, cosine = sine_cosine(angle - horizontal_angle)
    return (specific_force + gravity * cosine) / lever


@dataclass(slots=True)
class TrunkUnit:
    """An inertial unit on a trunk, and the pitch that its filter has found."""

    height: float  # Of the unit above the hips, along the trunk, in [m].
    behind: float  # Behind the line from hips to shoulders in [m].
    gyroscope_bias: float  # What it reads in excess in [rad] / [s].
    accelerometer_bias: float  # What the axis forwards reads in excess in [m] / [s²].
    gain: float  # Of the correction, from :func:`~twin_gait.core.estimation.first_order_gain`.
    pitch: float  # Estimate in [rad], forwards positive.


def trunk_specific_force(
    unit: TrunkUnit, pitch: float, rate: float, turning: float, forward: float, upward: float, gravity: float
) -> tuple[float, float]:
    r"""Specific force in an inertial unit on a trunk, forwards and up along the trunk.

    With the unit h above and d behind the hips, which accelerate with :math:`(a_x, a_z)`,

    .. math::

        f_x = a_x \cos\theta - (a_z + g) \sin\theta + h\,\ddot\theta + d\,\dot\theta^2, \qquad
        f_z = a_x \sin\theta + (a_z + g) \cos\theta + d\,\ddot\theta - h\,\dot\theta^2

    ``unit``: its place. ``pitch``: θ in [rad], forwards positive. ``rate``: of it in [rad] / [s].
    ``turning``: angular acceleration in [rad] / [s²]. ``forward``: :math:`a_x` of the hips in [m] / [s²].
    ``upward``: :math:`a_z`, likewise. ``gravity``: g in [m] / [s²]. Returns both forces in [m] / [s²].
    """
    sine, cosine = sine_cosine(pitch)
    lifted, spun = upward + gravity, rate * rate
    return (
        forward * cosine - lifted * sine + unit.height * turning + unit.behind * spun,
        forward * sine + lifted * cosine + unit.behind * turning - unit.height * spun,
    )


def follow_pitch(unit: TrunkUnit, rate: float, ahead: float, up: float, period: float) -> None:
    r"""One step of the complementary filter: the gyroscope integrated, drawn to where gravity seems to be.

    .. math::

        \hat\theta^- = \hat\theta + T \omega, \qquad
        \hat\theta \leftarrow \hat\theta^- + \alpha
            \frac{-f_x \cos\hat\theta^- - f_z \sin\hat\theta^-}{\sqrt{f_x^2 + f_z^2}}

    The fraction is the sine of the way to the pitch at which a trunk at rest would feel this force, so that
    small errors fade with the time constant of the gain (the passive complementary filter of Mahony, Hamel
    and Pflimlin 2008, in the plane); the acceleration of the trunk is taken for gravity meanwhile.

    ``unit``: its pitch is changed in place. ``rate``: that the gyroscope reads, without its bias, in [rad] /
    [s]. ``ahead``: what the accelerometer reads forwards, likewise, in [m] / [s²]. ``up``: and up along the
    trunk; in free fall there is no direction and no correction. ``period``: T in [s].
    """
    pitch = unit.pitch + period * (rate + unit.gyroscope_bias)
    sine, cosine = sine_cosine(pitch)
    felt = ahead + unit.accelerometer_bias
    size = math.sqrt(felt * felt + up * up)
    error = (-felt * cosine - up * sine) / size if size > 0.0 else 0.0
    unit.pitch = first_order_step(pitch, pitch + error, unit.gain)
