"""What the controller of an experiment knows before the walk, and where it lets the legs begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from twin_gait.control.controller import Plan
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.scaling import InertiaAt
from twin_gait.measures.reference import FASTEST, SLOWEST
from twin_gait.parameters import Patient
from twin_gait.vocabulary import Side
from twin_gait.worlds.treadmill import Treadmill


def plan_of(experiment: Experiment, sides: tuple[Side, ...], inertia: InertiaAt) -> Plan:
    """What the controller of an experiment knows.

    Args:
        inertia: Effective inertia of a joint of the controller's model.
    """
    scenario = experiment.scenario
    speed, leading = SLOWEST, sides[0]
    if isinstance(scenario, Treadmill):
        speed = min(max(scenario.belt_speed, SLOWEST), FASTEST)
        leading = scenario.leading
    return Plan(
        sides=sides,
        joints=tuple(experiment.table.joints),
        phases=tuple(experiment.table.phase_names),
        leading=leading,
        speed=speed,
        height=(experiment.patient or Patient()).height,
        inertia=inertia,
    )


def starting_at(experiment: Experiment, begin: Mapping[Side, tuple[float, float]]) -> Experiment:
    """Let the legs begin where the controller wants them to, whatever the scenario says.

    Args:
        begin: Joint angles in [rad] by leg; itself if there are none.
    """
    if not begin:
        return experiment
    scenario, sides = experiment.scenario, tuple(begin)
    if not isinstance(scenario, Treadmill):
        return replace(experiment, scenario=replace(scenario, start_angles=begin[sides[0]]))
    trailing = next(side for side in sides if side is not scenario.leading)
    return replace(
        experiment,
        scenario=replace(scenario, leading_angles=begin[scenario.leading], trailing_angles=begin[trailing]),
    )
