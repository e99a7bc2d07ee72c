"""Walks of candidates, many at a time, and what they cost."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from twin_gait.checking import exits, graph, leaving, stability
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.files import finite_or_none
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import gait_profile_score
from twin_gait.measures.walk import WALK_COLUMNS
from twin_gait.simulation.block import WIDTH
from twin_gait.studies.episodes import run_episodes
from twin_gait.studies.jobs import JobFailed, Progress, Stop, Workers
from twin_gait.studies.tune.parts import Rating, errors_of, nominal_cost, rate_walk

# Rules of the check that can find an error and take less time than a walk; the rest reads the final table.
_QUICK = (
    *("unreachable_phase", "trap", "ambiguity", "never_opens"),
    *("both_in_swing", "deadlock", "cannot_leave", "unstable"),
)
QUICK_RULES: tuple[Rule, ...] = tuple(
    rule for module in (graph, exits, leaving, stability) for rule in module.RULES if rule.__name__ in _QUICK
)
# Ends of the names of the columns of a log that the parts are made of, beside time and phases.
READ = (
    *(*WALK_COLUMNS, "_crutch_normal_force_N"),
    *("_motor_command_torque_Nm", "_target_current_A", "_measured_current_A"),
)
NOMINAL_WEIGHT = 0.75  # of the nominal case in the cost of a candidate; the other cases share the rest
# For the search, where a quarter of the time buys four times the candidates: parts of the shipped
# walk are within 0.01° and 0.1 percentage points of those at the default step, at which all is walked that is
# told in the end.
QUICK_INTEGRATION = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)


def table_of(document: Mapping[str, Any]) -> GaitTable:
    """The gait table of a document of :func:`twin_gait.studies.tune.space.editable_document`."""
    return gait_table_from_mapping(dict(document), "the tuning", str(document["name"]))


def walker(experiment: Experiment, *, duration: float, quick: bool = False) -> Experiment:
    """An experiment as the compiled engine walks it for so long in [s], by ``QUICK_INTEGRATION`` if quick."""
    step = min(QUICK_INTEGRATION.step, experiment.scenario.step)
    integration = replace(QUICK_INTEGRATION, step=step) if quick else None
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
    progress: Progress | None = None,
    should_stop: Stop | None = None,
) -> list[Rating] | None:
    """Rate walks of :func:`walker`, each with its table and case, in their order; None if it was stopped."""
    rate = partial(rate_walk, reference_speed=reference_speed)
    try:
        results = run_episodes(
            itself,
            rate,
            walks,
            columns=READ,
            block=WIDTH,
            workers=workers,
            progress=progress,
            should_stop=should_stop,
        )
    except JobFailed as error:
        raise ParameterFileError("the tuning", f"walk {error.index}", error.problem) from error
    return results if len(results) == len(walks) else None


def itself(walk: Experiment) -> Experiment:
    """The walk, which is its own experiment."""
    return walk


def standing(walks: Sequence[Rating]) -> list[float | None]:
    """What a table is good for over its cases, the nominal one first, less being better.

    Root mean square of the nominal walk's errors of all joints in [deg] and of its motors' torques in [N m],
    None if it fell or has no error; and the mean cost of the other walks, None without.
    """
    nominal, *others = walks
    errors = [nominal.values[part.name] for part in errors_of(nominal.joints)]
    known = [error for error in errors if error is not None]
    walked = not nominal.fell and len(known) == len(errors)
    return [
        gait_profile_score(known) if walked else None,
        finite_or_none(nominal.torque) if walked else None,
        sum(walk.cost for walk in others) / len(others) if others else None,
    ]


def weighted_cost(walks: Sequence[Rating]) -> float:
    """Cost of a table over its cases, the nominal one first.

    The nominal walk's, with what missed goals cost on top, and the mean of the others, weighted.
    """
    nominal, *others = walks
    if not others:
        return nominal_cost(nominal)
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal_cost(nominal) + (1.0 - NOMINAL_WEIGHT) * mean
