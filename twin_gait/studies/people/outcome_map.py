"""Who walks: the outcome of one experiment over a grid of wearers, speeds and supports."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import pandas as pd

from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.scenario import TreadmillScenario
from twin_gait.studies.batch import overridden, simulate_batch
from twin_gait.vocabulary import Outcome, Side

MASSES = (55.0, 65.0, 75.0, 85.0, 95.0)  # [kg]
HEIGHTS = (1.60, 1.70, 1.80, 1.90)  # [m]
SPEEDS = (0.30, 0.34, 0.38, 0.42)  # [m] / [s]
SUPPORTS = (0.40, 0.50, 0.60, 0.70)  # share of the weight


class Case(NamedTuple):
    """One point of the grid.

    Attributes:
        mass: In [kg].
        height: In [m].
        speed: Of the belt in [m] / [s].
        support: Share of the weight.
    """

    mass: float
    height: float
    speed: float
    support: float


def grid() -> list[Case]:
    """All points of the grid, in order."""
    return [Case(*values) for values in itertools.product(MASSES, HEIGHTS, SPEEDS, SUPPORTS)]


def changes_of(case: Case) -> dict[str, float]:
    """What a case changes, by the keys of an experiment."""
    return {
        "patient.mass_kg": case.mass,
        "patient.height_m": case.height,
        "scenario.belt_speed_m_per_s": case.speed,
        "scenario.support.share": case.support,
    }


def experiment_of(base: Experiment, case: Case) -> Experiment:
    """The base experiment with the wearer, speed and support of a case.

    Args:
        base: A treadmill experiment with a wearer.
        case: Point of the grid.

    Returns:
        The experiment.

    Raises:
        ParameterError: If the base has no treadmill or no wearer.
        ParameterFileError: If the case is out of range.
    """
    _check_walker(base)
    return overridden(base, changes_of(case), base.name)


def map_outcomes(
    base: Experiment,
    cases: Iterable[Case],
    *,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Simulate many cases with the base's engine.

    Args:
        base: The experiment that is varied.
        cases: Points of the grid.
        workers: Processes.
        progress: Called with cases done and in all.

    Returns:
        One row per case in the order of the cases.

    Raises:
        ParameterError: If the base has no treadmill or no wearer.
        ParameterFileError: If a case is out of range.
    """
    _check_walker(base)
    cases = list(cases)
    changes = [changes_of(case) for case in cases]
    batch = simulate_batch(base, changes, workers=workers, engine=base.engine, progress=progress)
    episodes = batch.table.to_dict("records")
    return pd.DataFrame(
        [_row(case, episode, tuple(base.leg.legs)) for case, episode in zip(cases, episodes, strict=True)]
    )


def _check_walker(base: Experiment) -> None:
    if not isinstance(base.scenario, TreadmillScenario) or base.patient is None:
        raise ParameterError(f"{base.name}: expected a treadmill with a wearer; there is nothing to vary")


def _row(case: Case, episode: Mapping[Any, Any], sides: tuple[Side, ...]) -> dict[str, Any]:
    """What the map shows of one case."""
    return {
        "mass_kg": case.mass,
        "height_m": case.height,
        "speed_m_per_s": case.speed,
        "support_share": case.support,
        "outcome": episode["outcome"],
        "duration_s": episode["duration_s"],
        "strides": min(episode[f"{side}_strides"] for side in sides),
        "further_contacts": sum(episode[f"{side}_further_contacts"] for side in sides),
        "time_outs": sum(episode[f"{side}_time_outs"] for side in sides),
    }


_SYMBOLS = {
    Outcome.WALKED: "#",
    Outcome.FELL: ".",
    Outcome.STALLED: "o",
    Outcome.HUNG: "h",
    Outcome.HELD: "!",
    Outcome.DIVERGED: "x",
}


def draw_map(table: pd.DataFrame) -> str:
    """Draw the outcomes as text: one block a support, rows of speeds, columns of mass and height.

    Args:
        table: From :func:`map_outcomes`.

    Returns:
        The map with its legend.
    """
    lines = ["   ".join(f"{symbol} {outcome}" for outcome, symbol in _SYMBOLS.items())]
    heights, masses = sorted(table["height_m"].unique()), sorted(table["mass_kg"].unique())
    for support, block in table.groupby("support_share"):
        lines.append("")
        share = (block["outcome"] == Outcome.WALKED).mean()
        within = " ".join(f"{height:.2f}" for height in heights)
        lines.append(f"support {support:.0%}: {share:.0%} walked   (within a mass: {within} m)")
        lines.append("            " + " ".join(f"{mass:>{len(heights)}.0f}" for mass in masses) + "  kg")
        for speed, row in block.groupby("speed_m_per_s"):
            places = zip(row["mass_kg"], row["height_m"], strict=True)
            found = dict(zip(places, row["outcome"].map(_SYMBOLS), strict=True))
            cells = ["".join(found.get((mass, height), " ") for height in heights) for mass in masses]
            lines.append(f"  {speed:.2f} m/s  " + " ".join(cells))
    return "\n".join(lines)
