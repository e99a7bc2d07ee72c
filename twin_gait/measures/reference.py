"""Angles of hip, knee and ankle in healthy walking, by the regression of Koopman et al. (2014).

B. Koopman, E. H. F. van Asseldonk, H. van der Kooij: Speed-dependent reference joint trajectory
generation for robotic gait support, Journal of Biomechanics 47 (2014) 1447-1458. A few key events of
the cycle have a timing, an angle, a velocity and an acceleration that depend on speed and body height,

.. math::

    y = b_0 + b_1 v + b_2 v^2 + b_3 h,

and quintic Hermite splines join them. The regression counts its instants as samples of a cycle: heel
contact is sample 1, the next heel contact sample 100, so that sample 1 + 0.99 p is p percent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.measures.koopman2014 import EVENTS, FIRST_SAMPLE, LAST_SAMPLE, STEP_RATIO, Coefficients
from twin_gait.parameters import require, require_positive
from twin_gait.vocabulary import JointName

KILOMETRES_PER_HOUR = 3.6
CYCLE = 100.0  # [%]
SAMPLES_PER_PERCENT = (LAST_SAMPLE - FIRST_SAMPLE) / CYCLE
SLOWEST, FASTEST = 0.5 / KILOMETRES_PER_HOUR, 5.0 / KILOMETRES_PER_HOUR  # [m] / [s], range of the regression


class KeyEvent(NamedTuple):
    """One key event at a speed and body height.

    Attributes:
        percent: Instant in [%] of the cycle.
        angle: In [rad].
        velocity: In [rad] / [%].
        acceleration: In [rad] / [%]².
    """

    percent: float
    angle: float
    velocity: float
    acceleration: float


def reference_covers(speed: float) -> bool:
    """Whether the regression was made for a walking speed.

    Args:
        speed: In [m] / [s].

    Returns:
        True from 0.5 to 5 km/h.
    """
    return SLOWEST <= speed <= FASTEST


def key_events(joint: JointName, *, speed: float, height: float) -> tuple[KeyEvent, ...]:
    """Key events of a joint, in the order of the cycle.

    Args:
        joint: Hip, knee or ankle.
        speed: Walking speed in [m] / [s].
        height: Body height in [m].

    Returns:
        The events.

    Raises:
        ParameterError: If the regression does not reach the speed, or the height is not positive.
    """
    _require_covered(speed, height)
    degree = math.pi / 180.0
    return tuple(
        KeyEvent(
            (_regress(event.timing, speed, height) - FIRST_SAMPLE) / SAMPLES_PER_PERCENT,
            degree * _regress(event.angle, speed, height),
            degree * _regress(event.velocity, speed, height) * SAMPLES_PER_PERCENT,
            degree * _regress(event.acceleration, speed, height) * SAMPLES_PER_PERCENT**2,
        )
        for event in EVENTS[joint]
    )


def reference_curve(joint: JointName, percent: np.ndarray, *, speed: float, height: float) -> np.ndarray:
    """Angle of a joint over the gait cycle in healthy walking.

    Args:
        joint: Hip, knee or ankle.
        percent: Instants in [%] of the cycle from heel strike, any shape; the cycle repeats.
        speed: Walking speed in [m] / [s].
        height: Body height in [m].

    Returns:
        Angles in [rad], shape of ``percent``; flexion and dorsiflexion positive.

    Raises:
        ParameterError: If the regression does not reach the speed, or the height is not positive.
    """
    from scipy.interpolate import BPoly  # takes longer to import than a walk to simulate

    events = key_events(joint, speed=speed, height=height)
    around = (*events, events[0]._replace(percent=CYCLE))
    spline = BPoly.from_derivatives(
        [event.percent for event in around],
        [(event.angle, event.velocity, event.acceleration) for event in around],
    )
    return np.asarray(spline(np.mod(np.asarray(percent, dtype=float), CYCLE)))


def reference_cycle_time(speed: float, height: float) -> float:
    r"""Duration of the gait cycle in healthy walking.

    With the step ratio :math:`r` (step length over cadence), :math:`T = 2 \sqrt{r / v}`.

    Args:
        speed: Walking speed in [m] / [s].
        height: Body height in [m].

    Returns:
        Duration in [s].

    Raises:
        ParameterError: If the regression does not reach the speed, or the height is too small for it.
    """
    _require_covered(speed, height)
    constant, with_speed, with_height = STEP_RATIO
    ratio = constant + with_speed * speed * KILOMETRES_PER_HOUR + with_height * height
    require(ratio > 0.0, "height", "a height that gives a positive step ratio", height)
    return 2.0 * math.sqrt(ratio / speed)


def _require_covered(speed: float, height: float) -> None:
    require_positive("height", height)
    if not reference_covers(speed):
        raise ParameterError(
            f"speed: the reference curves hold from {SLOWEST:.2f} to {FASTEST:.2f} m/s, got {speed!r}"
        )


def _regress(coefficients: Coefficients, speed: float, height: float) -> float:
    constant, linear, quadratic, with_height = coefficients
    v = speed * KILOMETRES_PER_HOUR
    return constant + linear * v + quadratic * v * v + with_height * height
