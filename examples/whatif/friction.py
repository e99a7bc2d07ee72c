"""Joint whose friction is compensated by a factor G of a model that is 1/s times the true friction."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from whatif.bench import (
    DEGREE,
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    HIGHEST_GAIN,
    LEVEL,
    MODEL,
    PUSH,
    PUSHED_DURATION,
    SPRING,
    THESIS_RATIO,
    Row,
    controlled,
    holding_torque,
    imposed_motion,
    inertia,
    knee,
    largest_resting_gain,
    law_in,
    least_torque_ratio,
    linear_loop,
    mean_delay,
    push,
    pushed,
    root_mean_square,
)
from whatif.endings import Ending

from twin_gait.checking.linear_loop import spectral_radius, transition_matrix
from twin_gait.checking.stability import largest_stable
from twin_gait.configuration.bench_device import BENCH_SENSORS
from twin_gait.gait.table import TICK
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.worlds.bench_control import CosinePath
from twin_gait.worlds.bench_joint import BenchFriction, BenchJoint, LinkParameters

# Decimation and window of the slow velocity: none, half of the thesis's, the thesis's, four times as long.
FILTERS = ((1, 1), (10, 1), (10, 10), (10, 40))
THESIS_FILTER = FILTERS[2]
DEAD_ZONE = 0.05  # [rad/s], past the steep part of the model
ENDLESS = 30.0  # [rad]; a joint without a spring needs room to slow down
STOPPED = 0.1  # of the speed of its push


class Compensation(StrEnum):
    """Source of the compensated velocity."""

    MEASURED = "measured"
    DEAD_ZONE = "dead zone"
    REFERENCE = "reference"


class Law(StrEnum):
    """True friction law, times the ratio."""

    TABLE = "table 3.1"
    NO_DIP = "no dip"  # break-away as large as Coulomb friction
    DEEPER_DIP = "deeper dip"  # half the break-away torque


class Setting(NamedTuple):
    """Joint on a spring that is pushed and released."""

    compensation: Compensation = Compensation.MEASURED
    gain: float = 0.0  # G
    ratio: float = THESIS_RATIO  # s
    filter: tuple[int, int] = THESIS_FILTER  # decimation and window of the slow velocity
    load: float = 0.0  # weight in [kg]
    push: float = PUSH  # speed at which it is let go in [rad/s]
    spring: float = SPRING  # [N·m/rad]
    law: Law = Law.TABLE  # shape of the true friction
    load_share: float = 0.0  # Coulomb friction per load


def true_law(law: Law, ratio: float) -> FrictionParameters:
    """Return the friction law of the plant: its shape times the ratio."""
    breakaway = {
        Law.TABLE: MODEL.breakaway_torque,
        Law.NO_DIP: MODEL.coulomb_friction,
        Law.DEEPER_DIP: 0.5 * MODEL.breakaway_torque,
    }
    return replace(MODEL, breakaway_torque=breakaway[law]).scaled(ratio)


def bench_of(setting: Setting) -> BenchJoint:
    """Return the bench of a setting without a hand."""
    decimation, window = setting.filter
    bench = knee(
        setting.load,
        sensors=replace(BENCH_SENSORS, decimation=decimation, window=window),
        friction=BenchFriction(law=true_law(setting.law, setting.ratio), coulomb_per_load=setting.load_share),
    )
    reference = setting.compensation is Compensation.REFERENCE
    control = controlled(
        friction_compensation_gain=setting.gain,
        follows_path=reference,
        dead_zone=DEAD_ZONE if setting.compensation is Compensation.DEAD_ZONE else 0.0,
        target_torque=holding_torque(bench),
        stiffness=setting.spring,
        equilibrium_angle=LEVEL,
    )
    return replace(bench, control=control)


def growth_rate_at_rest(setting: Setting) -> float:
    """Return the growth rate [1/s] of a small motion about rest by the transition matrix; below 0 it decays.

    A dead zone and a constant reference cause no feedback.
    """
    fed_back = setting.compensation is Compensation.MEASURED
    test = bench_of(setting if fed_back else setting._replace(gain=0.0))
    loop = linear_loop(test, 0.0, holding_torque(test))
    return math.log(spectral_radius(transition_matrix(loop))) / loop.frame


def map_row(setting: Setting) -> Row:
    """Push a joint, and return prediction and ending."""
    test = bench_of(setting)
    ending, amplitude = pushed(test, setting.push)
    return {
        "compensation": str(setting.compensation),
        "gain": setting.gain,
        "friction_ratio": setting.ratio,
        "filter_delay_ms": 1e3 * mean_delay(test.sensors),
        "load_kg": setting.load,
        "push_rad_per_s": setting.push,
        "growth_rate_at_rest_per_s": round(growth_rate_at_rest(setting), 5),
        "ending": str(ending),
        "amplitude_deg": round(amplitude / DEGREE, 3),
    }


# ---------------------------------------------------------------------- limits


class Question(NamedTuple):
    """Question for the largest G at which a joint comes to rest."""

    varied: str  # varied property, in a word
    setting: Setting  # everything but G


def limit_row(question: Question) -> Row:
    """Search the largest gain at which a pushed joint comes to rest, and return it with the prediction."""
    setting, test = question.setting, bench_of(question.setting)
    searched = largest_resting_gain(lambda gain: rests(setting._replace(gain=gain)))
    true = law_in(test.friction, holding_torque(test))
    return {
        "varied": question.varied,
        "spring_Nm_per_deg": round(setting.spring * DEGREE, 4),
        "filter_delay_ms": 1e3 * mean_delay(test.sensors),
        "law": str(setting.law),
        "push_rad_per_s": setting.push,
        "coulomb_per_load": setting.load_share,
        "load_kg": setting.load,
        "friction_ratio": setting.ratio,
        "largest_gain": round(searched, 4),
        "least_torque_ratio": round(least_torque_ratio(true, MODEL, setting.push), 4),
        "linear_gain_at_rest": round(linear_gain(setting), 4),
    }


def rests(setting: Setting) -> bool:
    """Return whether a pushed joint comes to rest; a joint without a spring has no stops."""
    test = bench_of(setting)
    if setting.spring > 0.0:
        return pushed(test, setting.push).ending is Ending.REST
    free_link = LinkParameters(mass=setting.load, lower_stop=-ENDLESS, upper_stop=ENDLESS)
    free = replace(test, link=free_link, imposed_motion=push(setting.push), duration=PUSHED_DURATION)
    speed = simulate_bench(free).column("link_velocity_rad_per_s")[-1]
    return bool(abs(speed) < STOPPED * setting.push)


def linear_gain(setting: Setting) -> float:
    """Return the largest gain at which a small motion about rest decays, by the transition matrix."""
    test = bench_of(setting)
    loop = linear_loop(test, 0.0, holding_torque(test))

    def radius(gain: float) -> float:
        return spectral_radius(transition_matrix(replace(loop, gain=np.array([gain]))))

    found = largest_stable(radius, 0.0, HIGHEST_GAIN)
    return math.nan if found is None else found


# ---------------------------------------------------------------------- costs


def cost_row(setting: Setting) -> Row:
    """Return the cost of an imposed motion without a spring, and the error on a path with a spring."""
    free = setting._replace(spring=0.0)
    effort, plain = imposed_motion(bench_of(free)), imposed_motion(bench_of(Setting(gain=0.0, spring=0.0)))
    return {
        "compensation": str(setting.compensation),
        "gain": setting.gain,
        "friction_ratio": setting.ratio,
        "hand_work_J": round(effort.work, 4),
        "hand_work_share": round(effort.work / plain.work, 4),
        "hand_friction_Nm": round(effort.friction, 4),
        "path_error_deg": round(path_error(setting) / DEGREE, 4),
    }


def path_error(setting: Setting) -> float:
    """Return the RMS error [rad] in the second cycle of a joint that follows a path by its own spring."""
    test = bench_of(setting)
    path = CosinePath(start_angle=LEVEL, amplitude=HAND_AMPLITUDE, frequency=HAND_FREQUENCY)
    damping = 2.0 * 0.7 * math.sqrt(setting.spring * inertia(test))  # ζ = 0.7
    control = replace(test.control, path=path, damping=damping)
    run = simulate_bench(replace(test, control=control, duration=2.0 / HAND_FREQUENCY))
    cycle = slice(-round(1.0 / HAND_FREQUENCY / TICK), None)
    return root_mean_square((run.column("link_angle_rad") - run.column("target_position_rad"))[cycle])
