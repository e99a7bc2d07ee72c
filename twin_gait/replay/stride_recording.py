"""Walk of one person from strides in the format of LocoHub, joined in the order of the file."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.device import PlantParameters
from twin_gait.measures import locohub
from twin_gait.measures.locohub import CONTRA, IPSI, StrideSet
from twin_gait.replay.samples import CLOSED, Recording, resample_to_ticks
from twin_gait.vocabulary import JointName, Side


def read_stride_recording(
    path: Path, *, subject: str | None = None, task: str | None = None, cycle_time: float | None = None
) -> Recording:
    """Read the strides of one limb and of the other limb in them as one walk.

    The last sample of a stride is the first one of the next stride. The limb is the left one if the file has
    strides of both, and if it states no side. ``task``: task or task_id. ``cycle_time``: duration of each
    stride in [s], needed if the file does not state it.

    Returns the walk at the ticks of the controller. Raises ParameterFileError if the file has a mistake,
    several people and no ``subject``, or no duration.
    """
    strides = locohub.read_strides(path, subject=subject, task=task)
    people = sorted(set(strides.subjects.tolist()))
    if len(people) > 1:
        raise ParameterFileError(
            path, "subject", f"expected --subject and one of {locohub.list_names(people)}, got none"
        )
    side, other = _limbs(strides)
    warnings = list(strides.notices)
    chosen = np.array([item in (side, None) for item in strides.sides])
    if None in strides.sides:
        warnings.append(f"the side of a stride is not stated; its own limb is taken as the {side} one")
    lasts = np.full(chosen.sum(), cycle_time) if cycle_time else strides.cycle_times[chosen]
    if not np.isfinite(lasts).all() or lasts.min() <= 0.0:
        text = "does not state the duration of the strides; give it in s with --cycle-time-s"
        raise ParameterFileError(path, locohub.PHASE_RATE, text)
    joined = {name: _join(rows[chosen]) for name, rows in strides.samples.items()}
    angles = {
        (limb_side, str(joint)): joined[name]
        for limb_side, limb in ((side, IPSI), (other, CONTRA))
        for joint in JointName
        if (name := locohub.angle_column(joint, limb)) in joined
    }
    warnings += _open_ends({name: rows[chosen] for name, rows in strides.samples.items()})
    share = np.linspace(0.0, 1.0, locohub.POINTS)[:-1]
    begin = np.append(0.0, np.cumsum(lasts))
    time = np.append((begin[:-1, None] + share * lasts[:, None]).ravel(), begin[-1])
    weight = PlantParameters.gravity * float(strides.masses[chosen][0])
    loads = {
        limb_side: weight * joined[name]
        for limb_side, limb in ((side, IPSI), (other, CONTRA))
        if (name := locohub.load_column(limb)) in joined and math.isfinite(weight)
    }
    recording = Recording(
        strides.source, 0.0, angles, loads, {}, {},
        body_weight=weight if loads else None, warnings=tuple(warnings), foot_strikes={side: begin},
    )  # fmt: skip
    return resample_to_ticks(recording, time)


def _limbs(strides: StrideSet) -> tuple[Side, Side]:
    """Return the side of the limb whose strides are joined, and the other side."""
    right = Side.RIGHT in strides.sides and Side.LEFT not in strides.sides
    return (Side.RIGHT, Side.LEFT) if right else (Side.LEFT, Side.RIGHT)


def _join(rows: np.ndarray) -> np.ndarray:
    """Join strides, shape ``(n, 150)``, to one signal; the last sample of each but the last is left out."""
    return np.append(rows[:, :-1].ravel(), rows[-1, -1])


def _open_ends(samples: Mapping[str, np.ndarray]) -> list[str]:
    """Return a warning if strides do not begin at the angles with which the ones before end."""
    angles = [rows for name, rows in samples.items() if "_angle_" in name]
    steps = np.max([np.abs(np.degrees(rows[1:, 0] - rows[:-1, -1])) for rows in angles], axis=0)
    apart = int((steps > CLOSED).sum())
    text = f"{apart} of {len(steps)} strides begin more than {CLOSED:g} deg from the end of the one before"
    return [f"{text}: they did not follow each other"] if apart else []
