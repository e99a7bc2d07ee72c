"""Compensator whose model is the true law at one temperature, on a joint under other conditions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from whatif.bench import (
    DEGREE,
    LEVEL,
    MODEL,
    PUSH,
    SPRING,
    Outcome,
    Row,
    controlled,
    holding_torque,
    imposed_motion,
    imposed_velocity,
    knee,
    largest_resting_gain,
    law_in,
    least_torque_ratio,
    pushed,
    torques,
)
from whatif.endings import Ending

from twin_gait.core.motor_drive import drive_efficiency
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.worlds.bench_joint import BenchFriction, BenchJoint, CatalogueEfficiency

REFERENCE_TEMPERATURE = CatalogueEfficiency().temperature  # [°C]
# Share of the Coulomb friction that is lost per kelvin: 5 to 10 % between 20 and 40 °C (from memory, low
# confidence).
COULOMB_LOSS_PER_KELVIN = 0.00375
INPUT_SPEED = 105.0  # [rad/s] of the wave generator, 1000 1/min, at which the catalogue is read
COULOMB_PER_LOAD = 0.05  # an assumption
FITTED_GAINS = tuple(round(0.3 * step, 1) for step in range(5))  # of the parabola of residual friction


class Condition(NamedTuple):
    """Condition of the joint."""

    kind: str  # temperature, age or load
    temperature: float = REFERENCE_TEMPERATURE  # of the gear in [°C]
    ageing: float = 1.0  # whole friction over that of a new joint
    load: float = 0.0  # weight in [kg]


class Case(NamedTuple):
    """Condition, and a compensator that was identified under another one."""

    condition: Condition
    identified_at: float = REFERENCE_TEMPERATURE  # [°C]
    gain: float = 0.0  # G


@cache
def viscous_loss_per_kelvin() -> float:
    """Return the share of viscous friction lost per kelvin at 25 °C, from the losses of the catalogue."""
    coefficients = CatalogueEfficiency().coefficients
    colder, mean, warmer = (
        1.0 - drive_efficiency(REFERENCE_TEMPERATURE + step, INPUT_SPEED, coefficients)
        for step in (-1.0, 0.0, 1.0)
    )
    return 0.5 * (colder - warmer) / mean


def friction_in(condition: Condition) -> BenchFriction:
    """Return the true friction: table 3.1 with its parts by temperature, age and load."""
    return BenchFriction(
        law=MODEL.scaled(condition.ageing),
        coulomb_per_kelvin=-COULOMB_LOSS_PER_KELVIN * condition.ageing * MODEL.coulomb_friction,
        viscous_per_kelvin=-viscous_loss_per_kelvin() * condition.ageing * MODEL.viscous_friction,
        coulomb_per_load=COULOMB_PER_LOAD if condition.kind == "load" else 0.0,
        temperature=condition.temperature,
    )


def identified_law(temperature: float) -> FrictionParameters:
    """Return a compensator model identified exactly at a temperature, on a new joint without a weight."""
    return law_in(friction_in(Condition("temperature", temperature=temperature)))


def true_law(condition: Condition) -> FrictionParameters:
    """Return the law of the joint under a condition, with its weight level."""
    return law_in(friction_in(condition), holding_torque(knee(condition.load)))


def bench_in(case: Case, spring: float = 0.0) -> BenchJoint:
    """Return the bench in a condition with its compensator and a spring in [N·m/rad], without a hand."""
    condition = case.condition
    bench = knee(condition.load, friction=friction_in(condition))
    control = controlled(
        identified_law(case.identified_at),
        friction_compensation_gain=case.gain,
        target_torque=holding_torque(bench),
        stiffness=spring,
        equilibrium_angle=LEVEL,
    )
    return replace(bench, control=control)


def pushed_on_a_spring(case: Case) -> Outcome:
    return pushed(bench_in(case, SPRING))


def case_columns(case: Case) -> Row:
    kind, temperature, ageing, load = case.condition
    return {
        "kind": kind,
        "temperature_degC": temperature,
        "ageing": ageing,
        "load_kg": load,
        "identified_at_degC": case.identified_at,
    }


def case_row(case: Case) -> Row:
    """Return the cost of an imposed motion, and the ending of a push."""
    effort, end = imposed_motion(bench_in(case)), pushed_on_a_spring(case)
    return {
        **case_columns(case),
        "gain": case.gain,
        "imposed_motion_torque_Nm": round(effort.torque, 4),
        "hand_friction_Nm": round(effort.friction, 4),
        "hand_work_J": round(effort.work, 4),
        "ending": str(end.ending),
        "amplitude_deg": round(end.amplitude / DEGREE, 3),
    }


def best_row(case: Case) -> Row:
    """Return the gain of least friction, and the largest gain of rest: simulated and closed form."""
    left = [imposed_motion(bench_in(case._replace(gain=gain))).friction for gain in FITTED_GAINS]
    model, true = identified_law(case.identified_at), true_law(case.condition)
    largest = largest_resting_gain(
        lambda gain: pushed_on_a_spring(case._replace(gain=gain)).ending is Ending.REST
    )
    return {
        **case_columns(case),
        "best_gain": round(lowest_of_parabola(FITTED_GAINS, np.square(left)), 4),
        "closed_best_gain": round(closed_best_gain(true, model), 4),
        "largest_resting_gain": round(largest, 4),
        "least_torque_ratio": round(least_torque_ratio(true, model, PUSH), 4),
        "hand_friction_without_Nm": round(left[0], 4),
    }


def lowest_of_parabola(points: tuple[float, ...], values: np.ndarray) -> float:
    """Return the vertex of the parabola through values; the mean square of residual friction is one in G."""
    square, slope, _ = np.polyfit(points, values, 2)
    return float(-0.5 * slope / square)


def closed_best_gain(true: FrictionParameters, model: FrictionParameters) -> float:
    r"""Return the gain with the least mean square of friction along the imposed motion.

    .. math::

        G = \frac{\int T_{true}(\omega)\,T_{model}(\omega)\,dt}{\int T_{model}^2(\omega)\,dt}
    """
    velocity = imposed_velocity()
    given, taken = torques(model, velocity), torques(true, velocity)
    return float(taken @ given / (given @ given))
