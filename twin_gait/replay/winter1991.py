"""Joint angles of healthy walking at natural cadence, after Winter (1991).

D. A. Winter: The biomechanics and motor control of human gait, 2nd edition, University of Waterloo Press,
1991: means over 19 subjects, every 2 % of the cycle from heel contact to the next, in [deg], hip and knee
flexion positive. Duration and speed are those that public copies of the table carry (105.3 steps a minute).
"""

from __future__ import annotations

CYCLE_TIME = 1.1396  # [s]
SPEED = 1.325  # [m] / [s]
PERCENT_STEP = 2.0

# Hip, knee.
ANGLES = (
    (19.33, 3.97),
    (18.92, 7.0),
    (18.45, 10.52),
    (17.94, 14.12),
    (17.3, 17.38),
    (16.4, 19.84),
    (15.18, 21.27),
    (13.67, 21.67),
    (11.97, 21.22),
    (10.21, 20.2),
    (8.48, 18.86),
    (6.74, 17.35),
    (4.94, 15.73),
    (3.13, 14.08),
    (1.42, 12.5),
    (-0.13, 11.09),
    (-1.54, 9.91),
    (-2.87, 8.97),
    (-4.12, 8.28),
    (-5.3, 7.86),
    (-6.4, 7.72),
    (-7.43, 7.94),
    (-8.39, 8.6),
    (-9.27, 9.76),
    (-10.02, 11.5),
    (-10.61, 13.86),
    (-10.95, 16.97),
    (-10.91, 20.96),
    (-10.31, 26.0),
    (-9.0, 32.63),
    (-6.95, 38.74),
    (-4.25, 45.6),
    (-1.05, 52.05),
    (2.42, 57.54),
    (5.93, 61.66),
    (9.22, 64.12),
    (12.11, 64.86),
    (14.55, 63.95),
    (16.53, 61.59),
    (18.13, 57.97),
    (19.45, 53.27),
    (20.54, 47.58),
    (21.38, 40.94),
    (21.84, 33.46),
    (21.87, 25.38),
    (21.5, 17.27),
    (20.84, 9.94),
    (20.09, 4.31),
    (19.5, 1.12),
    (19.18, 0.54),
    (19.01, 2.21),
)
