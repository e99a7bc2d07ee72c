"""What becomes of a joint whose friction is compensated by a factor G of a model that is 1/s too strong?

Three parts: a map of G, s, filter delay and load for three ways to compensate; gains at which the joint
stops coming to rest (:mod:`twin_gait.studies.whatif.friction_limits`); and what each way costs
(:mod:`twin_gait.studies.whatif.friction_price`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import pandas as pd

from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.whatif.friction_joint import (
    DEGREE,
    FILTERS,
    PUSH,
    Compensation,
    Setting,
    bench_of,
    growth_at_rest,
)
from twin_gait.studies.whatif.friction_limits import questions, threshold_row
from twin_gait.studies.whatif.friction_price import price_row, prices
from twin_gait.studies.whatif.rig import PUSHED_DURATION, mean_delay, outcome, push
from twin_gait.studies.whatif.work import Job, Means, Row, tables_of

GAINS = tuple(round(0.1 * step, 1) for step in range(1, 14))
# None of the ratios is one of the gains, where the joint is neutral.
RATIOS = (0.35, 0.55, 0.75, 0.95, 1.15)
LOADS = (0.0, 3.0)  # [kg], none and the thesis's largest
SMALL_PUSH = 0.04  # [rad] / [s], within the dead zone


def push_row(setting: Setting) -> Row:
    """Push a joint and judge what becomes of it.

    Args:
        setting: The setting.

    Returns:
        A row of the map.
    """
    test = replace(bench_of(setting), hand=push(setting.push), duration=PUSHED_DURATION)
    ending, amplitude = outcome(simulate_bench(test))
    return {
        "compensation": str(setting.compensation),
        "gain": setting.gain,
        "friction_ratio": setting.ratio,
        "filter_delay_ms": 1e3 * mean_delay(test.sensors),
        "load_kg": setting.load,
        "push_rad_per_s": setting.push,
        "growth_at_rest_per_s": round(growth_at_rest(setting), 5),
        "ending": str(ending),
        "amplitude_deg": round(amplitude / DEGREE, 3),
    }


def map_settings(*, quick: bool = False) -> list[Setting]:
    """Settings of the map, in order.

    Args:
        quick: A twentieth of them.

    Returns:
        The settings. The filter is nothing to a reference velocity, so that one filter is enough there.
    """
    gains, ratios = (GAINS[2::5], RATIOS[1::2]) if quick else (GAINS, RATIOS)
    filters, loads = (FILTERS[2:3], LOADS) if quick else (FILTERS, LOADS)
    base = list(itertools.product(gains, ratios))
    measured = [
        Setting(gain=gain, ratio=ratio, filter=kept, load=load)
        for kept, load, (gain, ratio) in itertools.product(filters, loads, base)
    ]
    ways = (
        (Compensation.DEAD_ZONE, SMALL_PUSH),
        (Compensation.DEAD_ZONE, PUSH),
        (Compensation.REFERENCE, PUSH),
    )
    others = [
        Setting(compensation=way, push=speed, gain=gain, ratio=ratio, load=load)
        for (way, speed), load, (gain, ratio) in itertools.product(ways, loads, base)
    ]
    return measured + others


# ---------------------------------------------------------------------- study


@dataclass(frozen=True, eq=False)
class FrictionMap:
    """Results of the study.

    Attributes:
        map: One row per setting of :func:`map_settings`.
        thresholds: One row per question.
        prices: One row per way and gain.
    """

    map: pd.DataFrame
    thresholds: pd.DataFrame
    prices: pd.DataFrame


def study_friction_map(means: Means, *, quick: bool = False) -> FrictionMap:
    """Run the whole study.

    Args:
        means: Processes, progress, interruption.
        quick: A small part of each grid.

    Returns:
        The tables.

    Raises:
        Interrupted: If it was stopped.
    """
    parts = (
        [Job(push_row, setting) for setting in map_settings(quick=quick)],
        [Job(threshold_row, question) for question in questions(quick=quick)],
        [Job(price_row, price) for price in prices(quick=quick)],
    )
    return FrictionMap(*tables_of(parts, means))
