"""Reference curves of healthy walking (Koopman et al., 2014; Winter, 1991) and distances of a gait from them.

B. Koopman, E. H. F. van Asseldonk, H. van der Kooij: Speed-dependent reference joint trajectory
generation for robotic gait support, Journal of Biomechanics 47 (2014) 1447-1458. A few key events of
the cycle have a timing, an angle, a velocity and an acceleration that depend on speed and body height
(fifteen healthy subjects of 47 to 68 years at 0.5 to 5 km/h, found in the abstract),

.. math::

    y = b_0 + b_1 v + b_2 v^2 + b_3 h,

and quintic Hermite splines join them. The regression counts its instants as samples of a cycle: heel
contact is sample 1, the next heel contact sample 100, so that sample 1 + 0.99 p is p percent.

Angles at natural cadence, and moments and ground forces at slow cadence, are from D. A. Winter: The
biomechanics and motor control of human gait, 2nd edition, University of Waterloo Press, 1991: means over 19
subjects, every 2 % of the cycle from heel contact to the next. Duration and speed at natural cadence are
those that public copies of the table give (105.3 steps a minute).
"""

import csv
import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin_gait.measures.effort import root_mean_square
from twin_gait.parameters.quantities import POSITIVE, coerce, require
from twin_gait.vocabulary import JointName

KILOMETRES_PER_HOUR = 3.6  # kilometres per hour in a metre per second
CYCLE = 100.0  # [%]
FIRST_SAMPLE, LAST_SAMPLE = 1.0, 100.0
SAMPLES_PER_PERCENT = (LAST_SAMPLE - FIRST_SAMPLE) / CYCLE
STEP_RATIO = (-0.532, 0.020, 0.470)  # coefficients of step length over cadence: constant, per km/h, per m
_QUANTITIES = ("timing", "angle", "velocity", "acceleration")
SLOWEST, FASTEST = 0.5 / KILOMETRES_PER_HOUR, 5.0 / KILOMETRES_PER_HOUR  # range of the regression, [m/s]
YOUNGEST, OLDEST = 47.0, 68.0  # ages of its subjects in years


def reference_covers(speed: float) -> bool:
    """Check whether the regression was made for a walking speed.

    ``speed`` in [m/s]. Returns true from 0.5 to 5 km/h.
    """
    return SLOWEST <= speed <= FASTEST


def key_events(joint: JointName, *, speed: float, height: float) -> np.ndarray:
    """Compute the key events of a joint, in the order of the cycle.

    ``speed`` in [m/s]; ``height`` of the body in [m]. Returns a row for each event with its instant in
    [%] of the cycle, angle in [rad], velocity in [rad/%] and acceleration in [rad/%]², shape
    ``(n, 4)``. Raises ParameterError for another joint, if the regression does not reach the speed, or if the
    height is not positive.
    """
    _require_covered(speed, height)
    b0, b1, b2, b3 = _coefficients()[coerce(JointName, "joint", joint)]
    v = speed * KILOMETRES_PER_HOUR
    events = b0 + b1 * v + b2 * v * v + b3 * height
    events[:, 0] = (events[:, 0] - FIRST_SAMPLE) / SAMPLES_PER_PERCENT
    events[:, 1:] *= math.pi / 180.0
    events[:, 2] *= SAMPLES_PER_PERCENT
    events[:, 3] *= SAMPLES_PER_PERCENT**2
    return np.asarray(events)


@lru_cache(maxsize=1)
def _coefficients() -> dict[JointName, np.ndarray]:
    """Read the coefficients b of each key event by joint, shape ``(4, n, 4)``: b, event, quantity."""
    lines = Path(__file__).with_name("koopman2014.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    names = [f"{name}_b{power}" for power in range(4) for name in _QUANTITIES]
    values = np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, 4, 4)
    joints = np.array([row["joint"] for row in rows])
    return {joint: values.swapaxes(0, 1)[:, joints == joint] for joint in JointName}


def reference_curve(joint: JointName, percent: np.ndarray, *, speed: float, height: float) -> np.ndarray:
    """Compute the angle of a joint over the gait cycle in healthy walking.

    ``percent``: instants in [%] of the cycle from heel strike, any shape; the cycle repeats. Returns angles
    in [rad], shape of ``percent``; flexion and dorsiflexion positive. Raises ParameterError if the regression
    does not reach the speed, or if the height is not positive.
    """
    events = key_events(joint, speed=speed, height=height)
    starts = np.append(events[:, 0], CYCLE)
    coefficients, at = _bernstein(starts, *events[:, 1:].T), np.mod(np.asarray(percent, dtype=float), CYCLE)
    interval = np.clip(np.searchsorted(starts, at, side="right") - 1, 0, len(events) - 1)
    share = (at - starts[interval]) / (starts[interval + 1] - starts[interval])
    found = np.zeros_like(share)
    for j, binomial in enumerate((1.0, 5.0, 10.0, 10.0, 5.0, 1.0)):
        found = found + binomial * _power(share, j) * _power(1.0 - share, 5 - j) * coefficients[interval, j]
    return np.asarray(found)


def _power(values: np.ndarray, exponent: int) -> np.ndarray:
    """Raise values to a power by the C library; the powers of NumPy differ between processors."""
    if exponent < 2:  # exact everywhere
        return np.asarray(values**exponent)
    return np.array(list(map(math.pow, values.ravel().tolist(), repeat(exponent)))).reshape(values.shape)


def _bernstein(
    starts: np.ndarray, angle: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Compute the coefficients of the polynomials of degree five between consecutive events, a row each."""
    span = np.diff(starts)
    squared = _power(span, 2)
    end_angle, end_velocity, end_acceleration = np.roll((angle, velocity, acceleration), -1, axis=1)
    first = velocity / 5.0 * span + angle
    last = end_angle - end_velocity / 5.0 * span
    second = acceleration / 20.0 * squared - angle + 2.0 * first
    last_but_one = end_acceleration / 20.0 * squared + 2.0 * last - end_angle
    return np.column_stack((angle, first, second, last_but_one, last, end_angle))


def reference_cycle_time(speed: float, height: float) -> float:
    r"""Compute the duration of the gait cycle in healthy walking.

    With the step ratio :math:`r` (step length over cadence), :math:`T = 2 \sqrt{r / v}`. Returns the duration
    in [s]. Raises ParameterError if the regression does not reach the speed, or if the height is too small
    for it.
    """
    _require_covered(speed, height)
    constant, with_speed, with_height = STEP_RATIO
    ratio = constant + with_speed * speed * KILOMETRES_PER_HOUR + with_height * height
    require(ratio > 0.0, "height", "a height that gives a positive step ratio", height)
    return 2.0 * math.sqrt(ratio / speed)


# Share of the stride in double support, by speed [m/s]: means of people who were instructed to walk slowly
# and at their own pace (supplemental table 5 of a study whose title the copy does not give, found; standard
# deviations of 19 and 9 points). Two treadmill studies give 46 to 48 % at 0.43 to 0.50 m/s (doi
# 10.1186/s12984-023-01286-6, table 3, found), and stance durations of 64.2 - 3.5 v % (Kirtley et al. 1985,
# found) give 19 % at 1.3 m/s, where the line below gives 21 %.
_SLOW_DOUBLE_SUPPORT, _OWN_DOUBLE_SUPPORT = (0.39, 0.462), (0.93, 0.310)


def reference_double_support(speed: float) -> float:
    """Compute the share of the stride with both feet loaded in healthy walking at a speed in [m/s].

    It is a line through two published pairs of speed and share, whose standard deviations are 19 and 9
    percent of the stride.
    """
    (slow, share), (faster, smaller) = _SLOW_DOUBLE_SUPPORT, _OWN_DOUBLE_SUPPORT
    return share + (smaller - share) * (speed - slow) / (faster - slow)


def _require_covered(speed: float, height: float) -> None:
    """Raise ParameterError unless the height is positive and the regression covers the speed."""
    POSITIVE.require("height", height)
    expected = f"{SLOWEST:.2f} to {FASTEST:.2f} m/s, for which there are reference curves"
    require(reference_covers(speed), "speed", expected, speed)


def gait_variable_score(cycles: np.ndarray, reference: np.ndarray) -> float:
    r"""Compute the Gait Variable Score: root mean square distance of the mean stride from a reference.

    .. math::

        \mathrm{GVS} = \sqrt{\frac{1}{T} \sum_{t=1}^{T} (\bar x_t - \bar x^{ref}_t)^2}

    after R. Baker, J. L. McGinley, M. H. Schwartz, S. Beynon, A. Rozumalski, H. K. Graham, O. Tirosh: The
    Gait Profile Score and Movement Analysis Profile, Gait & Posture 30 (2009) 265-269. The mean stride is
    compared, not each stride, so the variation between strides does not count.

    ``cycles``: one joint angle over the cycle, a row a stride, whose last sample is the first of the next
    stride, shape ``(n_strides, n_samples)``; ``reference``: curve at the same instants, shape
    ``(n_samples,)``, same unit. Returns the score in the unit of the curves; NaN without strides.
    """
    if len(cycles) == 0:
        return math.nan
    return root_mean_square((cycles.mean(axis=0) - reference)[:-1])


def gait_profile_score(scores: Sequence[float]) -> float:
    """Compute the root mean square of the Gait Variable Scores of several joints.

    The published score has nine variables; a device that moves hips and knees has two a side. ``scores``:
    Gait Variable Scores in one unit. Returns the score in the same unit; NaN without any.
    """
    if len(scores) == 0:
        return math.nan
    return math.sqrt(sum(score * score for score in scores) / len(scores))


WINTER_CYCLE_TIME = 1.1396  # [s], Winter (1991) at natural cadence
WINTER_SPEED = 1.325  # [m/s]
WINTER_JOINTS = (JointName.HIP, JointName.KNEE)


@lru_cache(maxsize=1)
def _table() -> np.ndarray:
    """Read percent, two angles in [deg], two extensor moments in [N·m/kg], two forces in [N/kg]."""
    table = np.loadtxt(Path(__file__).with_name("winter1991.csv"), delimiter=",", skiprows=4)
    table.setflags(write=False)
    return table


def _column_of(joint: str, first: int) -> np.ndarray:
    """Return the column of a joint in the table, where ``first`` is the column of the hip.

    Raises ParameterError for a joint that the table does not have.
    """
    require(joint in WINTER_JOINTS, "joint", " or ".join(WINTER_JOINTS), joint)
    return np.asarray(_table()[:, first + WINTER_JOINTS.index(JointName(joint))])


def normative_angle(joint: str, percent: np.ndarray) -> np.ndarray:
    """Compute the angle of a joint in healthy walking at natural cadence.

    The means at 0 and 100 % differ by up to 1.8 degrees; the last one is left out, so that the cycle closes.
    ``joint``: ``hip`` or ``knee``; ``percent`` of the gait cycle from foot contact, in [%], any shape; the
    cycle repeats. Returns the angle in [rad], flexion positive, the same shape.
    """
    from scipy.interpolate import CubicSpline  # takes longer to import than a walk to simulate

    degrees = _column_of(joint, 1)
    closed = np.append(degrees[:-1], degrees[0])
    spline = CubicSpline(_table()[:, 0], np.radians(closed), bc_type="periodic")
    return np.asarray(spline(np.mod(percent, CYCLE)))


def normative_moment(joint: str, percent: np.ndarray) -> np.ndarray:
    """Compute the flexor moment of healthy slow walking per body mass.

    Winter counts extensor moments positive; here flexor moments are, as everywhere in this package.
    ``joint``: ``hip`` or ``knee``; ``percent`` of the gait cycle from foot contact, in [%], any shape.
    Returns the moment in [N·m/kg], the same shape.
    """
    return np.asarray(np.interp(np.mod(percent, CYCLE), _table()[:, 0], -_column_of(joint, 3)))


WINTER_SLOW_SPEED = 1.0  # approximate speed at Winter's slow cadence (recalled), [m/s]
WINTER_GRAVITY = 9.81  # [m/s²]


class GroundForce(NamedTuple):
    """Force of the ground on a foot divided by body weight, in the shape of the requested instants."""

    vertical: np.ndarray  # vertical force, positive upwards
    forward: np.ndarray  # fore-aft force, negative where it brakes


def normative_ground_force(percent: np.ndarray, *, speed: float) -> GroundForce:
    """Compute the force of the ground in healthy walking, divided by the weight that is carried.

    The forces are Winter's at slow cadence, the slowest that he gives. The forward force is scaled in
    proportion to the speed: its largest values of 0.162, 0.223 and 0.262 body weights at 1.0, 1.325 and
    1.7 m/s are 0.154 to 0.168 of the speed in m/s. Below 1 m/s this is extrapolated; the vertical force is
    not scaled. Coefficients of a regression for these speeds were not found (docs/reference/running.md).
    ``percent`` of the gait cycle from foot contact, in [%], any shape; the cycle repeats; ``speed``: walking
    speed in [m/s].
    """
    instants, table = np.mod(percent, CYCLE), _table() / WINTER_GRAVITY
    vertical, forward = (np.interp(instants, _table()[:, 0], table[:, column]) for column in (5, 6))
    return GroundForce(vertical, forward * speed / WINTER_SLOW_SPEED)
