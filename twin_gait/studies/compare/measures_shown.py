"""Which numbers a comparison shows, in which words, and what each of them means."""

from __future__ import annotations

import math
from typing import NamedTuple

from twin_gait.studies.compare.comparing import Comparison, Interval


class Shown(NamedTuple):
    """A row of the table.

    Attributes:
        group: Heading that it stands under.
        number: Name of the number.
        label: What it is, with its unit.
        factor: From the number to what is shown.
        digits: After the point.
        meaning: In plain words.
    """

    group: str
    number: str
    label: str
    factor: float
    digits: int
    meaning: str


_GAIT, _SYMMETRY, _TORQUE, _WORK, _MOTORS = "gait", "symmetry", "torque", "work and help", "motors"
_INDEX = "difference of left and right over their mean; 0 is even, minus means less on the left"
SHOWN = (
    Shown(
        _GAIT,
        "walked_s",
        "walked for [s]",
        1.0,
        1,
        "until a fall or a stop by the safety monitor, or to the end",
    ),
    Shown(_GAIT, "stride_time_s", "stride time [s]", 1.0, 2, "from heel strike to heel strike of a foot"),
    Shown(_GAIT, "stride_length_m", "stride length [m]", 1.0, 2, "way of the belt in a stride"),
    Shown(_GAIT, "double_support_share", "both feet down [%]", 100.0, 0, "share of the stride"),
    Shown(_GAIT, "hip_range_of_motion_deg", "hip motion [°]", 1.0, 0, "from most extended to most flexed"),
    Shown(_GAIT, "knee_range_of_motion_deg", "knee motion [°]", 1.0, 0, "the same for the knee"),
    Shown(
        _GAIT,
        "gps_koopman_deg",
        "distance from slow healthy gait [°]",
        1.0,
        1,
        "Gait Variable Score (Baker et al. 2009), mean of hips and knees, against Koopman et al. (2014) at "
        "this speed and height",
    ),
    Shown(
        _GAIT,
        "gps_winter_deg",
        "distance from natural gait [°]",
        1.0,
        1,
        "the same against Winter (1991) at natural cadence",
    ),
    Shown(_GAIT, "toe_clearance_m", "least foot clearance [mm]", 1e3, 0, "in the middle half of the swing"),
    Shown(
        _GAIT,
        "smoothness",
        "smoothness",
        1.0,
        1,
        "minus the logarithm of dimensionless jerk; nearer 0 is smoother",
    ),
    Shown(_SYMMETRY, "step_time_symmetry", "step time, left against right [%]", 100.0, 1, _INDEX),
    Shown(_SYMMETRY, "hip_range_symmetry", "hip motion, left against right [%]", 100.0, 1, _INDEX),
    Shown(_SYMMETRY, "interaction_symmetry", "device torque, left against right [%]", 100.0, 1, _INDEX),
    Shown(
        _TORQUE,
        "hip_interaction_rms_Nm",
        "device torque on the hip [N m]",
        1.0,
        1,
        "interaction torque: what the motor does on the leg behind its gear, less friction and the rotor's "
        "own acceleration; root mean square. Leg and frame are one rigid body here; where braces bind the "
        "wearer, the torque of the brace",
    ),
    Shown(
        _TORQUE,
        "knee_interaction_rms_Nm",
        "device torque on the knee [N m]",
        1.0,
        1,
        "interaction torque at the knee",
    ),
    Shown(
        _TORQUE,
        "effort_rms_Nm",
        "wearer's effort [N m]",
        1.0,
        1,
        "torque of the muscles on purpose, mean of hips and knees",
    ),
    Shown(
        _TORQUE,
        "opposing_rms_Nm",
        "against each other [N m]",
        1.0,
        1,
        "torque with which device and effort cancel each other",
    ),
    Shown(
        _WORK,
        "wearer_work_share",
        "wearer's share of the work [%]",
        100.0,
        0,
        "of the positive joint work of effort and device",
    ),
    Shown(
        _WORK,
        "help_share",
        "help given [%]",
        100.0,
        0,
        "share of the spring that is given in the second half of the run; 0 without a spring",
    ),
    Shown(
        _MOTORS,
        "battery_power_W",
        "battery power [W]",
        1.0,
        0,
        "of the four motors, mean; electronics left out",
    ),
    Shown(_MOTORS, "battery_life_h", "battery life [h]", 1.0, 1, "of the full battery at that power"),
    Shown(
        _MOTORS, "energy_per_metre_J", "energy a metre [J]", 1.0, 0, "from the battery, per metre of the belt"
    ),
    Shown(
        _MOTORS,
        "current_rms_share",
        "motor current, of what it can hold [%]",
        100.0,
        0,
        "root mean square over the continuous current, the hottest of four; above 100 it overheats",
    ),
)


def text_of(found: Interval, shown: Shown) -> str:
    """A number as the table shows it.

    Args:
        found: Mean and interval.
        shown: Factor and digits.

    Returns:
        ``12.3 ± 0.4``; a dash where there is no number.
    """
    if math.isnan(found.mean):
        return "–"
    if math.isinf(found.mean):
        return "∞"
    text = _number(shown.factor * found.mean, shown.digits)
    if math.isnan(found.half_width):
        return text
    return f"{text} ± {_number(shown.factor * found.half_width, shown.digits)}"


def _number(value: float, digits: int) -> str:
    rounded = round(value, digits) + 0.0  # no minus before a zero
    return f"{rounded:.{digits}f}".replace("-", "−")


def table_rows(comparison: Comparison) -> list[tuple[str, str, str, list[str]]]:
    """The table of a report.

    Args:
        comparison: The comparison.

    Returns:
        Group, label, meaning, and one text per controller, for every row.
    """
    rows = []
    for shown in SHOWN:
        texts = [
            text_of(comparison.interval(item.name, shown.number), shown) for item in comparison.controllers
        ]
        rows.append((shown.group, shown.label, shown.meaning, texts))
    return rows
