"""The healthy walk that a run is held against."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.experiment import Experiment
from twin_gait.measures.reference import reference_covers, reference_curve, reference_cycle_time
from twin_gait.measures.strides import PERCENT
from twin_gait.scenario import TreadmillScenario
from twin_gait.vocabulary import JointName


class Walk(NamedTuple):
    """What the reference depends on.

    Attributes:
        speed: In [m] / [s].
        height: Of the wearer in [m].
    """

    speed: float
    height: float


def reference_walk(experiment: Experiment) -> Walk | None:
    """Belt speed and body height of an experiment.

    Args:
        experiment: What was run.

    Returns:
        The walk; None without belt or wearer, or where the regression does not reach the belt speed.
    """
    scenario, patient = experiment.scenario, experiment.patient
    if not isinstance(scenario, TreadmillScenario) or patient is None:
        return None
    return Walk(scenario.belt_speed, patient.height) if reference_covers(scenario.belt_speed) else None


def reference_cycle(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Reference angles for an experiment.

    Args:
        experiment: What was run.
        joint: The joint.

    Returns:
        Angles in [rad] at ``PERCENT``, shape ``(101,)``; None without a reference walk.
    """
    walk = reference_walk(experiment)
    if walk is None:
        return None
    return reference_curve(joint, PERCENT, speed=walk.speed, height=walk.height)


def reference_stride_time(experiment: Experiment) -> float | None:
    """Duration of a stride of the reference walk.

    Args:
        experiment: What was run.

    Returns:
        Duration in [s]; None without a reference walk.
    """
    walk = reference_walk(experiment)
    return None if walk is None else reference_cycle_time(walk.speed, walk.height)
