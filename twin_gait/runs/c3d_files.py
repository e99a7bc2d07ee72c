"""Reader of C3D files with the angles of a model, such as Vicon Plug-in Gait, and events of the feet.

The C3D format is that of The C3D File Format User Guide (https://www.c3d.org): ``EVENT:TIMES`` are minutes
and seconds since frame 1. The outputs of a model are points whose x component is flexion; Plug-in Gait writes
them in degrees (Vicon, Plug-in Gait Reference Guide, output angles).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.conventions import DEGREES, PLUG_IN_GAIT
from twin_gait.exceptions import MissingOptionalDependency, ParameterFileError
from twin_gait.files import require_regular, require_table_size
from twin_gait.vocabulary import Side

MOST_BYTES = 2**31  # largest size of a C3D file
STRIKE, OFF = "Foot Strike", "Foot Off"
INVERSE_KINEMATICS = (
    "has positions of markers and no joint angles; compute the angles by inverse kinematics with another "
    "program (OpenSim's Inverse Kinematics Tool, Pose2Sim, OpenCap, Visual3D, or Plug-in Gait in Nexus), and "
    f"replay its .mot, or its .c3d with {', '.join(PLUG_IN_GAIT.columns.values())}"
)
Events = Mapping[tuple[Side, str], np.ndarray]  # times in [s] by side and label, ascending


class C3dTrial(NamedTuple):
    """Columns and events of a C3D file."""

    frame: pd.DataFrame  # time in [s], and the x component of each point
    unit: str  # unit of the angles, ``deg`` or ``rad``
    events: Events


def read_c3d(path: Path, subject: str | None = None) -> C3dTrial:
    """Read the points and events of one person.

    ``subject``: prefix of the person's points, as in ``P01:LHipAngles``; None if all points are those of one
    person. Raises MissingOptionalDependency without ezc3d, and ParameterFileError if the file cannot be read,
    or has no points of ``subject``.
    """
    try:
        import ezc3d
    except ImportError as error:
        raise MissingOptionalDependency("ezc3d", "mocap", f"{path}: a C3D file") from error
    require_regular(path, MOST_BYTES)
    try:
        trial = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        text = f"cannot be read as C3D ({' '.join(str(error).split())[:100]})"
        raise ParameterFileError(path, "", text) from error
    parameters, points = trial["parameters"], trial["data"]["points"]
    require_table_size(path, points.shape[2], points.shape[1])
    labels = _labels(parameters.get("POINT", {}))[: points.shape[1]]
    people = sorted({owner for owner, colon, _ in map(_split, labels) if colon})
    person = people[0] if subject is None and len(people) == 1 else subject
    if people and person not in people:
        given = "none" if subject is None else repr(subject)
        text = f"expected --subject and one of {', '.join(people)}, got {given}"
        raise ParameterFileError(path, "subject", text)
    rate, first = float(trial["header"]["points"]["frame_rate"]), trial["header"]["points"]["first_frame"]
    if not rate > 0.0:
        raise ParameterFileError(path, "POINT:RATE", f"expected frames per second, got {rate:g}")
    columns = {"time_s": (first + np.arange(points.shape[2])) / rate}
    for index, label in enumerate(labels):
        owner, _, name = _split(label)
        if owner in ("", person):
            columns[name] = points[0, index]
    return C3dTrial(
        pd.DataFrame(columns), _angle_unit(path, parameters["POINT"]), _events(parameters, person)
    )


def _split(label: str) -> tuple[str, str, str]:
    """Return the person, a colon and the name of a point; the person is empty without a colon."""
    return label.rpartition(":")


def _labels(group: Mapping[str, Any]) -> list[str]:
    """Return the names of the points; more than 255 of them continue in ``LABELS2`` and so on."""
    names = ["LABELS", *(f"LABELS{number}" for number in range(2, len(group) + 2))]
    return [str(label).strip() for name in names if name in group for label in group[name]["value"]]


def _angle_unit(path: Path, group: Mapping[str, Any]) -> str:
    """Return the unit in ``POINT:ANGLE_UNITS``; without one, the degrees of Plug-in Gait."""
    stated = [str(item).strip() for item in group.get("ANGLE_UNITS", {"value": []})["value"]]
    unit = stated[0][:3].lower() if stated and stated[0] else DEGREES
    if unit not in (DEGREES, "rad"):
        raise ParameterFileError(path, "POINT:ANGLE_UNITS", f"expected deg or rad, got {stated[0]!r}")
    return unit


def _events(parameters: Mapping[str, Any], person: str | None) -> dict[tuple[Side, str], np.ndarray]:
    """Return the times of foot strikes and foot offs by side; those of another person are left out."""
    group = parameters.get("EVENT", {})
    if not all(name in group for name in ("CONTEXTS", "LABELS", "TIMES")):
        return {}
    contexts, labels = (group[name]["value"] for name in ("CONTEXTS", "LABELS"))
    owners = group.get("SUBJECTS", {"value": []})["value"] or [""] * len(labels)
    minutes, seconds = np.asarray(group["TIMES"]["value"], dtype=float).reshape(2, -1)
    found: dict[tuple[Side, str], list[float]] = {}
    for context, label, owner, time in zip(contexts, labels, owners, 60.0 * minutes + seconds, strict=False):
        side, kind = context.strip().lower(), label.strip().title()
        if side in tuple(Side) and kind in (STRIKE, OFF) and (not person or owner.strip() in ("", person)):
            found.setdefault((Side(side), kind), []).append(time)
    return {key: np.sort(times) for key, times in found.items()}
