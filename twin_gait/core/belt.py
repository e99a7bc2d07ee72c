"""The belt of a treadmill that starts, runs and stops, and the walk command that goes with it.

A trip of the safety monitor, or the operator's Stop, brings a belt to rest with or without a profile.
"""

import math
from dataclasses import dataclass

from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend_share


@dataclass(slots=True)
class Belt:
    """Parameters of the speed profile of a treadmill."""

    cruise: float = 0.0  # Speed between the ramps in [m/s].
    start: float = 0.0  # Start of the walk command in [s].
    stop: float = math.inf  # End of the walk command in [s].
    ramp: float = 0.0  # Length of a ramp in [s]; 0 for a belt with constant speed.
    delay: float = 0.0  # Delay from a command until the belt follows it in [s].
    stop_ramp: float = math.inf  # Time to rest after a trip in [s]; infinite for a belt that runs on.


def belt_speed(time: float, cruise: float, start: float, stop: float, ramp: float) -> float:
    r"""Compute the speed in [m/s] of a belt that starts and stops along minimum-jerk ramps.

    :math:`u(t) = u_c\,\Bigl[s\Bigl(\frac{t - t_1}{T}\Bigr) - s\Bigl(\frac{t - t_2}{T}\Bigr)\Bigr]`, backwards
    positive,

    with :func:`~twin_gait.core.blending.blend_share` as s: speed and acceleration are continuous. The ramp up
    begins at ``start`` t_1 and the ramp down at ``stop`` t_2 (not before t_1, may be infinite); each takes
    ``ramp`` T (positive), all in [s]. ``cruise``: u_c between the ramps.
    """
    up = blend_share((time - start) / ramp, BLEND_MINIMUM_JERK)
    return cruise * (up - blend_share((time - stop) / ramp, BLEND_MINIMUM_JERK))


def treadmill_speed(belt: Belt, time: float, trip_time: float) -> float:
    r"""Compute the speed in [m/s] of a treadmill's belt, backwards positive, which a trip brings to rest.

    :math:`u(t) = u(t_0)\,\Bigl[1 - s\Bigl(\frac{t - t_0}{T_0}\Bigr)\Bigr] \quad\text{for}\quad t > t_0`

    after a trip at t_0 in [s] (``trip_time``, infinite if there is none); T_0 is the ``stop_ramp``.
    """
    speed = belt.cruise
    if belt.ramp > 0.0:
        speed = belt_speed(min(time, trip_time) - belt.delay, belt.cruise, belt.start, belt.stop, belt.ramp)
    if time > trip_time:
        speed *= 1.0 - blend_share((time - trip_time) / belt.stop_ramp, BLEND_MINIMUM_JERK)
    return speed


def walk_command(time: float, start: float, stop: float) -> float:
    """Return the walk command at a time in [s]: 1 to walk, from ``start`` to ``stop``, and 0 for standing."""
    return 1.0 if start <= time < stop else 0.0
