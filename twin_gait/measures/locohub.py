"""Strides in the format of LocoHub: Parquet with 150 samples from a heel strike to the next of the same foot.

Names, units and signs are those of LocoHub (https://github.com/jmontp/LocoHub: docs/reference/index.md at
commit 0316a58, and src/locohub/feature_constants.py at commit 6a09983 for the columns). The limb whose heel
strikes bound a stride is ``ipsi``, the other one ``contra``. Flexion and dorsiflexion are positive, as in
this package. LocoHub's converters state the side in ``task_info`` as ``leg:l`` or ``leg:r`` and the rate of
the phase in [%/s] as ``phase_ipsi_dot``; both are optional.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from twin_gait.exceptions import ParameterFileError
from twin_gait.files import read_parquet, require_parquet
from twin_gait.measures.strides import PERCENT
from twin_gait.vocabulary import JointName, Side

POINTS = 150  # samples of a stride; the last one is the first of the next stride
PHASE = np.linspace(PERCENT[0], PERCENT[-1], POINTS)  # phase of the samples in [%]
PHASE.setflags(write=False)
IPSI, CONTRA = "ipsi", "contra"
MOTIONS = {
    JointName.HIP: "hip_flexion",
    JointName.KNEE: "knee_flexion",
    JointName.ANKLE: "ankle_dorsiflexion",
}
SUBJECT, TASK, TASK_ID, TASK_INFO, STEP = "subject", "task", "task_id", "task_info", "step"
PHASE_COLUMN, PHASE_RATE, METADATA = "phase_ipsi", "phase_ipsi_dot", "subject_metadata"
LARGEST_ANGLE = math.pi  # [rad]; a larger angle means that degrees are in a column of radians
_UNREADABLE = (pa.ArrowException, OSError, ValueError, TypeError, KeyError, OverflowError)
_LISTED = 12  # largest number of names in a message
_KEYS = (SUBJECT, TASK, TASK_ID, TASK_INFO, STEP)  # columns that are constant within a stride
_SIDES = {"l": Side.LEFT, "left": Side.LEFT, "r": Side.RIGHT, "right": Side.RIGHT}


def angle_column(joint: JointName, limb: str) -> str:
    """Return the column of a joint angle; ``limb``: ``ipsi`` or ``contra``."""
    return f"{MOTIONS[joint]}_angle_{limb}_rad"


def load_column(limb: str) -> str:
    """Return the column of the vertical ground force divided by the weight of the subject."""
    return f"grf_vertical_{limb}_BW"


_ANGLES = {angle_column(joint, limb) for joint in JointName for limb in (IPSI, CONTRA)}
_SAMPLED = _ANGLES | {load_column(limb) for limb in (IPSI, CONTRA)}


@dataclass(frozen=True, eq=False)
class StrideSet:
    """Strides of a file, in its order."""

    source: str  # path of the file, for messages
    subjects: np.ndarray  # subject of each stride, shape ``(n,)``
    sides: tuple[Side | None, ...]  # side of the ipsilateral limb of each stride, None if it is not stated
    cycle_times: np.ndarray  # duration of each stride in [s], NaN if it is not stated, shape ``(n,)``
    masses: np.ndarray  # mass of the subject in [kg], NaN if it is not stated, shape ``(n,)``
    samples: Mapping[str, np.ndarray]  # samples by column, shape ``(n, 150)``
    notices: tuple[str, ...] = ()  # strides that were left out, one line each


def is_locohub(path: Path) -> bool:
    """Return whether a file is a Parquet table with the columns of LocoHub."""
    try:
        require_parquet(path)
        return {SUBJECT, TASK} <= set(pq.read_schema(path).names)
    except (*_UNREADABLE, ParameterFileError):
        return False  # its reader raises the error


def read_strides(path: Path, *, subject: str | None = None, task: str | None = None) -> StrideSet:
    """Read the strides of one task, of one subject or of all.

    A stride without a number in a joint angle that others have is left out with a notice. ``task``: task or
    task_id; None if the file has one task only. Raises ParameterFileError if the file is not in the format of
    LocoHub, has no such subject or task, or no whole stride.
    """
    frame = _select(path, _read(path), subject, task)
    starts = _stride_starts(path, frame)
    samples = {
        name: frame[name].to_numpy(dtype=float).reshape(-1, POINTS)
        for name in sorted(_SAMPLED & set(frame.columns))
        if frame[name].notna().any()
    }
    angles = sorted(_ANGLES & samples.keys())
    for name in angles:
        largest = np.nanmax(np.abs(samples[name]))
        if largest > LARGEST_ANGLE:
            text = f"reaches {largest:.4g} rad; expected at most {LARGEST_ANGLE:.2f}: is it in degrees?"
            raise ParameterFileError(path, name, text)
    if not any(IPSI in name for name in angles):
        expected = ", ".join(angle_column(joint, IPSI) for joint in JointName)
        raise ParameterFileError(path, "", f"has numbers in none of {expected}")
    whole = np.all([np.isfinite(samples[name]).all(axis=1) for name in angles], axis=0)
    text = f"{(~whole).sum()} of {len(whole)} strides have no number in a sample of a joint angle"
    if not whole.any():
        raise ParameterFileError(path, ", ".join(angles), f"{text}; expected whole strides")
    first = frame.iloc[starts[whole]]
    return StrideSet(
        source=str(path),
        subjects=first[SUBJECT].astype(str).to_numpy(),
        sides=tuple(_SIDES.get(text.lower()) for text in _stated(first, TASK_INFO, "leg")),
        cycle_times=PERCENT[-1] / _numbers(first[PHASE_RATE] if PHASE_RATE in first else [None] * len(first)),
        masses=_numbers(_stated(first, METADATA, "weight_kg")),
        samples={name: rows[whole] for name, rows in samples.items()},
        notices=() if whole.all() else (f"{text}; they were left out",),
    )


def _read(path: Path) -> pd.DataFrame:
    """Read the columns that are used; raise ParameterFileError if a required one is missing."""
    try:
        require_parquet(path)
        names = pq.read_schema(path).names
        frame = read_parquet(path, {*_KEYS, PHASE_COLUMN, PHASE_RATE, METADATA, *_SAMPLED})
    except _UNREADABLE as error:
        text = f"cannot be read as Parquet with strides of LocoHub ({' '.join(str(error).split())[:100]})"
        raise ParameterFileError(path, "", text) from error
    for name in (SUBJECT, TASK, STEP, PHASE_COLUMN):
        if name not in frame:
            text = "is missing; expected a table of LocoHub that is indexed by phase (…_phase.parquet)"
            raise ParameterFileError(path, name, text)
    for name in names:
        in_radians = name.removesuffix("_deg") + "_rad"
        if in_radians in _ANGLES:
            raise ParameterFileError(path, name, f"is in degrees by its name; expected {in_radians}")
    return frame


def _select(path: Path, frame: pd.DataFrame, subject: str | None, task: str | None) -> pd.DataFrame:
    """Return the rows of a subject, None for all, and of a task."""
    if subject is not None:
        _require_known(path, SUBJECT, subject, frame[SUBJECT].unique())
        frame = frame[frame[SUBJECT].astype(str) == subject]
    columns = [name for name in (TASK, TASK_ID) if name in frame]
    if task is not None:
        _require_known(path, TASK, task, pd.unique(frame[columns].to_numpy().ravel()))
        frame = frame[(frame[columns].astype(str) == task).any(axis=1)]
    tasks = frame[TASK].astype(str).unique()
    if len(tasks) != 1:
        raise ParameterFileError(path, TASK, f"choose one task of {list_names(tasks)}")
    return frame


def _require_known(path: Path, key: str, name: str, known: Iterable[object]) -> None:
    if name not in map(str, known):
        raise ParameterFileError(path, key, f"expected one of {list_names(known)}, got {name!r}")


def list_names(names: Iterable[object]) -> str:
    """Return names for a message."""
    found = sorted(map(str, names))
    return ", ".join(found[:_LISTED]) + (f" and {len(found) - _LISTED} more" if len(found) > _LISTED else "")


def _stride_starts(path: Path, frame: pd.DataFrame) -> np.ndarray:
    """Return the first row of each stride; raise ParameterFileError unless each has 150 samples."""
    phase = frame[PHASE_COLUMN].to_numpy(dtype=float)
    begun = np.diff(phase, prepend=math.inf) < 0.0
    for name in (name for name in _KEYS if name in frame):
        begun |= np.diff(pd.factorize(frame[name])[0], prepend=-1) != 0
    starts = np.flatnonzero(begun)
    lengths = np.diff(np.append(starts, len(frame)))
    for start, length in zip(starts[lengths != POINTS], lengths[lengths != POINTS], strict=True):
        row = frame.iloc[start]
        stride = f"{row[SUBJECT]}, {row[TASK]}, step {row[STEP]}"
        text = f"expected {POINTS} samples in a stride, got {length} in {stride} (row {row.name + 1})"
        raise ParameterFileError(path, PHASE_COLUMN, text)
    return starts


def _stated(rows: pd.DataFrame, column: str, key: str) -> list[str]:
    """Return the value of a key in each cell ``key:value,key:value``; empty if it is not stated."""
    cells = rows[column].astype(str) if column in rows else [""] * len(rows)
    pairs = ((part.partition(":") for part in cell.split(",")) for cell in cells)
    return [next((value.strip() for name, _, value in cell if name.strip() == key), "") for cell in pairs]


def _numbers(cells: Iterable[object]) -> np.ndarray:
    """Return the numbers in cells, NaN where there is none."""
    return np.asarray(pd.to_numeric(pd.Series(list(cells)), errors="coerce").to_numpy(dtype=float))
