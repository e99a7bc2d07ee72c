"""What does friction that changes with temperature, age or load do to a compensator that does not know it?

The compensator's model is the joint's true law, identified exactly, as new, unloaded and at one temperature.
The joint is then led by hand, and pushed, under other conditions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd

from twin_gait.core.friction_models import REFERENCE_TEMPERATURE
from twin_gait.core.motor_drive import drive_efficiency
from twin_gait.parameters import FrictionParameters, SensorParameters
from twin_gait.scenario.bench_joint import BenchFriction, BenchJoint, CatalogueEfficiency
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif.friction_joint import DEGREE, PUSH, SPRING
from twin_gait.studies.whatif.rig import (
    LEVEL,
    MODEL,
    PUSHED_DURATION,
    Outcome,
    controlled,
    feeling,
    hand_velocity,
    holding_torque,
    largest_resting_gain,
    law_in,
    least_torque_ratio,
    outcome,
    push,
    rig,
    torques,
)
from twin_gait.studies.whatif.work import Job, Means, Row, tables_of

TEMPERATURES = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)  # [°C]
IDENTIFIED_AT = (10.0, 25.0, 40.0)  # [°C]
GAINS = tuple(round(0.1 * step, 1) for step in range(14))
# Share of the Coulomb friction that a kelvin takes away: 5 to 10 % between 20 and 40 °C (from memory, low
# confidence).
COULOMB_LOSS_PER_KELVIN = 0.00375
INPUT_SPEED = 105.0  # [rad] / [s] of the wave generator, 1000 1/min, at which the catalogue is read
# Whole law over the new one: run in, and with grease that has gone. Assumptions.
AGES = {"run in": 0.8, "worn": 1.3}
LOADS = (1.0, 2.0, 3.0)  # [kg]
COULOMB_PER_LOAD = 0.05  # an assumption


class Condition(NamedTuple):
    """Under which the joint is.

    Attributes:
        kind: ``temperature``, ``age`` or ``load``.
        temperature: Of the gear in [°C].
        ageing: Whole friction over that of a new joint.
        load: Weight in [kg].
    """

    kind: str
    temperature: float = REFERENCE_TEMPERATURE
    ageing: float = 1.0
    load: float = 0.0


class Case(NamedTuple):
    """A condition, and a compensator that was identified under another one.

    Attributes:
        condition: Of the joint.
        identified_at: Temperature in [°C] at which the model was identified.
        gain: G.
    """

    condition: Condition
    identified_at: float = REFERENCE_TEMPERATURE
    gain: float = 0.0


# ---------------------------------------------------------------------- friction


def loss_ratio(temperature: float) -> float:
    """Losses of the gear by its catalogue over those at 25 °C.

    Args:
        temperature: In [°C].

    Returns:
        Ratio of 1 less the efficiency.
    """
    coefficients = CatalogueEfficiency().coefficients
    losses = [
        1.0 - drive_efficiency(value, INPUT_SPEED, *coefficients)
        for value in (temperature, REFERENCE_TEMPERATURE)
    ]
    return losses[0] / losses[1]


@cache
def viscous_loss_per_kelvin() -> float:
    """Share of the viscous friction that a kelvin takes away at 25 °C, as the catalogue's losses fall."""
    above, below = (loss_ratio(REFERENCE_TEMPERATURE + step) for step in (1.0, -1.0))
    return 0.5 * (below - above)


def friction_in(condition: Condition) -> BenchFriction:
    """True friction under a condition.

    Args:
        condition: The condition.

    Returns:
        Table 3.1 with its parts by temperature, age and load.
    """
    return BenchFriction(
        law=MODEL.scaled(condition.ageing),
        coulomb_per_kelvin=-COULOMB_LOSS_PER_KELVIN * condition.ageing * MODEL.coulomb_friction,
        viscous_per_kelvin=-viscous_loss_per_kelvin() * condition.ageing * MODEL.viscous_friction,
        coulomb_per_load=COULOMB_PER_LOAD if condition.kind == "load" else 0.0,
        temperature=condition.temperature,
    )


def identified_law(temperature: float) -> FrictionParameters:
    """Model of a compensator that was identified exactly on a new joint without a weight.

    Args:
        temperature: In [°C].

    Returns:
        The law.
    """
    return law_in(friction_in(Condition("temperature", temperature=temperature)))


def bench_in(case: Case, spring: float = 0.0) -> BenchJoint:
    """The bench under a condition, with its compensator.

    Args:
        case: The case.
        spring: That holds the joint in [N m] / [rad].

    Returns:
        The test, without a hand.
    """
    condition = case.condition
    bench = rig(condition.load, friction=friction_in(condition), sensors=SensorParameters(ideal=False))
    control = controlled(
        identified_law(case.identified_at),
        friction_compensation_gain=case.gain,
        target_torque=holding_torque(bench),
        stiffness=spring,
        equilibrium_angle=LEVEL,
    )
    return replace(bench, control=control)


def true_law(condition: Condition) -> FrictionParameters:
    """Law of the joint under a condition, its weight level.

    Args:
        condition: The condition.

    Returns:
        The law.
    """
    return law_in(friction_in(condition), holding_torque(rig(condition.load)))


# ---------------------------------------------------------------------- rows


def _pushed(case: Case) -> Outcome:
    test = replace(bench_in(case, SPRING), hand=push(PUSH), duration=PUSHED_DURATION)
    return outcome(simulate_bench(test))


def case_row(case: Case) -> Row:
    """What a hand feels, and what becomes of a push.

    Args:
        case: The case.

    Returns:
        A row.
    """
    hand, pushed = feeling(bench_in(case)), _pushed(case)
    return {
        **_where(case),
        "gain": case.gain,
        "hand_torque_Nm": round(hand.rms, 4),
        "hand_friction_Nm": round(hand.friction, 4),
        "hand_work_J": round(hand.work, 4),
        "ending": str(pushed.ending),
        "amplitude_deg": round(pushed.amplitude / DEGREE, 3),
    }


def _where(case: Case) -> Row:
    condition = case.condition
    return {
        "kind": condition.kind,
        "temperature_degC": condition.temperature,
        "ageing": condition.ageing,
        "load_kg": condition.load,
        "identified_at_degC": case.identified_at,
    }


def best_row(case: Case) -> Row:
    """The gain that leaves least friction, and the largest at which a pushed joint comes to rest.

    Args:
        case: Without a gain.

    Returns:
        A row, simulation beside closed form.
    """
    felt = [feeling(bench_in(case._replace(gain=gain))).friction for gain in GAINS[::3]]
    model, true = identified_law(case.identified_at), true_law(case.condition)
    largest = largest_resting_gain(lambda gain: _pushed(case._replace(gain=gain)).ending is Ending.REST)
    return {
        **_where(case),
        "best_gain": round(lowest_of_parabola(GAINS[::3], np.square(felt)), 4),
        "closed_best_gain": round(closed_best_gain(true, model), 4),
        "largest_resting_gain": round(largest, 4),
        "least_torque_ratio": round(least_torque_ratio(true, model, PUSH), 4),
        "hand_friction_without_Nm": round(felt[0], 4),
    }


def lowest_of_parabola(places: tuple[float, ...], values: np.ndarray) -> float:
    """Where the parabola through values is lowest.

    Args:
        places: Where the values were taken, three or more.
        values: The mean square of what friction is left is a parabola in G.

    Returns:
        The place.
    """
    square, slope, _ = np.polyfit(places, values, 2)
    return float(-0.5 * slope / square)


def closed_best_gain(true: FrictionParameters, model: FrictionParameters) -> float:
    r"""Gain that leaves the least mean square of friction along the hand's path.

    .. math::

        G = \frac{\int T_{true}(\omega)\,T_{model}(\omega)\,dt}{\int T_{model}^2(\omega)\,dt}

    Args:
        true: Law of the plant.
        model: Law of the compensator, at the true velocity.

    Returns:
        G.
    """
    velocity = hand_velocity()
    given, taken = torques(model, velocity), torques(true, velocity)
    return float(taken @ given / (given @ given))


# ---------------------------------------------------------------------- study


def cases(*, quick: bool = False) -> Iterator[Case]:
    """Cases of the study without their gains, in order.

    Args:
        quick: A few of them.

    Yields:
        Temperatures against each compensator, then ages and loads against the one identified at 25 °C.
    """
    for identified in IDENTIFIED_AT[1:2] if quick else IDENTIFIED_AT:
        for temperature in TEMPERATURES[1::3] if quick else TEMPERATURES:
            yield Case(Condition("temperature", temperature=temperature), identified)
    for ageing in AGES.values():
        yield Case(Condition("age", ageing=ageing))
    for load in LOADS[2:] if quick else LOADS:
        yield Case(Condition("load", load=load))


@dataclass(frozen=True, eq=False)
class TemperatureStudy:
    """Results of the study.

    Attributes:
        cases: One row per case and gain.
        best: One row per case.
    """

    cases: pd.DataFrame
    best: pd.DataFrame


def study_temperature(means: Means, *, quick: bool = False) -> TemperatureStudy:
    """Run the whole study.

    Args:
        means: Processes, progress, interruption.
        quick: A small part of each grid.

    Returns:
        The tables.

    Raises:
        Interrupted: If it was stopped.
    """
    asked = list(cases(quick=quick))
    gains = GAINS[::4] if quick else GAINS
    parts = (
        [Job(case_row, case._replace(gain=gain)) for case in asked for gain in gains],
        [Job(best_row, case) for case in asked],
    )
    return TemperatureStudy(*tables_of(parts, means))
