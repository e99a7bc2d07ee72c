"""Wearers, plants and sensors that a table is tried on besides those that it is tuned for."""

from __future__ import annotations

from typing import Any, NamedTuple

from twin_gait.configuration.people import PatientEntry
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.parameters import HEAVIEST_WEARER, HIGHEST_LOAD_FRICTION, Patient
from twin_gait.scenario import TreadmillScenario

NOMINAL = "nominal"
LOW_VOLTAGE, HIGH_VOLTAGE = 23.0, 33.6  # [V], an empty and a full battery
LOW_FRICTION, HIGH_FRICTION = 0.35, 1.0  # true friction over the model's
ANGLE_NOISE = 2e-5  # [rad], assumption: a standard deviation of some three counts of the encoder


class Case(NamedTuple):
    """One way in which the world differs from the person and place that a table is tuned for.

    Attributes:
        name: In words.
        changes: Values by keys of an experiment.
    """

    name: str
    changes: dict[str, Any]


class Departure(NamedTuple):
    """One quantity that departs from its nominal value; values ascend, the nominal one among them."""

    name: str
    nominal: float
    values: tuple[float, ...]
    cases: tuple[Case, ...]


def check_walker(experiment: Experiment) -> tuple[TreadmillScenario, Patient]:
    """Belt and wearer of an experiment.

    Raises:
        ParameterError: If it has no treadmill with a wearer.
    """
    if not isinstance(experiment.scenario, TreadmillScenario) or experiment.patient is None:
        raise ParameterError(
            f"{experiment.name}: expected a treadmill with a wearer; there is nothing to tune"
        )
    return experiment.scenario, experiment.patient


def search_cases(experiment: Experiment) -> tuple[Case, ...]:
    """What every candidate walks: as it is (first), and two corners of the robust set."""
    return (
        Case(NOMINAL, {}),
        Case(
            "heavy, rough, empty battery",
            {**_mass(experiment, 1.1), **_friction(HIGH_FRICTION), **_voltage(LOW_VOLTAGE), **_noise()},
        ),
        Case("light, smooth", {**_mass(experiment, 0.9), **_friction(LOW_FRICTION)}),
    )


def robust_cases(experiment: Experiment) -> tuple[Case, ...]:
    """The robust set, which the best candidates walk; the nominal case first."""
    return (
        Case(NOMINAL, {}),
        Case("mass −10 %", _mass(experiment, 0.9)),
        Case("mass +10 %", _mass(experiment, 1.1)),
        Case(f"friction ratio {LOW_FRICTION:g}", _friction(LOW_FRICTION)),
        Case(f"friction ratio {HIGH_FRICTION:g}", _friction(HIGH_FRICTION)),
        Case(f"load friction {HIGHEST_LOAD_FRICTION:g}", _load_friction(HIGHEST_LOAD_FRICTION)),
        Case("support −10 points", _support(experiment, -0.1)),
        Case("support +10 points", _support(experiment, 0.1)),
        Case("belt −10 %", _speed(experiment, 0.9)),
        Case("belt +10 %", _speed(experiment, 1.1)),
        Case(f"bus {LOW_VOLTAGE:g} V", _voltage(LOW_VOLTAGE)),
        Case(f"bus {HIGH_VOLTAGE:g} V", _voltage(HIGH_VOLTAGE)),
        Case("sensor noise", _noise()),
        *search_cases(experiment)[1:],
    )


def departures(experiment: Experiment) -> tuple[Departure, ...]:
    """How the world may depart from the one that a table is tuned for, one quantity at a time."""
    scenario, patient = check_walker(experiment)
    masses = [patient.mass * factor for factor in (0.7, 0.85, 1.0, 1.15, 1.3)]
    masses = sorted({min(HEAVIEST_WEARER, mass) for mass in masses})
    heights = [patient.height + step for step in (-0.1, -0.05, 0.0, 0.05, 0.1)]
    ratio = sum(experiment.plant.friction_ratio.values()) / len(experiment.plant.friction_ratio)
    ratios = sorted({0.2, LOW_FRICTION, ratio, 0.75, HIGH_FRICTION})
    load = sum(experiment.plant.load_friction.values()) / len(experiment.plant.load_friction)
    loads = sorted({0.0, load, 0.05, 0.1, HIGHEST_LOAD_FRICTION, 0.2})
    share = scenario.support.share
    shares = [share + step for step in (-0.2, -0.1, 0.0, 0.1, 0.2) if 0.0 <= share + step < 1.0]
    speeds = [scenario.belt_speed * factor for factor in (0.7, 0.85, 1.0, 1.1, 1.2)]
    return (
        _departure("wearer's mass [kg]", patient.mass, masses, lambda x: _mass(experiment, x / patient.mass)),
        _departure("wearer's height [m]", patient.height, heights, lambda x: {"patient.height_m": x}),
        _departure("true friction over model", ratio, ratios, _friction),
        _departure("friction over motor torque", load, loads, _load_friction),
        _departure("supported share of weight", share, shares, lambda x: {"scenario.support.share": x}),
        _departure(
            "belt speed [m/s]", scenario.belt_speed, speeds, lambda x: {"scenario.belt_speed_m_per_s": x}
        ),
    )


def _departure(name: str, nominal: float, values: list[float], changes: Any) -> Departure:
    cases = tuple(Case(f"{name}: {x:.3g}", {} if x == nominal else changes(x)) for x in values)
    return Departure(name, nominal, tuple(values), cases)


def _mass(experiment: Experiment, factor: float) -> dict[str, Any]:
    """The true mass changes and nobody tells the device: neither its model nor the table's scaling law."""
    _, patient = check_walker(experiment)
    told = patient if experiment.control.patient is None else experiment.control.patient
    mass = min(HEAVIEST_WEARER, factor * patient.mass)
    changes = {"patient.mass_kg": mass, "control.patient": PatientEntry.document(told)}
    reference = experiment.table.scaling.carried_mass
    if reference is not None:
        # The law divides the carried mass, which the scenario knows, by this one.
        total = experiment.build_world().model.total_mass
        changes["table.scaling.carried_mass_kg"] = reference * (total + mass - patient.mass) / total
    return changes


def _friction(ratio: float) -> dict[str, Any]:
    return {"plant.friction_ratio.hip": ratio, "plant.friction_ratio.knee": ratio}


def _load_friction(coefficient: float) -> dict[str, Any]:
    return {"plant.load_friction.hip": coefficient, "plant.load_friction.knee": coefficient}


def _voltage(volts: float) -> dict[str, Any]:
    return {"plant.battery.voltage_V": volts}


def _support(experiment: Experiment, step: float) -> dict[str, Any]:
    scenario, _ = check_walker(experiment)
    return {"scenario.support.share": min(0.95, max(0.0, scenario.support.share + step))}


def _speed(experiment: Experiment, factor: float) -> dict[str, Any]:
    scenario, _ = check_walker(experiment)
    return {"scenario.belt_speed_m_per_s": factor * scenario.belt_speed}


def _noise() -> dict[str, Any]:
    return {"sensors.ideal": False, "sensors.angle_noise_rad": ANGLE_NOISE}
