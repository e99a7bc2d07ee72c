"""The belt of a treadmill that starts, runs and stops, and the command to walk that goes with it."""

from __future__ import annotations

from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend_share

# Positions in the array of a belt: speed between the ramps, begin and end of the command to walk, length of a
# ramp, and how long after the command the belt follows.
BELT_CRUISE, BELT_START, BELT_STOP, BELT_RAMP, BELT_DELAY = range(5)
BELT_COUNT = BELT_DELAY + 1


def belt_speed(time: float, cruise: float, start: float, stop: float, ramp: float) -> float:
    r"""Speed of a belt that starts and stops along minimum-jerk ramps.

    .. math::

        u(t) = u_c\,\Bigl[s\Bigl(\frac{t - t_1}{T}\Bigr) - s\Bigl(\frac{t - t_2}{T}\Bigr)\Bigr]

    with :func:`~twin_gait.core.blending.blend_share` as s: speed and acceleration are continuous, and the
    belt does not run before ``start`` or after ``stop + ramp``.

    Args:
        time: In [s].
        cruise: Speed u_c between the ramps in [m] / [s].
        start: t_1, at which the belt begins to move, in [s].
        stop: t_2, at which it begins to slow down, not before ``start``, in [s]; infinite if it never does.
        ramp: Length T of each ramp in [s], positive.

    Returns:
        Speed in [m] / [s], backwards positive.
    """
    up = blend_share((time - start) / ramp, BLEND_MINIMUM_JERK)
    return cruise * (up - blend_share((time - stop) / ramp, BLEND_MINIMUM_JERK))


def belt_travel(time: float, cruise: float, start: float, stop: float, ramp: float) -> float:
    r"""Way that the belt has gone since time 0: the integral of :func:`belt_speed`.

    .. math::

        x(t) = u_c\,T\,\Bigl[S\Bigl(\frac{t - t_1}{T}\Bigr) - S\Bigl(\frac{t - t_2}{T}\Bigr)\Bigr],
        \qquad S(p) = \tfrac{5}{2} p^4 - 3 p^5 + p^6

    on the ramp, :math:`S = p - \tfrac{1}{2}` behind it, 0 before.

    Args:
        time: In [s].
        cruise: As in :func:`belt_speed`.
        start: Likewise, 0 or later.
        stop: Likewise.
        ramp: Likewise.

    Returns:
        Way in [m], backwards positive.
    """
    return cruise * ramp * (_ramp_way((time - start) / ramp) - _ramp_way((time - stop) / ramp))


def _ramp_way(progress: float) -> float:
    """Integral of the share of a ramp over its progress."""
    if progress <= 0.0:
        return 0.0
    if progress >= 1.0:
        return progress - 0.5
    return progress * progress * progress * progress * (2.5 + progress * (progress - 3.0))


def walk_command(time: float, start: float, stop: float) -> float:
    """What the legs are told.

    Args:
        time: In [s].
        start: From when on they are to walk in [s].
        stop: From when on they are to stand in [s].

    Returns:
        1 to walk, 0 to stand.
    """
    return 1.0 if start <= time < stop else 0.0
