"""What the wearer of an experiment does, as an episode has it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin_gait.core.wearer import Condition
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.reference import FASTEST, SLOWEST, normative_moment, reference_curve
from twin_gait.parameters import JointCondition, Patient
from twin_gait.scenario.treadmill import TreadmillScenario
from twin_gait.vocabulary import FIRST_SWING, STAND, GaitPhase, JointName, Side

# Spans of the phases in healthy walking in [%] of the cycle: loading response, mid stance, terminal stance
# with pre-swing, initial swing, mid and terminal swing (J. Perry: Gait analysis, Slack, 1992).
PHASE_SPANS = {
    GaitPhase.EARLY_STANCE: (0.0, 12.0),
    GaitPhase.MIDDLE_STANCE: (12.0, 31.0),
    GaitPhase.LATE_STANCE: (31.0, 62.0),
    GaitPhase.SWING_FLEXION: (62.0, 75.0),
    GaitPhase.SWING_EXTENSION: (75.0, 100.0),
}
_STANCE = (GaitPhase.EARLY_STANCE, GaitPhase.MIDDLE_STANCE, GaitPhase.LATE_STANCE)
LOWEST_POSTURE, POSTURE_STEP, POSTURES = np.radians(-30.0), np.radians(2.0), 41  # hip angles of the table
_SAMPLES = 51  # of the cycle in a phase


class Wearer(NamedTuple):
    """A wearer as :mod:`twin_gait.core.wearer` reads them.

    Attributes:
        acts: Whether the wearer gives any torque.
        conditions: Of each joint.
        moments: Normative moment in [N m] by joint, phase and hip angle, shape
            ``(n_joints, n_phases, POSTURES)``.
        noise: Share by which the effort strays in a tick, shape ``(n_ticks or 1, n_joints)``.
        delay: Of the effort in ticks.
    """

    acts: bool
    conditions: list[Condition]
    moments: np.ndarray
    noise: np.ndarray
    delay: int


def wearer_of(experiment: Experiment, table: GaitTable, joints: Sequence[tuple[Side, JointName]]) -> Wearer:
    """Lay the wearer of an experiment out.

    Raises:
        ParameterError: If the wearer makes an effort, and the table has other phases than the five.
    """
    patient = experiment.patient
    count, phases = len(joints), len(table.phase_names)
    moments = np.zeros((count, phases, POSTURES))
    if patient is None or patient.is_mass_alone:
        nothing = [Condition(0.0, 0.0, 0.0, 0.0, 0.0) for _ in joints]
        return Wearer(False, nothing, moments, np.zeros((1, count)), 0)
    conditions = [_condition(patient.conditions.get(place, JointCondition())) for place in joints]
    if any(item.effort for item in conditions):
        _require_phases(table)
        for number, (_, joint) in enumerate(joints):
            moments[number] = _moments(experiment, patient, table, joint)
    noise = _noise(experiment, patient, count)
    return Wearer(True, conditions, moments, noise, round(patient.effort_delay / TICK))


def _condition(condition: JointCondition) -> Condition:
    return Condition(
        passive_share=condition.passive,
        contracture=condition.contracture,
        stretch_reflex_threshold=condition.stretch_reflex_threshold,
        stretch_reflex_gain=condition.stretch_reflex_gain,
        effort=condition.effort * condition.strength,
    )


def _require_phases(table: GaitTable) -> None:
    known = (*PHASE_SPANS, STAND, FIRST_SWING)
    unknown = [name for name in table.phase_names if name not in known]
    if unknown:
        raise ParameterError(
            f"patient.effort: gait table {table.name!r} has the phase {unknown[0]!r}; an effort is known for "
            f"{', '.join(known)} only; set it to 0"
        )


def _moments(experiment: Experiment, patient: Patient, table: GaitTable, joint: JointName) -> np.ndarray:
    """Normative moment by phase and hip angle: that of the instant of the phase with the nearest hip angle.

    On a treadmill the legs carry what the support leaves, and stance moments shrink with it; a leg on its
    stand carries nothing. A wearer who stands still leaves that to the device; in the first swing they act as
    in the initial swing of any stride.
    """
    scenario = experiment.scenario
    speed, carried = SLOWEST, 0.0
    if isinstance(scenario, TreadmillScenario):
        speed = min(max(scenario.belt_speed, SLOWEST), FASTEST)
        carried = 1.0 - scenario.support.share
    postures = LOWEST_POSTURE + POSTURE_STEP * np.arange(POSTURES)
    rows = []
    for name in table.phase_names:
        if name == STAND:
            rows.append(np.zeros(POSTURES))
            continue
        phase = GaitPhase.SWING_FLEXION if name == FIRST_SWING else GaitPhase(name)
        percent = np.linspace(*PHASE_SPANS[phase], _SAMPLES)
        hip = reference_curve(JointName.HIP, percent, speed=speed, height=patient.height)
        nearest = np.abs(hip[None, :] - postures[:, None]).argmin(axis=1)
        share = carried if phase in _STANCE else 1.0
        rows.append(share * patient.mass * normative_moment(joint, percent[nearest]))
    return np.array(rows)


def _noise(experiment: Experiment, patient: Patient, count: int) -> np.ndarray:
    if patient.effort_noise == 0.0:
        return np.zeros((1, count))
    # A stream of its own: the sensors' noise stays what it is without an effort.
    generator = np.random.default_rng((experiment.seed, 1))
    return patient.effort_noise * generator.standard_normal((experiment.n_ticks, count))
