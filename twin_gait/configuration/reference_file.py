"""Section ``reference`` of an experiment file: measured gait from strides in the format of LocoHub.

A user names files. The mean stride is computed when the experiment is loaded, and replaces the names, so that
a run folder contains it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from twin_gait.configuration.validation import Number, Strict, convert_with_context, short, validate
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.reference_gait import ReferenceGait
from twin_gait.measures import locohub
from twin_gait.measures.locohub import StrideSet
from twin_gait.measures.strides import PERCENT, finite_mean
from twin_gait.vocabulary import JointName

DIGITS = 6  # decimals of the curves in [rad]; the last one is 0.00006°


class ReferenceFiles(Strict):
    """Strides from which a reference is computed, as a user writes them."""

    file: str | list[str]  # one Parquet file in the format of LocoHub, or several
    subject: str | None = None  # one person; all without it
    task: str | None = None  # task or task_id; it may be left out if the files have one task only


class ReferenceSection(Strict):
    """Mean stride of measured people, as a run folder contains it."""

    source: str
    strides: int
    subjects: int
    cycle_time_s: Number | None = None
    mean_rad: dict[JointName, list[Number]]
    sd_rad: dict[JointName, list[Number]] = Field(default_factory=dict)


def resolve_reference(value: Any, path: Path, source: str = "") -> dict[str, Any] | None:
    """Return the section of a run folder for one that a user wrote in the file ``path``.

    ``value``: a file, several files, a mapping of :class:`ReferenceFiles`, or a section that is already
    resolved. A relative name is searched next to ``path``, then in the working folder. ``source``: name of
    the file in messages. Raises ParameterFileError if a file cannot be read, or has no such person or task.
    """
    source = source or str(path)
    if value is None or (isinstance(value, dict) and "mean_rad" in value):
        return value
    if not isinstance(value, (str, list, dict)):
        text = f"expected a file, several files, or file with subject and task, got {short(value)}"
        raise ParameterFileError(source, "reference", text)
    given = value if isinstance(value, dict) else {"file": value}
    chosen: ReferenceFiles = validate(ReferenceFiles, given, source, "reference")
    names = [chosen.file] if isinstance(chosen.file, str) else chosen.file
    if not names:
        raise ParameterFileError(source, "reference.file", "expected one file or more, got none")
    neighbours = [path.parent / Path(name).expanduser() for name in names]
    found = [
        file if file.is_file() else Path(name).expanduser()
        for name, file in zip(names, neighbours, strict=True)
    ]
    for name, file in zip(names, found, strict=True):
        if not file.is_file():
            text = f"there is no file {name}; expected a Parquet file with strides in the format of LocoHub"
            raise ParameterFileError(source, "reference", text)
    sets = [locohub.read_strides(file, subject=chosen.subject, task=chosen.task) for file in found]
    parts = [", ".join(Path(name).name for name in names), chosen.task, chosen.subject]
    return reference_document(mean_gait(sets, ", ".join(part for part in parts if part)))


def mean_gait(sets: Sequence[StrideSet], source: str) -> ReferenceGait:
    """Compute the mean stride and its standard deviation over strides of all files.

    For several people, the mean and the deviation are those of their mean strides; for one person, those of
    the strides. Raises ParameterFileError if no joint is in all files.
    """
    subjects = np.concatenate([item.subjects for item in sets])
    people, mean, sd = sorted(set(subjects.tolist())), {}, {}
    for joint in JointName:
        name = locohub.angle_column(joint, locohub.IPSI)
        if not all(name in item.samples for item in sets):
            continue
        strides = np.concatenate([item.samples[name] for item in sets])
        if len(people) > 1:
            strides = np.array([strides[subjects == person].mean(axis=0) for person in people])
        mean[joint] = _curve(strides.mean(axis=0))
        if len(strides) > 1:
            sd[joint] = _curve(strides.std(axis=0, ddof=1))
    if not mean:
        raise ParameterFileError(sets[0].source, "", f"no joint angle is in all files of {source}")
    time = finite_mean(np.concatenate([item.cycle_times for item in sets]))
    cycle_time = None if math.isnan(time) else round(time, DIGITS)
    return ReferenceGait(
        source=source, strides=len(subjects), subjects=len(people), cycle_time=cycle_time, mean=mean, sd=sd
    )


def _curve(samples: np.ndarray) -> tuple[float, ...]:
    """Return 150 samples of a stride at every percent, rounded."""
    return tuple(np.interp(PERCENT, locohub.PHASE, samples).round(DIGITS).tolist())


def reference_document(reference: ReferenceGait) -> dict[str, Any]:
    """Convert a reference to the section of a run folder; reading it gives an equal reference."""
    curves = {"mean_rad": reference.mean, "sd_rad": reference.sd}
    return {
        "source": reference.source,
        "strides": reference.strides,
        "subjects": reference.subjects,
        "cycle_time_s": reference.cycle_time,
        **{key: {str(joint): list(curve) for joint, curve in item.items()} for key, item in curves.items()},
    }


def convert_reference(section: ReferenceSection, source: str) -> ReferenceGait:
    """Convert a validated section. Raises ParameterFileError if a curve has a wrong length."""
    values = section.model_dump()
    cycle_time, *curves = (values.pop(key) for key in ("cycle_time_s", "mean_rad", "sd_rad"))
    mean, sd = ({joint: tuple(curve) for joint, curve in item.items()} for item in curves)
    make = lambda: ReferenceGait(cycle_time=cycle_time, mean=mean, sd=sd, **values)  # noqa: E731
    return convert_with_context(source, "reference", make)
