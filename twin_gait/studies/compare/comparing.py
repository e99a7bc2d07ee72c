"""Run every controller for every variation of the wearer's day, and put the numbers side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import t as student

from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment import Experiment
from twin_gait.parameters import HEAVIEST_WEARER, JointCondition, Patient
from twin_gait.scenario import TreadmillScenario
from twin_gait.simulation import Run, simulate
from twin_gait.studies.compare.controllers import Controller
from twin_gait.studies.compare.numbers import Numbers, numbers_of

# By how much a day differs from the nominal one, either way, evenly distributed (assumptions): clothes and
# luggage, warm or cold gears, a belt that is not quite what its display says, a good or a bad day.
MASS_SPREAD, FRICTION_SPREAD, SPEED_SPREAD, EFFORT_SPREAD = 0.03, 0.2, 0.03, 0.1
CONFIDENCE = 0.95


class ComparisonInterrupted(TwinGaitError):
    """The comparison was stopped before it was done."""


class Interval(NamedTuple):
    """A mean over seeds.

    Attributes:
        mean: NaN where no run has the number.
        half_width: Of its 95 % confidence interval; NaN for fewer than two runs.
        runs: With the number.
    """

    mean: float
    half_width: float
    runs: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """Controllers beside each other.

    Attributes:
        experiment: What they have in common.
        controllers: In order.
        seeds: Days that each was run on; the first is the nominal one.
        table: One row per run: ``controller``, ``seed`` and the numbers of
            :func:`~twin_gait.studies.compare.numbers.numbers_of`.
        runs: Of the nominal day, by the name of the controller.
    """

    experiment: Experiment
    controllers: tuple[Controller, ...]
    seeds: int
    table: pd.DataFrame
    runs: dict[str, Run]

    def interval(self, controller: str, number: str) -> Interval:
        """Mean of a number over the runs of a controller that have it.

        Args:
            controller: Name of the controller.
            number: Name of the number.

        Returns:
            The mean with its interval.
        """
        if number not in self.table:
            return Interval(math.nan, math.nan, 0)
        values = self.table.loc[self.table["controller"] == controller, number].to_numpy(dtype=float)
        return interval_of(values)

    def walked(self, controller: str) -> int:
        """Runs of a controller without a fall or a trip."""
        return int(self.table.loc[self.table["controller"] == controller, "walked"].sum())


def interval_of(values: np.ndarray) -> Interval:
    """Mean with the confidence interval of Student's t distribution.

    Args:
        values: Shape ``(n,)``; NaN does not count.

    Returns:
        The interval.
    """
    known = values[~np.isnan(values)]
    if len(known) == 0:
        return Interval(math.nan, math.nan, 0)
    mean = float(known.mean())
    if len(known) < 2:
        return Interval(mean, math.nan, len(known))
    spread = float(np.std(known, ddof=1)) / math.sqrt(len(known))
    quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, len(known) - 1))
    return Interval(mean, quantile * spread, len(known))


def compare(
    experiment: Experiment,
    controllers: Sequence[Controller],
    *,
    seeds: int = 1,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Comparison:
    """Run every controller on every day.

    All controllers meet the same days.

    Args:
        experiment: On the treadmill, with a wearer.
        controllers: What drives the legs.
        seeds: Number of days; the first is the experiment as it is.
        progress: Called with runs done and in all.
        should_stop: Asked before each run.
        on_compile: Called if the engine has to be compiled for a controller.

    Returns:
        The comparison.

    Raises:
        ParameterError: If there is no treadmill, no wearer, or not one seed.
        ComparisonInterrupted: If it was stopped.
    """
    _check(experiment, seeds)
    days = [varied(experiment, seed) for seed in range(seeds)]
    rows: list[dict[str, object]] = []
    nominal: dict[str, Run] = {}
    for controller in controllers:
        for seed, day in enumerate(days):
            if should_stop is not None and should_stop():
                raise ComparisonInterrupted("interrupted; nothing was written")
            run = simulate(controller.change(day), on_compile=on_compile)
            if seed == 0:
                nominal[controller.name] = run
            rows.append({"controller": controller.name, "seed": seed, **_ending(run), **numbers_of(run)})
            if progress is not None:
                progress(len(rows), len(days) * len(controllers))
    return Comparison(experiment, tuple(controllers), seeds, pd.DataFrame(rows), nominal)


def _check(experiment: Experiment, seeds: int) -> None:
    if not isinstance(experiment.scenario, TreadmillScenario):
        raise ParameterError(
            f"{experiment.name}: controllers are compared on the treadmill; name such a preset"
        )
    if experiment.patient is None:
        raise ParameterError("patient: nobody wears the device; name somebody with --patient")
    if seeds < 1:
        raise ParameterError(f"seeds: expected 1 or more, got {seeds}")


def _ending(run: Run) -> dict[str, str]:
    trip = "" if run.trip is None else f"{run.trip.cause} of the {run.trip.place} at {run.trip.time:.2f} s"
    return {"status": str(run.status), "trip": trip}


def varied(experiment: Experiment, seed: int) -> Experiment:
    """The experiment on another day.

    Args:
        experiment: On the treadmill, with a wearer.
        seed: 0 leaves it as it is; any other draws mass, effort, friction and belt speed.

    Returns:
        The experiment with that seed.
    """
    scenario, patient, plant = experiment.scenario, experiment.patient, experiment.plant
    if seed == 0:
        return experiment
    assert isinstance(scenario, TreadmillScenario) and patient is not None  # the caller has checked
    draw = np.random.default_rng((experiment.seed, seed)).uniform(-1.0, 1.0, size=4)
    friction = {
        joint: (1.0 + FRICTION_SPREAD * draw[1]) * item for joint, item in plant.friction_ratio.items()
    }
    return replace(
        experiment,
        seed=experiment.seed + seed,
        patient=_on_another_day(patient, float(draw[0]), float(draw[3])),
        plant=replace(plant, friction_ratio={joint: float(item) for joint, item in friction.items()}),
        scenario=replace(scenario, belt_speed=float((1.0 + SPEED_SPREAD * draw[2]) * scenario.belt_speed)),
    )


def _on_another_day(patient: Patient, weight: float, form: float) -> Patient:
    def condition(item: JointCondition) -> JointCondition:
        return replace(item, effort=min(1.0, (1.0 + EFFORT_SPREAD * form) * item.effort))

    return replace(
        patient,
        mass=min(HEAVIEST_WEARER, (1.0 + MASS_SPREAD * weight) * patient.mass),
        conditions={place: condition(item) for place, item in patient.conditions.items()},
    )


def summary_rows(comparison: Comparison) -> list[Numbers]:
    """Means and intervals of every number, one row per controller, in the order of the controllers.

    Args:
        comparison: The comparison.

    Returns:
        ``NAME`` and ``NAME_half_width`` of every number.
    """
    named = {"controller", "seed", "status", "trip"}
    names = [name for name in comparison.table if name not in named]
    rows: list[Numbers] = []
    for controller in comparison.controllers:
        row: Numbers = {}
        for name in names:
            found = comparison.interval(controller.name, str(name))
            row |= {str(name): found.mean, f"{name}_half_width": found.half_width}
        rows.append(row)
    return rows
