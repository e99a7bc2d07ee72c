"""Whether the people who ship walk with the shipped table, and in what braces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.configuration.experiments import DEFAULT_PRESET, load_experiment
from twin_gait.experiment import Experiment
from twin_gait.measures.leg_record import wearer_column
from twin_gait.parameters import BraceParameters, Patient
from twin_gait.runs.summary import interaction_summary
from twin_gait.simulation import Run, simulate
from twin_gait.studies.batch import Flat, flat_summary
from twin_gait.vocabulary import JointName, Side

MASS_ALONE, PASSIVE_ALONE = "mass alone", "passive moments alone"
_PLAIN = {MASS_ALONE: (), PASSIVE_ALONE: ("patient.both={hip: {passive: 1}, knee: {passive: 1}}",)}


class Trial(NamedTuple):
    """A run of one person with the shipped table.

    Attributes:
        patient: Who walked.
        outcome: See :mod:`twin_gait.measures.outcome`.
        reason: Why, if they did not walk.
        summary: Of the run.
        peaks: Highest torque of the wearer at any hip and at any knee in [N m].
        powers: Mean power of his torques at both hips and at both knees in [W].
    """

    patient: Patient
    outcome: str
    reason: str
    summary: Flat
    peaks: tuple[float, float]
    powers: tuple[float, float]


def trial(experiment: Experiment) -> Trial:
    """Let one person walk.

    Args:
        experiment: On the treadmill, with a wearer.

    Returns:
        What came of it.
    """
    run = simulate(experiment)
    return Trial(
        patient=experiment.patient or Patient(),
        outcome=str(run.verdict.outcome),
        reason=run.verdict.reason,
        summary=flat_summary(run),
        peaks=(_peak(run, JointName.HIP), _peak(run, JointName.KNEE)),
        powers=(_power(run, JointName.HIP), _power(run, JointName.KNEE)),
    )


def experiment_of(name: str, support: float, duration: float) -> Experiment:
    """The shipped walk with somebody as wearer.

    Args:
        name: Of a person that ships, ``mass alone`` or ``passive moments alone``.
        support: Share of the weight that is carried.
        duration: In [s].

    Returns:
        The experiment.
    """
    settings = [f"scenario.support.share={support}", f"duration_s={duration}"]
    settings += _PLAIN.get(name, (f"patient={name}",))
    return load_experiment(DEFAULT_PRESET, settings).experiment


class BraceTrial(NamedTuple):
    """A run of one person in braces.

    Attributes:
        braces: What binds him.
        outcome: See :mod:`twin_gait.measures.outcome`.
        interaction: From :func:`twin_gait.runs.summary.interaction_summary`.
        stride_times: Mean of each leg in [s]; None without strides.
    """

    braces: BraceParameters
    outcome: str
    interaction: Mapping[str, Mapping[str, float]]
    stride_times: tuple[float | None, ...]


def brace_trial(experiment: Experiment, factor: float) -> BraceTrial:
    """Let one person walk in braces.

    Args:
        experiment: On the treadmill, with a wearer.
        factor: By which the braces are stiffer than the default ones; their dampers by its root, which keeps
            the share of critical damping.

    Returns:
        What came of it.
    """
    braces = BraceParameters().stiffened(factor)
    run = simulate(replace(experiment, interface=braces))
    summary = flat_summary(run)
    return BraceTrial(
        braces=braces,
        outcome=str(run.verdict.outcome),
        interaction=interaction_summary(run)["interaction"],
        stride_times=tuple(summary[f"{side}_stride_time_mean_s"] for side in Side),  # type: ignore[misc]
    )


def _columns(run: Run, joint: JointName, name: str) -> np.ndarray:
    return run.log[[f"{side}_{joint}_{name}" for side in Side]].to_numpy()


def _velocities(run: Run, joint: JointName) -> np.ndarray:
    names = [wearer_column(run.log, side, joint, "velocity_rad_per_s") for side in Side]
    return run.log[names].to_numpy()


def _peak(run: Run, joint: JointName) -> float:
    return float(np.abs(_columns(run, joint, "patient_torque_Nm")).max())


def _power(run: Run, joint: JointName) -> float:
    power = _columns(run, joint, "patient_torque_Nm") * _velocities(run, joint)
    return float(power.sum(axis=1).mean())
