"""Who walks: the outcome of one experiment over a grid of wearers, speeds and supports."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from typing import Any, NamedTuple

import pandas as pd

from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.parameters import Patient
from twin_gait.scenario import TreadmillScenario
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.studies.summary import summarise

MASSES = (55.0, 65.0, 75.0, 85.0, 95.0)  # [kg]
HEIGHTS = (1.60, 1.70, 1.80, 1.90)  # [m]
SPEEDS = (0.30, 0.34, 0.38, 0.42)  # [m] / [s]
SUPPORTS = (0.40, 0.50, 0.60, 0.70)  # share of the weight
# Fewer strides of either leg than one in this time is standing about, not walking.
LONGEST_STRIDE = 4.0  # [s]


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


def experiment_of(base: Experiment, case: Case) -> Experiment:
    """The base experiment with the wearer, speed and support of a case.

    Args:
        base: A treadmill experiment with a wearer.
        case: Point of the grid.

    Returns:
        The experiment.

    Raises:
        ParameterError: If the base has no treadmill or no wearer.
    """
    if not isinstance(base.scenario, TreadmillScenario) or base.patient is None:
        raise ParameterError(f"{base.name}: expected a treadmill with a wearer; there is nothing to vary")
    return replace(
        base,
        patient=Patient(mass=case.mass, height=case.height, sex=base.patient.sex),
        scenario=replace(
            base.scenario,
            belt_speed=case.speed,
            support=replace(base.scenario.support, share=case.support),
        ),
    )


def outcome_of(run: Run) -> str:
    """What became of a run, in one word.

    Args:
        run: The run.

    Returns:
        ``walks``, ``falls``, ``stalls`` (on its feet, but hardly a stride) or ``diverges``.
    """
    if run.status is RunStatus.FELL:
        return "falls"
    if run.status is RunStatus.DIVERGED:
        return "diverges"
    strides = [values["strides"] for values in summarise(run)["sides"].values()]
    return "walks" if min(strides) >= run.duration / LONGEST_STRIDE else "stalls"


def run_case(base: Experiment, case: Case) -> dict[str, Any]:
    """Simulate one case and keep what the map shows."""
    run = simulate(experiment_of(base, case))
    sides = summarise(run)["sides"].values()
    return {
        "mass_kg": case.mass,
        "height_m": case.height,
        "speed_m_per_s": case.speed,
        "support_share": case.support,
        "outcome": outcome_of(run),
        "duration_s": run.duration,
        "strides": min(values["strides"] for values in sides),
        "further_contacts": sum(values["further_contacts"] for values in sides),
        "time_outs": sum(values["time_outs"] for values in sides),
    }


def map_outcomes(
    base: Experiment,
    cases: Iterable[Case],
    *,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Simulate many cases.

    Args:
        base: The experiment that is varied.
        cases: Points of the grid.
        workers: Processes.
        progress: Called with cases done and in all.

    Returns:
        One row per case in the order of the cases, whatever the order in which they ended.
    """
    cases = list(cases)
    rows: dict[int, dict[str, Any]] = {}
    # Forked children would share the BLAS and OpenMP threads of this process; spawned ones do not.
    with ProcessPoolExecutor(max_workers=workers, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(run_case, base, case): index for index, case in enumerate(cases)}
        for done in as_completed(waiting):
            rows[waiting[done]] = done.result()
            if progress is not None:
                progress(len(rows), len(cases))
    return pd.DataFrame([rows[index] for index in range(len(cases))])


_SYMBOLS = {"walks": "#", "falls": ".", "stalls": "o", "diverges": "x"}


def draw_map(table: pd.DataFrame) -> str:
    """Draw the outcomes as text: one block a support, rows of speeds, columns of mass and height.

    Args:
        table: From :func:`map_outcomes`.

    Returns:
        The map with its legend.
    """
    lines = ["# walks   . falls   o stalls   x diverges"]
    heights, masses = sorted(table["height_m"].unique()), sorted(table["mass_kg"].unique())
    for support, block in table.groupby("support_share"):
        lines.append("")
        share = (block["outcome"] == "walks").mean()
        within = " ".join(f"{height:.2f}" for height in heights)
        lines.append(f"support {support:.0%}: {share:.0%} walk   (within a mass: {within} m)")
        lines.append("            " + " ".join(f"{mass:>{len(heights)}.0f}" for mass in masses) + "  kg")
        for speed, row in block.groupby("speed_m_per_s"):
            places = zip(row["mass_kg"], row["height_m"], strict=True)
            found = dict(zip(places, row["outcome"].map(_SYMBOLS), strict=True))
            cells = ["".join(found.get((mass, height), " ") for height in heights) for mass in masses]
            lines.append(f"  {speed:.2f} m/s  " + " ".join(cells))
    return "\n".join(lines)
