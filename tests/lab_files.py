"""Files of the lab as other programs write them, with known content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.replay.recording import normative_walk
from twin_gait.vocabulary import JointName, Side

SPEED = 3.0  # [km/h] of the reference walk
RATE = 100  # [frames/s]
MODEL_ANGLES = {
    (side, joint): f"{str(side)[0].upper()}{joint.capitalize()}Angles" for side in Side for joint in JointName
}


def healthy_frames() -> tuple[np.ndarray, dict[tuple[Side, JointName], np.ndarray]]:
    """Return times in s and angles in deg of the reference walk, 100 frames a second, in single precision."""
    walk = normative_walk(f"koopman@{SPEED:g}")
    step = 1000 // RATE
    angles = {
        key: np.degrees(walk.angles[key][::step]).astype(np.float32).astype(float) for key in MODEL_ANGLES
    }
    return np.arange(len(angles[Side.LEFT, JointName.HIP])) / RATE, angles


def write_c3d(
    path: Path, points: dict[str, np.ndarray], *, events: Sequence[tuple[str, str, float]] = (),
    unit: str = "deg", first_frame: int = 0, owners: Sequence[str] = (),
) -> Path:  # fmt: skip
    """Write the x components of points as C3D; ``events``: side, label and time in s."""
    import ezc3d

    trial: Any = ezc3d.c3d()
    trial["header"]["points"]["first_frame"] = first_frame
    trial["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    trial["parameters"]["POINT"]["LABELS"]["value"] = list(points)
    data = np.ones((4, len(points), len(next(iter(points.values())))))
    data[0] = np.array(list(points.values()))
    trial["data"]["points"] = data
    trial.add_parameter("POINT", "ANGLE_UNITS", [unit])
    if events:
        minutes, seconds = np.divmod([time for *_, time in events], 60.0)
        trial.add_parameter("EVENT", "USED", [len(events)])
        trial.add_parameter("EVENT", "CONTEXTS", [side for side, *_ in events])
        trial.add_parameter("EVENT", "LABELS", [label for _, label, _ in events])
        trial.add_parameter("EVENT", "TIMES", np.array([minutes, seconds]))
        if owners:
            trial.add_parameter("EVENT", "SUBJECTS", list(owners))
    trial.write(str(path))
    return path


def locohub_frame(
    strides: int = 4, *, subject: str = "UM21_AB01", task: str = "level_walking", shift: float = 0.0,
    cycle_time: float | None = 1.2, **more: Any,
) -> pd.DataFrame:  # fmt: skip
    """Return strides as LocoHub's converters write them: sines with the knee flexed, in rad."""
    turn = np.linspace(0.0, 2.0 * np.pi, 150)
    columns: dict[str, Any] = {
        "subject": subject, "subject_metadata": "age:25,sex:M,height_m:1.75,weight_kg:70", "task": task,
        "task_id": "level", "task_info": "leg:l,speed_m_s:1.2,incline_deg:0",
        "step": np.repeat([f"{number:03d}" for number in range(1, strides + 1)], 150),
        "phase_ipsi": np.tile(np.linspace(0.0, 100.0, 150), strides),
    }  # fmt: skip
    if cycle_time is not None:
        columns["phase_ipsi_dot"] = 100.0 / cycle_time
    for limb, lead in (("ipsi", 0.0), ("contra", np.pi)):
        columns[f"hip_flexion_angle_{limb}_rad"] = np.tile(0.2 + shift + 0.3 * np.cos(turn + lead), strides)
        columns[f"knee_flexion_angle_{limb}_rad"] = np.tile(0.5 - 0.4 * np.cos(2 * turn + lead), strides)
    return pd.DataFrame({**columns, **more})
