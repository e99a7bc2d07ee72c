"""Gains at which a compensated joint stops coming to rest, beside what is predicted without a simulation."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.checking.linear_loop import spectral_radius, transition_matrix
from twin_gait.checking.stability import largest_stable
from twin_gait.scenario.bench_joint import LinkParameters
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif.friction_joint import (
    DEGREE,
    FILTERS,
    Law,
    Setting,
    bench_of,
)
from twin_gait.studies.whatif.rig import (
    HIGHEST_GAIN,
    MODEL,
    PUSHED_DURATION,
    holding_torque,
    largest_resting_gain,
    law_in,
    least_torque_ratio,
    linear_loop,
    mean_delay,
    outcome,
    push,
)
from twin_gait.studies.whatif.work import Row

# None, the thesis's, that of the map, that of the shipped gaits; in [N m] / [rad].
SPRINGS = tuple(value / DEGREE for value in (0.0, 0.05, 0.5, 2.5))
LOADS = (0.0, 1.5, 3.0)  # [kg], none and the thesis's
PUSHES = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3)  # [rad] / [s]
LOAD_SHARES = (0.0, 0.05, 0.1)  # Coulomb friction per load
_ENDLESS = 30.0  # [rad]; a joint without a spring needs room to slow down
_STOPPED = 0.1  # of the speed of its push


class Question(NamedTuple):
    """At which G does a joint stop coming to rest?

    Attributes:
        varied: What is varied, in words.
        setting: Everything but G.
    """

    varied: str
    setting: Setting


def questions(*, quick: bool = False) -> list[Question]:
    """Thresholds that are searched for, in order.

    Args:
        quick: A few of them.

    Returns:
        The questions: spring and filter; shape of the law and push, without a spring; load.
    """
    springs = itertools.product(SPRINGS[::3] if quick else SPRINGS, FILTERS[3:] if quick else FILTERS)
    asked = [Question("filter", Setting(spring=spring, filter=kept)) for spring, kept in springs]
    pushes = PUSHES[::4] if quick else PUSHES
    for law, speed in itertools.product(Law, pushes):
        asked.append(Question("law", Setting(spring=0.0, law=law, push=speed, filter=FILTERS[1])))
    loads = itertools.product(LOAD_SHARES[::2] if quick else LOAD_SHARES, LOADS[::2] if quick else LOADS)
    for share, load in loads:
        asked.append(Question("load", Setting(load_share=share, load=load)))
    return asked


def threshold_row(question: Question) -> Row:
    """Search the largest gain at which a pushed joint comes to rest, beside what is predicted.

    Args:
        question: The question.

    Returns:
        A row.
    """
    setting = question.setting
    searched = largest_resting_gain(lambda gain: _rests(setting._replace(gain=gain)))
    return {
        "varied": question.varied,
        "spring_Nm_per_deg": round(setting.spring * DEGREE, 4),
        "filter_delay_ms": 1e3 * mean_delay(bench_of(setting).sensors),
        "law": str(setting.law),
        "push_rad_per_s": setting.push,
        "coulomb_per_load": setting.load_share,
        "load_kg": setting.load,
        "friction_ratio": setting.ratio,
        "largest_gain": round(searched, 4),
        "least_torque_ratio": round(_least_ratio(setting), 4),
        "linear_gain_at_rest": round(linear_gain(setting), 4),
    }


def _rests(setting: Setting) -> bool:
    test = replace(bench_of(setting), hand=push(setting.push), duration=PUSHED_DURATION)
    if setting.spring > 0.0:
        return outcome(simulate_bench(test)).ending is Ending.REST
    room = LinkParameters(mass=setting.load, lower_stop=-_ENDLESS, upper_stop=_ENDLESS)
    speed = simulate_bench(replace(test, link=room)).column("link_velocity_rad_per_s")[-1]
    return bool(abs(speed) < _STOPPED * setting.push)


def _least_ratio(setting: Setting) -> float:
    test = bench_of(setting)
    return least_torque_ratio(law_in(test.friction, holding_torque(test)), MODEL, setting.push)


def linear_gain(setting: Setting) -> float:
    """Largest gain at which a small motion about rest decays, by the closed-loop transition matrix.

    Args:
        setting: The setting; its gain is put in.

    Returns:
        The gain.
    """
    test = bench_of(setting)
    loop = linear_loop(test, 0.0, holding_torque(test))

    def radius(gain: float) -> float:
        return spectral_radius(transition_matrix(replace(loop, gain=np.array([gain]))))

    found = largest_stable(radius, 0.0, HIGHEST_GAIN)
    return math.nan if found is None else found
