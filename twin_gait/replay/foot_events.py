"""Strides of a recorded walk from heel strike to heel strike, and their table in the format of LocoHub."""

from pathlib import Path

import numpy as np
from scipy.signal import find_peaks

from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.device import PlantParameters
from twin_gait.export.locohub import LEVEL, angle_signals, stride_table
from twin_gait.files import write_parquet
from twin_gait.gait.table import TICK
from twin_gait.measures.foot_contact import find_foot_contacts
from twin_gait.measures.locohub import load_column
from twin_gait.measures.strides import stride_bounds
from twin_gait.replay.samples import Recording
from twin_gait.vocabulary import JointName, Side

# Durations in [s]: of a sprinter, and of the slowest steps of an exoskeleton's wearer.
SHORTEST_STRIDE, LONGEST_STRIDE = 0.4, 10.0
_PROMINENCE = 0.5  # least height of a forward position of the foot over the range of the positions
RECORDED, FROM_LOAD, FROM_ANGLES = "recorded", "the load of the foot", "the angles of hip and knee"


def foot_strikes(recording: Recording, side: Side) -> tuple[np.ndarray, str]:
    """Return the ticks of the heel strikes of a leg, ascending, and their origin.

    They are the recorded ones, else those of the load of the foot, else the instants at which the foot is
    furthest in front of the hip (J. A. Zeni, J. G. Richards, J. S. Higginson: Two simple methods for
    determining gait events during treadmill and overground walking using kinematic data, Gait & Posture 27
    (2008) 710-714). With thighs as long as shanks, its position over their length is
    sin(hip) + sin(hip − knee); the pelvis is taken to keep its tilt. Raises ParameterFileError if hip or knee
    were not recorded.
    """
    hip, knee = (recording.angles.get((side, joint)) for joint in (JointName.HIP, JointName.KNEE))
    if side in recording.foot_strikes:
        ticks = np.rint((recording.foot_strikes[side] - recording.start) / TICK).astype(int)
        return ticks[(ticks >= 0) & (ticks < recording.n_ticks)], RECORDED
    if side in recording.loads:
        return find_foot_contacts(recording.loads[side], TICK, hip).heel_strikes, FROM_LOAD
    if hip is None or knee is None:
        text = "expected foot strikes, the load of the foot, or hip and knee, to find the heel strikes"
        raise ParameterFileError(recording.source, f"{side} leg", text)
    position = np.sin(hip) + np.sin(hip - knee)
    least = _PROMINENCE * np.ptp(position)
    peaks, _ = find_peaks(position, distance=round(SHORTEST_STRIDE / TICK), prominence=least or None)
    return peaks, FROM_ANGLES


def walking_strides(strikes: np.ndarray) -> np.ndarray:
    """Return the strides between heel strikes that last as long as a stride of walking, shape ``(n, 2)``."""
    bounds = stride_bounds(strikes)
    lasts = TICK * (bounds[:, 1] - bounds[:, 0])
    return np.asarray(bounds[(lasts >= SHORTEST_STRIDE) & (lasts <= LONGEST_STRIDE)])


def write_strides(recording: Recording, path: Path, *, subject: str = "subject", task: str = LEVEL) -> str:
    """Write the strides of a recorded walk in the format of LocoHub.

    Returns a line about their number and origin. Raises ParameterFileError if there is no whole stride.
    """
    found = {side: foot_strikes(recording, side) for side in recording.sides}
    bounds = {side: walking_strides(strikes) for side, (strikes, _) in found.items()}
    count = sum(map(len, bounds.values()))
    if not count:
        origins = ", ".join(dict.fromkeys(origin for _, origin in found.values()))
        text = f"has no whole stride between two heel strikes of a foot ({origins})"
        raise ParameterFileError(recording.source, "", text)
    weight, limbs = recording.body_weight, {}
    for side in recording.sides:
        angles = {
            joint: recording.angles[side, joint] for joint in JointName if (side, joint) in recording.angles
        }
        limbs[side] = angle_signals(angles)
        if weight is not None and side in recording.loads:
            limbs[side][load_column("{}")] = recording.loads[side] / weight
    metadata = {} if weight is None else {"weight_kg": f"{weight / PlantParameters.gravity:g}"}
    table = stride_table(limbs, bounds, subject=subject, metadata=metadata, task=task, facts={})
    write_parquet(path, table)
    origins = ", ".join(f"{side}: {origin}" for side, (_, origin) in found.items())
    return f"{count} strides (heel strikes: {origins})"
