"""Wearers, plants and sensors that a table is tried on besides those that it is tuned for."""

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment, PlantParameters
from twin_gait.measures.reference import KILOMETRES_PER_HOUR
from twin_gait.parameters import HEAVIEST_WEARER, LOADED_EFFICIENCY, Patient
from twin_gait.worlds import Walking
from twin_gait.worlds.scenario import BELT_SPEED, SUPPORT_SHARE

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


class Case(NamedTuple):
    """One way in which the world differs from the person and place that a table is tuned for."""

    name: str  # in words
    change: Change  # what it makes of an experiment, whatever its table


class Departure(NamedTuple):
    """One quantity that departs from its nominal value; values ascend, the nominal one among them."""

    name: str
    nominal: float
    values: tuple[float, ...]
    cases: tuple[Case, ...]


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


def departures(experiment: Experiment) -> tuple[Departure, ...]:
    """How the world may depart from the one that a table is tuned for, one quantity at a time."""
    walking, patient = check_walker(experiment)
    masses = [patient.mass * factor for factor in (0.7, 0.85, 1.0, 1.15, 1.3)]
    masses = sorted({min(HEAVIEST_WEARER, mass) for mass in masses})
    heights = [patient.height + step for step in (-0.1, -0.05, 0.0, 0.05, 0.1)]
    of = experiment.plant.friction_ratio
    ratio = sum(of.get(joint, 1.0) for joint in experiment.joints) / len(experiment.joints)
    ratios = sorted({0.2, LOW_FRICTION, ratio, 0.75, HIGH_FRICTION})
    actuators = experiment.plant.actuators
    efficiency = sum(item.gear_efficiency for item in actuators.values()) / len(actuators)
    efficiencies = sorted({LOW_EFFICIENCY, LOADED_EFFICIENCY, 0.9, 0.95, efficiency, 1.0})
    share = walking.support_share
    shares = [share + step for step in (-0.2, -0.1, 0.0, 0.1, 0.2) if 0.0 <= share + step < 1.0]
    speeds = [walking.speed * factor for factor in (0.7, 0.85, 1.0, 1.1, 1.2)]
    belt = _departure("belt speed [m/s]", walking.speed, speeds, _speed)
    return (
        _departure("wearer's mass [kg]", patient.mass, masses, lambda x: _mass(experiment, x / patient.mass)),
        _departure("wearer's height [m]", patient.height, heights, _height),
        _departure("true friction over model", ratio, ratios, _friction),
        _departure("gear efficiency", efficiency, efficiencies, _efficiency),
        _departure("supported share of weight", share, shares, _support),
        *((belt,) if experiment.scenario.adjusts(BELT_SPEED) else ()),
    )


def _departure(
    name: str, nominal: float, values: list[float], change: Callable[[float], Change]
) -> Departure:
    cases = tuple(Case(f"{name}: {x:.3g}", _nothing if x == nominal else change(x)) for x in values)
    return Departure(name, nominal, tuple(values), cases)


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


def _height(height: float) -> Change:
    return lambda walked: replace(walked, patient=replace(check_walker(walked)[1], height=height))


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
