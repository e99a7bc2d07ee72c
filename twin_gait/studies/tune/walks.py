"""Walks of candidates, some at a time as a job that any process that has this package can do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from twin_gait.checking import exits, graph, leaving, stability
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.table import GaitTable
from twin_gait.simulation import simulate
from twin_gait.studies.jobs import JobFailed, Workers, run_jobs
from twin_gait.studies.tune.parts import Rating, nominal_cost, rate_walk

# Rules of the check that can find an error and take less time than a walk; the rest reads the final table.
QUICK_RULES: tuple[Rule, ...] = tuple(
    rule
    for module in (graph, exits, leaving, stability)
    for rule in module.RULES
    if rule.__name__
    in {
        "unreachable_phase",
        "trap",
        "ambiguity",
        "never_opens",
        "both_in_swing",
        "deadlock",
        "cannot_leave",
        "unstable",
    }
)
NOMINAL_WEIGHT = 0.75  # of the nominal case in the cost of a candidate; the other cases share the rest
MOST_TOGETHER = 32  # walks that a worker does together
# For the search, where a quarter of the time buys four times the candidates: parts of the shipped
# walk are within 0.01° and 0.1 percentage points of those at the default step, at which all is walked that is
# told in the end.
QUICK_INTEGRATION = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)


class Portion(NamedTuple):
    """Walks that a worker does together.

    Attributes:
        number: Of the first.
        walks: What is to be walked.
        reference_speed: As in :func:`twin_gait.studies.tune.parts.part_values`.
    """

    number: int
    walks: tuple[Experiment, ...]
    reference_speed: float | None

    def __str__(self) -> str:
        return f"walks from {self.number} on"


def rate_walks(portion: Portion, on_compile: Callable[[], None] | None = None) -> list[Rating]:
    """Walk tables; a fall is a result, and an error of this package that one cannot be run."""
    runs = (simulate(experiment, on_compile=on_compile) for experiment in portion.walks)
    return [rate_walk(run, portion.reference_speed) for run in runs]


def table_of(document: Mapping[str, Any]) -> GaitTable:
    """The gait table of a document of :func:`twin_gait.studies.tune.space.editable_document`."""
    return gait_table_from_mapping(dict(document), "the tuning", str(document["name"]))


def walker(experiment: Experiment, *, duration: float, quick: bool = False) -> Experiment:
    """An experiment as it is walked: by the compiled engine, for so long in [s], at the default step or not.

    Args:
        quick: Whether ``QUICK_INTEGRATION`` will do.
    """
    integration = QUICK_INTEGRATION if quick else None
    return replace(experiment, engine=Engine.COMPILED, integration=integration, duration=duration)


def quick_errors(experiment: Experiment) -> tuple[str, ...]:
    """Errors that the quick rules of the check find in the table of an experiment, by their ids."""
    case = build_case(experiment.table, experiment)
    found = [finding for rule in QUICK_RULES for finding in rule(case)]
    return tuple(sorted({item.rule for item in found if item.severity is Severity.ERROR}))


def walk_all(
    walks: Sequence[Experiment],
    workers: Workers,
    *,
    reference_speed: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> list[Rating] | None:
    """Walk many tables in many cases; the results do not depend on the workers.

    Args:
        walks: From :func:`walker`, each with its table and case.
        workers: Processes or a cluster that execute the walks.
        reference_speed: As in :func:`twin_gait.studies.tune.parts.part_values`.
        progress: Called with walks done and in all.

    Returns:
        One result for each, in their order; None if it was stopped.

    Raises:
        ParameterFileError: If a walk could not be run.
    """
    size = max(1, min(MOST_TOGETHER, math.ceil(len(walks) / workers.slots())))
    portions = [
        Portion(place, tuple(walks[place : place + size]), reference_speed)
        for place in range(0, len(walks), size)
    ]
    told = progress and (lambda done, total: progress(min(done * size, len(walks)), len(walks)))
    try:
        results = run_jobs(rate_walks, portions, workers=workers, progress=told, should_stop=should_stop)
    except JobFailed as error:
        raise ParameterFileError("the tuning", str(portions[error.index]), error.problem) from error
    return [rating for part in results for rating in part] if len(results) == len(portions) else None


def weighted_cost(walks: Sequence[Rating]) -> float:
    """Cost of a table over its cases, the nominal one first.

    The nominal walk's, with what missed goals cost on top, and the mean of the others, weighted.
    """
    nominal, *others = walks
    if not others:
        return nominal_cost(nominal)
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal_cost(nominal) + (1.0 - NOMINAL_WEIGHT) * mean
