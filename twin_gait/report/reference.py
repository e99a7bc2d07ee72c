"""Reference walk of a run: measured gait that the experiment names, or that of a regression."""

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
    """Return speed [m/s] and body height [m]; None without them, or outside of the regression."""
    walking, patient = experiment.scenario.walking, experiment.patient
    if walking is None or patient is None:
        return None
    return (walking.speed, patient.height) if reference.reference_covers(walking.speed) else None


def reference_notes(experiment: Experiment) -> list[str]:
    """Return a sentence for each property of a walk for which the healthy reference is outside of its range.

    An unknown age gives no sentence. With a measured reference, errors do not depend on the regression.
    """
    walking, patient, notes = experiment.scenario.walking, experiment.patient, list[str]()
    if walking is None or patient is None:
        return notes
    if not reference.reference_covers(walking.speed):
        shown, slowest, fastest = (
            f"{reference.KILOMETRES_PER_HOUR * speed:.3g}"
            for speed in (walking.speed, reference.SLOWEST, reference.FASTEST)
        )
        nearest = slowest if walking.speed < reference.SLOWEST else fastest
        missing = "" if experiment.reference else "errors against healthy gait are missing, and "
        notes.append(
            f"There is no healthy reference at {shown} km/h, because the regression of Koopman et al. (2014) "
            f"covers {slowest} to {fastest} km/h: {missing}effort of the wearer and position control use "
            f"{nearest} km/h."
        )
    regression = experiment.reference is None
    if regression and patient.age is not None and not reference.YOUNGEST <= patient.age <= reference.OLDEST:
        notes.append(
            f"The healthy reference (Koopman et al. 2014) is that of people of {reference.YOUNGEST:.0f} to "
            f"{reference.OLDEST:.0f} years; the wearer is {patient.age:g} years old."
        )
    return notes


def reference_cycle(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Return the reference angles of a joint for an experiment.

    Returns angles in [rad] at ``PERCENT``, shape ``(101,)``; None without a reference walk.
    """
    if experiment.reference is not None:
        return experiment.reference.angles(joint)
    walk = _reference_walk(experiment)
    return None if walk is None else _cycle(joint, *walk)


@lru_cache(maxsize=16)
def _cycle(joint: JointName, speed: float, height: float) -> np.ndarray:
    """Return a reference curve from a cache: a summary needs it some ten times, and a new spline is slow."""
    curve = reference.reference_curve(joint, PERCENT, speed=speed, height=height)
    curve.setflags(write=False)
    return curve


def reference_label(experiment: Experiment) -> str:
    """Return the name of the reference angles for the legend of a figure."""
    return "healthy, Koopman (2014)" if experiment.reference is None else experiment.reference.source


def reference_deviation(experiment: Experiment, joint: JointName) -> np.ndarray | None:
    """Return the standard deviation of the reference angles of a joint in [rad]; None if it is not known."""
    return None if experiment.reference is None else experiment.reference.deviation(joint)


def reference_ground_force(experiment: Experiment) -> reference.GroundForce | None:
    """Return the ground reaction force of the reference walk over the carried weight, at ``PERCENT``.

    Returns shape ``(101,)`` each; None without a reference walk.
    """
    walk = _reference_walk(experiment)
    return None if walk is None else reference.normative_ground_force(PERCENT, speed=walk[0])


def reference_measures(experiment: Experiment) -> dict[str, float]:
    """Return the measures of the reference walk, named as in :func:`twin_gait.measures.walk.walk_measures`.

    Angles and time are from Koopman et al. (2014) or from the measured gait of the experiment, forces from
    Winter (1991), double support from two published means. In steady walking the mean fore-aft force and the
    power of the belt are zero. Measures without a reference are left out.
    """
    walk, measured, found = _reference_walk(experiment), experiment.reference, dict[str, float]()
    time = (
        measured.cycle_time if measured else None if walk is None else reference.reference_cycle_time(*walk)
    )
    if time is not None:
        found |= {"stride_time_s": time, "cadence_per_min": cadence(np.array([time]))}
    if walk is not None and measured is None:
        found["step_length_m"] = 0.5 * walk[0] * found["stride_time_s"]
    if walk is not None:
        found["double_support_share"] = reference.reference_double_support(walk[0])
    force = reference_ground_force(experiment)
    if force is not None:
        found["load_peak"] = float(force.vertical.max())
        found |= load_measures(force.vertical) | fore_aft_peaks(force.forward)
        found |= {"fore_aft_force_N": 0.0, "belt_power_W": 0.0}
    hip, knee, ankle = (reference_cycle(experiment, joint) for joint in JointName)
    if hip is not None:
        found["hip_lowest_deg"] = math.degrees(hip.min())
    if knee is not None:
        found |= knee_shape(knee)
    if ankle is not None:
        found["ankle_range_deg"] = math.degrees(np.ptp(ankle))
    return found
