"""The healthy walk that a run is compared with."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from twin_gait.experiment.experiment import Experiment
from twin_gait.measures import reference
from twin_gait.measures.strides import PERCENT, cadence
from twin_gait.measures.walk import fore_aft_peaks, knee_shape, load_measures
from twin_gait.vocabulary import JointName


def _reference_walk(experiment: Experiment) -> tuple[float, float] | None:
    """Speed in [m/s] and body height in [m]; None without them, or beyond the regression."""
    walking, patient = experiment.scenario.walking, experiment.patient
    if walking is None or patient is None:
        return None
    return (walking.speed, patient.height) if reference.reference_covers(walking.speed) else None


def reference_cycle(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Reference angles for an experiment.

    Returns angles in [rad] at ``PERCENT``, shape ``(101,)``; None without a reference walk.
    """
    walk = _reference_walk(experiment)
    return None if walk is None else _cycle(joint, *walk)


@lru_cache(maxsize=16)
def _cycle(joint: JointName, speed: float, height: float) -> np.ndarray:
    """A summary asks for it some ten times, and building the spline takes as long as reading the strides."""
    curve = reference.reference_curve(joint, PERCENT, speed=speed, height=height)
    curve.setflags(write=False)
    return curve


def reference_ground_force(experiment: Experiment) -> reference.GroundForce | None:
    """Force of the ground on a foot of the reference walk over the weight that it carries, at ``PERCENT``.

    Returns shape ``(101,)`` each; None without a reference walk.
    """
    walk = _reference_walk(experiment)
    return None if walk is None else reference.normative_ground_force(PERCENT, speed=walk[0])


def reference_measures(experiment: Experiment) -> dict[str, float]:
    """Measures of the reference walk, as :func:`twin_gait.measures.walk.walk_measures` has them.

    Angles and time are of Koopman et al. (2014), forces of Winter (1991); feet that neither brake nor propel
    on the mean, and a belt that gives nothing, are what even walking is. Returns those that are known; none
    without a reference walk.
    """
    walk, force = _reference_walk(experiment), reference_ground_force(experiment)
    if walk is None or force is None:
        return {}
    time = reference.reference_cycle_time(*walk)
    hip, knee, ankle = (_cycle(joint, *walk) for joint in JointName)
    return {
        "stride_time_s": time,
        "cadence_per_min": cadence(np.array([time])),
        "step_length_m": 0.5 * walk[0] * time,
        "load_peak": float(force.vertical.max()),
        **load_measures(force.vertical),
        **fore_aft_peaks(force.forward),
        "fore_aft_force_N": 0.0,
        "belt_power_W": 0.0,
        "hip_lowest_deg": math.degrees(hip.min()),
        **knee_shape(knee),
        "ankle_range_deg": math.degrees(np.ptp(ankle)),
    }
