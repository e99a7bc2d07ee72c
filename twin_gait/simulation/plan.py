"""What the controller of an experiment knows before the walk, and where it lets the legs begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from twin_gait.control.controller import Plan
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.scaling import InertiaAt
from twin_gait.measures.reference import FASTEST, SLOWEST
from twin_gait.parameters import Patient
from twin_gait.vocabulary import JointName, Side


def plan_of(experiment: Experiment, sides: tuple[Side, ...], inertia: InertiaAt) -> Plan:
    """What the controller of an experiment knows.

    ``inertia``: effective inertia of a joint of the controller's model.
    """
    scenario = experiment.scenario
    walking = scenario.walking
    return Plan(
        sides=sides,
        joints=tuple(experiment.table.joints),
        phases=tuple(experiment.table.phase_names),
        leading=scenario.leading_of(sides),
        speed=SLOWEST if walking is None else min(max(walking.speed, SLOWEST), FASTEST),
        height=(experiment.patient or Patient()).height,
        inertia=inertia,
    )


def starting_at(experiment: Experiment, begin: Mapping[Side, Mapping[JointName, float]]) -> Experiment:
    """Let the legs begin where the controller wants them to, whatever the scenario says.

    ``begin``: joint angles in [rad] by leg; itself if there are none.
    """
    if not begin:
        return experiment
    return replace(experiment, scenario=experiment.scenario.starting_in(begin))
