"""Walks of candidates, what they cost, and the wearers, plants and sensors that they are tried on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple, Unpack

from twin_gait.checking import exits, graph, leaving, stability
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import Rule, Severity
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod, PlantParameters
from twin_gait.files import finite_or_none
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import KILOMETRES_PER_HOUR, gait_profile_score
from twin_gait.measures.walk import WALK_COLUMNS
from twin_gait.parameters import HEAVIEST_WEARER, Patient
from twin_gait.simulation.block import WIDTH
from twin_gait.studies.batch import run_episodes
from twin_gait.studies.jobs import JobFailed, Watch
from twin_gait.studies.tune.parts import Rating, errors_of, nominal_cost, rate_walk
from twin_gait.studies.workers import Workers
from twin_gait.worlds import Walking
from twin_gait.worlds.scenario import BELT_SPEED, SUPPORT_SHARE

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
NOMINAL = "nominal"
LOW_VOLTAGE, HIGH_VOLTAGE = 23.0, 33.6  # [V], an empty and a full battery
LOW_FRICTION, HIGH_FRICTION = 0.35, 1.0  # true friction over the model's
LOW_EFFICIENCY = 0.75  # of the gears, assumption: as cold grease has it; that of the default walk is 0.85
ANGLE_NOISE = 2e-5  # [rad], assumption: a standard deviation of some three counts of the encoder
# Corners of whom and what a table that ships is to carry: 50 to 110 kg, 1.50 to 1.95 m, 20 to 80 % support,
# 0.8 to 1.9 km/h. Mass in [kg], height in [m], supported share, belt in [km/h].
CORNERS = (
    (95.0, 1.60, 0.40, 1.08),
    (55.0, 1.90, 0.70, 1.50),
    (90.0, 1.75, 0.30, 1.15),
    (53.0, 1.57, 0.26, 1.80),
    (105.0, 1.90, 0.50, 0.85),
    (60.0, 1.60, 0.75, 0.85),
    (102.0, 1.62, 0.40, 1.85),
)
Change = Callable[[Experiment], Experiment]


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


def walk_all(walks: Sequence[Experiment], workers: Workers, **watch: Unpack[Watch]) -> list[Rating] | None:
    """Rate walks of :func:`walker`, each with its table and case, in their order; None if it was stopped."""
    try:
        results = run_episodes(itself, rate_walk, walks, columns=READ, block=WIDTH, workers=workers, **watch)
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


class Case(NamedTuple):
    """One way in which the world differs from the person and place that a table is tuned for."""

    name: str  # in words
    change: Change  # what it makes of an experiment, whatever its table


def check_walker(experiment: Experiment) -> tuple[Walking, Patient]:
    """How an experiment walks, and its wearer; without both it is a ParameterError."""
    walking, patient = experiment.scenario.walking, experiment.patient
    if walking is None or patient is None:
        raise ParameterError(
            f"{experiment.name}: expected a wearer who walks on the ground; there is nothing to tune"
        )
    return walking, patient


def search_cases(experiment: Experiment) -> tuple[Case, ...]:
    """What every candidate walks: as it is (first), and two corners of the robust set."""
    return (
        Case(NOMINAL, _nothing),
        Case(
            "heavy, rough, empty battery",
            _all(_mass(experiment, 1.1), _friction(HIGH_FRICTION), _voltage(LOW_VOLTAGE), _noise),
        ),
        Case("light, smooth", _all(_mass(experiment, 0.9), _friction(LOW_FRICTION))),
    )


def robust_cases(experiment: Experiment) -> tuple[Case, ...]:
    """The robust set, which the best candidates walk; the nominal case first."""
    belts = (
        Case("belt −10 %", _faster(experiment, 0.9)),
        Case("belt +10 %", _faster(experiment, 1.1)),
    )
    return (
        Case(NOMINAL, _nothing),
        Case("mass −10 %", _mass(experiment, 0.9)),
        Case("mass +10 %", _mass(experiment, 1.1)),
        Case(f"friction ratio {LOW_FRICTION:g}", _friction(LOW_FRICTION)),
        Case(f"friction ratio {HIGH_FRICTION:g}", _friction(HIGH_FRICTION)),
        Case(f"gear efficiency {LOW_EFFICIENCY:g}", _efficiency(LOW_EFFICIENCY)),
        Case("support −10 points", _more_support(experiment, -0.1)),
        Case("support +10 points", _more_support(experiment, 0.1)),
        *(belts if experiment.scenario.adjusts(BELT_SPEED) else ()),
        Case(f"bus {LOW_VOLTAGE:g} V", _voltage(LOW_VOLTAGE)),
        Case(f"bus {HIGH_VOLTAGE:g} V", _voltage(HIGH_VOLTAGE)),
        Case("sensor noise", _noise),
        *search_cases(experiment)[1:],
    )


def corner_cases() -> tuple[Case, ...]:
    """Other wearers, whom the device is told of, with other support on other belts; see ``CORNERS``."""
    return tuple(
        Case(
            f"{mass:g} kg, {height:g} m, {100.0 * share:g} % supported, {speed:g} km/h",
            _all(_wearer(mass, height), _support(share), _speed(speed / KILOMETRES_PER_HOUR)),
        )
        for mass, height, share, speed in CORNERS
    )


def _nothing(walked: Experiment) -> Experiment:
    return walked


def _all(*changes: Change) -> Change:
    return lambda walked: reduce(lambda changed, change: change(changed), changes, walked)


def _mass(experiment: Experiment, factor: float) -> Change:
    """The true mass changes and nobody tells the device: neither its model nor the table's scaling law."""
    _, patient = check_walker(experiment)
    told = patient if experiment.control.patient is None else experiment.control.patient
    mass = min(HEAVIEST_WEARER, factor * patient.mass)
    # The law divides the carried mass, which the scenario knows, by its reference.
    total = experiment.build_world().model.total_mass
    ratio = (total + mass - patient.mass) / total

    def change(walked: Experiment) -> Experiment:
        table, control = walked.table, replace(walked.control, patient=told)
        reference = table.scaling.carried_mass
        if reference is not None:
            table = replace(table, scaling=replace(table.scaling, carried_mass=reference * ratio))
        return replace(walked, patient=replace(patient, mass=mass), control=control, table=table)

    return change


def _wearer(mass: float, height: float) -> Change:
    """Another wearer; the device knows."""
    return lambda walked: replace(
        walked,
        patient=replace(check_walker(walked)[1], mass=mass, height=height),
        control=replace(walked.control, patient=None),
    )


def _plant(change: Callable[[PlantParameters], PlantParameters]) -> Change:
    return lambda walked: replace(walked, plant=change(walked.plant))


def _friction(ratio: float) -> Change:
    return _plant(lambda plant: replace(plant, friction_ratio=dict.fromkeys(plant.friction, ratio)))


def _efficiency(efficiency: float) -> Change:
    return _plant(
        lambda plant: replace(
            plant, actuators={k: replace(v, gear_efficiency=efficiency) for k, v in plant.actuators.items()}
        )
    )


def _voltage(volts: float) -> Change:
    return _plant(lambda plant: replace(plant, battery=replace(plant.battery, voltage=volts)))


def _support(share: float) -> Change:
    return lambda walked: replace(walked, scenario=walked.scenario.adjusted(SUPPORT_SHARE, share))


def _more_support(experiment: Experiment, step: float) -> Change:
    return _support(min(0.95, max(0.0, check_walker(experiment)[0].support_share + step)))


def _speed(speed: float) -> Change:
    return lambda walked: replace(walked, scenario=walked.scenario.adjusted(BELT_SPEED, speed))


def _faster(experiment: Experiment, factor: float) -> Change:
    return _speed(factor * check_walker(experiment)[0].speed)


def _noise(walked: Experiment) -> Experiment:
    return replace(walked, sensors=replace(walked.sensors, ideal=False, angle_noise=ANGLE_NOISE))
