"""Which numbers of a table matter: elementary effects after Morris.

M. D. Morris: Factorial sampling plans for preliminary computational experiments, Technometrics 33 (1991)
161-174, with the mean of the magnitudes (mu star) of Campolongo et al. (2007), computed by SALib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.studies.tune.parts import WORST
from twin_gait.studies.tune.space import Parameter

LEVELS = 4
# Of the unit cube, to either side of the start. Many numbers change at once: at 0.15 nearly all points fall
# or are forbidden, which tells nothing about the rest; at 0.04 143 of 204 walk (tried on the shipped table).
REACH = 0.04
TRAJECTORIES = 4
# The search gets the numbers that make up this share of all effects.
KEPT_SHARE = 0.95
FEWEST = 30


@dataclass(frozen=True)
class Effect:
    """What a number of the table does to the cost.

    Attributes:
        name: Of the parameter.
        mu_star: Mean magnitude of its elementary effects on log(1 + cost), with no cost above that of
            the worst walk.
        mu_star_conf: Half the 95 % interval of it.
        sigma: Standard deviation of the effects: interaction and curvature.
        kept: Whether the search changes it.
    """

    name: str
    mu_star: float
    mu_star_conf: float
    sigma: float
    kept: bool


def plan(parameters: Sequence[Parameter], seed: int, trajectories: int = TRAJECTORIES) -> np.ndarray:
    """Points to be walked: trajectories that change one number at a time.

    Args:
        parameters: The numbers.
        seed: Of the draw.
        trajectories: How many.

    Returns:
        Coordinates from 0 to 1, shape ``(trajectories * (n + 1), n)``.

    Raises:
        MissingOptionalDependency: If SALib is not installed.
    """
    sample, _ = _salib()
    return np.asarray(sample.sample(_problem(parameters), trajectories, num_levels=LEVELS, seed=seed))


def effects(
    parameters: Sequence[Parameter], points: np.ndarray, costs: Sequence[float], seed: int
) -> list[Effect]:
    """Effects of all numbers, and which of them the search gets.

    Args:
        parameters: The numbers.
        points: From :func:`plan`.
        costs: Of each point.
        seed: Of the interval's resampling.

    Returns:
        One per parameter, in their order.
    """
    _, analysis = _salib()
    # Falls and forbidden tables cost ten to a hundred times a walk: uncut they alone would rank the numbers.
    responses = np.log1p(np.minimum(np.asarray(costs, dtype=float), WORST))
    found = analysis.analyze(
        _problem(parameters), points, responses, num_levels=LEVELS, seed=seed, print_to_console=False
    )
    mu_star = [_number(value) for value in found["mu_star"]]
    kept = keep(mu_star)
    return [
        Effect(
            parameter.name,
            mu_star[i],
            _number(found["mu_star_conf"][i]),
            _number(found["sigma"][i]),
            i in kept,
        )
        for i, parameter in enumerate(parameters)
    ]


def keep(mu_star: Sequence[float], fewest: int = FEWEST) -> set[int]:
    """The fewest numbers that make up ``KEPT_SHARE`` of all effects.

    Args:
        mu_star: Effects.
        fewest: Numbers that are kept at least.

    Returns:
        Their positions.
    """
    order = sorted(range(len(mu_star)), key=lambda i: (-mu_star[i], i))
    total, kept, share = sum(mu_star), set[int](), 0.0
    for position in order:
        if share >= KEPT_SHARE * total and len(kept) >= fewest:
            break
        kept.add(position)
        share += mu_star[position]
    return kept


def _problem(parameters: Sequence[Parameter]) -> dict[str, Any]:
    bounds = []
    for parameter in parameters:
        centre = parameter.start_coordinate
        low = min(max(0.0, centre - REACH), 1.0 - 2.0 * REACH)
        bounds.append([low, low + 2.0 * REACH])
    return {"num_vars": len(parameters), "names": [item.name for item in parameters], "bounds": bounds}


def _number(value: Any) -> float:
    number = float(value)
    return number if math.isfinite(number) else 0.0


def _salib() -> tuple[Any, Any]:
    try:
        return import_module("SALib.sample.morris"), import_module("SALib.analyze.morris")
    except ImportError as error:
        raise MissingOptionalDependency("SALib", "tune", "the screening of twin-gait tune") from error
