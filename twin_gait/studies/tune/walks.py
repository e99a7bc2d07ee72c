"""Walks of candidates, what they cost, and the wearers, plants and sensors that they are tried on."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any, Unpack

from twin_gait.checking import exits, graph, leaving, stability
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.files import finite_or_none
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import gait_profile_score
from twin_gait.measures.walk import WALK_COLUMNS
from twin_gait.parameters import HEAVIEST_WEARER
from twin_gait.simulation.block import WIDTH
from twin_gait.studies.batch import overridden, run_episodes, walking_wearer
from twin_gait.studies.jobs import Watch
from twin_gait.studies.tune.parts import Rating, nominal_cost, rate_walk
from twin_gait.studies.workers import Workers
from twin_gait.worlds.world import BELT_SPEED, SUPPORT_SHARE
from twin_gait.yaml12 import load_yaml

# Rules of the check that can find an error and take less time than a walk; the rest reads the final table.
QUICK_RULES: tuple[Rule, ...] = (*graph.RULES, *exits.RULES, *leaving.RULES, stability.unstable)
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
_CASES = load_yaml(Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8"))


def table_of(document: Mapping[str, Any]) -> GaitTable:
    """The gait table of a document of :func:`twin_gait.studies.tune.space.editable_document`."""
    return gait_table_from_mapping(dict(document), "the tuning", str(document["name"]))


def walker(experiment: Experiment, *, duration: float, quick: bool = False) -> Experiment:
    """An experiment as the compiled engine walks it for so long in [s], by ``QUICK_INTEGRATION`` if quick."""
    step = min(QUICK_INTEGRATION.step, experiment.scenario.step)
    integration = replace(QUICK_INTEGRATION, step=step) if quick else None
    return replace(experiment, engine=Engine.COMPILED, integration=integration, duration=duration)


def quick_errors(experiment: Experiment) -> set[str]:
    """Errors that the quick rules of the check find in the table of an experiment, by their ids."""
    case = build_case(experiment.table, experiment)
    return {item.rule for rule in QUICK_RULES for item in rule(case) if item.severity is Severity.ERROR}


class Stopped(Exception):  # not an error: somebody asked for it
    """A tuning was asked to stop."""


def walk_all(walks: Sequence[Experiment], workers: Workers, **watch: Unpack[Watch]) -> list[Rating]:
    """Rate walks of :func:`walker`, each with its table and case, in their order; raises :class:`Stopped`."""
    results = run_episodes(itself, rate_walk, walks, columns=READ, block=WIDTH, workers=workers, **watch)
    if len(results) < len(walks):
        raise Stopped
    return results


def itself(walk: Experiment) -> Experiment:
    """The walk, which is its own experiment."""
    return walk


def standing(walks: Sequence[Rating]) -> list[float | None]:
    """What a table is good for over its cases, the nominal one first, less being better.

    Root mean square of the nominal walk's errors of all joints in [deg] and of its motors' torques in [N m],
    None if it fell or has no error; and the mean cost of the other walks, None without.
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
    """Cost of a table over its cases, the nominal one first.

    The nominal walk's, with what missed goals cost on top, and the mean of the others, weighted.
    """
    nominal, *others = walks
    if not others:
        return nominal_cost(nominal)
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal_cost(nominal) + (1.0 - NOMINAL_WEIGHT) * mean


def cases_of(nominal: Experiment, kind: str) -> dict[str, Experiment]:
    """The cases of a kind by names, as ``cases.yaml`` has them: ``search``, ``robust`` or ``everyone``.

    Those with another belt are left out where there is none.
    """
    cases = _CASES[kind].items()
    if not nominal.scenario.adjusts(BELT_SPEED):
        cases = [(name, changes) for name, changes in cases if "belt_ratio" not in changes]
    return {name: reduce(_changed, changes.items(), nominal) for name, changes in cases}


def _changed(walked: Experiment, change: tuple[str, Any]) -> Experiment:
    """An experiment with one of the changes that ``cases.yaml`` lists."""
    (what, value), (walking, _) = change, walking_wearer(walked)
    plant, scenario = walked.plant, walked.scenario
    match what:
        case "mass_ratio":
            return _weighing(walked, value)
        case "friction_ratio":
            plant = replace(plant, friction_ratio=dict.fromkeys(plant.friction, value))
        case "gear_efficiency":
            gears = {joint: replace(gear, gear_efficiency=value) for joint, gear in plant.actuators.items()}
            plant = replace(plant, actuators=gears)
        case "support_more":
            share = min(0.95, max(0.0, walking.support_share + value))
            scenario = scenario.adjusted(SUPPORT_SHARE, share)
        case "belt_ratio":
            scenario = scenario.adjusted(BELT_SPEED, value * walking.speed)
        case key:
            return overridden(walked, {key: value})
    return replace(walked, plant=plant, scenario=scenario)


def _weighing(walked: Experiment, ratio: float) -> Experiment:
    """The true mass changes and nobody tells the device: neither its model nor the table's scaling law."""
    _, patient = walking_wearer(walked)
    table, control = walked.table, replace(walked.control, patient=walked.control.patient or patient)
    mass = min(HEAVIEST_WEARER, ratio * patient.mass)
    reference = table.scaling.carried_mass
    if reference is not None:
        # The law divides the carried mass, which the scenario knows, by its reference.
        total = walked.build_world().model.total_mass
        carried = reference * ((total + mass - patient.mass) / total)
        table = replace(table, scaling=replace(table.scaling, carried_mass=carried))
    return replace(walked, patient=replace(patient, mass=mass), control=control, table=table)


def in_case(walked: Experiment, table: GaitTable) -> Experiment:
    """A walk of a case with another table, scaled as the case has it."""
    return replace(walked, table=replace(table, scaling=walked.table.scaling))
