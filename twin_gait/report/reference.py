"""The healthy walk that a run is compared with."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twin_gait.experiment import Experiment
from twin_gait.measures.reference import reference_covers, reference_curve, reference_cycle_time
from twin_gait.measures.strides import PERCENT
from twin_gait.scenario import TreadmillScenario
from twin_gait.vocabulary import JointName


def _reference_walk(experiment: Experiment) -> tuple[float, float] | None:
    """Belt speed in [m/s] and body height in [m]; None without them, or beyond the regression."""
    scenario, patient = experiment.scenario, experiment.patient
    if not isinstance(scenario, TreadmillScenario) or patient is None:
        return None
    return (scenario.belt_speed, patient.height) if reference_covers(scenario.belt_speed) else None


def reference_cycle(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Reference angles for an experiment.

    Returns:
        Angles in [rad] at ``PERCENT``, shape ``(101,)``; None without a reference walk.
    """
    walk = _reference_walk(experiment)
    return None if walk is None else _cycle(joint, *walk)


@lru_cache(maxsize=16)
def _cycle(joint: JointName, speed: float, height: float) -> np.ndarray:
    """A summary asks for it some ten times, and building the spline takes as long as reading the strides."""
    curve = reference_curve(joint, PERCENT, speed=speed, height=height)
    curve.setflags(write=False)
    return curve


def reference_stride_time(experiment: Experiment) -> float | None:
    """Duration of a stride of the reference walk.

    Returns:
        Duration in [s]; None without a reference walk.
    """
    walk = _reference_walk(experiment)
    return None if walk is None else reference_cycle_time(*walk)
