"""Walks of candidates, their cost, and the wearers, plants and sensors with which they are tested."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any, Unpack

from twin_gait.checking import exits, graph, stability, stuck_phases
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.experiment.experiment import Engine, Experiment
from twin_gait.files import finite_or_none
from twin_gait.gait.table import GaitTable
from twin_gait.measures.crutches import TRUNK_PITCH
from twin_gait.measures.reference import gait_profile_score
from twin_gait.measures.walk import WALK_COLUMNS
from twin_gait.parameters.wearer import MASSES
from twin_gait.simulation.block import WIDTH
from twin_gait.studies.batch import identity, override_experiment, run_episodes, walking_wearer
from twin_gait.studies.jobs import WorkCallbacks
from twin_gait.studies.tune.objective import Rating, nominal_cost, rate_walk
from twin_gait.studies.tune.space import SETTINGS
from twin_gait.studies.workers import Workers
from twin_gait.worlds.world import BELT_SPEED, SUPPORT_SHARE
from twin_gait.yaml12 import load_data

# Rules of the check that can find an error and take less time than a walk; all others check the final table.
QUICK_RULES: tuple[Rule, ...] = (*graph.RULES, *exits.RULES, *stuck_phases.RULES, stability.unstable)
# Endings of the log columns from which the parts are computed, in addition to time and phases.
LOG_COLUMNS = (
    *(*WALK_COLUMNS, "_crutch_normal_force_N", TRUNK_PITCH),
    *("_motor_command_torque_Nm", "_target_current_A", "_measured_current_A"),
)
NOMINAL_WEIGHT = 0.75  # weight of the nominal case in the cost of a candidate; the other cases share the rest
# Changes of a case that are no assignment of a single key.
_CHANGES = ("mass_ratio", "friction_ratio", "gear_efficiency", "support_more", "belt_ratio")
_CASES = load_data(Path(__file__).with_name("cases.yaml"))


def candidate_table(candidate: Mapping[str, Any]) -> GaitTable:
    """Return the gait table of a candidate, a document of :mod:`twin_gait.studies.tune.space`."""
    document = {key: value for key, value in candidate.items() if key != SETTINGS}
    return gait_table_from_mapping(document, "the tuning", str(document["name"]))


def walker(experiment: Experiment, *, duration: float) -> Experiment:
    """Return an experiment for the compiled engine at its default integration, with a duration in [s]."""
    return replace(experiment, engine=Engine.COMPILED, integration=None, duration=duration)


def quick_errors(experiment: Experiment) -> set[str]:
    """Return the ids of the errors that the quick rules of the check find in the table of an experiment."""
    case = build_case(experiment.table, experiment)
    return {item.rule for rule in QUICK_RULES for item in rule(case) if item.severity is Severity.ERROR}


class TuningStopped(Exception):  # not an error, because the user requested it
    """A tuning was stopped."""


def walk_all(walks: Sequence[Experiment], workers: Workers, **watch: Unpack[WorkCallbacks]) -> list[Rating]:
    """Rate walks of :func:`walker` with their tables and cases, in order; raise :class:`TuningStopped`."""
    results = run_episodes(
        identity, rate_walk, walks, columns=LOG_COLUMNS, block=WIDTH, workers=workers, **watch
    )
    if len(results) < len(walks):
        raise TuningStopped
    return results


def table_performance(walks: Sequence[Rating]) -> list[float | None]:
    """Compute the performance of a table over its cases, the nominal one first; smaller is better.

    Returns the root mean square of the nominal walk's errors of all joints in [deg] and of its motors'
    torques in [N·m], None if it fell or has no error; and the mean cost of the other walks, None without
    other walks.
    """
    nominal, *others = walks
    errors = [nominal.values[f"{joint}_error_deg"] for joint in nominal.joints]
    known = [error for error in errors if error is not None]
    walked = not nominal.fell and len(known) == len(errors)
    return [
        gait_profile_score(known) if walked else None,
        finite_or_none(nominal.torque) if walked else None,
        sum(walk.cost for walk in others) / len(others) if others else None,
    ]


def weighted_cost(walks: Sequence[Rating]) -> float:
    """Compute the cost of a table over its cases, the nominal one first.

    It is the weighted sum of the nominal walk's cost, in which exceeding a goal costs more, and the mean cost
    of the others.
    """
    nominal, *others = walks
    costs = [nominal_cost(nominal), *(walk.cost for walk in others)]
    return sum(weight * cost for weight, cost in zip(case_weights(len(walks)), costs, strict=True))


def case_weights(count: int) -> tuple[float, ...]:
    """Return the weights of the cases in the cost of a table, which add up to 1; the nominal one is first."""
    others = count - 1
    if not others:
        return (1.0,)
    return (NOMINAL_WEIGHT, *([(1.0 - NOMINAL_WEIGHT) / others] * others))


def build_cases(nominal: Experiment, kind: str) -> dict[str, Experiment]:
    """Return the cases of a kind by names, from ``cases.yaml``: ``search``, ``robust`` or ``corners``.

    Cases with another belt speed are left out if there is no belt.
    """
    cases = _CASES[kind].items()
    if not nominal.scenario.has_adjustments(BELT_SPEED):
        cases = [(name, changes) for name, changes in cases if "belt_ratio" not in changes]
    return {name: apply_changes(nominal, changes) for name, changes in cases}


def apply_changes(nominal: Experiment, changes: Mapping[str, Any]) -> Experiment:
    """Apply changes by the keys that ``cases.yaml`` lists; all other keys are those of ``--set``."""
    settings = {key: value for key, value in changes.items() if key not in _CHANGES}
    others = [(key, value) for key, value in changes.items() if key in _CHANGES]
    return reduce(_changed, others, override_experiment(nominal, settings) if settings else nominal)


def _changed(walked: Experiment, change: tuple[str, Any]) -> Experiment:
    """Apply one of the changes that ``cases.yaml`` lists to an experiment."""
    (kind, value), (walking, _) = change, walking_wearer(walked)
    plant, scenario = walked.plant, walked.scenario
    match kind:
        case "mass_ratio":
            return _with_true_mass(walked, value)
        case "friction_ratio":
            plant = replace(plant, friction_ratio=dict.fromkeys(plant.friction, value))
        case "gear_efficiency":
            gears = {joint: replace(gear, gear_efficiency=value) for joint, gear in plant.actuators.items()}
            plant = replace(plant, actuators=gears)
        case "support_more":
            share = min(0.95, max(0.0, walking.support_share + value))
            scenario = scenario.replace_adjustment(SUPPORT_SHARE, share)
        case "belt_ratio":
            scenario = scenario.replace_adjustment(BELT_SPEED, value * walking.speed)
    return replace(walked, plant=plant, scenario=scenario)


def _with_true_mass(walked: Experiment, ratio: float) -> Experiment:
    """Change the true mass but not the mass that the device assumes.

    Neither the model of the controller nor the scaling law of the table takes the new mass into account.
    """
    _, patient = walking_wearer(walked)
    table, control = walked.table, replace(walked.control, patient=walked.control.patient or patient)
    mass = min(MASSES.maximum, ratio * patient.mass)
    reference = table.scaling.carried_mass
    if reference is not None:
        # The law divides the carried mass, which the scenario states, by its reference.
        total = walked.build_world().model.total_mass
        carried = reference * ((total + mass - patient.mass) / total)
        table = replace(table, scaling=replace(table.scaling, carried_mass=carried))
    return replace(walked, patient=replace(patient, mass=mass), control=control, table=table)


def with_candidate(
    walked: Experiment, candidate: Mapping[str, Any], table: GaitTable | None = None
) -> Experiment:
    """Return a walk of a case with the table of a candidate, scaled as in the case, and with its settings.

    ``table``: the table of the candidate, if it has been read already.
    """
    settings = candidate.get(SETTINGS)
    table = replace(table or candidate_table(candidate), scaling=walked.table.scaling)
    return replace(override_experiment(walked, settings) if settings else walked, table=table)
