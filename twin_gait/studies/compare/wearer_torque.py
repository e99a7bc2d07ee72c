"""The wearer's torque in its parts: what his muscles give on purpose, and the rest."""

from __future__ import annotations

import numpy as np

from twin_gait.core.wearer import passive_hip_torque, passive_knee_torque, spastic_torque
from twin_gait.measures.leg_record import wearer_column
from twin_gait.parameters import JointCondition, Patient
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side


def voluntary_torque(run: Run, side: Side, joint: JointName) -> np.ndarray:
    """Torque of the wearer's effort at a joint: his whole torque less tissue and spastic muscles.

    Args:
        run: A run on the treadmill.
        side: The leg.
        joint: Hip or knee.

    Returns:
        Torque in [N m], one value a tick, shape ``(n_ticks,)``.
    """
    log, patient = run.log, run.experiment.patient or Patient()
    condition = patient.conditions.get((side, joint), JointCondition())
    whole = log[f"{side}_{joint}_patient_torque_Nm"].to_numpy()
    speeds = log[wearer_column(log, side, joint, "velocity_rad_per_s")]
    catch = [
        spastic_torque(speed, condition.stretch_reflex_threshold, condition.stretch_reflex_gain)
        for speed in speeds
    ]
    return np.asarray(whole - condition.passive * _passive(run, side, joint) - np.array(catch))


def _passive(run: Run, side: Side, joint: JointName) -> np.ndarray:
    patient, log = run.experiment.patient or Patient(), run.log
    if patient.conditions.get((side, joint), JointCondition()).passive == 0.0:
        return np.zeros(len(log))
    hip, knee = (_shifted(run, patient, side, item) for item in (JointName.HIP, JointName.KNEE))
    if joint is JointName.HIP:
        return np.array([passive_hip_torque(*pair) for pair in zip(hip, knee, strict=True)])
    name = wearer_column(log, side, JointName.ANKLE, "angle_rad")
    ankle = log[name].tolist() if name in log else [0.0] * len(log)
    return np.array([passive_knee_torque(*angles) for angles in zip(hip, knee, ankle, strict=True)])


def _shifted(run: Run, patient: Patient, side: Side, joint: JointName) -> list[float]:
    """Angles as the tissue feels them: a contracture acts as if the joint were further extended."""
    contracture = patient.conditions.get((side, joint), JointCondition()).contracture
    name = wearer_column(run.log, side, joint, "angle_rad")
    angles: list[float] = (run.log[name] - contracture).tolist()
    return angles
