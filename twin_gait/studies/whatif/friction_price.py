"""What each way to compensate friction costs: the hand that leads the joint, the path that it follows."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

from twin_gait.gait.table import TICK
from twin_gait.measures.effort import root_mean_square
from twin_gait.scenario.bench_joint import CosinePath, TorqueControl
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.whatif.friction_joint import DEGREE, Compensation, Setting, bench_of
from twin_gait.studies.whatif.rig import (
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    LEVEL,
    feeling,
    inertia,
)
from twin_gait.studies.whatif.work import Row

GAINS = tuple(round(0.1 * step, 1) for step in range(12))


class Price(NamedTuple):
    """One way to compensate at one gain, at the thesis's filter and ratio.

    Attributes:
        compensation: Where the compensated velocity comes from.
        gain: G.
    """

    compensation: Compensation
    gain: float


def prices(*, quick: bool = False) -> list[Price]:
    """What is priced, in order."""
    gains = GAINS[::4] if quick else GAINS
    return [Price(way, gain) for way, gain in itertools.product(Compensation, gains)]


def price_row(price: Price) -> Row:
    """What the hand feels of a joint without a spring, and how well a joint with one follows a path.

    Args:
        price: Way and gain.

    Returns:
        A row.
    """
    setting = Setting(compensation=price.compensation, gain=price.gain)
    free = bench_of(setting._replace(spring=0.0))
    hand = feeling(free)
    plain = feeling(bench_of(Setting(gain=0.0, spring=0.0)))
    return {
        "compensation": str(price.compensation),
        "gain": price.gain,
        "friction_ratio": setting.ratio,
        "hand_work_J": round(hand.work, 4),
        "hand_work_share": round(hand.work / plain.work, 4),
        "hand_friction_Nm": round(hand.friction, 4),
        "path_error_deg": round(_path_error(setting) / DEGREE, 4),
    }


def _path_error(setting: Setting) -> float:
    """RMS error in [rad] of a joint that is led along the hand's path by its own spring, second cycle."""
    test = bench_of(setting)
    assert isinstance(test.control, TorqueControl)
    path = CosinePath(start_angle=LEVEL, amplitude=HAND_AMPLITUDE, frequency=HAND_FREQUENCY)
    damping = 2.0 * 0.7 * math.sqrt(setting.spring * inertia(test))  # ζ = 0.7
    control = replace(test.control, path=path, damping=damping)
    run = simulate_bench(replace(test, control=control, duration=2.0 / HAND_FREQUENCY))
    cycle = slice(-round(1.0 / HAND_FREQUENCY / TICK), None)
    error = (run.column("link_angle_rad") - run.column("target_position_rad"))[cycle]
    return root_mean_square(error)
