"""The healthy walk that a run is held against."""

from __future__ import annotations

import numpy as np

from twin_gait.experiment import Experiment
from twin_gait.measures.reference import reference_covers, reference_curve
from twin_gait.measures.strides import PERCENT
from twin_gait.scenario import TreadmillScenario
from twin_gait.vocabulary import JointName


def reference_cycle(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Reference angles at the belt speed and for the body height of an experiment.

    Args:
        experiment: What was run.
        joint: The joint.

    Returns:
        Angles in [rad] at ``PERCENT``, shape ``(101,)``; None without belt or wearer, or where the
        regression does not reach the belt speed.
    """
    scenario, patient = experiment.scenario, experiment.patient
    if not isinstance(scenario, TreadmillScenario) or patient is None:
        return None
    if not reference_covers(scenario.belt_speed):
        return None
    return reference_curve(joint, PERCENT, speed=scenario.belt_speed, height=patient.height)
