"""One walk of one candidate as a job, which any process that has this package can do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.checking import exits, graph, leaving, stability
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.simulation import simulate
from twin_gait.studies.batch import overridden
from twin_gait.studies.jobs import JobFailed, Workers, run_jobs
from twin_gait.studies.tune.cases import Case
from twin_gait.studies.tune.parts import Rating, excess_cost, rate_walk

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
FORBIDDEN = 1000.0  # cost of a table with an error, far above any walk
# For screening and search, where a quarter of the time buys four times the candidates: parts of the shipped
# walk are within 0.01° and 0.1 percentage points of those at the default step, at which all is walked that is
# told in the end.
QUICK_INTEGRATION = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)


class Walk(NamedTuple):
    """A walk to be done: plain values only.

    Attributes:
        number: Of it in its portion.
        document: The experiment, whose table is replaced.
        table: Document of the gait table.
        changes: Values by keys of the experiment.
        reference_speed: As in :func:`twin_gait.studies.tune.parts.part_values`.
        checked: Whether the quick rules of the check come first.
        quick: Whether ``QUICK_INTEGRATION`` will do.
    """

    number: int
    document: Mapping[str, Any]
    table: Mapping[str, Any]
    changes: Mapping[str, Any]
    reference_speed: float | None
    checked: bool
    quick: bool

    def __str__(self) -> str:
        return f"walk {self.number}"


class Ask(NamedTuple):
    """One table in one case, for :func:`walk_all`."""

    table: Mapping[str, Any]
    case: Case
    checked: bool = False


def run_walk(walk: Walk, on_compile: Callable[[], None] | None = None) -> Rating:
    """Check a table and walk it; a fall is a result, and an error of this package that it cannot be run."""
    experiment = experiment_of(walk.document, walk.table, walk.changes, quick=walk.quick)
    errors = quick_errors(experiment) if walk.checked else ()
    if errors:
        return Rating(FORBIDDEN + len(errors), {}, False, 0.0, errors)
    run = simulate(experiment, on_compile=on_compile)
    return rate_walk(run, walk.reference_speed)


def experiment_of(
    document: Mapping[str, Any], table: Mapping[str, Any], changes: Mapping[str, Any], *, quick: bool = False
) -> Experiment:
    """Experiment with another table and some changes by its keys, for the compiled engine."""
    experiment = experiment_from_mapping({**document, "table": dict(table)}, "the tuning", Path())
    experiment = replace(experiment, engine=Engine.COMPILED, integration=QUICK_INTEGRATION if quick else None)
    return overridden(experiment, changes, "the tuning") if changes else experiment


def quick_errors(experiment: Experiment) -> tuple[str, ...]:
    """Errors that the quick rules of the check find in the table of an experiment, by their ids."""
    case = build_case(experiment.table, experiment)
    found = [finding for rule in QUICK_RULES for finding in rule(case)]
    return tuple(sorted({item.rule for item in found if item.severity is Severity.ERROR}))


def walk_all(
    asks: Sequence[Ask],
    document: Mapping[str, Any],
    workers: Workers,
    *,
    quick: bool = False,
    reference_speed: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> list[Rating] | None:
    """Walk many tables in many cases; the results do not depend on the workers.

    Args:
        workers: Processes or a cluster that execute the walks.
        quick: Whether ``QUICK_INTEGRATION`` will do.
        reference_speed: As in :func:`twin_gait.studies.tune.parts.part_values`.
        progress: Called with walks done and in all.

    Returns:
        One result for each, in their order; None if it was stopped.

    Raises:
        ParameterFileError: If a walk could not be run.
    """
    walks = [
        Walk(index, document, ask.table, ask.case.changes, reference_speed, ask.checked, quick)
        for index, ask in enumerate(asks)
    ]
    try:
        results = run_jobs(run_walk, walks, workers=workers, progress=progress, should_stop=should_stop)
    except JobFailed as error:
        raise ParameterFileError("the tuning", asks[error.index].case.name, error.problem) from error
    return results if len(results) == len(asks) else None


def weighted_cost(walks: Sequence[Rating]) -> float:
    """Cost of a table over its cases, the nominal one first.

    The nominal walk's, with what missed goals cost on top, and the mean of the others, weighted; the nominal
    cost alone of a table that must not walk.
    """
    nominal, *others = walks
    if nominal.errors or not others:
        return nominal_cost(nominal)
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal_cost(nominal) + (1.0 - NOMINAL_WEIGHT) * mean


def nominal_cost(walk: Rating) -> float:
    """Cost of the walk that a table is tuned for: its own, and for each goal that it misses some more."""
    return walk.cost if walk.fell else walk.cost + excess_cost(walk.values)
