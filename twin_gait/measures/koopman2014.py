"""Coefficients of the walking regression of Koopman et al. (2014).

B. Koopman, E. H. F. van Asseldonk, H. van der Kooij: Speed-dependent reference joint trajectory
generation for robotic gait support, Journal of Biomechanics 47 (2014) 1447-1458.
:mod:`twin_gait.measures.reference` makes curves of them.
"""

from __future__ import annotations

from typing import NamedTuple

from twin_gait.vocabulary import JointName

# The regression counts instants as samples: heel contact is the first, the next one the last.
FIRST_SAMPLE, LAST_SAMPLE = 1.0, 100.0

# b0, b1 with the speed in km/h, b2 with its square, b3 with the body height in m.
Coefficients = tuple[float, float, float, float]
NOTHING: Coefficients = (0.0, 0.0, 0.0, 0.0)
HEEL_CONTACT: Coefficients = (FIRST_SAMPLE, 0.0, 0.0, 0.0)


class EventRegression(NamedTuple):
    """Coefficients of one key event.

    An extreme of the angle has no velocity, an extreme of the velocity no acceleration.

    Attributes:
        timing: Of the instant, in samples.
        angle: Of the angle in [deg].
        velocity: In [deg] / sample.
        acceleration: In [deg] / sample².
    """

    timing: Coefficients
    angle: Coefficients
    velocity: Coefficients
    acceleration: Coefficients


# Koopman et al. (2014), tables 2 to 5. Two cells are blank in the copy that they were taken from, and 0
# here: the speed² coefficient of the velocity of the knee's fastest extension, and the height
# coefficient of the timing of the ankle's lowest angle in stance.
HIP_EVENTS = (
    EventRegression(  # heel contact
        HEEL_CONTACT, (20.354, 1.934, 0.0, 0.0), (-2.062, 0.0, 0.0, 1.112), (-0.068, 0.031, 0.0, 0.0)
    ),
    EventRegression(  # highest in stance
        (-10.809, 0.0, 0.0, 11.762), (18.917, 2.583, 0.0, 0.0), NOTHING, (-0.112, 0.0, 0.0, 0.0)
    ),
    EventRegression(  # half-way through stance
        (24.512, -2.021, 0.195, 5.109),
        (4.845, 1.718, 0.0, 0.0),
        (-0.240, -0.224, 0.0, 0.0),
        (0.026, -0.010, 0.0, 0.0),
    ),
    EventRegression(  # lowest
        (48.879, -3.854, 0.355, 9.891), (-2.026, -2.090, 0.0, 0.0), NOTHING, (-0.117, 0.059, -0.007, 0.098)
    ),
    EventRegression(  # fastest flexion
        (80.562, -6.432, 0.885, 0.0), (20.030, 0.0, 0.0, -7.732), (0.472, 0.096, 0.0, 0.633), NOTHING
    ),
    EventRegression(  # highest in swing
        (94.280, -0.601, 0.0, 0.0), (21.447, 2.318, 0.0, 0.0), NOTHING, (-0.083, 0.0, -0.002, 0.0)
    ),
)
KNEE_EVENTS = (
    EventRegression(  # heel contact
        HEEL_CONTACT, (31.595, -4.311, 0.494, -13.050), (-3.581, 0.0, 0.0, 1.977), (0.301, 0.073, 0.0, 0.0)
    ),
    EventRegression(  # highest in stance
        (17.103, 0.0, 0.0, 0.0), (5.995, 3.028, 0.0, 0.0), NOTHING, (-0.094, 0.0, -0.005, 0.0)
    ),
    EventRegression(  # lowest in stance
        (48.542, -0.998, 0.0, 0.0), (-10.037, 0.0, 0.0, 7.594), NOTHING, (0.042, 0.0, 0.004, 0.0)
    ),
    EventRegression(  # fastest flexion
        (68.947, -6.096, 0.611, 5.967), (29.618, 3.803, -0.486, 0.0), (3.276, 0.0, 0.0, 0.0), NOTHING
    ),
    EventRegression(  # highest in swing
        (85.816, -4.480, 0.519, 0.0), (38.110, 9.744, -1.105, 0.0), NOTHING, (-0.784, 0.225, -0.026, 0.0)
    ),
    EventRegression(  # fastest extension
        (92.489, 0.0, 0.0, 0.0), (24.631, -0.967, 0.0, 0.0), (-0.446, -0.032, 0.0, -1.696), NOTHING
    ),
)
ANKLE_EVENTS = (
    EventRegression(  # heel contact
        HEEL_CONTACT, (18.645, 0.554, 0.0, -13.246), (-0.145, 0.0, -0.020, 0.0), (0.145, -0.137, 0.015, 0.0)
    ),
    EventRegression(  # lowest in stance
        (8.145, 0.331, 0.0, 0.0), (17.309, 0.0, 0.0, -14.173), NOTHING, (-0.556, 0.0, 0.0, 0.492)
    ),
    EventRegression(  # extreme of the velocity in stance
        (12.005, 0.0, 0.0, 13.754), (0.836, 0.812, 0.0, 0.0), (-0.991, 0.0, 0.0, 0.620), NOTHING
    ),
    EventRegression(  # highest
        (67.686, -5.469, 0.493, 0.0), (-15.523, 0.0, 0.0, 14.494), NOTHING, (0.055, -0.019, 0.0, -0.089)
    ),
    EventRegression(  # lowest in swing
        (73.460, -6.699, 0.744, 6.463), (21.984, -3.425, 0.0, -12.522), NOTHING, (0.433, 0.0, 0.0, 0.0)
    ),
    EventRegression(  # highest in swing
        (87.621, 0.0, 0.132, 0.0), (4.860, -0.655, 0.0, 0.0), NOTHING, (0.412, 0.087, -0.012, -0.425)
    ),
)
EVENTS = {JointName.HIP: HIP_EVENTS, JointName.KNEE: KNEE_EVENTS, JointName.ANKLE: ANKLE_EVENTS}

# Of step length over cadence, the same source: constant, speed in km/h, height in m.
STEP_RATIO = (-0.532, 0.020, 0.470)
