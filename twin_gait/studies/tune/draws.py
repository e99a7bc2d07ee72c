"""Random worlds of a robust tuning: wearers, drives, ground, sensors and arms are drawn together."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from scipy.stats import qmc

from twin_gait.experiment.experiment import Experiment
from twin_gait.studies.tune.walks import apply_changes
from twin_gait.worlds.world import BELT_SPEED, SUPPORT_SHARE
from twin_gait.yaml12 import load_data

_RANGES = load_data(Path(__file__).with_name("draws.yaml"))
_ADJUSTMENTS = (BELT_SPEED, SUPPORT_SHARE)
# Stream of the held-out draws; those of the search have the number of the generation.
HELD_OUT = 1_000_000


def draw_ranges(nominal: Experiment) -> dict[str, Mapping[str, Any]]:
    """Return the ranges of the drawn numbers of an experiment by key."""
    return {**_RANGES["all"], **_RANGES.get(nominal.scenario.kind, {})}


def draw_worlds(nominal: Experiment, count: int, seed: int, stream: int) -> dict[str, Experiment]:
    """Draw random worlds around an experiment.

    Args:
        nominal: Experiment for which a table is tuned.
        count: Number of worlds.
        seed: Seed of the tuning.
        stream: Number of the draw; equal seeds and streams give equal worlds.

    Returns:
        The experiments by names.

    Raises:
        ParameterError: If the experiment has no such numbers.
    """
    ranges = draw_ranges(nominal)
    points = qmc.LatinHypercube(len(ranges), rng=[seed, stream]).random(count)
    return {
        f"draw {number + 1}": _world(nominal, dict(zip(ranges, point.tolist(), strict=True)), seed + number)
        for number, point in enumerate(points)
    }


def _world(nominal: Experiment, point: Mapping[str, float], seed: int) -> Experiment:
    """Return the world at a point of the unit cube of all ranges."""
    values = {key: _value(point[key], **row) for key, row in draw_ranges(nominal).items()}
    adjusted = {key: values.pop(key) for key in _ADJUSTMENTS if key in values}
    changes = {"control.patient": None, "sensors.ideal": False, "seed": seed, **values}
    world = apply_changes(nominal, changes)
    scenario = world.scenario
    for name, value in adjusted.items():
        scenario = scenario.replace_adjustment(name, value)
    return replace(world, scenario=scenario)


def _value(share: float, lower: float, upper: float, logarithmic: bool = False) -> float:
    if logarithmic:
        return lower * math.pow(upper / lower, share)
    return lower + share * (upper - lower)
